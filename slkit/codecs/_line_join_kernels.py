"""Which lines of several pictures go on smoothly to their neighbours in a row, and how sure they are, compiled."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._footprint import COMFORTABLE_SPACING, SAMPLING, STEEPEST, VARIANCE, VARIANCE_DOUBT
from slkit.codecs._line_kernels import COL, CONTRAST, NOISE, SIGMA, VALUE

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]

ROW, PLACE, SPREAD, CHANCE = range(4)
"""What is written of a line that is kept: its row, its projector px and 1 sigma, the probability that it is right."""

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_compiled
def join_rows(
    row0: int,
    lines: Doubles,
    ends: Wholes,
    slope: Singles,
    light: Singles,
    square: Singles,
    period: float,
    flattest: float,
    chance: Singles,
    per_sigma: int,
    col: Doubles,
    told: Singles,
) -> int:
    """Write the lines of all pictures that fit their neighbours, row by row, and return how many.

    lines (s, n, 5), ends (s, r + 1): of each picture, as `find_rows` writes them; slope (r, w): projector px a camera
    px; light (r + 2, w): logarithm of white less black, of the rows around, too; square (r, w): of the coarse
    position's margin in sigmas; chance: the probability at k / per_sigma sigmas; period: px of value between lines of
    one picture. col (m,): camera px; told (m, 4): row from row0 on, value, sigma and probability.
    """
    most = 0
    for row in range(len(slope)):
        most = max(most, np.sum(ends[:, row + 1] - ends[:, row]))
    here, rate = np.empty((most, 5)), np.empty(most)
    fits = np.empty(most + 1, np.bool_)
    end = 0
    for row in range(len(slope)):
        count = _merge(lines, ends, row, here)
        for i in range(count):
            at = int(np.rint(here[i, COL]))
            _recenter(here[i], light[row : row + 3], period / max(abs(slope[row, at]), flattest))
            rate[i] = slope[row, int(np.rint(here[i, COL]))]
        count = _agreeing(here, rate, count, period / 2, fits)
        _fit(here, rate, count, period / 2, fits)
        for i in range(count):
            at = int(np.rint(here[i, COL]))
            pace = rate[i]
            if fits[i] & fits[i + 1]:
                pace = (here[i + 1, VALUE] - here[i - 1, VALUE]) / (here[i + 1, COL] - here[i - 1, COL])
            col[end], told[end, ROW], told[end, PLACE] = here[i, COL], row0 + row, here[i, VALUE]
            told[end, SPREAD] = here[i, SIGMA] * abs(pace)
            margin = min(np.sqrt(square[row, at]), np.float32(here[i, CONTRAST] / here[i, NOISE]))
            told[end, CHANCE] = _look_up(chance, margin * np.float32(per_sigma))
            end += 1
    return end


@_inlined
def _look_up(table: Singles, place: float) -> float:
    last = len(table) - 2
    step = int(place) if place < last else last
    part = min(place - np.float32(step), np.float32(1))
    return table[step] + part * (table[step + 1] - table[step])


@_compiled
def _merge(lines: Doubles, ends: Wholes, row: int, here: Doubles) -> int:
    """Write the lines of a row in all pictures, by column, and return how many."""
    following = ends[:, row].copy()
    count = 0
    while True:
        first, least = -1, np.inf
        for s in range(len(lines)):
            if following[s] < ends[s, row + 1] and lines[s, following[s], COL] < least:
                first, least = s, lines[s, following[s], COL]
        if first < 0:
            return count
        for k in range(5):
            here[count, k] = lines[first, following[first], k]
        following[first] += 1
        count += 1


@_compiled
def _recenter(line: Doubles, light: Singles, spacing: float) -> None:
    """Move a line to where it would be on a scene of even brightness, and widen its sigma; see `View.centered`."""
    left = int(line[COL])
    part = line[COL] - left
    before, after = light[1, left + 1] - light[1, left - 1], light[1, left + 2] - light[1, left]
    brighter = (before + part * (after - before)) / 2
    outer, inner, further = np.float32(0), np.float32(0), np.float32(0)
    for k in range(3):
        near = light[k]
        outer = max(outer, abs(near[left] - near[left - 2]))
        inner = max(inner, max(abs(near[left + 1] - near[left - 1]), abs(near[left + 2] - near[left])))
        further = max(further, abs(near[left + 3] - near[left + 1]))
    before, after = max(outer, inner), max(inner, further)
    doubt = VARIANCE_DOUBT * min((before + part * (after - before)) / 2, STEEPEST)
    sampling = SAMPLING * max(COMFORTABLE_SPACING / spacing, 1.0) ** 3
    line[COL] += VARIANCE * min(max(brighter, -STEEPEST), STEEPEST)
    line[SIGMA] = np.sqrt(line[SIGMA] ** 2 + doubt**2 + sampling**2)


@_compiled
def _agreeing(here: Doubles, rate: Doubles, count: int, limit: float, fits: npt.NDArray[np.bool_]) -> int:
    """Move the lines of a row that go on smoothly to a neighbour to its begin, and return how many; see `agreeing`."""
    _fit(here, rate, count, limit, fits)
    kept = 0
    for i in range(count):
        if fits[i] | fits[i + 1]:
            here[kept], rate[kept] = here[i], rate[i]
            kept += 1
    return kept


@_compiled
def _fit(here: Doubles, rate: Doubles, count: int, limit: float, fits: npt.NDArray[np.bool_]) -> None:
    """Write whether lines i - 1 and i of a row belong to one smooth piece of it, for i from 0 to count; see `joined`."""
    fits[0] = fits[count] = False
    for i in range(1, count):
        rise = here[i, VALUE] - here[i - 1, VALUE]
        ratio = rise / (here[i, COL] - here[i - 1, COL]) / (rate[i - 1] + rate[i]) * 2
        fits[i] = (abs(rise) <= limit) & (ratio > 0.5) & (ratio < 2)


@_compiled
def write_lines(
    col: Doubles,
    told: Singles,
    turned: bool,
    axis: int,
    white: Levels,
    brightest: float,
    camera_xy: Singles,
    projector_xy: Singles,
    sigma: Singles,
    confidence: Singles,
    grey: Singles,
) -> None:
    """Write lines (m,) as the rows of a result; what the other axis is, stays open: NaN.

    col, told: as `join_rows` writes them; turned: rows and columns are exchanged; white (h, w): where grey, 0 to 1 of
    the brightest, comes from, turned as the lines are.
    """
    along, across, scale = (1, 0, np.float32(brightest)) if turned else (0, 1, np.float32(brightest))
    for i in range(len(col)):
        camera_xy[i, along], camera_xy[i, across] = col[i], told[i, ROW]
        projector_xy[i, axis], projector_xy[i, 1 - axis] = told[i, PLACE], np.nan
        sigma[i, axis], sigma[i, 1 - axis] = told[i, SPREAD], np.nan
        confidence[i] = told[i, CHANCE]
        at = min(max(int(np.rint(camera_xy[i, along])), 0), white.shape[1] - 1)
        grey[i] = np.float32(white[int(told[i, ROW]), at]) / scale
