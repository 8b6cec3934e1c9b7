"""What a cloud is compared with: a plate, two balls, or nothing but the other clouds; a surface: the module beside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.geometry import Rig

Float64s = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_BENT = 4.0
"""A spread about the plane this many times the noise is a form."""
_MAD = 1.4826


@dataclass(frozen=True, eq=False)
class Measured:
    """What a reference says of one cloud.

    numbers: by the names of `report.comparison.COLUMNS`; away_mm (m,): signed distance of each point, positive nearer
    to the camera where there is a truth, NaN where it is compared with nothing; cloud: the points (m,), moved where the
    reference was aligned first; notes: what to know; flat_xyz (m, 3) mm: the points less the true shape, None where it
    is not known: the roughness of these holds no relief.
    """

    numbers: Mapping[str, float]
    away_mm: Float64s
    cloud: PointCloud
    notes: tuple[str, ...] = ()
    flat_xyz: Float64s | None = None


@runtime_checkable
class Reference(Protocol):
    """Something to compare clouds with."""

    @property
    def words(self) -> str:
        """What it is, for the report."""
        ...

    @property
    def error(self) -> str:
        """The column that says how wrong a method is."""
        ...

    def measure(self, cloud: PointCloud, common: Mask, rig: Rig) -> Measured:
        """Return what it says of a cloud (m,); common (m,): points where all methods saw the scene."""
        ...


@dataclass(frozen=True)
class Nothing:
    """No truth: the roughness of a cloud is all that is known of its error."""

    words: str = "nothing: no truth is known, so there is no accuracy; completeness is of what all methods together saw"
    error: str = "roughness_mm"

    def measure(self, cloud: PointCloud, common: Mask, rig: Rig) -> Measured:
        """Return no number and no distance."""
        return Measured({}, np.full(len(cloud), np.nan), cloud)


@dataclass(frozen=True)
class Plate:
    """A flat plate: each cloud against the plane through its own points, all of them and where all methods saw."""

    words: str = (
        "a flat plate: the least-squares plane of each cloud, through all its points and through those where every "
        "method saw the plate; no point is left out"
    )
    error: str = "common_plane_rms_mm"

    def measure(self, cloud: PointCloud, common: Mask, rig: Rig) -> Measured:
        """Return the flatness of all points and of the common ones. Errors: InputError for fewer than four points."""
        from slkit.report.measure import flatness, plane_fit

        numbers: dict[str, float] = {}
        for prefix, chosen in (("", np.ones(len(cloud), dtype=bool)), ("common_", common)):
            xyz = cloud.xyz[chosen].astype(np.float64)
            if prefix and len(xyz) < 4:
                continue
            flat = flatness(xyz)
            numbers |= {
                f"{prefix}plane_rms_mm": plane_fit(xyz)[2],
                f"{prefix}plane_form95_mm": flat.form95_mm,
                f"{prefix}plane_form_mm": flat.form_mm,
            }
        normal, offset, _ = plane_fit(cloud.xyz)
        return Measured(numbers, offset - cloud.xyz @ normal, cloud)


@dataclass(frozen=True)
class Balls:
    """Two balls: their form, size and distance. Diameters and distance in mm."""

    diameters_mm: tuple[float, float]
    distance_mm: float
    error: str = "form95_1_mm"

    @property
    def words(self) -> str:
        """What it is, for the report."""
        a, b = self.diameters_mm
        return f"two balls of {a:g} and {b:g} mm, {self.distance_mm:g} mm apart, as calibrated; no point is left out"

    def measure(self, cloud: PointCloud, common: Mask, rig: Rig) -> Measured:
        """Return probing errors and spacing error. Errors: InputError where a ball is not found."""
        from slkit.report.measure import find_spheres, points_on_sphere, probing_error, sphere_fit, sphere_spacing

        xyz, away = cloud.xyz.astype(np.float64), np.full(len(cloud), np.nan)
        numbers: dict[str, float] = {}
        balls: list[Float64s] = []
        found = find_spheres(xyz, self.diameters_mm, np.random.default_rng(0))
        for i, (ball, diameter) in enumerate(zip(found, self.diameters_mm, strict=True), 1):
            mask = points_on_sphere(xyz, ball.center, ball.radius_mm)
            error = probing_error(xyz[mask], diameter)
            away[mask] = sphere_fit(xyz[mask]).residuals_mm
            balls.append(xyz[mask])
            numbers |= {
                f"form95_{i}_mm": error.form95_mm,
                f"form_{i}_mm": error.form_mm,
                f"size_{i}_mm": error.size_mm,
            }
        numbers["spacing_error_mm"] = sphere_spacing(balls[0], balls[1], self.distance_mm).error_mm
        return Measured(numbers, away, cloud)


def bent_note(away_mm: Float64s, noise_mm: float) -> tuple[str, ...]:
    """Return a note where points (m,) leave their plane by much more than their noise explains."""
    spread = _MAD * float(np.median(np.abs(away_mm - np.median(away_mm))))
    if not spread > _BENT * noise_mm:
        return ()
    return (
        f"the points leave their plane by {spread:.2g} mm, {spread / noise_mm:.0f} times their noise: either this is "
        "no flat plate, or other things are in view (--depth leaves them out), or the rig bends it",
    )
