"""Everything at once: residuals of board views under a rig, and the rig that makes them smallest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

    camera, projector = Device("camera", rig.camera, camera_free), Device("projector", rig.projector, projector_free)
    shared = len(camera.values) + len(projector.values) + 6

    def split(values: Array) -> tuple[Rig, list[Pose]]:
        lenses, motion, placed = np.split(values, [shared - 6, shared])
        lens, light = np.split(lenses, [len(camera.values)])
        moved = Rig(camera.at(lens), projector.at(light), moved_pose(rig.projector_from_camera, motion))
        return moved, [moved_pose(p, m) for p, m in zip(poses, placed.reshape(-1, 6), strict=True)]

    def residuals(values: Array) -> list[Array]:
        moved, placed = split(values)
        pairs = [residuals_of(moved, pose, view) for pose, view in zip(placed, views, strict=True)]
        return [np.nan_to_num(np.concatenate(pair).ravel(), nan=1e6) for pair in pairs]

    motions = [pose_scale(p) for p in (rig.projector_from_camera, *poses)]
    scale = np.concatenate([camera.scale, projector.scale, *motions])

    def pooled(values: Array) -> Array:
        return np.concatenate(residuals(values))

    def jacobian(values: Array) -> Array:
        return _bordered_jacobian(residuals, values, scale, shared)

    x0 = np.concatenate([camera.values, projector.values, np.zeros(6 + 6 * len(poses))])
    found: Any = least_squares(pooled, x0, jac=jacobian, x_scale=scale, xtol=1e-12, ftol=1e-10)  # pyright: ignore
    refined, placed = split(found.x)
    names = (*camera.names, *projector.names, *pose_names("projector_from_camera"))
    covariance = covariance_of(found.jac, found.fun)[: len(names), : len(names)]
    return Refined(refined, tuple(placed), names, covariance)


def _bordered_jacobian(residuals: Callable[[Array], list[Array]], values: Array, scale: Array, shared: int) -> Array:
    """Return the Jacobian of residuals that come one array a view, by central differences.

    The first `shared` values act on every view, then six a view act on that view alone: these are shifted together.
    """
    steps = _STEP * scale
    ends = np.cumsum([len(r) for r in residuals(values)])
    jacobian = np.zeros((ends[-1], len(values)))
    for k in range(shared + 6):
        columns = [k] if k < shared else list(range(k, len(values), 6))
        shift = np.zeros(len(values))
        shift[columns] = steps[columns]
        pairs = zip(residuals(values + shift), residuals(values - shift), strict=True)
        for view, (above, below) in enumerate(pairs):
            column = k if k < shared else columns[view]
            jacobian[ends[view] - len(above) : ends[view], column] = (above - below) / (2 * steps[column])
    return jacobian


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
