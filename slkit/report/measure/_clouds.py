"""A cloud against the true surface, given as a mesh, as points, or both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import _open3d
from slkit.data import PointCloud
from slkit.errors import InputError
from slkit.report.measure._points import Float64s, check_positive, finite_points, points_of, rms_of

_SAMPLES = 100_000
_R2 = np.array([0.7548776662466927, 0.5698402909980532])
"""The inverse of the plastic number and its square."""


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


@dataclass(frozen=True)
class CloudError:
    """How far a cloud is from the truth.

    points: of the cloud; outliers: share of them beyond the outlier limit; rms_mm, mean_mm, median_mm, p95_mm: unsigned
    distance to the truth, outliers left out; truth_points: what completeness is a share of; precision: share of the
    cloud within the tolerance of the truth; completeness: share of the truth with a point of the cloud within it;
    f_score: 2 precision completeness / (precision + completeness). NaN where there is nothing to measure.
    """

    points: int
    outliers: float
    rms_mm: float
    mean_mm: float
    median_mm: float
    p95_mm: float
    truth_points: int
    precision: float
    completeness: float
    f_score: float


def distances_to_mesh(xyz: npt.ArrayLike, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Float64s:
    """Return the unsigned distance (n,) mm of points (n, 3) to the nearest triangle of a mesh.

    vertices (v, 3) mm; faces (f, 3) indices. Errors: InputError for a mesh without faces.
    """
    corners, triangles = _mesh(vertices, faces)
    o3d = _open3d.load()
    scene: Any = o3d.t.geometry.RaycastingScene()
    # Open3D measures in float32: near the origin of the mesh it loses least.
    origin = corners.mean(axis=0)
    tensor = o3d.core.Tensor
    scene.add_triangles(
        tensor((corners - origin).astype(np.float32)), tensor(np.ascontiguousarray(triangles, dtype=np.uint32))
    )
    points = np.ascontiguousarray(points_of(xyz, "xyz") - origin, dtype=np.float32)
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
    gap = KDTree(points.xyz).query(points_of(truth_xyz, "truth_xyz"), distance_upper_bound=near_mm, workers=-1)[0]
    median = float(np.median(good)) if len(good) else np.nan
    return ScanError(len(points), rms_of(good), median, 1 - len(good) / len(away), float(np.isfinite(gap).mean()))


def compare_to_points(
    xyz: npt.ArrayLike, truth_xyz: npt.ArrayLike, tolerance_mm: float = 1.0, outlier_mm: float = 2.0
) -> CloudError:
    """Return how far a cloud (n, 3) mm is from points (t, 3) mm of the true surface, both without rows that are NaN.

    The distance of a point is that to the nearest true one: the spacing of these is in it, a mesh has none.
    Errors: InputError without true points, and for limits that are not positive.
    Source: Knapitsch et al., Tanks and Temples (2017), precision, recall (here completeness) and F-score.
    """
    from scipy.spatial import KDTree

    points, truth = finite_points(xyz, "xyz"), _truth(truth_xyz)
    return _cloud_error(KDTree(truth).query(points, workers=-1)[0], points, truth, tolerance_mm, outlier_mm)


def compare_to_mesh(
    xyz: npt.ArrayLike,
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    truth_xyz: npt.ArrayLike | None = None,
    tolerance_mm: float = 1.0,
    outlier_mm: float = 2.0,
) -> CloudError:
    """Return how far a cloud (n, 3) mm is from a mesh, vertices (v, 3) mm and faces (f, 3).

    truth_xyz (t, 3) mm: the points of the mesh that a scan should show, default 100 000 even samples of all of it, of
    which one camera never sees more than about half. Rows that are NaN are left out.
    Errors and source as for `compare_to_points`; InputError for a mesh without faces.
    """
    points = finite_points(xyz, "xyz")
    truth = mesh_samples(vertices, faces, _SAMPLES) if truth_xyz is None else _truth(truth_xyz)
    return _cloud_error(distances_to_mesh(points, vertices, faces), points, truth, tolerance_mm, outlier_mm)


def mesh_samples(vertices: npt.ArrayLike, faces: npt.ArrayLike, count: int) -> Float64s:
    """Return points (count, 3) mm spread evenly over the area of a mesh, the same at every call.

    vertices (v, 3) mm; faces (f, 3) indices. Errors: InputError for a mesh without faces or without area.
    Source: systematic sampling along the cumulated area; within a triangle the sequence R2 of Roberts (2018), folded.
    """
    corners, triangles = _mesh(vertices, faces)
    base, second, third = np.moveaxis(corners[triangles], 1, 0)
    a, b = second - base, third - base
    reached = np.cumsum(np.linalg.norm(np.cross(a, b), axis=1))
    if not reached[-1] > 0:
        raise InputError("the mesh has no area: are its vertices in mm, and its faces theirs?")
    steps = np.arange(count) + 0.5
    chosen = np.minimum(np.searchsorted(reached, steps / count * reached[-1], side="right"), len(reached) - 1)
    u, v = (steps[:, None] * _R2 % 1).T
    outside = u + v > 1
    u[outside], v[outside] = 1 - u[outside], 1 - v[outside]
    return base[chosen] + u[:, None] * a[chosen] + v[:, None] * b[chosen]


def _cloud_error(
    away: Float64s, points: Float64s, truth: Float64s, tolerance_mm: float, outlier_mm: float
) -> CloudError:
    from scipy.spatial import KDTree

    check_positive(tolerance_mm, "tolerance_mm")
    check_positive(outlier_mm, "outlier_mm")
    if not len(points):
        return CloudError(0, np.nan, np.nan, np.nan, np.nan, np.nan, len(truth), np.nan, 0.0, 0.0)
    good = away[away <= outlier_mm]
    mean = float(good.mean()) if len(good) else np.nan
    median, p95 = np.quantile(good, [0.5, 0.95]).tolist() if len(good) else (np.nan, np.nan)
    gap = KDTree(points).query(truth, distance_upper_bound=np.nextafter(tolerance_mm, np.inf), workers=-1)[0]
    precision, completeness = float((away <= tolerance_mm).mean()), float(np.isfinite(gap).mean())
    both = precision + completeness
    return CloudError(
        len(points),
        1 - len(good) / len(points),
        rms_of(good),
        mean,
        median,
        p95,
        len(truth),
        precision,
        completeness,
        2 * precision * completeness / both if both else 0.0,
    )


def _truth(truth_xyz: npt.ArrayLike) -> Float64s:
    truth = finite_points(truth_xyz, "truth_xyz")
    if not len(truth):
        raise InputError("truth_xyz has no point: there is nothing to compare the cloud with")
    return truth


def _mesh(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> tuple[Float64s, npt.NDArray[np.integer[Any]]]:
    corners, triangles = points_of(vertices, "vertices"), np.asarray(faces)
    if triangles.ndim != 2 or triangles.shape[1:] != (3,) or not len(triangles):
        raise InputError("a mesh needs faces, three vertex numbers each")
    return corners, triangles


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
