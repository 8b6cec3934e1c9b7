"""How a coarse projector position changes along the rows of a picture, and how light does, in compiled loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from slkit.codecs._line_scales import Scales

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

NO_KERNEL = 255
"""Stands for a pixel where no line is looked for."""

_ROWS = 2
_GAP = 64

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
# A sum in any order, for parallel lanes.
_summing = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "nsz"})


@_summing
def change_rows(value: Singles, known: Mask, jump: float, first: int, last: int, sums: Doubles) -> None:
    """Add up how much a map (h, w) changes from column to column and from row to row, of rows first up to last.

    known (h, w): where value is; a change of a jump or more is left out. sums (4,): total and count along the columns,
    then along the rows.
    """
    size, counts = np.empty(value.shape[1], np.float32), np.empty(value.shape[1], np.float32)
    for row in range(first, last):
        here, sure, steps = value[row], known[row], value.shape[1] - 1
        _sizes(here[:steps], here[1:], sure[:steps], sure[1:], jump, size, counts)
        sums[0] += np.sum(size[:steps])
        sums[1] += np.sum(counts[:steps])
        if row + 1 < len(value):
            _sizes(here, value[row + 1], sure, known[row + 1], jump, size, counts)
            sums[2] += np.sum(size)
            sums[3] += np.sum(counts)


@_compiled
def _sizes(
    one: Singles, other: Singles, known: Mask, other_known: Mask, jump: float, size: Singles, counts: Singles
) -> None:
    """Write how far apart values (w,) are, and 1, where both are known and less than a jump apart, else 0."""
    limit, none, unit = np.float32(jump), np.float32(0), np.float32(1)
    for col in range(len(one)):
        change = abs(other[col] - one[col])
        good = known[col] & other_known[col] & (change < limit)
        size[col] = change if good else none
        counts[col] = unit if good else none


@_compiled
def slope_rows(value: Singles, known: Mask, jump: float, radius: int, first: int, slope: Singles) -> None:
    """Write how fast a map (h, w) changes from column to column, of rows first on (r, w); see `slope_along_rows`."""
    steps = value.shape[1] - 1
    total, count = np.empty(steps + 2 * radius + 1, np.float32), np.empty(steps + 2 * radius + 1, np.float32)
    for row in range(len(slope)):
        total[:], count[:] = 0, 0
        for other in range(max(first + row - _ROWS, 0), min(first + row + _ROWS + 1, len(value))):
            _add_steps(value[other], known[other], jump, total[radius + 1 :], count[radius + 1 :])
        _window(total, count, radius, slope[row])


@_compiled
def _add_steps(value: Singles, known: Mask, jump: float, total: Singles, count: Singles) -> None:
    """Add the changes of a row (w,) from column to column where both are known and less than a jump apart."""
    limit, none, one = np.float32(jump), np.float32(0), np.float32(1)
    for col in range(len(value) - 1):
        step = value[col + 1] - value[col]
        good = known[col] & known[col + 1] & (abs(step) < limit)
        total[col] += step if good else none
        count[col] += one if good else none


@_compiled
def _window(total: Singles, count: Singles, radius: int, slope: Singles) -> None:
    """Write the mean step (w,) within `radius` columns; total, count: with radius + 1 zeros before, radius after."""
    sums, counts, least = 0.0, np.float32(0), np.float32(radius)
    last = len(slope) - 1
    slope[last] = np.nan
    for k in range(radius + 1, 2 * radius + 1):
        sums += total[k]
        counts += count[k]
    for col in range(last):
        sums += np.float64(total[col + 2 * radius + 1]) - np.float64(total[col])
        counts += count[col + 2 * radius + 1] - count[col]
        # Below two thirds of a row's worth of neighbours the mean says nothing.
        slope[col] = np.float32(sums) / counts if counts > least else np.nan
    if last > 0:
        slope[last] = slope[last - 1]


@_compiled
def run_rows(slope: Singles, scales: Scales, kernels: Bytes, runs: Wholes, starts: Wholes) -> None:
    """Write which kernel serves each pixel (r, w), NO_KERNEL where none does, and the runs (n, 3) in which they do so.

    A run: first and past-the-last column and kernel; other kernels' pixels may lie between. starts (r + 1,): the runs
    of row i are those from starts[i] to starts[i + 1].
    """
    end, open_run = 0, np.empty(len(scales.least), np.int32)
    for row in range(len(slope)):
        starts[row] = end
        _choose(slope[row], scales, kernels[row])
        here, col = kernels[row], 0
        open_run[:] = -1
        while col < len(here):
            kernel, first = here[col], col
            while col < len(here) and here[col] == kernel:
                col += 1
            if kernel == NO_KERNEL:
                continue
            at = open_run[kernel]
            # Where slopes waver between two kernels, a few long runs take far less time than many short ones.
            if at >= 0 and first - runs[at, 1] <= _GAP:
                runs[at, 1] = col
                continue
            runs[end, 0], runs[end, 1], runs[end, 2], open_run[kernel] = first, col, kernel, end
            end += 1
    starts[len(slope)] = end


@_compiled
def _choose(slope: Singles, scales: Scales, kernels: Bytes) -> None:
    """Write which kernel serves each pixel of a row (w,); see `run_rows`."""
    flattest, steepest = np.float32(np.inf), np.float32(scales.steepest)
    for col in range(len(slope)):
        # Unknown slopes are not a number, hence not below.
        flattest = abs(slope[col]) if abs(slope[col]) < flattest else flattest
    kernels[:] = 0
    for least in scales.least:
        if least <= flattest:
            break
        for col in range(len(slope)):
            kernels[col] += np.uint8(1) if abs(slope[col]) < least else np.uint8(0)
    for col in range(len(slope)):
        kernels[col] = kernels[col] if abs(slope[col]) <= steepest else np.uint8(NO_KERNEL)


@_compiled
def to_share(
    picture: Levels, high: Levels, low: Levels, mask: Mask, noise: Singles, share: Singles, variance: Singles
) -> None:
    """Write a row (w,) as a share of white less black, 0 outside of mask, and the variance of that share.

    high, low (w,): white and black; noise (3,): variance in dark, its gain a level, the dark level.
    """
    least, gain, dark, nothing = noise[0], noise[1], noise[2], np.float32(0)
    for col in range(len(picture)):
        a, b, c = np.float32(picture[col]), np.float32(high[col]), np.float32(low[col])
        span = max(b - c, np.float32(1))
        part = (a - c) / span if mask[col] else nothing
        own = least + gain * max(a - dark, nothing)
        of_white, of_black = least + gain * max(b - dark, nothing), least + gain * max(c - dark, nothing)
        rest = np.float32(1) - part
        share[col] = part
        variance[col] = (own + rest * rest * of_black + part * part * of_white) / (span * span)


@_compiled
def log_rows(high: Levels, low: Levels, first: int, logs: Singles) -> None:
    """Write the logarithm of white less black (h, w), never below one level, of rows first on (r, w).

    Rows beyond the picture are those at its border. NumPy's logarithm does not run in parallel lanes; this one does, as
    2 artanh(s) of the mantissa, within 1e-7.
    """
    bits = logs.view(np.int32)
    one, two, base = np.float32(1), np.float32(2), np.float32(np.log(2))
    c3, c5, c7, c9 = np.float32(1 / 3), np.float32(1 / 5), np.float32(1 / 7), np.float32(1 / 9)
    for row in range(len(logs)):
        at = min(max(first + row, 0), len(high) - 1)
        white, black, to, raw = high[at], low[at], logs[row], bits[row]
        for col in range(len(to)):
            to[col] = max(np.float32(white[col]) - np.float32(black[col]), one)
        for col in range(len(to)):
            # The bits of sqrt(1/2), and so many behind the exponent.
            exponent = (raw[col] - np.int32(0x3F3504F3)) >> np.int32(23)
            raw[col] -= exponent << np.int32(23)
            s = (to[col] - one) / (to[col] + one)
            q = s * s
            series = one + q * (c3 + q * (c5 + q * (c7 + q * c9)))
            to[col] = two * s * series + np.float32(exponent) * base
