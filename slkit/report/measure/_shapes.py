"""Planes and spheres through points, by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.report.measure._points import Float64s, check_positive, finite_points, points_of, rms_of

_STEPS = 100
_CONVERGED = 1e-10
_FLAT = 1e-14
"""Smallest over largest moment of points on one plane, as rounding leaves it."""
_FARTHEST = 1e6
"""The centre's distance, in units of the points' spread, at which nothing bends any more."""
_SIGNIFICANT = 3.0
"""The curvature that a sphere needs, in units of its own sigma: noise on a plane is no sphere."""


@dataclass(frozen=True, eq=False)
class SphereFit:
    """A sphere through points: center (3,) mm, radius_mm, residuals_mm (n,), distance to the centre less the radius."""

    center: Float64s
    radius_mm: float
    residuals_mm: Float64s

    @property
    def points(self) -> int:
        """How many points the fit is of."""
        return len(self.residuals_mm)


def plane_fit(xyz: npt.ArrayLike) -> tuple[Float64s, float, float]:
    """Return normal (3,), offset in mm and rms distance in mm of the least-squares plane normal . X = offset.

    xyz (n, 3) mm; the offset is not negative. Errors: InputError for fewer than three points.
    """
    points = points_of(xyz, "xyz")
    if len(points) < 3:
        raise InputError(f"a plane needs three or more points, not {len(points)}")
    center = points.mean(axis=0)
    # The 3 x 3 moments suffice: an SVD of a million rows would cost a second.
    moments = (points - center).T @ (points - center)
    normal = np.linalg.eigh(moments)[1][:, 0]
    offset = float(normal @ center)
    normal, offset = (normal, offset) if offset >= 0 else (-normal, -offset)
    return normal, offset, rms_of(points @ normal - offset)


def sphere_fit(xyz: npt.ArrayLike, radius_mm: float | None = None) -> SphereFit:
    """Return the least-squares sphere through points, the sum of (|X - c| - r)^2 being least.

    xyz (n, 3) mm, rows that are not finite left out; radius_mm: the calibrated radius, default free.
    Errors: InputError for fewer than four points, and where they do not bend: on one plane, or so little of a sphere
    that the noise hides its curvature.
    Source: Gauss-Newton from the algebraic fit, as in Forbes, Least-squares best-fit geometric elements (1989).
    """
    points = finite_points(xyz, "xyz")
    if radius_mm is not None:
        check_positive(radius_mm, "radius_mm")
    if len(points) < 4:
        raise InputError(f"a sphere needs four or more points, not {len(points)}")
    middle = points.mean(axis=0)
    local = points - middle
    moments = np.linalg.eigvalsh(local.T @ local)
    if moments[0] <= _FLAT * moments[2]:
        raise InputError("the points lie on one plane: a sphere needs points that bend")
    scale = float(np.sqrt(moments.sum() / len(points)))
    local /= scale
    center, radius = _algebraic(local)
    if radius_mm is not None:
        # The pole that the points lie around stays where it is.
        known = radius_mm / scale
        center = center * (1 + (known - radius) / max(float(np.linalg.norm(center)), 1e-12))
        radius = known
    center, radius = _geometric(local, center, radius, radius_mm is None)
    residuals = np.linalg.norm(local - center, axis=1) - radius
    return SphereFit(middle + scale * center, scale * radius if radius_mm is None else radius_mm, scale * residuals)


def _algebraic(local: Float64s) -> tuple[Float64s, float]:
    """Return centre and radius that make the sum of (|X - c|^2 - r^2)^2 least, of points (n, 3) around the origin."""
    squares = np.einsum("ij,ij->i", local, local)
    center = np.linalg.solve(2 * (local.T @ local), local.T @ (squares - squares.mean()))
    return center, float(np.sqrt(squares.mean() + center @ center))


def _geometric(local: Float64s, center: Float64s, radius: float, free: bool) -> tuple[Float64s, float]:
    """Return centre and radius, the latter held unless free, after Gauss-Newton on the distances."""
    slopes = -np.ones((len(local), 4 if free else 3))
    for _ in range(_STEPS):
        away = local - center
        distance = np.maximum(np.sqrt(np.einsum("ij,ij->i", away, away)), 1e-12)
        slopes[:, :3] = -away / distance[:, None]
        residuals = distance - radius
        normal = slopes.T @ slopes
        try:
            step = np.linalg.solve(normal, -slopes.T @ residuals)
        except np.linalg.LinAlgError:
            break
        center = center + step[:3]
        radius += float(step[3]) if free else 0.0
        if radius <= 0 or not np.linalg.norm(center) < _FARTHEST:
            break
        if np.abs(step).max() <= _CONVERGED * max(radius, 1.0):
            spare = len(local) - 4
            variance = residuals @ residuals / spare * np.linalg.inv(normal)[3, 3] if free and spare else 0.0
            if radius >= _SIGNIFICANT * np.sqrt(max(variance, 0.0)):
                return center, radius
            break
    raise InputError("the points do not determine a sphere: they cover too little of it for their noise")
