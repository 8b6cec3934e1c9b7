"""What the noise of pictures is measured from, in compiled loops."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_compiled
def cut_tiles(picture: Levels, saturated: Mask, rows: Longs, cols: Longs, level: Singles, usable: Mask) -> None:
    """Write tiles of a picture (h, w) to level (r, c), and take what is saturated (h, w) out of usable (r, c).

    rows, cols (r,): where in the picture each row of a tile begins.
    """
    for row in range(len(rows)):
        here, burnt = picture[rows[row], cols[row] :], saturated[rows[row], cols[row] :]
        to, good = level[row], usable[row]
        for k in range(len(to)):
            to[k] = np.float32(here[k])
        for k in range(len(good)):
            good[k] &= not burnt[k]


@_compiled
def rough_rows(
    picture: Singles, level: Singles, usable: Mask, scale: np.float32, sizes: Singles, near: Singles, ends: Singles
) -> None:
    """Write the second differences of a picture (r, w) along both axes and the mean level around, (r - 2, w - 2) each.

    usable (r, w): where a difference counts, NaN elsewhere; scale: what differences are multiplied by; ends (r - 2, 2):
    the least and the highest level that counts in a row.
    """
    width = sizes.shape[1]
    rise, total = np.empty(width + 2, np.float32), np.empty(width + 2, np.float32)
    two, ninth, nothing = np.float32(2), np.float32(9), np.float32(np.nan)
    for row in range(len(sizes)):
        above, middle, below = picture[row], picture[row + 1], picture[row + 2]
        for col in range(width + 2):
            rise[col] = above[col] - two * middle[col] + below[col]
        above, middle, below = level[row], level[row + 1], level[row + 2]
        for col in range(width + 2):
            total[col] = above[col] + middle[col] + below[col]
        size, mean, good = sizes[row], near[row], usable[row + 1]
        for col in range(width):
            both = abs(rise[col] - two * rise[col + 1] + rise[col + 2]) * scale
            size[col] = both if good[col + 1] else nothing
        for col in range(width):
            mean[col] = (total[col] + total[col + 1] + total[col + 2]) / ninth
        least, most = np.float32(np.inf), np.float32(-np.inf)
        for col in range(width):
            if good[col + 1]:
                least, most = min(least, mean[col]), max(most, mean[col])
        ends[row, 0], ends[row, 1] = least, most


@_compiled
def sort_by_level(
    sizes: Singles, near: Singles, low: np.float32, steps: np.float32, ends: Longs, totals: Doubles, found: Singles
) -> None:
    """Write the sizes (n,) that are none NaN to found (n,), those of low levels first; near (n,): their levels.

    steps: steps of the level in one grey level; ends (s + 1,): those of step i are found from ends[i] to ends[i + 1];
    totals (s,): sum of their levels.
    """
    last = len(totals) - 1
    totals[:], ends[:] = 0, 0
    for i in range(len(sizes)):
        if not np.isnan(sizes[i]):
            step = min(int((near[i] - low) * steps), last)
            ends[step + 1] += 1
            totals[step] += near[i]
    for step in range(last + 1):
        ends[step + 1] += ends[step]
    at = ends[:-1].copy()
    for i in range(len(sizes)):
        if not np.isnan(sizes[i]):
            step = min(int((near[i] - low) * steps), last)
            found[at[step]] = sizes[i]
            at[step] += 1


@_inlined
def chance_of(margin: np.float32) -> np.float32:
    """Return the standard normal distribution at a margin from 0 sigmas on, within 2e-6.

    A table would keep loops out of parallel lanes. Source: Abramowitz and Stegun, formula 26.2.19.
    """
    series = np.float32(0.0000488906) + margin * np.float32(0.0000053830)
    series = np.float32(0.0032776263) + margin * (np.float32(0.0000380036) + margin * series)
    series = np.float32(0.0498673470) + margin * (np.float32(0.0211410061) + margin * series)
    power = np.float32(1) + margin * series
    power *= power
    power *= power
    power *= power
    return np.float32(1) - np.float32(0.5) / (power * power)


@_compiled
def write_chances(square: Singles, chances: Singles) -> None:
    """Write the probability (n,) that noise does not turn over a difference; square (n,): of it in sigmas."""
    for i in range(len(square)):
        chances[i] = chance_of(np.sqrt(square[i]))
