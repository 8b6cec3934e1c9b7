"""How projections move with points and lenses: what least squares and propagated uncertainty need."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.geometry.lenses import Pinhole, distort, distort_slopes

Doubles = npt.NDArray[np.floating[Any]]


def project_with_derivatives(lens: Pinhole, xyz: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return the pixels (n, 2) of points (n, 3) mm, d pixel / d point (n, 2, 3) and d pixel / d lens (n, 2, 10).

    The points must lie in front of the lens. Source: the chain rule through Brown's distortion.
    """
    inverse = 1 / xyz[:, 2]
    normalized = xyz[:, :2] * inverse[:, None]
    pixels, slopes, d_lens = _pixels(lens, normalized)
    d_xyz = np.empty((len(xyz), 2, 3))
    d_xyz[:, :, :2] = slopes * inverse[:, None, None]
    d_xyz[:, :, 2] = -(d_xyz[:, :, 0] * normalized[:, :1] + d_xyz[:, :, 1] * normalized[:, 1:])
    return pixels, d_xyz, d_lens


def normalize_with_derivatives(lens: Pinhole, xy: Doubles) -> tuple[Doubles, Doubles]:
    """Return the undistorted normalised coordinates (n, 2) of pixels (n, 2) and their d / d lens (n, 2, 10).

    Source: the implicit function theorem on `Pinhole.normalize`.
    """
    normalized = lens.normalize(xy)
    _, slopes, d_lens = _pixels(lens, normalized)
    (a, b), (c, d) = np.moveaxis(slopes, 0, -1)
    determinant = a * d - b * c
    result = np.empty_like(d_lens)
    result[:, 0] = (b[:, None] * d_lens[:, 1] - d[:, None] * d_lens[:, 0]) / determinant[:, None]
    result[:, 1] = (c[:, None] * d_lens[:, 0] - a[:, None] * d_lens[:, 1]) / determinant[:, None]
    return normalized, result


def _pixels(lens: Pinhole, normalized: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return pixels (n, 2), their slopes (n, 2, 2) over the normalised coordinates, and over the lens (n, 2, 10)."""
    bent = distort(normalized, lens.distortion)
    a, b, c, d = distort_slopes(normalized, lens.distortion)
    fx, skew, fy = lens.K[0, 0], lens.K[0, 1], lens.K[1, 1]
    count = len(normalized)
    slopes = np.empty((count, 2, 2))
    slopes[:, 0, 0], slopes[:, 0, 1] = fx * a + skew * c, fx * b + skew * d
    slopes[:, 1, 0], slopes[:, 1, 1] = fy * c, fy * d
    x, y = normalized.T
    r2, xy = x * x + y * y, 2 * x * y
    d_lens = np.zeros((count, 2, 10))
    d_lens[:, 0, 0], d_lens[:, 1, 1] = bent[:, 0], bent[:, 1]
    d_lens[:, 0, 2] = d_lens[:, 1, 3] = 1
    d_lens[:, 0, 4] = bent[:, 1]
    over_x = np.stack([x * r2, x * r2**2, xy, r2 + 2 * x * x, x * r2**3], axis=1)
    over_y = np.stack([y * r2, y * r2**2, r2 + 2 * y * y, xy, y * r2**3], axis=1)
    d_lens[:, 0, 5:] = fx * over_x + skew * over_y
    d_lens[:, 1, 5:] = fy * over_y
    pixels = np.stack([fx * bent[:, 0] + skew * bent[:, 1] + lens.K[0, 2], fy * bent[:, 1] + lens.K[1, 2]], axis=1)
    return pixels, slopes, d_lens
