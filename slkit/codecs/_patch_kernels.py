"""The doubt that a pixel's patch adds to a decoded axis, written to the rows of a result: compiled loops."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._run_kernels import next_run, write_axis

Singles = npt.NDArray[np.float32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def shift_row(position: Singles, light: Singles, row: int, jump: float, out: Singles) -> None:
    """Write |`displacement`| of one row (w,) of a picture.

    position (h, w): projector px, NaN where unknown; light (h, w): the logarithm of the brightness; jump: px of value
    from one pixel to the next that is an edge.
    """
    height, width = position.shape
    out[:] = 0
    if row < 2 or row >= height - 2 or width < 5:
        return
    up, here, down = position[row - 2], position[row], position[row + 2]
    above, level, below = light[row - 2], light[row], light[row + 2]
    most, share, eighth = np.float32(2 * jump), np.float32(1 / 16), np.float32(1 / 8)
    two, zero = np.float32(2), np.float32(0)
    left, value, right, dark, bright = here[:-4], here[2:-2], here[4:], level[:-4], level[4:]
    top, bottom, darker, brighter, inner = up[2:-2], down[2:-2], above[2:-2], below[2:-2], out[2:-2]
    for k in range(len(inner)):
        x, a, b, c, d = value[k], left[k], right[k], top[k], bottom[k]
        total = share * ((bright[k] - dark[k]) * (b - a) + (brighter[k] - darker[k]) * (d - c))
        total += eighth * ((b - two * x + a) + (d - two * x + c))
        # Not a number beside unknown pixels, hence not below.
        usable = (abs(d - x) < most) & (abs(x - c) < most) & (abs(b - x) < most) & (abs(x - a) < most)
        inner[k] = abs(total) if usable else zero


@_compiled
def write_doubted(
    first: int,
    last: int,
    mask: Mask,
    position: Singles,
    sigma: Singles,
    light: Singles,
    jump: float,
    variance: float,
    axis: int,
    alone: bool,
    starts: Longs,
    projector_xy: Singles,
    spread: Singles,
) -> None:
    """Write one axis of the kept pixels of rows first to last of a picture to the rows of a result.

    sigma (h, w) is enlarged by `variance` times the largest |`displacement`| of a pixel and its eight neighbours. mask
    (h, w): what to keep; starts (last - first,): where each of these rows begins in the result; alone: no other axis is
    coded; else as `shift_row`.
    """
    height, width = mask.shape
    shifts, nothing = np.zeros((3, width), dtype=np.float32), np.full(width, np.nan, dtype=np.float32)
    most, doubt = np.zeros(width + 2, dtype=np.float32), np.empty(width, dtype=np.float32)
    for row in range(max(first - 1, 0), min(first + 1, height)):
        shift_row(position, light, row, jump, shifts[row % 3])
    for row in range(first, last):
        shifts[(row + 1) % 3] = 0
        if row + 1 < height:
            shift_row(position, light, row + 1, jump, shifts[(row + 1) % 3])
        _doubts(shifts, sigma[row], variance, most, doubt)
        to = starts[row - first]
        begin, end = next_run(mask[row], 0)
        while begin < end:
            part, out = slice(begin, end), slice(to, to + end - begin)
            write_axis(position[row, part], doubt[part], nothing[part], axis, alone, projector_xy[out], spread[out])
            to += end - begin
            begin, end = next_run(mask[row], end)


@_compiled
def _doubts(shifts: Singles, sigma: Singles, variance: float, most: Singles, doubt: Singles) -> None:
    """Write sigma of a row (w,) with `variance` times the largest shift in its three rows (3, w); most (w + 2,)."""
    a, b, c, scale = shifts[0], shifts[1], shifts[2], np.float32(variance)
    for col in range(len(a)):
        most[col + 1] = max(a[col], b[col], c[col])
    for col in range(len(doubt)):
        shift = scale * max(most[col], most[col + 1], most[col + 2])
        doubt[col] = np.sqrt(sigma[col] * sigma[col] + shift * shift)


@_compiled
def pick_pixels(first: int, mask: Mask, starts: Longs, step: int, at: Longs) -> None:
    """Write the flat place in a picture of every step-th pixel of a mask, rows first on (r, w): at (m,).

    starts (r,): how many pixels of the mask lie above each row.
    """
    width, run = mask.shape[1], 64
    for row in range(mask.shape[0]):
        count, here = starts[row], mask[row]
        due = (count + step - 1) // step
        for left in range(0, width, run):
            some, before = here[left : left + run], count
            for k in range(len(some)):
                count += some[k]
            if count <= due * step:
                continue
            for k in range(len(some)):
                if some[k]:
                    if before == due * step:
                        at[due] = (first + row) * width + left + k
                        due += 1
                    before += 1
