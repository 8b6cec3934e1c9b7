"""How wide lines look in a camera picture, and what makes one count: tables for compiled loops."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from slkit.data import Float32s

_SCALE_STEP = 1.4
# A narrower kernel, sampled at whole pixels, would pull centres towards the pixel grid.
SMALLEST_SCALE = 0.9
# Scales at which the kernel ends: nearer, the next line would tip it as it moves between the pixels.
REACH = 4.5
# What blurs a line beyond its own width, as a variance in px: one pixel's area and a lens in focus.
_BLUR_VARIANCE = 0.4
# A wider kernel would reach the next line of the same picture.
_LARGEST_SCALE = 0.25
# Lines closer than this many px cannot be told apart in a picture of whole pixels.
_LEAST_SPACING = 2.5
FLATTEST = 1e-3
"""Projector px a camera px below which a surface counts as this flat."""


class Scales(NamedTuple):
    """The kernels of lines, from the narrowest on: the derivative of a Gaussian, each for a range of slopes.

    steepest: projector px a camera px beyond which lines are not told apart; least (n,): down to which slope a kernel
    serves, the last one to 0; square (n,): of the Gaussian's sigma in px; reach (n,): px to either side;
    bell (n, largest reach + 1): the Gaussian at whole px from the centre on, 1 there.
    """

    steepest: float
    least: Float32s
    square: Float32s
    reach: npt.NDArray[np.intp]
    bell: Float32s


class LineRule(NamedTuple):
    """Which lines of a picture count.

    The picture shows the lines offset + period * i, in px, whose centres lie from first to last; near: px at most from
    a coarse position to its line; contrast: least height above the valleys, snr: the same in units of its noise;
    flattest: see `FLATTEST`.
    """

    offset: float
    period: float
    near: float
    first: float
    last: float
    contrast: float
    snr: float
    flattest: float = FLATTEST


class Room(NamedTuple):
    """Memory for one picture row (w,) at a time, used again for the next one.

    share, variance (1, w), change (w,), flags (>= w,), near (w,): of its pixels; left, scale, start (>= w,): where
    lines begin to fall, their kernel, and how many px further; numbers, windows, doubts: as `fill_lanes`.
    """

    share: Float32s
    variance: Float32s
    change: Float32s
    flags: npt.NDArray[np.uint8]
    near: npt.NDArray[np.uint8]
    left: npt.NDArray[np.int32]
    scale: npt.NDArray[np.int32]
    start: Float32s
    numbers: Float32s
    windows: Float32s
    doubts: Float32s

    @classmethod
    def of(cls, width: int, scales: Scales) -> Room:
        """Return memory for rows of `width` px."""
        from slkit.codecs._center_kernels import LANES, NUMBERS

        share, variance = np.empty((1, width), np.float32), np.empty((1, width), np.float32)
        # As far as the kernels reach that fit into the row.
        reach = int(scales.reach[2 * scales.reach < width].max(initial=0))
        windows, doubts = (np.zeros((2 * reach + 1) * LANES, np.float32) for _ in range(2))
        flags, near = np.empty(width + 16, np.uint8), np.empty(width, np.uint8)
        left, scale = np.empty(width + 16, np.int32), np.empty(width + 16, np.int32)
        change, start = np.empty(width, np.float32), np.empty(width + 16, np.float32)
        numbers = np.zeros(NUMBERS, np.float32)
        return cls(share, variance, change, flags, near, left, scale, start, numbers, windows, doubts)


def scales_of(width: float, period: float) -> Scales:
    """Return the kernels for lines `width` px wide, `period` px apart, both in projector px."""
    # The sigma of a line grows with the camera px a projector px; beyond each border the next kernel is nearer.
    count, flattest = 0, 1 / FLATTEST
    while _stretch_at(_border(count), width, period) < flattest:
        count += 1
    borders = [1 / _stretch_at(_border(k), width, period) for k in range(count)]
    sigma = SMALLEST_SCALE * _SCALE_STEP ** np.arange(count + 1)
    reach = np.ceil(REACH * sigma).astype(np.intp)
    bell: npt.NDArray[Any] = np.exp(-((np.arange(reach[-1] + 1) / sigma[:, None]) ** 2) / 2)
    least = np.array([*borders, 0], dtype=np.float32)
    # As float32, in which slopes are told: that of just this spacing is common, because cells are whole.
    steepest = float(np.float32(period / _LEAST_SPACING))
    return Scales(steepest, least, (sigma**2).astype(np.float32), reach, bell.astype(np.float32))


def _border(scale: int) -> float:
    """Return the sigma in px at which a kernel gives way to the next."""
    return SMALLEST_SCALE * _SCALE_STEP ** (scale + 0.5)


def _stretch_at(sigma: float, width: float, period: float) -> float:
    """Return the camera px a projector px at which lines look as wide as a Gaussian of a sigma in px."""
    by_width = np.sqrt(12 * (sigma**2 - _BLUR_VARIANCE)) / width
    return float(max(by_width, sigma / (_LARGEST_SCALE * period)))
