"""Lines in pictures: where they lie between the pixels and which of the projector's they are, in compiled loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._center_kernels import AT, LANES, center_lanes, fill_lanes
from slkit.codecs._center_kernels import SIGMA as SPREAD
from slkit.codecs._slope_kernels import to_share

if TYPE_CHECKING:
    from slkit.codecs._line_scales import LineRule, Room, Scales

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]
Places = npt.NDArray[np.intp]
Longs = npt.NDArray[np.uint64]
Mask = npt.NDArray[np.bool_]

COL, SIGMA, CONTRAST, NOISE, VALUE = range(5)
"""What is written of a line: column in px and its 1 sigma, height over the valleys beside it, noise, projector px."""

# Flags are looked through so many at a time.
_WORD = 8

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_compiled
def line_rows(
    picture: Levels,
    high: Levels,
    low: Levels,
    mask: Mask,
    known: Mask,
    value: Singles,
    slope: Singles,
    noise: Singles,
    kernels: Bytes,
    runs: Wholes,
    starts: Wholes,
    scales: Scales,
    rule: LineRule,
    room: Room,
    lines: Doubles,
    ends: Wholes,
) -> None:
    """Write the lines of a picture (r, w) that crosses them, see `find_rows`; high, low (r, w): white and black."""
    ends[0] = 0
    for row in range(len(picture)):
        to_share(picture[row], high[row], low[row], mask[row], noise, room.share[0], room.variance[0])
        told = mask[row : row + 1], known[row : row + 1], value[row : row + 1], slope[row : row + 1]
        where, aside = (kernels[row : row + 1], runs, starts[row : row + 2]), (room, lines, ends[row : row + 2])
        find_rows(room.share, room.variance, *told, *where, scales, rule, *aside)


@_compiled
def find_rows(
    share: Singles,
    variance: Singles,
    mask: Mask,
    known: Mask,
    value: Singles,
    slope: Singles,
    kernels: Bytes,
    runs: Wholes,
    starts: Wholes,
    scales: Scales,
    rule: LineRule,
    room: Room,
    lines: Doubles,
    ends: Wholes,
) -> None:
    """Write the bright lines of a picture (r, w) to lines (n, 5), those of row i from ends[i] to ends[i + 1].

    A line is where the smoothed derivative along the row falls through zero; it counts where the coarse projector
    position beside it belongs to one that the picture shows. share, variance (r, w): of the picture; mask (r, w): what
    is lit; known (r, w): where value (r, w), a coarse position in projector px, is known; slope (r, w): projector px a
    camera px; kernels, runs, starts: as `run_rows` writes them.
    Source: Blais and Rioux, Real-time numerical peak detector (1986), with a Gaussian derivative (Steger 1998).
    """
    for row in range(len(share)):
        _mark_near(value[row], known[row], rule, room.near)
        aside = room.near, room.change, room.flags, room.left, room.start, room.scale
        where = kernels[row], runs[starts[row] : starts[row + 1]]
        count = _find_falls(share[row], *where, scales.reach, scales.bell, *aside)
        here = share[row], variance[row], mask[row], known[row], value[row], slope[row]
        end = ends[row]
        for first in range(0, count, LANES):
            last = min(first + LANES, count)
            told = room.left[first:last], room.start[first:last], room.scale[first:last]
            aside = room.numbers, room.windows, room.doubts
            most = fill_lanes(share[row], variance[row], *told, scales.square, scales.reach, scales.bell, *aside)
            center_lanes(last - first, most, *aside)
            end = _take(*here, first, last, rule, room, lines, end)
        ends[row + 1] = end


@_compiled
def _mark_near(value: Singles, known: Mask, rule: LineRule, near: Bytes) -> None:
    """Write 1 where a coarse position (w,) is as near as a line's may be, else 0."""
    offset, pace, one, none = np.float32(rule.offset), np.float32(1 / rule.period), np.uint8(1), np.uint8(0)
    # A little more, for rounding: what counts is decided with the line's own place.
    most = np.float32(rule.near / rule.period + 1e-4)
    for col in range(len(value)):
        place = (value[col] - offset) * pace
        near[col] = one if known[col] & (abs(place - np.rint(place)) <= most) else none


