"""From correspondences to points: ray-plane for one coded axis, two rays for both, and what to throw away."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences, PointCloud
from slkit.geometry import Rig
from slkit.triangulation.filters import Filters
from slkit.triangulation.normals import with_normals
from slkit.triangulation.ray_plane import ray_plane
from slkit.triangulation.two_rays import two_rays
from slkit.triangulation.uncertainty import point_covariance, uncertainty_map

__all__ = [
    "Filters",
    "point_covariance",
    "ray_plane",
    "triangulate",
    "two_rays",
    "uncertainty_map",
    "with_normals",
]


def triangulate(correspondences: Correspondences, rig: Rig) -> PointCloud:
    """Return the points of a scan: rows with both axes by `two_rays`, rows with one by `ray_plane`.

    Points in the camera frame in mm, in the order of the rows; rows without a finite point are dropped.
    """
    both = np.isfinite(correspondences.projector_xy.sum(axis=1))
    if both.all() or not both.any():
        cloud = (two_rays if both.all() else ray_plane)(correspondences, rig)
    else:
        cloud = _merge(both, two_rays(correspondences.select(both), rig), ray_plane(correspondences.select(~both), rig))
    return cloud.select(cloud.finite)


def _merge(first: npt.NDArray[np.bool_], a: PointCloud, b: PointCloud) -> PointCloud:
    """Return the rows of `a` where the mask is true and those of `b` elsewhere."""
    order = np.empty(len(first), dtype=np.intp)
    order[first] = np.arange(len(a))
    order[~first] = len(a) + np.arange(len(b))
    names = ("xyz", "color", "sigma_mm", "residual_px", "camera_xy", "sigma_cal_mm")
    return PointCloud(**{n: np.concatenate([getattr(a, n), getattr(b, n)])[order] for n in names})
