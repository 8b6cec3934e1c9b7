"""What to throw away after triangulation, each test by name and relative to the cloud itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.errors import InputError
from slkit.triangulation.company import in_company

_SMALLEST_RESIDUAL_PX = 1e-3  # what float32 pixel coordinates leave of a perfect pair
_MEDIAN_OF_HALF_NORMAL = 0.6745


@dataclass(frozen=True)
class Filters:
    """The tests a point must pass; each is off only where its name is set to False.

    residual: residual_px at most residual_factor standard deviations, estimated as the cloud's median / 0.6745. Points
    without a residual (one coded axis) pass.
    sigma: sigma_decoding_mm at most sigma_factor times the cloud's median; points without a sigma pass. Ten lets a
    Gray pixel pass that is known to four cells only, on a surface seen at a grazing angle. The calibration's share is
    common to neighbours and would hide the difference between a good point and a bad one.
    depth: z inside the range given to `apply`; passes everything without one.
    isolated: the distance to the tenth neighbour at most isolated_factor times the median of the same distance among
    those ten neighbours, and, as an angle seen from the camera, at most remote_factor times the cloud's median. The
    first compares a point with its own surroundings and takes strays near a surface, up to five together; the second
    takes strays that have only one another. Thin wires and scans whose lines are far apart pass both.
    Errors: InputError where a factor is not positive.
    """

    residual: bool = True
    sigma: bool = True
    depth: bool = True
    isolated: bool = True
    residual_factor: float = 5.0
    sigma_factor: float = 10.0
    isolated_factor: float = 4.0
    remote_factor: float = 10.0

    def __post_init__(self) -> None:
        for name in ("residual_factor", "sigma_factor", "isolated_factor", "remote_factor"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} must be positive, not {getattr(self, name)}")

    def apply(
        self, cloud: PointCloud, depth_mm: tuple[float, float] | None = None
    ) -> tuple[PointCloud, dict[str, int]]:
        """Return the points that pass, and how many each test removed, in the order depth, residual, sigma, isolated.

        depth_mm: smallest and largest z in mm, or None. Points that are NaN are removed before, and counted as
        "no_point" where there are any. Errors: InputError where depth_mm is not a range.
        """
        if depth_mm is not None and not depth_mm[0] < depth_mm[1]:
            raise InputError(f"the depth range must go from near to far, not from {depth_mm[0]} to {depth_mm[1]} mm")
        there = cloud.finite
        removed = {} if there.all() else {"no_point": int((~there).sum())}
        cloud = cloud.select(there)
        for name in ("depth", "residual", "sigma", "isolated"):
            if getattr(self, name):
                keep = self._passes(name, cloud, depth_mm)
                removed[name] = int((~keep).sum())
                cloud = cloud.select(keep)
        return cloud, removed

    def _passes(self, name: str, cloud: PointCloud, depth_mm: tuple[float, float] | None) -> npt.NDArray[np.bool_]:
        if name == "depth":
            low, high = depth_mm or (-np.inf, np.inf)
            return (cloud.xyz[:, 2] >= low) & (cloud.xyz[:, 2] <= high)
        if name == "residual":
            limit = self.residual_factor / _MEDIAN_OF_HALF_NORMAL * _median(cloud.residual_px)
            return ~(cloud.residual_px > max(limit, _SMALLEST_RESIDUAL_PX))
        if name == "sigma":
            sigma_mm = cloud.sigma_decoding_mm
            return ~(sigma_mm > self.sigma_factor * _median(sigma_mm))
        return in_company(cloud.xyz, self.isolated_factor, self.remote_factor)


def _median(values: npt.NDArray[np.float32]) -> float:
    """Return the median of the finite values, the upper one of two, infinity where there are none."""
    finite = values[np.isfinite(values)]
    middle = len(finite) // 2
    # NumPy's median asks for both middle values, which takes ten times as long as one.
    return float(np.partition(finite, middle)[middle]) if len(finite) else np.inf