@_compiled
def _find_falls(
    share: Singles,
    kernels: Bytes,
    runs: Wholes,
    reaches: Places,
    bell: Singles,
    near: Bytes,
    change: Singles,
    flags: Bytes,
    left: Wholes,
    start: Singles,
    scale: Wholes,
) -> int:
    """Write where in the runs (n, 3) of a row (w,) a line may begin to fall, and return how many; see `Room`."""
    count = 0
    for k in range(len(runs)):
        kernel = runs[k, 2]
        reach = int(reaches[kernel])
        # Nearer to the picture's border the kernel would reach beyond it.
        first, last = max(runs[k, 0], reach + 1), min(runs[k, 1], len(share) - reach - 2)
        if last <= first:
            continue
        _derive(share, first, last + 1 - first, bell, kernel, reach, change)
        begin, words = count, _flag(change, near, kernels, kernel, first, last - first, flags)
        for word in range(len(words)):
            if words[word] == 0:
                continue
            for i in range(word * _WORD, word * _WORD + _WORD):
                # Written over by the next one unless it counts: a branch here would often be guessed wrongly.
                left[count], scale[count] = first + i, kernel
                count += flags[i]
        for i in range(begin, count):
            at = left[i] - first
            start[i] = change[at] / (change[at] - change[at + 1])
    return count


@_inlined
def _derive(share: Singles, first: int, count: int, bell: Singles, kernel: int, reach: int, change: Singles) -> None:
    """Write the smoothed derivative of a row (w,) at `count` px from first on, up to a factor."""
    change[:count] = 0
    for k in range(1, reach + 1):
        weight = np.float32(k) * bell[kernel, k]
        after, before = share[first + k : first + k + count], share[first - k : first - k + count]
        for i in range(count):
            change[i] += weight * (after[i] - before[i])


@_inlined
def _flag(change: Singles, near: Bytes, kernels: Bytes, kernel: int, first: int, count: int, flags: Bytes) -> Longs:
    """Write 1 where a derivative falls through zero to the next px, and a line is near; return flags as words.

    change (>= count + 1,): of px from first on, by this kernel; near, kernels (w,): of the whole row.
    """
    one, none, this = np.uint8(1), np.uint8(0), np.uint8(kernel)
    here, following = change[:count], change[1 : count + 1]
    for i in range(count):
        flags[i] = one if (here[i] > 0) & (following[i] <= 0) else none
    # A centre may end up a px from where the fall begins or ends.
    before, at, after, last = near[first - 1 :], near[first:], near[first + 1 :], near[first + 2 :]
    for i in range(count):
        flags[i] &= before[i] | at[i] | after[i] | last[i]
    served = kernels[first : first + count]
    for i in range(count):
        flags[i] = flags[i] if served[i] == this else none
    padded = -(-count // _WORD) * _WORD
    flags[count:padded] = 0
    return flags[:padded].view(np.uint64)


@_compiled
def _take(
    share: Singles,
    variance: Singles,
    mask: Mask,
    known: Mask,
    value: Singles,
    slope: Singles,
    first: int,
    last: int,
    rule: LineRule,
    room: Room,
    lines: Doubles,
    end: int,
) -> int:
    """Write the lines of a row (w,) that count, of those whose centres were found, from `end` on; return their end."""
    pace = 1 / rule.period
    for i in range(first, last):
        begin = room.left[i] + np.float64(room.start[i])
        col = np.rint(begin) + room.numbers[AT + i - first]
        sigma = room.numbers[SPREAD + i - first]
        at = int(np.rint(col))
        half = 0.5 * rule.period / max(abs(slope[room.left[i]]), rule.flattest)
        contrast = sample(share, col) - (sample(share, col - half) + sample(share, col + half)) / 2
        noise = np.sqrt(variance[at])
        line = rule.offset + rule.period * np.rint((value[at] - rule.offset) * pace)
        near = (abs(value[at] - line) <= rule.near) & (line >= rule.first) & (line <= rule.last)
        strong = contrast > max(rule.contrast, rule.snr * noise)
        # Beside an unlit pixel the picture is cut off, and a centre there is biased.
        counts = near & strong & known[at] & mask[at - 1] & mask[at + 1] & (sigma < np.inf)
        # Written over by the next one unless it counts.
        lines[end, COL], lines[end, SIGMA], lines[end, CONTRAST] = col, sigma, contrast
        lines[end, NOISE], lines[end, VALUE] = noise, line
        end += counts
    return end


@_inlined
def sample(row: Singles, col: float) -> float:
    """Return the value of a row (w,) at a fractional column, by linear interpolation."""
    last = len(row) - 1
    col = min(max(col, 0.0), float(last))
    left = min(int(col), max(last - 1, 0))
    part = col - left
    return (1 - part) * row[left] + part * row[min(left + 1, last)]
