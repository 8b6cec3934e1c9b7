"""A rig against another: the points that one makes of what the other knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences, VolumeMap
from slkit.errors import InputError
from slkit.geometry import Pose, Rig, pixel_grid, steeper_axis, working_volume
from slkit.protocols import Triangulator
from slkit.report.measure._alignment import rigid_alignment
from slkit.report.measure._points import Float64s, rms_of


@dataclass(frozen=True)
class VolumeError:
    """How far a rig puts points that the true rig knows: counts, and rms of the 3-vector error in mm.

    points: how many were compared; missing: how many the tested rig could not triangulate (left out of both rms);
    rms_mm: as is; aligned_mm: after the best rigid fit.
    """

    points: int
    missing: int
    rms_mm: float
    aligned_mm: float


def volume_error(
    rig: Rig,
    truth: Rig,
    triangulate: Triangulator,
    depths_mm: Sequence[float],
    step_px: int = 64,
    axis: int = 0,
) -> VolumeError:
    """Return the 3D error of a rig over the working volume.

    The true rig says which projector pixel lights each camera pixel of a grid (first pixel step_px / 2) at each depth,
    kept where it lies in the projector image; camera pixel and projector coordinate `axis` (0: column, 1: row) are
    exact, and `triangulate` with the tested rig must bring the point back.
    Errors: InputError where fewer than three points can be compared.
    """
    width, height = truth.camera.size
    start = step_px // 2
    camera_xy = np.stack(np.meshgrid(np.arange(start, width, step_px), np.arange(start, height, step_px)), axis=-1)
    expected, points = _brought_back(rig, truth, triangulate, depths_mm, camera_xy, axis)
    inside, there = np.isfinite(expected).all(axis=-1), np.isfinite(points).all(axis=-1)
    points, expected = points[there], expected[there]
    aligned = rigid_alignment(points, expected).apply(points)
    rms, rms_aligned = (rms_of(np.linalg.norm(p - expected, axis=1)) for p in (points, aligned))
    return VolumeError(len(points), int(inside.sum()) - len(points), rms, rms_aligned)


def volume_difference(
    a: Rig,
    b: Rig,
    triangulate: Triangulator,
    depths_mm: Sequence[float],
    align: bool = True,
    axis: int | None = None,
    step_px: float | None = None,
) -> VolumeMap:
    """Return how far apart two rigs put the same points, over the working volume of the first.

    Camera pixel and projector coordinate `axis` are exact for rig a, and `triangulate` brings the point back with rig
    b. align: after the rigid motion that brings all points of the map nearest. axis: 0: column, 1: row, default the one
    that tells depth better. step_px: of the grid of camera pixels, default a 24th of the longer side.
    Errors: InputError where fewer than three points can be compared.
    """
    camera_xy = pixel_grid(a.camera.size, step_px)
    chosen = steeper_axis(a, working_volume(a, camera_xy, depths_mm)[0]) if axis is None else axis
    expected, points = _brought_back(b, a, triangulate, depths_mm, camera_xy, chosen)
    there = np.isfinite(points).all(axis=-1)
    motion = rigid_alignment(points[there], expected[there]) if align else Pose(np.eye(3), np.zeros(3))
    value = np.linalg.norm(motion.apply(points) - expected, axis=-1)
    return VolumeMap(np.asarray(depths_mm, dtype=np.float64), camera_xy, value)


def _brought_back(
    rig: Rig,
    truth: Rig,
    triangulate: Triangulator,
    depths_mm: Sequence[float],
    camera_xy: npt.NDArray[np.number[Any]],
    axis: int,
) -> tuple[Float64s, Float64s]:
    """Return the true rig's points (d, r, c, 3) mm over the volume, and those that another rig makes of their pixels.

    NaN where the projector of the true rig does not reach, or where the other rig finds no point.
    """
    expected, projector_xy = working_volume(truth, camera_xy, depths_mm)
    inside = np.isfinite(expected).all(axis=-1)
    coded = projector_xy[inside]
    coded[:, 1 - axis] = np.nan
    rows = len(coded)
    pixels = np.broadcast_to(camera_xy, (*inside.shape, 2))[inside]
    cloud = triangulate(
        Correspondences(
            pixels.astype(np.float32),
            coded.astype(np.float32),
            np.full((rows, 2), np.nan, np.float32),
            np.ones(rows, np.float32),
            np.ones((rows, 3), np.float32),
        ),
        rig,
    )
    if len(cloud) != rows:
        raise InputError("rigs are compared by a triangulator that returns one point a row, such as ray_plane")
    points = np.full(expected.shape, np.nan)
    points[inside] = cloud.xyz
    if cloud.finite.sum() < 3:
        raise InputError("the two rigs share less than three points of the working volume: nothing to compare")
    return expected, points
