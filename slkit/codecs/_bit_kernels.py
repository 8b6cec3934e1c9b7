"""Gray code bit by bit, a few pixels of all its pictures at a time."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.signedinteger[Any]]

# What is known of so many pixels stays in a cache, and they are enough of each picture for the processor to fetch it
# ahead. Their distance is fixed: that tells the compiler that they do not overlap, which it needs for parallel lanes.
_CHUNK = 4096
_LO, _HI, _SQUARE, _LEAST = (_CHUNK * k for k in range(4))

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_compiled
def add_rows(
    pictures: tuple[Levels, ...],
    paired: bool,
    high: Levels,
    low: Levels,
    noise: Singles,
    rule: Singles,
    first: int,
    count: int,
    last: int,
    lo: Wholes,
    hi: Wholes,
    square: Singles,
) -> None:
    """Take bits into the cells lo to hi that are possible, (r, w) each: `count` from `first` on, the lowest ones first.

    pictures: (r, w) each, the pattern of every bit, followed by its inverse where paired, and any others behind; high,
    low (r, w): white and black. Without an inverse white + black - pattern stands in for it.
    noise (3,): variance in dark, its gain a level, the dark level; rule (2,): what makes a bit known, in sigmas and as
    a share of white - black; last: number of the last cell after these bits. square (r, w): of the smallest known
    difference in sigmas. What was in lo, hi and square does not count where the first bit is the code's.
    """
    state, width = np.empty(4 * _CHUNK, np.float32), lo.shape[1]
    for row in range(lo.shape[0]):
        for start in range(0, width, _CHUNK):
            part = slice(start, min(start + _CHUNK, width))
            references, here = (high[row, part], low[row, part]), (lo[row, part], hi[row, part], square[row, part])
            _begin(*references, rule[1], first == 0, *here, state)
            for k in range(count):
                top = np.float32((1 << (first + k + 1)) - 1)
                if paired:
                    _add_pair(pictures[2 * k][row, part], pictures[2 * k + 1][row, part], noise, rule[0], top, state)
                else:
                    _add_single(pictures[k][row, part], *references, noise, rule[0], top, state)
            _end(last, *here, state)


@_compiled
def _begin(
    high: Levels, low: Levels, contrast: np.float32, new: bool, lo: Wholes, hi: Wholes, square: Singles, state: Singles
) -> None:
    """Put what is known of pixels (w,) into a state: cells, whole numbers as float32, which lanes hold more of."""
    for i in range(len(lo)):
        wanted = contrast * max(np.float32(high[i]) - np.float32(low[i]), np.float32(1))
        state[_LEAST + i] = wanted * wanted
    if new:
        for i in range(len(lo)):
            state[_LO + i], state[_HI + i], state[_SQUARE + i] = 0, 0, np.inf
        return
    for i in range(len(lo)):
        state[_LO + i] = np.float32(lo[i])
    for i in range(len(lo)):
        state[_HI + i] = np.float32(hi[i])
    for i in range(len(lo)):
        state[_SQUARE + i] = square[i]


@_compiled
def _end(last: int, lo: Wholes, hi: Wholes, square: Singles, state: Singles) -> None:
    """Write the state of pixels (w,) back, no cell beyond the last."""
    most = np.float32(last)
    for i in range(len(lo)):
        lo[i] = np.int32(state[_LO + i])
    for i in range(len(lo)):
        hi[i] = np.int32(min(state[_HI + i], most))
    for i in range(len(lo)):
        square[i] = state[_SQUARE + i]


@_compiled
def _add_pair(lit: Levels, inverse: Levels, noise: Singles, snr: np.float32, top: np.float32, state: Singles) -> None:
    dark, gain, base, wanted, zero = np.float32(2) * noise[0], noise[1], noise[2], snr * snr, np.float32(0)
    for i in range(len(lit)):
        a, b = np.float32(lit[i]), np.float32(inverse[i])
        light = max(a - base, zero) + max(b - base, zero)
        _settle(a - b, dark + gain * light, wanted, top, state, i)


@_compiled
def _add_single(
    lit: Levels, high: Levels, low: Levels, noise: Singles, snr: np.float32, top: np.float32, state: Singles
) -> None:
    dark, gain, base, wanted, zero = np.float32(6) * noise[0], noise[1], noise[2], snr * snr, np.float32(0)
    for i in range(len(lit)):
        a, b, c = np.float32(lit[i]), np.float32(high[i]), np.float32(low[i])
        light = np.float32(4) * max(a - base, zero) + max(b - base, zero) + max(c - base, zero)
        _settle(np.float32(2) * a - (b + c), dark + gain * light, wanted, top, state, i)


@_inlined
def _settle(
    difference: np.float32, variance: np.float32, wanted: np.float32, top: np.float32, state: Singles, i: int
) -> None:
    """Let a bit change the cells of pixel i, in a block twice as large: top is its last cell."""
    size, zero = difference * difference, np.float32(0)
    ratio = size / variance
    first, last, least, before = state[_LO + i], state[_HI + i], state[_LEAST + i], state[_SQUARE + i]
    known = (ratio > wanted) & (size > least)
    mirrored, mirrored_last = top - last, top - first
    state[_LO + i] = mirrored if known & (difference > zero) else first
    # An unknown bit leaves the hull of both halves.
    state[_HI + i] = last if known & (difference <= zero) else mirrored_last
    state[_SQUARE + i] = ratio if known & (ratio < before) else before
