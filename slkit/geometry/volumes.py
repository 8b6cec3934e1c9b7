"""The working volume of a rig: what camera and projector share, as a grid of camera pixels and depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from slkit.geometry.rays import homogeneous
from slkit.geometry.rigs import Rig

_ACROSS = 24


def pixel_grid(size: tuple[int, int], step_px: float | None = None) -> npt.NDArray[np.float64]:
    """Return pixels (r, c, 2) in even steps over an image (w, h): the middles of squares of step_px.

    step_px: default a 24th of the longer side.
    """
    step = max(size) / _ACROSS if step_px is None else step_px
    x, y = (np.arange(0.5 * step - 0.5, length - 0.5, step) for length in size)
    return np.stack(np.meshgrid(x, y), axis=-1)


def ninths(xy: npt.ArrayLike, size: tuple[int, int]) -> npt.NDArray[np.intp]:
    """Return how many points (n, 2) px lie in each ninth (3, 3) of an image (w, h), row by row."""
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    place = np.clip(np.floor(3 * (points + 0.5) / np.array(size)), 0, 2).astype(np.intp)
    counts = np.zeros((3, 3), dtype=np.intp)
    np.add.at(counts, (place[:, 1], place[:, 0]), 1)
    return counts


def working_volume(
    rig: Rig, camera_xy: npt.ArrayLike, depths_mm: Sequence[float] | npt.NDArray[np.floating]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the points (d, ..., 3) mm at each depth (d,) on the rays of camera pixels (..., 2), and what lights them.

    That is projector pixels (d, ..., 2); both are NaN where the projector's image does not reach.
    """
    rays = homogeneous(rig.camera.normalize(camera_xy))
    depths = np.asarray(depths_mm, dtype=np.float64)
    xyz = depths.reshape(-1, *(1,) * rays.ndim) * rays
    projector_xy = rig.to_projector(xyz)
    outside = ~((projector_xy >= -0.5) & (projector_xy <= np.array(rig.projector.size) - 0.5)).all(axis=-1)
    xyz[outside] = projector_xy[outside] = np.nan
    return xyz, projector_xy


def steeper_axis(rig: Rig, xyz: npt.ArrayLike) -> int:
    """Return the projector axis, 0 or 1, that tells the depth of points (n, 3) mm better, by the median over them."""
    points = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    moved = np.abs(rig.to_projector(1.001 * points) - rig.to_projector(points))
    return int(np.argmax(np.median(moved, axis=0))) if len(points) else 0
