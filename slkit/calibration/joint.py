"""Everything at once: residuals of board views under a rig, and the rig that makes them smallest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slkit.calibration._parameters import (
    Array,
    Device,
    covariance_of,
    homogeneous_zero,
    moved_pose,
    pose_names,
    pose_scale,
)
from slkit.data import BoardView
from slkit.geometry import Pinhole, Pose, Rig, homogeneous, intersect_plane

_STEP = 1e-6
"""Step of the numerical derivatives, in units of each value's scale."""


@dataclass(frozen=True, eq=False)
class Refined:
    """The result of `refine`: the rig, one pose camera_from_board a view, and the covariance of the named values."""

    rig: Rig
    poses: tuple[Pose, ...]
    parameters: tuple[str, ...]
    covariance: Array


def refine(
    rig: Rig,
    poses: Sequence[Pose],
    views: Sequence[BoardView],
    camera_free: Sequence[str],
    projector_free: Sequence[str],
) -> Refined:
    """Return camera, projector, their pose and all board poses refined together on all residuals of the views.

    poses: camera_from_board, one a view. The residuals are those of `residuals_of`, in px, unweighted: what
    cv2.stereoCalibrate minimises, with the principal points free to leave the images.
    """
    from scipy.optimize import least_squares

    problem = _Problem(rig, poses, views, camera_free, projector_free)
    found: Any = least_squares(
        problem.residuals,
        problem.start,
        jac=problem.jacobian,  # pyright: ignore[reportArgumentType]
        x_scale=problem.scale,
        xtol=1e-12,
        ftol=1e-10,
    )
    refined, placed = problem.split(found.x)
    count = len(problem.names)
    return Refined(refined, tuple(placed), problem.names, covariance_of(found.jac, found.fun)[:count, :count])


def covariance_in_sequence(
    rig: Rig,
    poses: Sequence[Pose],
    views: Sequence[BoardView],
    camera_free: Sequence[str],
    projector_free: Sequence[str],
) -> tuple[tuple[str, ...], Array]:
    """Return the names and covariance (p, p) of a rig whose projector was solved after camera and poses.

    The camera and the board poses scatter as their own residuals tell; the projector scatters with its residuals and,
    through the points that it is fitted to, with camera and poses. poses: camera_from_board, one a view.
    """
    problem = _Problem(rig, poses, views, camera_free, projector_free)
    jacobian, residuals = problem.jacobian(problem.start), problem.residuals(problem.start)
    of_camera = np.concatenate([np.repeat([True, False], [2 * v.printed.sum(), 2 * v.projected.sum()]) for v in views])
    lens = np.arange(len(problem.camera.values))
    last = np.arange(len(lens), problem.shared)
    first = np.setdiff1d(np.arange(len(problem.start)), last)
    before = covariance_of(jacobian[np.ix_(of_camera, first)], residuals[of_camera])
    after = jacobian[np.ix_(~of_camera, last)]
    carry = -np.linalg.lstsq(after, jacobian[np.ix_(~of_camera, first)], rcond=None)[0]
    own = covariance_of(after, residuals[~of_camera]) + carry @ before @ carry.T
    crossed = (carry @ before)[:, : len(lens)]
    return problem.names, np.block([[before[: len(lens), : len(lens)], crossed.T], [crossed, own]])


class _Problem:
    """Residuals of all views as a function of one vector: both lenses, the projector's pose, then six a board pose."""

    def __init__(
        self,
        rig: Rig,
        poses: Sequence[Pose],
        views: Sequence[BoardView],
        camera_free: Sequence[str],
        projector_free: Sequence[str],
    ) -> None:
        self._rig, self._poses, self._views = rig, poses, views
        self.camera = Device("camera", rig.camera, camera_free)
        self.projector = Device("projector", rig.projector, projector_free)
        self.shared = len(self.camera.values) + len(self.projector.values) + 6
        self.names = (*self.camera.names, *self.projector.names, *pose_names("projector_from_camera"))
        self.start = np.concatenate([self.camera.values, self.projector.values, np.zeros(6 + 6 * len(poses))])
        motions = [pose_scale(p) for p in (rig.projector_from_camera, *poses)]
        self.scale = np.concatenate([self.camera.scale, self.projector.scale, *motions])

    def split(self, values: Array) -> tuple[Rig, list[Pose]]:
        """Return the rig and the board poses that a vector stands for."""
        lenses, motion, placed = np.split(values, [self.shared - 6, self.shared])
        lens, light = np.split(lenses, [len(self.camera.values)])
        moved = moved_pose(self._rig.projector_from_camera, motion)
        rig = Rig(self.camera.at(lens), self.projector.at(light), moved)
        return rig, [moved_pose(p, m) for p, m in zip(self._poses, placed.reshape(-1, 6), strict=True)]

    def residuals(self, values: Array) -> Array:
        """Return all residuals, view by view, those of the camera first."""
        return np.concatenate(self._by_view(values))

    def jacobian(self, values: Array) -> Array:
        """Return the Jacobian of `residuals` by central differences.

        The shared values act on every view, then six a view act on that view alone: these are shifted together.
        """
        steps = _STEP * self.scale
        ends = np.cumsum([len(r) for r in self._by_view(values)])
        jacobian = np.zeros((ends[-1], len(values)))
        for k in range(self.shared + 6):
            columns = [k] if k < self.shared else list(range(k, len(values), 6))
            shift = np.zeros(len(values))
            shift[columns] = steps[columns]
            pairs = zip(self._by_view(values + shift), self._by_view(values - shift), strict=True)
            for view, (above, below) in enumerate(pairs):
                column = k if k < self.shared else columns[view]
                jacobian[ends[view] - len(above) : ends[view], column] = (above - below) / (2 * steps[column])
        return jacobian

    def _by_view(self, values: Array) -> list[Array]:
        rig, placed = self.split(values)
        pairs = [residuals_of(rig, pose, view) for pose, view in zip(placed, self._views, strict=True)]
        return [np.nan_to_num(np.concatenate(pair).ravel(), nan=1e6) for pair in pairs]


def residuals_of(rig: Rig, pose: Pose, view: BoardView) -> tuple[Array, Array]:
    """Return camera residuals (n, 2) px of the printed rows and projector residuals (m, 2) px of the projected rows.

    pose: camera_from_board, shared by both devices. A projected row that is not printed lies where its camera ray
    meets the board.
    """
    printed, projected = view.printed, view.projected
    camera = rig.camera.project(pose.apply(homogeneous_zero(view.board_xy[printed]))) - view.camera_xy[printed]
    if not projected.any():
        return camera, np.empty((0, 2))
    xyz = points_of(rig.camera, pose, view)[projected]
    return camera, rig.to_projector(xyz) - view.projector_xy[projected]


def points_of(camera: Pinhole, pose: Pose, view: BoardView) -> Array:
    """Return the camera-frame points (n, 3) mm of a view's rows: on the board where printed, else by their ray."""
    printed = view.printed
    normal = pose.rotation[:, 2]
    rays = homogeneous(camera.normalize(view.camera_xy[~printed]))
    points = np.empty((len(printed), 3))
    points[printed] = pose.apply(homogeneous_zero(view.board_xy[printed]))
    points[~printed] = intersect_plane(rays, normal, float(normal @ pose.translation))
    return points
