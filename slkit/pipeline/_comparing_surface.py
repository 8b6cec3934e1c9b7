"""A true surface to compare clouds with: as they are, or moved onto it first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.errors import InputError
from slkit.geometry import Pose, Rig
from slkit.pipeline._comparing_references import Float64s, Mask, Measured

_ICP_STEPS, _ICP_SAMPLES, _ICP_CONVERGED_MM = 50, 20_000, 1e-4
_ICP_OPEN = 1e-4
"""Curvature of the fit along a motion, as a share of the largest, at which the shape tells it; facets tell less."""


@dataclass(frozen=True, eq=False)
class Truth:
    """A true surface in the camera frame: vertices (v, 3) mm and faces (f, 3).

    seen_xyz (n, 3) mm: the points of it that camera and projector both see, None: found by tracing rays. near_mm: how
    near a point must come to make a true one complete; outlier_mm: from where on a point is an outlier. align: move
    each cloud onto the surface first. also_aligned: give the error after the best rigid motion too.
    """

    vertices: Float64s
    faces: npt.NDArray[np.integer[Any]]
    name: str
    near_mm: float = 1.0
    outlier_mm: float = 2.0
    align: bool = False
    also_aligned: bool = True
    seen_xyz: Float64s | None = None
    error: str = "rms_mm"

    @property
    def words(self) -> str:
        """What it is, for the report."""
        moved = "each cloud moved onto it first by a rigid motion (ICP)" if self.align else "not aligned"
        return (
            f"{self.name}, {moved}; outliers: farther than {self.outlier_mm:g} mm, left out of rms, median and 95 %; "
            f"complete: share of the surface that camera and projector see with a point within {self.near_mm:g} mm"
        )

    def measure(self, cloud: PointCloud, common: Mask, rig: Rig) -> Measured:
        """Return the distances to the surface. Errors: InputError where no point comes near it."""
        from slkit.report.measure import compare_to_mesh, distances_to_mesh

        numbers: dict[str, float] = {}
        notes: tuple[str, ...] = ()
        motion = Pose.identity()
        if self.align or self.also_aligned:
            best = surface_from_cloud(cloud.xyz, self.vertices, self.faces, self._reaches())
            if self.align:
                motion, notes, numbers = best, (f"moved onto the surface first: {_told(best)}",), _size(best)
                cloud = _moved(cloud, motion)
            else:
                after = distances_to_mesh(best.apply(cloud.xyz), self.vertices, self.faces)
                numbers["aligned_rms_mm"] = self._rms(after)
        front = _signed(cloud.xyz, self.vertices, self.faces, motion.apply(np.zeros(3)))
        away = np.abs(front)
        if not (away <= self.outlier_mm).any():
            raise InputError(
                f"no point lies within {self.outlier_mm:g} mm of {self.name}, the nearest {away.min():.1f} mm away: is "
                "it in mm and in the camera frame? Otherwise align first (--align), or allow more (--outlier)"
            )
        seen = self.seen_xyz
        if seen is None:
            # The rig sees the surface where it stood during the scan.
            seen = motion.apply(lit_points(motion.inverse().apply(self.vertices), self.faces, rig))
        error = compare_to_mesh(cloud.xyz, self.vertices, self.faces, seen, self.near_mm, self.outlier_mm)
        numbers |= {
            "completeness_share": error.completeness,
            "rms_mm": error.rms_mm,
            "median_mm": error.median_mm,
            "p95_mm": error.p95_mm,
            "outliers_share": error.outliers,
            "precision_share": error.precision,
            "f_score": error.f_score,
            "common_rms_mm": self._rms(away[common]),
        }
        flat = np.column_stack([cloud.xyz[:, :2].astype(np.float64), front])
        return Measured(numbers, front, cloud, notes, flat)

    def seen_by(self, rig: Rig) -> Truth:
        """Return the same with what a rig sees of it, found once for all clouds; as it is where these move first.

        Errors: InputError where the rig sees nothing of it.
        """
        if self.align or self.seen_xyz is not None:
            return self
        return replace(self, seen_xyz=lit_points(self.vertices, self.faces, rig))

    def _rms(self, away: Float64s) -> float:
        good = away[away <= self.outlier_mm]
        return float(np.sqrt(np.mean(good**2))) if len(good) else float("nan")

    def _reaches(self) -> tuple[float, ...]:
        """Return from how far points are drawn to the surface, mm, largest first."""
        size = float(np.linalg.norm(np.ptp(self.vertices, axis=0)))
        near = 3 * self.outlier_mm
        return (size, max(size / 5, near), max(size / 25, near), near) if self.align else (near,)


def surface_from_cloud(
    xyz: npt.ArrayLike, vertices: Float64s, faces: npt.NDArray[np.integer[Any]], reaches_mm: tuple[float, ...]
) -> Pose:
    """Return the rigid motion that brings points (n, 3) mm nearest to a mesh, from where they are.

    reaches_mm: how far a point may be from the surface to be drawn to it, one round each. A motion that the shape
    leaves open, such as the turn of a ball, is not made. Source: point to plane ICP of Chen and Medioni (1992).
    """
    points = np.asarray(xyz, dtype=np.float64)
    points = points[:: max(len(points) // _ICP_SAMPLES, 1)]
    closest = _closest(vertices, faces)
    motion = Pose.identity()
    for reach in reaches_mm:
        for _ in range(_ICP_STEPS):
            moved = motion.apply(points)
            foot, normal = closest(moved)
            near = np.linalg.norm(moved - foot, axis=1) <= reach
            step, size = _step(moved[near], foot[near], normal[near])
            motion = step @ motion
            if size < _ICP_CONVERGED_MM:
                break
    return motion


def _step(points: Float64s, foot: Float64s, normal: Float64s) -> tuple[Pose, float]:
    """Return the motion that brings points (n, 3) nearest to the planes through their feet, and its size in mm."""
    if len(points) < 6:
        return Pose.identity(), 0.0
    middle = points.mean(axis=0)
    arms = points - middle
    # In units of its size a body turns as far as it shifts.
    size = max(float(np.sqrt((arms * arms).sum(axis=1).mean())), 1e-9)
    slopes = np.concatenate([np.cross(arms / size, normal), normal], axis=1)
    values, vectors = np.linalg.eigh(slopes.T @ slopes)
    told = values > _ICP_OPEN * values[-1]
    wanted = vectors.T @ (slopes.T @ ((foot - points) * normal).sum(axis=1))
    motion = vectors @ np.where(told, wanted / np.where(told, values, 1.0), 0.0)
    turn = Pose.from_rotation_vector(motion[:3] / size, np.zeros(3)).rotation
    return Pose(turn, middle + motion[3:] - turn @ middle), float(np.linalg.norm(motion))


def _closest(
    vertices: Float64s, faces: npt.NDArray[np.integer[Any]]
) -> Callable[[Float64s], tuple[Float64s, Float64s]]:
    """Return a function that gives the nearest point of a mesh and its normal, (n, 3) each, of points (n, 3) mm."""
    from slkit import _open3d

    o3d = _open3d.load()
    scene: Any = o3d.t.geometry.RaycastingScene()
    # Open3D measures in float32: near the origin of the mesh it loses least.
    origin, tensor = vertices.mean(axis=0), o3d.core.Tensor
    scene.add_triangles(tensor((vertices - origin).astype(np.float32)), tensor(faces.astype(np.uint32)))

    def closest(points: Float64s) -> tuple[Float64s, Float64s]:
        found = scene.compute_closest_points(tensor((points - origin).astype(np.float32)))
        foot, normal = (found[name].numpy().astype(np.float64) for name in ("points", "primitive_normals"))
        return foot + origin, normal

    return closest


def _signed(xyz: npt.ArrayLike, vertices: Float64s, faces: npt.NDArray[np.integer[Any]], eye: Float64s) -> Float64s:
    """Return the distance (n,) mm of points (n, 3) to a mesh, positive on the side of the eye (3,)."""
    points = np.asarray(xyz, dtype=np.float64)
    step = points - _closest(vertices, faces)(points)[0]
    return np.where(((eye - points) * step).sum(axis=1) >= 0, 1.0, -1.0) * np.linalg.norm(step, axis=1)


def lit_points(vertices: Float64s, faces: npt.NDArray[np.integer[Any]], rig: Rig) -> Float64s:
    """Return the points (n, 3) mm of a mesh at the camera pixels that see it lit by the projector.

    Errors: InputError where there is none.
    """
    from slkit.simulation import SimulatedScanner, from_mesh

    seen = SimulatedScanner(from_mesh(vertices, np.asarray(faces)), rig).truth().xyz_mm
    if not len(seen):
        raise InputError(
            "camera and projector of this rig see no common part of the true mesh: is it in mm and in the camera frame?"
        )
    return seen


def _moved(cloud: PointCloud, motion: Pose) -> PointCloud:
    return replace(cloud, xyz=motion.apply(cloud.xyz).astype(np.float32))


def _size(motion: Pose) -> dict[str, float]:
    angle = np.degrees(np.arccos(np.clip((np.trace(motion.rotation) - 1) / 2, -1, 1)))
    return {"motion_mm": float(np.linalg.norm(motion.translation)), "motion_deg": float(angle)}


def _told(motion: Pose) -> str:
    size, shift = _size(motion), ", ".join(f"{v:.3f}" for v in motion.translation)
    return f"turned by {size['motion_deg']:.3f} degrees about the camera's centre, then shifted by ({shift}) mm"
