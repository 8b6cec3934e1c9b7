"""Numbers: alignment, planes, distances to a mesh, a scan against its truth, a rig against the true rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import _open3d
from slkit.data import Correspondences, PointCloud, VolumeMap
from slkit.errors import InputError
from slkit.geometry import Pose, Rig, pixel_grid, steeper_axis, working_volume
from slkit.protocols import Triangulator

Float64s = npt.NDArray[np.float64]


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


@dataclass(frozen=True)
class ScanError:
    """How far a scan is from the true surface.

    points: scanned points at pixels that see the object; rms_mm and median_mm: unsigned distance to the surface,
    outliers left out; outliers: share of the points beyond the outlier limit; completeness: share of the true pixels
    with a scanned point close by. NaN where there is nothing to measure.
    """

    points: int
    rms_mm: float
    median_mm: float
    outliers: float
    completeness: float


def rigid_alignment(a: npt.ArrayLike, b: npt.ArrayLike) -> Pose:
    """Return b_from_a, the rotation and shift without scale that brings points a (n, 3) nearest to points b (n, 3), mm.

    Errors: InputError for different shapes or fewer than three points, or points on one line.
    Source: Kabsch (1976), with the determinant's sign of Umeyama (1991).
    """
    pa, pb = _points(a, "a"), _points(b, "b")
    if pa.shape != pb.shape or len(pa) < 3:
        raise InputError(f"an alignment needs three or more pairs of points, not {len(pa)} and {len(pb)}")
    ca, cb = pa.mean(axis=0), pb.mean(axis=0)
    u, s, vt = np.linalg.svd((pa - ca).T @ (pb - cb))
    if s[1] <= 1e-12 * s[0] or s[0] == 0:
        raise InputError("an alignment needs points that are not all on one line")
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = vt.T @ flip @ u.T
    return Pose(rotation, cb - rotation @ ca)


def plane_fit(xyz: npt.ArrayLike) -> tuple[Float64s, float, float]:
    """Return normal (3,), offset in mm and rms distance in mm of the least-squares plane normal . X = offset.

    xyz (n, 3) mm; the offset is not negative. Errors: InputError for fewer than three points.
    """
    points = _points(xyz, "xyz")
    if len(points) < 3:
        raise InputError(f"a plane needs three or more points, not {len(points)}")
    center = points.mean(axis=0)
    # The 3 x 3 moments suffice: an SVD of a million rows would cost a second.
    moments = (points - center).T @ (points - center)
    normal = np.linalg.eigh(moments)[1][:, 0]
    offset = float(normal @ center)
    normal, offset = (normal, offset) if offset >= 0 else (-normal, -offset)
    return normal, offset, _rms(points @ normal - offset)


def distances_to_mesh(xyz: npt.ArrayLike, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Float64s:
    """Return the unsigned distance (n,) mm of points (n, 3) to the nearest triangle of a mesh.

    vertices (v, 3) mm; faces (f, 3) indices. Errors: InputError for a mesh without faces.
    """
    corners, triangles = _points(vertices, "vertices"), np.asarray(faces)
    if triangles.ndim != 2 or triangles.shape[1:] != (3,) or not len(triangles):
        raise InputError("a mesh needs faces, three vertex numbers each")
    o3d = _open3d.load()
    scene: Any = o3d.t.geometry.RaycastingScene()
    # Open3D measures in float32: near the origin of the mesh it loses least.
    origin = corners.mean(axis=0)
    tensor = o3d.core.Tensor
    scene.add_triangles(
        tensor((corners - origin).astype(np.float32)), tensor(np.ascontiguousarray(triangles, dtype=np.uint32))
    )
    points = np.ascontiguousarray(_points(xyz, "xyz") - origin, dtype=np.float32)
    return scene.compute_distance(tensor(points)).numpy().astype(np.float64)


def cloud_against_truth(
    cloud: PointCloud,
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    truth_camera_xy: npt.NDArray[np.integer[Any]],
    truth_xyz: npt.ArrayLike,
    outlier_mm: float = 2.0,
    near_mm: float = 1.0,
) -> ScanError:
    """Return how far a scan is from the surface it should show.

    vertices (v, 3) mm, faces (f, 3): the true surface; truth_camera_xy (n, 2): the camera pixels that see it lit, with
    the surface points truth_xyz (n, 3) mm there. Only points whose nearest camera pixel is among those count; points
    farther than outlier_mm from the surface are counted apart. Completeness asks for a scanned point within near_mm.
    """
    points = cloud.select(cloud.finite)
    points = points.select(_at_pixels(points.camera_xy, truth_camera_xy))
    if not len(points):
        return ScanError(0, np.nan, np.nan, np.nan, 0.0)
    from scipy.spatial import KDTree

    away = distances_to_mesh(points.xyz, vertices, faces)
    good = away[away <= outlier_mm]
    gap = KDTree(points.xyz).query(_points(truth_xyz, "truth_xyz"), distance_upper_bound=near_mm, workers=-1)[0]
    median = float(np.median(good)) if len(good) else np.nan
    return ScanError(len(points), _rms(good), median, 1 - len(good) / len(away), float(np.isfinite(gap).mean()))


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
    rms, rms_aligned = (_rms(np.linalg.norm(p - expected, axis=1)) for p in (points, aligned))
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


def _at_pixels(camera_xy: npt.NDArray[np.float32], pixels: npt.NDArray[np.integer[Any]]) -> npt.NDArray[np.bool_]:
    """Mask (m,) of the positions whose nearest pixel is one of `pixels` (n, 2)."""
    if not len(pixels):
        return np.zeros(len(camera_xy), dtype=bool)
    width, height = (int(n) + 1 for n in np.asarray(pixels).max(axis=0))
    mask = np.zeros((width, height), dtype=bool)
    mask[pixels[:, 0], pixels[:, 1]] = True
    col, row = np.rint(np.nan_to_num(camera_xy, nan=-1)).astype(np.intp).T
    inside = (col >= 0) & (row >= 0) & (col < width) & (row < height)
    inside[inside] = mask[col[inside], row[inside]]
    return inside


def _points(value: npt.ArrayLike, name: str) -> Float64s:
    points = np.asarray(value, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{name} must have the shape n x 3, not {points.shape}")
    return points


def _rms(values: Float64s) -> float:
    return float(np.sqrt(np.mean(values * values))) if len(values) else float("nan")
