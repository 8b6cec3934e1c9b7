"""Which lines of several pictures go on smoothly to their neighbours in a row, and how sure they are, compiled."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._footprint import COMFORTABLE_SPACING, SAMPLING, STEEPEST, VARIANCE, VARIANCE_DOUBT
from slkit.codecs._line_kernels import COL, CONTRAST, NOISE, SIGMA, VALUE
from slkit.codecs._noise_kernels import chance_of

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Longs = npt.NDArray[np.int64]
Wholes = npt.NDArray[np.int32]

ROW, PLACE, SPREAD, CHANCE = range(4)
"""What is written of a line that is kept: its row, its projector px and 1 sigma, the probability that it is right."""

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


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
    col: Doubles,
    told: Singles,
) -> int:
    """Write the lines of all pictures that fit their neighbours, row by row, and return how many.

    lines (s n, 5), ends (s, r + 1): of each picture, as `find_rows` writes them, n to a picture; slope (r, w):
    projector px a camera px; light (r + 2, w): logarithm of white less black, of the rows around, too; square (r, w):
    of the coarse position's margin in sigmas; period: px of value between lines of one picture. col (m,): camera px;
    told (m, 4): row from row0 on, value, sigma and probability.
    """
    height, width = slope.shape
    most = 0
    for row in range(height):
        most = max(most, np.sum(ends[:, row + 1] - ends[:, row]))
    order, buckets, fits = np.empty(most, np.int64), np.empty(width + 1, np.int64), np.empty(most + 1, np.bool_)
    place, value, spread, sure, rate = np.empty(most), np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    rise, around, aside = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    end = 0
    for row in range(height):
        count = _sort(lines, ends, row, len(lines) // len(ends), buckets, place, order)
        for i in range(count):
            line = order[i]
            value[i], spread[i] = lines[line, VALUE], lines[line, SIGMA]
            sure[i] = lines[line, CONTRAST] / lines[line, NOISE]
        _brighten(light[row], light[row + 1], light[row + 2], rise, around, aside)
        _recenter(slope[row], rise, around, period, flattest, count, place, spread, rate)
        _fit(place, value, rate, count, period / 2, fits)
        kept = _keep(fits, count, place, value, spread, sure, rate)
        if kept < count:
            _fit(place, value, rate, kept, period / 2, fits)
        for i in range(kept):
            pace = rate[i]
            if fits[i] & fits[i + 1]:
                pace = (value[i + 1] - value[i - 1]) / (place[i + 1] - place[i - 1])
            margin = min(np.sqrt(square[row, int(np.rint(place[i]))]), np.float32(sure[i]))
            col[end], told[end, ROW], told[end, PLACE] = place[i], row0 + row, value[i]
            told[end, SPREAD] = spread[i] * abs(pace)
            told[end, CHANCE] = chance_of(margin)
            end += 1
    return end


@_compiled
def _keep(fits: Mask, count: int, place: Doubles, value: Doubles, spread: Doubles, sure: Doubles, rate: Doubles) -> int:
    """Move what goes on smoothly to a neighbour in a row to the front, and return how much; see `agreeing`."""
    kept = 0
    for i in range(count):
        if fits[i] | fits[i + 1]:
            if kept < i:
                place[kept], value[kept], spread[kept] = place[i], value[i], spread[i]
                sure[kept], rate[kept] = sure[i], rate[i]
            kept += 1
    return kept


@_compiled
def _sort(lines: Doubles, ends: Wholes, row: int, apart: int, buckets: Longs, place: Doubles, order: Longs) -> int:
    """Write the columns of a row's lines in all pictures, in order, and which these are, and return how many.

    lines (s apart, n), ends: see `join_rows`. Lines are put into buckets of a px first, then in order within these.
    """
    buckets[:] = 0
    for s in range(len(ends)):
        for k in range(s * apart + ends[s, row], s * apart + ends[s, row + 1]):
            buckets[int(lines[k, COL]) + 1] += 1
    count = 0
    for at in range(len(buckets)):
        count += buckets[at]
        buckets[at] = count
    for s in range(len(ends)):
        for k in range(s * apart + ends[s, row], s * apart + ends[s, row + 1]):
            col = lines[k, COL]
            at = buckets[int(col)]
            buckets[int(col)] = at + 1
            place[at], order[at] = col, k
    for i in range(1, count):
        col, k, at = place[i], order[i], i
        while at > 0 and col < place[at - 1]:
            place[at], order[at] = place[at - 1], order[at - 1]
            at -= 1
        place[at], order[at] = col, k
    return count


@_compiled
def _brighten(above: Singles, here: Singles, below: Singles, rise: Singles, around: Singles, most: Singles) -> None:
    """Write how brightness rises along a row (w,), and the most that it does at a pixel and those around.

    above, here, below (w,): logarithm of white less black, of the row and those beside it; most (w,): memory. What is
    within two px of the picture's border is left open.
    """
    inner, half = len(here) - 2, np.float32(0.5)
    rise, up, down = rise[1:], above[2:], above[:-2]
    right, left, deeper, flatter = here[2:], here[:-2], below[2:], below[:-2]
    for i in range(inner):
        rise[i] = (right[i] - left[i]) * half
    for i in range(inner):
        most[i] = max(max(abs(up[i] - down[i]), abs(deeper[i] - flatter[i])) * half, abs(rise[i]))
    before, at, after, around = most[:-2], most[1:], most[2:], around[2:]
    for i in range(inner - 2):
        around[i] = max(max(before[i], at[i]), after[i])


@_compiled
def _recenter(
    slope: Singles,
    rise: Singles,
    around: Singles,
    period: float,
    flattest: float,
    count: int,
    place: Doubles,
    spread: Doubles,
    rate: Doubles,
) -> None:
    """Move lines of a row to where they would be on a scene of even brightness, widen their sigma, write the slope.

    slope (w,): of the row; rise, around (w,): as `_brighten`; place, spread: of lines, in px. See `View.centered`.
    """
    crowded = COMFORTABLE_SPACING / period
    for i in range(count):
        left = int(place[i])
        part = np.float32(place[i] - left)
        brighter = rise[left] + part * (rise[left + 1] - rise[left])
        doubt = VARIANCE_DOUBT * min(around[left] + part * (around[left + 1] - around[left]), STEEPEST)
        place[i] += VARIANCE * min(max(brighter, -STEEPEST), STEEPEST)
        rate[i] = slope[int(np.rint(place[i]))]
        crowding = max(crowded * max(abs(rate[i]), flattest), 1.0)
        sampling = SAMPLING * crowding * crowding * crowding
        spread[i] = np.sqrt(spread[i] * spread[i] + doubt * doubt + sampling * sampling)


@_compiled
def _fit(place: Doubles, value: Doubles, rate: Doubles, count: int, limit: float, fits: Mask) -> None:
    """Write whether lines i - 1 and i of a row belong to one smooth piece, for i from 0 to count; see `joined`."""
    fits[0] = fits[count] = False
    for i in range(1, count):
        rise = value[i] - value[i - 1]
        ratio = rise / (place[i] - place[i - 1]) / (rate[i - 1] + rate[i]) * 2
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
