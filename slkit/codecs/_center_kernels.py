"""Centres of many lines side by side, each in one of a processor's parallel lanes."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Places = npt.NDArray[np.intp]

LANES = 64
"""So many lines at a time: about half of what a row of a picture holds, so that few lanes stay empty."""

# What is kept of each line, so many numbers apart: a fixed distance tells the compiler that they do not overlap, which
# it needs for parallel lanes.
(_START, _INVERSE, _AT, _OFF, _GROW, _SHRINK, _MORE, _LESS, _EVEN, _ODD, _WIDE, _PACE, _STEP, _SPREAD) = (
    LANES * k for k in range(14)
)
AT, SIGMA = _AT, _SPREAD
"""Where `center_lanes` leaves a line's place in px from the middle of its kernel, and its 1 sigma in px."""
NUMBERS = 14 * LANES

_STEPS = 3
# After so small a step, in px, the next one would be far below a millionth.
_SETTLED = 2e-4

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def fill_lanes(
    share: Singles,
    variance: Singles,
    left: Wholes,
    start: Singles,
    scale: Wholes,
    square: Singles,
    reach: Places,
    bell: Singles,
    numbers: Singles,
    windows: Singles,
    doubts: Singles,
) -> int:
    """Put the px around lines (m,) of a row into a lane each, and return how many px to either side.

    share, variance (w,): of the row; left + start: where to start, in px; scale: number of the kernel, of which square:
    of the Gaussian's sigma, reach: px to either side, bell: the Gaussian at whole px from the centre on.
    numbers (NUMBERS,); windows, doubts ((2 px + 1) LANES,): share and variance, weighted by the Gaussian.
    """
    most = 0
    for kernel in scale:
        most = max(most, int(reach[kernel]))
    for lane in range(len(left)):
        kernel, shift = scale[lane], int(np.rint(left[lane] + np.float64(start[lane]))) - left[lane]
        middle, at, own = left[lane] + shift, lane, reach[kernel]
        numbers[_START + lane] = numbers[_AT + lane] = start[lane] - np.float32(shift)
        numbers[_INVERSE + lane] = np.float32(1) / square[kernel]
        windows[lane], doubts[lane] = share[middle], variance[middle]
        for k in range(1, own + 1):
            weight, ahead = bell[kernel, k], at + LANES
            at = ahead + LANES
            windows[ahead], windows[at] = weight * share[middle + k], weight * share[middle - k]
            doubts[ahead], doubts[at] = weight * weight * variance[middle + k], weight * weight * variance[middle - k]
        for _ in range(2 * (most - own)):
            at += LANES
            windows[at] = doubts[at] = 0
    return most


@_compiled
def center_lanes(count: int, most: int, numbers: Singles, windows: Singles, doubts: Singles) -> None:
    """Find where the smoothed derivative around each of `count` lines vanishes, and its 1 sigma, NaN where it does not.

    Newton's method with the kernel centred between the pixels: interpolating between sums taken at whole pixels
    instead would pull every centre towards the nearer one, by up to 0.04 px. With the kernel d px further left, its
    weight at px k is the one at whole pixels times exp(-k d / square), up to a factor that is common to all.
    """
    for step in range(_STEPS):
        _turn(numbers)
        _add_up(most, numbers, windows)
        _move(numbers)
        largest = np.float32(0)
        for i in range(count):
            largest = max(largest, abs(numbers[_STEP + i]))
        if step > 0 and largest < np.float32(_SETTLED):
            break
    _add_doubts(most, numbers, doubts)
    one, nothing = np.float32(1), np.float32(np.nan)
    for i in range(LANES):
        good = (numbers[_PACE + i] < 0) & (abs(numbers[_AT + i] - numbers[_START + i]) <= one)
        numbers[_SPREAD + i] = np.sqrt(numbers[_SPREAD + i]) / -numbers[_PACE + i] if good else nothing


@_compiled
def _turn(numbers: Singles) -> None:
    """Work out by what the weights grow and shrink from px to px: exp(+-place / square)."""
    one, eighth, c2, c3 = np.float32(1), np.float32(1 / 8), np.float32(1 / 2), np.float32(1 / 6)
    c4, c5, c6 = np.float32(1 / 24), np.float32(1 / 120), np.float32(1 / 720)
    for i in range(LANES):
        # A compiled loop has no exponential in parallel lanes: a series for an eighth of the exponent, below 0.3.
        x = numbers[_AT + i] * numbers[_INVERSE + i] * eighth
        root = one + x * (one + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * c6)))))
        root *= root
        root *= root
        numbers[_GROW + i] = root * root
        numbers[_SHRINK + i] = one / (root * root)


@_compiled
def _add_up(most: int, numbers: Singles, windows: Singles) -> None:
    """Add up the weighted pixels: their sum, and those of k and k^2 times each."""
    for i in range(LANES):
        numbers[_MORE + i], numbers[_LESS + i] = 1, 1
        numbers[_EVEN + i], numbers[_ODD + i], numbers[_WIDE + i] = windows[i], 0, 0
    for k in range(1, most + 1):
        far = np.float32(k)
        after, before = windows[(2 * k - 1) * LANES : 2 * k * LANES], windows[2 * k * LANES : (2 * k + 1) * LANES]
        for i in range(LANES):
            numbers[_MORE + i] *= numbers[_GROW + i]
            numbers[_LESS + i] *= numbers[_SHRINK + i]
            a, b = numbers[_MORE + i] * after[i], numbers[_LESS + i] * before[i]
            numbers[_EVEN + i] += a + b
            numbers[_ODD + i] += far * (a - b)
            numbers[_WIDE + i] += far * far * (a + b)


@_compiled
def _move(numbers: Singles) -> None:
    """Take one step of Newton's method, half a px at most; none where the sum does not fall."""
    zero, half = np.float32(0), np.float32(0.5)
    for i in range(LANES):
        d = -numbers[_AT + i]
        even, odd = numbers[_EVEN + i], numbers[_ODD + i]
        pace = (numbers[_WIDE + i] + d * (odd + odd + d * even)) * numbers[_INVERSE + i] - even
        step = min(max((odd + d * even) / pace, -half), half)
        step = step if pace < zero else zero
        numbers[_OFF + i], numbers[_PACE + i], numbers[_STEP + i] = d, pace, step
        numbers[_AT + i] -= step


@_compiled
def _add_doubts(most: int, numbers: Singles, doubts: Singles) -> None:
    """Add up the variances of the weighted pixels at the place of the last step."""
    for i in range(LANES):
        numbers[_MORE + i], numbers[_LESS + i] = 1, 1
        numbers[_SPREAD + i] = numbers[_OFF + i] * numbers[_OFF + i] * doubts[i]
    for k in range(1, most + 1):
        far = np.float32(k)
        after, before = doubts[(2 * k - 1) * LANES : 2 * k * LANES], doubts[2 * k * LANES : (2 * k + 1) * LANES]
        for i in range(LANES):
            numbers[_MORE + i] *= numbers[_GROW + i]
            numbers[_LESS + i] *= numbers[_SHRINK + i]
            a, b = (far + numbers[_OFF + i]) * numbers[_MORE + i], (far - numbers[_OFF + i]) * numbers[_LESS + i]
            numbers[_SPREAD + i] += a * a * after[i] + b * b * before[i]
