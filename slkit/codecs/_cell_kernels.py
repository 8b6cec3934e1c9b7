"""Gray code bit by bit, a block of rows at a time, and from cells to the rows of a result."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

TILE = 16
"""Side in px of the tiles over which doubtful pixels are counted."""
PER_SIGMA = 256
"""Steps a sigma of the table that turns margins into probabilities."""


# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_compiled
def light_rows(high: Levels, low: Levels, saturated: Mask, noise: Singles, snr: float, lit: Mask) -> None:
    """Write where rows (r, w) of the white picture stand out of the black one by snr times the noise and are whole.

    noise (3,): variance in dark, its gain a level, the dark level.
    """
    least, gain, dark, square = noise[0], noise[1], noise[2], np.float32(snr * snr)
    for row in range(high.shape[0]):
        for col in range(high.shape[1]):
            a, b = np.float32(high[row, col]), np.float32(low[row, col])
            rise = max(a - b, np.float32(0))
            variance = 2 * least + gain * (max(a - dark, np.float32(0)) + max(b - dark, np.float32(0)))
            lit[row, col] = (rise * rise > square * variance) & ~saturated[row, col]


@_compiled
def least_squares(high: Levels, low: Levels, contrast: float, out: Singles) -> None:
    """Write the square of the least difference that decides a bit, (r, w): `contrast` times white - black."""
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            span = np.float32(high[row, col]) - np.float32(low[row, col])
            wanted = np.float32(contrast) * max(span, np.float32(1))
            out[row, col] = wanted * wanted


@_compiled
def add_pair(
    lit: Levels,
    inverse: Levels,
    least: Singles,
    noise: Singles,
    snr: float,
    bit: int,
    lo: Singles,
    hi: Singles,
    square: Singles,
) -> None:
    """Take one bit, shown by a pattern and its inverse, into the cells lo to hi that are possible, (r, w) each.

    Cells are whole numbers; as float32, of which a processor adds eight or more at a time.

    least (r, w): see `least_squares`; noise (3,): as `light_rows`; snr: what makes a bit known; square (r, w): of the
    smallest known difference in sigmas.
    """
    # Two loops over few arrays each: with more of them the compiler gives up on parallel lanes.
    dark, gain, base, wanted = np.float32(2 * noise[0]), noise[1], noise[2], np.float32(snr * snr)
    said = np.empty(lo.shape[1], dtype=np.float32)
    for row in range(lo.shape[0]):
        one, other, floor = lit[row], inverse[row], least[row]
        for col in range(len(said)):
            a, b = np.float32(one[col]), np.float32(other[col])
            light = max(a - base, np.float32(0)) + max(b - base, np.float32(0))
            said[col] = _decided(a - b, dark + gain * light, wanted, floor[col])
        _take(said, np.float32((1 << (bit + 1)) - 1), lo[row], hi[row], square[row])


@_compiled
def add_single(
    lit: Levels,
    high: Levels,
    low: Levels,
    least: Singles,
    noise: Singles,
    snr: float,
    bit: int,
    lo: Singles,
    hi: Singles,
    square: Singles,
) -> None:
    """Take one bit without an inverse, for which white + black - pattern stands in; see `add_pair`."""
    dark, gain, base, wanted = np.float32(6 * noise[0]), noise[1], noise[2], np.float32(snr * snr)
    said = np.empty(lo.shape[1], dtype=np.float32)
    for row in range(lo.shape[0]):
        one, white, black, floor = lit[row], high[row], low[row], least[row]
        for col in range(len(said)):
            a, b, c = np.float32(one[col]), np.float32(white[col]), np.float32(black[col])
            light = np.float32(4) * max(a - base, np.float32(0))
            light += max(b - base, np.float32(0)) + max(c - base, np.float32(0))
            said[col] = _decided(np.float32(2) * a - (b + c), dark + gain * light, wanted, floor[col])
        _take(said, np.float32((1 << (bit + 1)) - 1), lo[row], hi[row], square[row])


@_inlined
def _decided(difference: np.float32, variance: np.float32, wanted: np.float32, least: np.float32) -> np.float32:
    """Return the square of the difference in sigmas, with its sign; 0 where it decides nothing."""
    size = difference * difference
    ratio = size / variance
    told = ratio if difference > 0 else -ratio
    return told if (ratio > wanted) & (size > least) else np.float32(0)


@_compiled
def _take(said: Singles, top: np.float32, lo: Singles, hi: Singles, square: Singles) -> None:
    """Let what a bit said (w,) change the cells of a row, of a block twice as large: top is its last cell."""
    for col in range(len(said)):
        first, last, told = lo[col], hi[col], said[col]
        lo[col] = top - last if told > 0 else first
        # An unknown bit leaves the hull of both halves.
        hi[col] = top - first if told >= 0 else last
    for col in range(len(said)):
        size = abs(said[col])
        square[col] = size if (size > 0) & (size < square[col]) else square[col]


@_compiled
def count_doubts(lo: Wholes, hi: Wholes, most: int, mask: Mask, counts: Wholes) -> None:
    """Take the pixels that cannot be placed out of mask (r, w), and count the others.

    A pixel is placed where 1 to `most` cells, lo to hi (r, w), are possible. counts (t, s, 3): in each tile the placed
    pixels, those between two cells at a border of the lowest bit, and at any other.
    """
    width = lo.shape[1]
    kind = np.empty(width, dtype=np.uint8)
    for row in range(lo.shape[0]):
        begin, end, kept = lo[row], hi[row], mask[row]
        for col in range(width):
            cells = end[col] - begin[col] + np.int32(1)
            placed = (cells >= 1) & (cells <= most)
            kind[col] = (
                (np.uint8(2) + np.uint8(begin[col] & 1) if cells == 2 else np.uint8(1)) if placed else np.uint8(0)
            )
        for col in range(width):
            kept[col] = kept[col] & (kind[col] > 0)
        for tile in range(counts.shape[1]):
            placed, lowest, other = 0, 0, 0
            for col in range(tile * TILE, min((tile + 1) * TILE, width)):
                placed += kind[col] > 0
                lowest += kind[col] == 2
                other += kind[col] == 3
            here = counts[row // TILE, tile]
            here[0] += placed
            here[1] += lowest
            here[2] += other


@_compiled
def place_rows(lo: Wholes, hi: Wholes, mask: Mask, most: int, step: float, value: Singles, known: Mask) -> None:
    """Write the middle in px of the possible cells lo to hi (r, w), and whether it is known; see `place`.

    most: of cells in a known position; step: px a cell.
    """
    half, middle = np.float32(step / 2), np.float32((step - 1) / 2)
    for row in range(lo.shape[0]):
        begin, end, lit, to, sure = lo[row], hi[row], mask[row], value[row], known[row]
        for col in range(len(to)):
            to[col] = np.float32(begin[col] + end[col]) * half + middle
        for col in range(len(to)):
            count = end[col] - begin[col] + np.int32(1)
            sure[col] = lit[col] & (count >= 1) & (count <= most)


@_compiled
def write_pixels(
    row0: int,
    mask: Mask,
    margin: Singles,
    chance: Singles,
    light: Levels,
    brightest: float,
    starts: Longs,
    camera_xy: Singles,
    confidence: Singles,
    grey: Singles,
) -> None:
    """Write the kept pixels of rows row0 on (r, w) to the rows of a result from starts (r,) on.

    margin (r, w): squares of sigmas; chance (n,): the probability at k / 256 sigmas; light (r, w): the white picture,
    and its brightest level.
    """
    last = len(chance) - 2
    for row in range(mask.shape[0]):
        at = starts[row]
        for col in range(mask.shape[1]):
            if not mask[row, col]:
                continue
            camera_xy[at, 0], camera_xy[at, 1] = col, row0 + row
            place = np.sqrt(margin[row, col]) * np.float32(PER_SIGMA)
            step = int(place) if place < last else last
            part = min(place - np.float32(step), np.float32(1))
            confidence[at] = chance[step] + part * (chance[step + 1] - chance[step])
            grey[at] = np.float32(light[row, col]) / np.float32(brightest)
            at += 1


@_compiled
def write_places(
    row0: int,
    mask: Mask,
    lo: Wholes,
    hi: Wholes,
    shares: Singles,
    scale: Singles,
    axis: int,
    alone: bool,
    starts: Longs,
    projector_xy: Singles,
    sigma: Singles,
) -> None:
    """Write value and sigma in px of one axis for the kept pixels of rows row0 on; see `write_pixels`.

    shares (t, s, 2): of pixels near by that are between two cells, at borders of the lowest bit and at others; scale
    (4,): px a cell, px of the middle of cell 0, narrowest width of a place in cells, and px of sigma a cell of width;
    alone: no other axis is coded.
    """
    for row in range(mask.shape[0]):
        at = starts[row]
        for col in range(mask.shape[1]):
            if not mask[row, col]:
                continue
            first, cells = lo[row, col], hi[row, col] - lo[row, col] + 1
            tile, place = (row0 + row) // TILE, col // TILE
            width = np.float32(cells)
            if cells == 1:
                width = max(1 - shares[tile, place, 0] - shares[tile, place, 1], scale[2])
            elif cells == 2:
                width = max(2 * shares[tile, place, first & 1], scale[2])
            projector_xy[at, axis] = (first + hi[row, col]) * np.float32(0.5) * scale[0] + scale[1]
            sigma[at, axis] = width * scale[3]
            if alone:
                projector_xy[at, 1 - axis], sigma[at, 1 - axis] = np.nan, np.nan
            at += 1
