"""What one camera pixel sees of the scene: not a point, but a small patch around it.

A pixel gathers light over its area, blurred by the lens. Where brightness or shape change over that patch, the
projector position that the pixel reports is not that of its centre.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.data import Float32s

# Variance in px of what one pixel sees along an axis, 1/12 for its area and 0.32 for a lens in focus, and how far
# off that may be from one camera to the next.
VARIANCE, VARIANCE_DOUBT = 0.4, 0.25
# Beyond this many px for a patch of variance 1 px, a change is an edge, not a slope that can be corrected for.
STEEPEST = 0.5
# What sampling in whole pixels leaves undecided of the place of a line or edge, 1 sigma in px.
SAMPLING = 0.01
# Where they are closer than this many px, sampling pulls their centres to the pixel grid, growing as the cube of the
# crowding (simulated, 0.6 px of blur).
COMFORTABLE_SPACING = 5.0
_STEP = 2
# The correction subtracts part of the value's own curvature, hence adds to its noise: 1.2 of it and -0.05 of each of
# four neighbours remain.
NOISE_GAIN = float(np.hypot(1 + 2 * VARIANCE / _STEP**2, 2 * VARIANCE / (2 * _STEP**2)))


def displacement(value: Float32s, known: npt.NDArray[np.bool_], span: Float32s, jump: float) -> Float32s:
    """Return, for a pixel that sees a patch of variance 1 px, by how much that shifts the value it reports.

    value (h, w): projector px where known (h, w); span (h, w): the brightness; jump: px of value from one pixel to
    the next that is an edge of the scene. (h, w) in projector px; 0 beside unknown pixels and edges.
    Source: the mean of a quadratic x(u) over a patch weighted with a brightness that is exp-linear is
    x + variance (grad ln(brightness) . grad x + laplacian(x) / 2).
    """
    value = np.where(known, value, np.float32(np.nan))
    light = np.log(span)
    total, usable = np.zeros_like(value), np.ones(value.shape, dtype=bool)
    for axis in (0, 1):
        before, after = _moved(value, axis, _STEP), _moved(value, axis, -_STEP)
        brighter = (_moved(light, axis, -_STEP) - _moved(light, axis, _STEP)) / np.float32(2 * _STEP)
        total += brighter * (after - before) / np.float32(2 * _STEP)
        total += (after - 2 * value + before) / np.float32(2 * _STEP**2)
        usable &= (np.abs(after - value) < _STEP * jump) & (np.abs(value - before) < _STEP * jump)
    return np.where(usable, total, np.float32(0))


def around(shift: Float32s) -> Float32s:
    """Return the largest |shift| (h, w) of each pixel and its eight neighbours.

    Where curvature changes sign a pixel's own shift vanishes, but not the doubt in it.
    """
    height, width = shift.shape
    padded = np.pad(np.abs(shift), 1)
    rows = np.maximum.reduce([padded[i : i + height] for i in range(3)])
    return np.maximum.reduce([rows[:, i : i + width] for i in range(3)])


def _moved(array: Float32s, axis: int, by: int) -> Float32s:
    result = np.roll(array, by, axis=axis)
    border = slice(0, by) if by > 0 else slice(by, None)
    result[(slice(None), border) if axis == 1 else border] = np.nan
    return result
