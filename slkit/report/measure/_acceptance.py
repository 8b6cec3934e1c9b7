"""Acceptance: form, size and distance of calibrated balls, and the flatness of a plate.

Inspired by VDI/VDE 2634 part 2 and ISO 10360-13; a measure of slkit, not a test after either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.report.measure._points import Float64s, check_positive, finite_points
from slkit.report.measure._shapes import plane_fit, sphere_fit

_MOST_DISCARDED = 0.003


@dataclass(frozen=True)
class ProbingError:
    """How well a ball is measured.

    points: those of the fit, the discarded ones not among them; form_mm: largest less smallest residual from the
    sphere of free radius; form95_mm: length of the smallest interval that holds 95 % of the residuals; sigma_mm: their
    standard deviation, four degrees of freedom lost; size_mm: fitted less calibrated diameter, NaN without one.
    """

    points: int
    discarded: int
    form_mm: float
    form95_mm: float
    sigma_mm: float
    size_mm: float


@dataclass(frozen=True)
class SpacingError:
    """How well the distance of two balls is measured.

    points_a, points_b: on each; distance_mm: of the fitted centres; error_mm: that less the calibrated distance.
    """

    points_a: int
    points_b: int
    distance_mm: float
    error_mm: float


@dataclass(frozen=True)
class Flatness:
    """How flat a plate is measured.

    form_mm: largest less smallest signed distance to the least-squares plane; form95_mm: length of the smallest
    interval that holds 95 % of them; sigma_mm: their standard deviation, three degrees of freedom lost.
    """

    points: int
    form_mm: float
    form95_mm: float
    sigma_mm: float


def probing_error(xyz: npt.ArrayLike, diameter_mm: float | None = None, discard: float = 0.0) -> ProbingError:
    """Return form and size error of a ball from points (n, 3) mm on it, rows that are not finite left out.

    diameter_mm: the calibrated one; discard: share of the points, those with the largest residuals, that are left out
    before the sphere is fitted anew, at most 0.003.
    Errors: InputError for a larger share, and where `sphere_fit` refuses the points.
    """
    if diameter_mm is not None:
        check_positive(diameter_mm, "diameter_mm")
    if not 0 <= discard <= _MOST_DISCARDED:
        raise InputError(f"discard must be between 0 and {_MOST_DISCARDED:g} of the points, not {discard:g}")
    points = finite_points(xyz, "xyz")
    fit = sphere_fit(points)
    # A product such as 0.003 * 1000 may fall short of the whole number by rounding.
    discarded = int(discard * len(points) + 1e-9)
    if discarded:
        fit = sphere_fit(points[np.argsort(np.abs(fit.residuals_mm))[:-discarded]])
    size = np.nan if diameter_mm is None else 2 * fit.radius_mm - diameter_mm
    return ProbingError(fit.points, discarded, *_form(fit.residuals_mm, 4), size)


def sphere_spacing(
    xyz_a: npt.ArrayLike,
    xyz_b: npt.ArrayLike,
    distance_mm: float,
    diameters_mm: tuple[float, float] | None = None,
) -> SpacingError:
    """Return the error of the distance of two balls from points (n, 3) and (m, 3) mm on them.

    distance_mm: the calibrated one; diameters_mm: the calibrated diameters to fit with, default free.
    Errors: InputError where `sphere_fit` refuses the points.
    """
    check_positive(distance_mm, "distance_mm")
    radii = (None, None) if diameters_mm is None else tuple(d / 2 for d in diameters_mm)
    a, b = (sphere_fit(xyz, radius) for xyz, radius in zip((xyz_a, xyz_b), radii, strict=True))
    measured = float(np.linalg.norm(a.center - b.center))
    return SpacingError(a.points, b.points, measured, measured - distance_mm)


def flatness(xyz: npt.ArrayLike) -> Flatness:
    """Return the flatness of a plate from points (n, 3) mm on it, rows that are not finite left out.

    Errors: InputError for fewer than four points.
    """
    points = finite_points(xyz, "xyz")
    if len(points) < 4:
        raise InputError(f"flatness needs four or more points, not {len(points)}: three are always on one plane")
    normal, offset, _ = plane_fit(points)
    return Flatness(len(points), *_form(points @ normal - offset, 3))


def _form(residuals: Float64s, lost: int) -> tuple[float, float, float]:
    """Return range, smallest interval of 95 % and standard deviation, `lost` degrees of freedom short, of (n,)."""
    ordered = np.sort(residuals)
    held = int(np.ceil(0.95 * len(ordered) - 1e-9))
    shortest = (ordered[held - 1 :] - ordered[: len(ordered) - held + 1]).min()
    spare = len(ordered) - lost
    sigma = np.sqrt(residuals @ residuals / spare) if spare else np.nan
    return float(np.ptp(ordered)), float(shortest), float(sigma)
