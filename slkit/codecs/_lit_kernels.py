"""Where sets of shifted sinusoids are lit and not saturated, and their means in tiles: compiled loops over rows."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._wave_kernels import CHUNK, SINE, TOTAL, add_four

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def lit_rows(
    one: Levels,
    two: Levels,
    three: Levels,
    four: Levels,
    weights: Singles,
    most: Levels,
    first: bool,
    last: bool,
    sums: Singles,
    steps: int,
    noise: Singles,
    snr: float,
    lit: Mask,
    saturated: Mask,
    mean: Levels,
) -> None:
    """Take four frames of a set (r, w) into its sums, and mark where one is saturated.

    With the last, take out of lit (r, w) where the modulation is not above snr times the noise of one frame, and write
    the frames' mean, rounded, to mean: (r, w), or (0, w) where it is not wanted. most (4,): the highest level of each
    frame that is not saturated; noise (3,): variance in dark, its gain a level, the dark level; steps: of the whole
    set; else as `wave_rows`.
    """
    for row in range(lit.shape[0]):
        for start in range(0, lit.shape[1], CHUNK):
            to = sums[row % sums.shape[0], start // CHUNK % sums.shape[1]]
            p, q = one[row, start : start + CHUNK], two[row, start : start + CHUNK]
            r, s = three[row, start : start + CHUNK], four[row, start : start + CHUNK]
            add_four(p, q, r, s, weights, first, to)
            _mark_saturated(p, q, r, s, most, saturated[row, start : start + CHUNK])
            if last:
                _keep_lit(to, steps, noise, snr, lit[row, start : start + CHUNK])
                if len(mean):
                    _write_mean(to, steps, mean[row, start : start + CHUNK])


@_compiled
def _mark_saturated(one: Levels, two: Levels, three: Levels, four: Levels, most: Levels, saturated: Mask) -> None:
    m0, m1, m2, m3 = most[0], most[1], most[2], most[3]
    for k in range(len(saturated)):
        saturated[k] |= (one[k] > m0) | (two[k] > m1) | (three[k] > m2) | (four[k] > m3)


@_compiled
def _keep_lit(sums: Singles, steps: int, noise: Singles, snr: float, lit: Mask) -> None:
    square, mean = np.float32((steps * snr / 2) ** 2), np.float32(1 / steps)
    least, gain, dark, zero = noise[0], noise[1], noise[2], np.float32(0)
    for k in range(len(lit)):
        x, y = sums[k], sums[SINE + k]
        variance = least + gain * max(sums[TOTAL + k] * mean - dark, zero)
        lit[k] &= x * x + y * y > square * variance


@_compiled
def _write_mean(sums: Singles, steps: int, mean: Levels) -> None:
    count = np.float32(steps)
    for k in range(len(mean)):
        mean[k] = np.rint(sums[TOTAL + k] / count)


@_compiled
def add_tiles(frame: Levels, most: int, rows: Longs, cols: Longs, total: Singles, usable: Mask) -> None:
    """Add tiles of a frame (h, w) to total (r, c), and take what is above the level `most` out of usable (r, c).

    rows, cols (r,): where in the frame each row of a tile begins.
    """
    for row in range(len(rows)):
        here, to, good = frame[rows[row], cols[row] :], total[row], usable[row]
        for k in range(len(to)):
            to[k] += np.float32(here[k])
        for k in range(len(good)):
            good[k] &= here[k] <= most
