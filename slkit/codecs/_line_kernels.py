"""Lines in pictures: where they lie between the pixels and which of the projector's they are, in compiled loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from slkit.codecs._line_scales import LineRule, Scales

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

COL, SIGMA, CONTRAST, NOISE, VALUE = range(5)
"""What is written of a line: column in px and its 1 sigma, height over the valleys beside it, noise, projector px."""

_STEPS = 3
# After so small a step, in px, the next one would be below a millionth.
_SETTLED = 2e-4

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
    runs: Wholes,
    starts: Wholes,
    scales: Scales,
    rule: LineRule,
    lines: Doubles,
    ends: Wholes,
) -> None:
    """Write the lines of a picture (r, w) that crosses them, see `find_rows`; high, low (r, w): white and black."""
    share, variance = np.empty((1, picture.shape[1]), np.float32), np.empty((1, picture.shape[1]), np.float32)
    end = ends[:1]
    end[0] = 0
    for row in range(len(picture)):
        to_share(picture[row], high[row], low[row], mask[row], noise, share[0], variance[0])
        told = mask[row : row + 1], known[row : row + 1], value[row : row + 1], slope[row : row + 1]
        ends[row + 1] = ends[row]
        find_rows(share, variance, *told, runs, starts[row : row + 2], scales, rule, lines, ends[row : row + 2])


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
def find_rows(
    share: Singles,
    variance: Singles,
    mask: Mask,
    known: Mask,
    value: Singles,
    slope: Singles,
    runs: Wholes,
    starts: Wholes,
    scales: Scales,
    rule: LineRule,
    lines: Doubles,
    ends: Wholes,
) -> None:
    """Write the bright lines of a picture (r, w) to lines (n, 5), those of row i from ends[i] to ends[i + 1].

    A line is where the smoothed derivative along the row falls through zero; it counts where the coarse projector
    position beside it belongs to one that the picture shows. share, variance (r, w): of the picture; mask (r, w): what
    is lit; known (r, w): where value (r, w), a coarse position in projector px, is known; slope (r, w): projector px a
    camera px; runs, starts: as `run_rows` writes them.
    Source: Blais and Rioux, Real-time numerical peak detector (1986), with a Gaussian derivative (Steger 1998).
    """
    change = np.empty(share.shape[1], np.float32)
    for row in range(len(share)):
        end = ends[row]
        here = share[row], variance[row], mask[row], known[row], value[row]
        for k in range(starts[row], starts[row + 1]):
            scale = runs[k, 2]
            reach = scales.reach[scale]
            # Nearer to the picture's border the kernel would reach beyond it.
            first, last = max(runs[k, 0], reach + 1), min(runs[k, 1], share.shape[1] - reach - 2)
            if last > first:
                _derive(share[row], first, last + 1, scales.bell[scale], reach, change)
                end = _falls(change, first, last, *here, slope[row], scale, scales, rule, lines, end)
        ends[row + 1] = end


@_compiled
def _derive(share: Singles, first: int, last: int, bell: Singles, reach: int, change: Singles) -> None:
    """Write the smoothed derivative of a row (w,) from first up to last, up to a factor."""
    count = last - first
    to = change[first:last]
    to[:] = 0
    for k in range(1, reach + 1):
        weight = np.float32(k) * bell[k]
        after, before = share[first + k : first + k + count], share[first - k : first - k + count]
        for i in range(count):
            to[i] += weight * (after[i] - before[i])


@_compiled
def _falls(
    change: Singles,
    first: int,
    last: int,
    share: Singles,
    variance: Singles,
    mask: Mask,
    known: Mask,
    value: Singles,
    slope: Singles,
    scale: int,
    scales: Scales,
    rule: LineRule,
    lines: Doubles,
    end: int,
) -> int:
    """Write the lines of a row (w,) that begin to fall from first up to last, from `end` on; return where they end."""
    for left in range(first, last):
        if not ((change[left] > 0) & (change[left + 1] <= 0)):
            continue
        half = 0.5 * rule.period / max(abs(slope[left]), rule.flattest)
        if not _likely(left, half, share, variance, known, value, rule):
            continue
        start = left + change[left] / np.float64(change[left] - change[left + 1])
        col, sigma = _center(share, variance, start, scales.square[scale], scales.reach[scale], scales.bell[scale])
        if not np.isfinite(sigma):
            continue
        at = int(np.rint(col))
        contrast = sample(share, col) - (sample(share, col - half) + sample(share, col + half)) / 2
        noise = np.sqrt(variance[at])
        line = rule.offset + rule.period * np.rint((value[at] - rule.offset) / rule.period)
        near = (abs(value[at] - line) <= rule.near) & (line >= rule.first) & (line <= rule.last)
        strong = contrast > max(rule.contrast, rule.snr * noise)
        # Beside an unlit pixel the picture is cut off, and a centre there is biased.
        if near & strong & known[at] & mask[at - 1] & mask[at + 1]:
            lines[end, COL], lines[end, SIGMA], lines[end, CONTRAST] = col, sigma, contrast
            lines[end, NOISE], lines[end, VALUE] = noise, line
            end += 1
    return end


@_inlined
def _likely(
    left: int, half: float, share: Singles, variance: Singles, known: Mask, value: Singles, rule: LineRule
) -> bool:
    """Tell whether a line that begins to fall at a px may count, wherever within a px of there its centre lies."""
    near, top, least = False, share[left], variance[left]
    for at in range(left - 1, left + 3):
        off = (value[at] - rule.offset) / rule.period
        near |= known[at] & (abs(off - np.rint(off)) * rule.period <= rule.near + rule.period * 1e-4)
        top, least = max(top, share[at]), min(least, variance[at])
    if not near:
        return False
    bottom = _least(share, left - 1 - half, left + 2 - half) + _least(share, left - 1 + half, left + 2 + half)
    return top - bottom / 2 > max(rule.contrast, rule.snr * np.sqrt(least))


@_inlined
def _least(share: Singles, first: float, last: float) -> float:
    """Return the least value of a row (w,) between two places in px."""
    end = len(share) - 1
    low, high = min(max(int(np.floor(first)), 0), end), min(max(int(np.ceil(last)), 0), end)
    least = share[low]
    for at in range(low + 1, high + 1):
        least = min(least, share[at])
    return least


@_inlined
def sample(row: Singles, col: float) -> float:
    """Return the value of a row (w,) at a fractional column, by linear interpolation."""
    last = len(row) - 1
    col = min(max(col, 0.0), float(last))
    left = min(int(col), max(last - 1, 0))
    part = col - left
    return (1 - part) * row[left] + part * row[min(left + 1, last)]


@_inlined
def _center(
    share: Singles, variance: Singles, start: float, square: float, reach: int, bell: Singles
) -> tuple[float, float]:
    """Return where the derivative of a smoothed row (w,) vanishes near `start`, and its 1 sigma, in px; sigma NaN: no.

    Newton's method with the kernel centred between the pixels: interpolating between sums taken at whole pixels
    instead would pull every centre towards the nearer one, by up to 0.04 px. square: of the kernel's sigma; bell
    (reach + 1,): exp(-k^2 / (2 square)). With the kernel d px further left, its weights at px k are those at whole
    pixels times exp(-k d / square), up to a factor.
    """
    middle, place = int(np.rint(start)), start
    step, grow, d, pace = 0.0, np.float32(1), np.float32(0), np.float32(0)
    for _ in range(_STEPS):
        d = np.float32(middle - place)
        grow = np.exp(np.float32(-d / square))
        shrink, more, less = np.float32(1) / grow, np.float32(1), np.float32(1)
        even, odd, wide = share[middle], np.float32(0), np.float32(0)
        for k in range(1, reach + 1):
            more *= grow
            less *= shrink
            after, before = bell[k] * more * share[middle + k], bell[k] * less * share[middle - k]
            far = np.float32(k)
            even += after + before
            odd += far * (after - before)
            wide += far * far * (after + before)
        pace = (wide + d * (odd + odd + d * even)) / np.float32(square) - even
        if not pace < 0:
            return place, np.nan
        step = min(max((odd + d * even) / pace, np.float32(-0.5)), np.float32(0.5))
        place -= step
        if abs(step) < _SETTLED:
            break
    shrink, more, less = np.float32(1) / grow, np.float32(1), np.float32(1)
    spread = d * d * variance[middle]
    for k in range(1, reach + 1):
        more *= grow
        less *= shrink
        after, before = (k + d) * bell[k] * more, (k - d) * bell[k] * less
        spread += after * after * variance[middle + k] + before * before * variance[middle - k]
    return place, np.sqrt(spread) / -pace if abs(place - start) <= 1 else np.nan
