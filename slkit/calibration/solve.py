"""From board views to lenses and poses: Zhang's camera, board poses, the projector by DLT and least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration._normal import lens_columns
from slkit.calibration._parameters import (
    Array,
    covariance_of,
    homogeneous_zero,
    left_jacobian,
    moved_pose,
    pose_scale,
    rms,
)
from slkit.calibration._state import moved_lens
from slkit.calibration.model import Lens
from slkit.data import BoardView, Finding
from slkit.errors import CalibrationError, InputError
from slkit.geometry import LENS_NAMES, RIG_NAMES, Pinhole, Pose, as_size, homogeneous, project_with_derivatives

_SAME_DEG = 1.0
"""Refinement often takes both planar solutions to one pose; closer than this they are one."""
MIRRORED = Finding(
    "the projected image is mirrored",
    "",
    "switch off the projector's setting for rear projection, and take all views again",
    "mirrored",
)
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)


@dataclass(frozen=True, eq=False)
class ProjectorFit:
    """A projector located from points in the camera frame.

    residual_xy (m, 2): projected minus known projector px; covariance (p, p) of `parameters`, 1 sigma squared,
    given the points.
    """

    projector: Pinhole
    projector_from_camera: Pose
    residual_xy: Array
    parameters: tuple[str, ...]
    covariance: Array

    @property
    def rms(self) -> float:
        """Reprojection error, sqrt(mean(dx^2 + dy^2)) in px."""
        return rms(self.residual_xy)


def calibrate_camera(
    views: Sequence[BoardView], size: tuple[int, int], lens: Lens | None = None
) -> tuple[Pinhole, list[Pose]]:
    """Return the camera, and one pose camera_from_board a view, from the printed points of the views.

    size (w, h) px; lens: what is estimated. OpenCV knows no skew, and no p1 without p2: these are left to refinement.
    Errors: CalibrationError where OpenCV finds no camera. Source: Zhang (2000), as in cv2.calibrateCamera.
    """
    lens = lens or Lens()
    objects = [homogeneous_zero(v.board_xy[v.printed]) for v in views]
    images = [v.camera_xy[v.printed] for v in views]
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            objects,
            [image.astype(np.float32) for image in images],
            size,
            np.eye(3),
            np.zeros(5),
            flags=_fixed_flags(lens.distortion),
            criteria=_CRITERIA,
        )
    except cv2.error as error:
        raise CalibrationError(f"the camera cannot be calibrated from these {len(views)} views: {error.err}") from error
    camera = Pinhole(size, np.asarray(matrix, dtype=np.float64), np.ravel(np.asarray(distortion, dtype=np.float64))[:5])
    return lens.held(camera), [
        Pose.from_rotation_vector(np.ravel(r), np.ravel(t)) for r, t in zip(turns, shifts, strict=True)
    ]


def board_pose(camera: Pinhole, board_xy: Array, camera_xy: Array) -> tuple[Pose, float, float]:
    """Return the pose camera_from_board, its residual rms in px, and how many times worse the other solution fits.

    board_xy (n, 2) mm, camera_xy (n, 2) px, n >= 4. Both solutions of the planar problem are refined by least squares
    on the pixels and the better one is kept. Errors: CalibrationError where there is none.
    Source: Collins and Bartoli, IPPE (2014), as in cv2.solvePnPGeneric; Fernandez and Salvi (2011), section III-B.
    """
    points = homogeneous_zero(board_xy).astype(np.float64)
    undistorted = camera.normalize(camera_xy)
    try:
        found, turns, shifts, _ = cv2.solvePnPGeneric(points, undistorted, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    except cv2.error as error:
        raise CalibrationError(f"no pose explains the marks: {error.err}") from error
    solutions: list[tuple[float, Pose]] = []
    for turn, shift in zip(turns, shifts, strict=True) if found else ():
        pose = _refine_pose(camera, points, camera_xy, Pose.from_rotation_vector(np.ravel(turn), np.ravel(shift)))
        if (pose.apply(points)[:, 2] > 0).all():
            solutions.append((rms(camera.project(pose.apply(points)) - camera_xy), pose))
    if not solutions:
        raise CalibrationError("no pose explains the marks: is their order TL TR BR BL, and are xy_mm right?")
    (best, pose), *others = sorted(solutions, key=lambda s: s[0])
    distinct = [error for error, other in others if (pose.inverse() @ other).angle_deg > _SAME_DEG]
    return pose, best, min(distinct, default=np.inf) / max(best, 1e-6)


def _refine_pose(camera: Pinhole, points: Array, camera_xy: Array, start: Pose) -> Pose:
    from scipy.optimize import least_squares

    def residuals(motion: Array) -> Array:
        return np.nan_to_num(camera.project(moved_pose(start, motion).apply(points)) - camera_xy, nan=1e6).ravel()

    def jacobian(motion: Array) -> Array:
        turned = points @ moved_pose(start, motion).rotation.T
        _, slope, _ = project_with_derivatives(camera, moved_pose(start, motion).apply(points))
        # The motion turns about its own, finite, vector: its derivative is that of the turn times this.
        turn = np.cross(turned[:, None], slope) @ left_jacobian(motion[:3])
        return np.nan_to_num(np.concatenate([turn, slope], axis=2)).reshape(-1, 6)

    found = least_squares(residuals, np.zeros(6), jac=jacobian, x_scale=pose_scale(start), method="lm")  # pyright: ignore[reportArgumentType]
    return moved_pose(start, found.x)


def solve_projector(
    camera_xyz: npt.ArrayLike,
    projector_xy: npt.ArrayLike,
    size: tuple[int, int],
    distortion: Sequence[str] = ("k1", "k2"),
    lens: Lens | None = None,
) -> ProjectorFit:
    """Return the projector that lights points of the camera frame, with one shared rotation and translation.

    camera_xyz (m, 3) mm and projector_xy (m, 2) px, or both with leading axes such as (views, corners, .); rows with
    NaN are left out. size (w, h) px. distortion: the coefficients that are estimated; lens: instead of it, all that is
    estimated. The principal point is free, unless the lens holds it, and may lie outside the image.
    Errors: InputError for wrong shapes; CalibrationError for fewer than eight points or points in one plane.
    Source: Fernandez and Salvi (2011), section III-E; DLT and RQ, then Levenberg-Marquardt.
    """
    from scipy.linalg import block_diag
    from scipy.optimize import least_squares

    lens = lens or Lens(tuple(distortion))
    size = as_size(size, "size")
    xyz = np.asarray(camera_xyz, dtype=np.float64).reshape(-1, 3)
    pixels = np.asarray(projector_xy, dtype=np.float64).reshape(-1, 2)
    if len(xyz) != len(pixels):
        raise InputError(f"camera_xyz has {len(xyz)} points, but projector_xy has {len(pixels)}")
    known = np.isfinite(xyz).all(axis=1) & np.isfinite(pixels).all(axis=1)
    xyz, pixels = xyz[known], pixels[known]
    start = linear_projector(xyz, pixels, size)
    device, pose = lens.held(start.projector), start.projector_from_camera
    spread = np.stack(lens_columns(np.eye(10), lens), axis=1)
    scale = np.concatenate([spread.T @ np.repeat([device.K[0, 0], 1.0], 5), pose_scale(pose)])

    def split(step: Array) -> tuple[Pinhole, Pose]:
        return moved_lens(device, spread @ step[:-6]), moved_pose(pose, step[-6:])

    def residuals(step: Array) -> Array:
        found, moved = split(step)
        return np.nan_to_num(found.project(moved.apply(xyz)) - pixels, nan=1e6).ravel()

    found = least_squares(residuals, 0 * scale, x_scale=scale, method="lm", xtol=1e-12, ftol=1e-12)
    device, pose = split(found.x)
    free = np.abs(spread).sum(axis=1) > 0
    carry = np.asarray(block_diag(spread[free], np.eye(6)))
    covariance = carry @ covariance_of(found.jac, found.fun) @ carry.T
    names = [f"projector.{n}" for n, is_free in zip(LENS_NAMES, free, strict=True) if is_free]
    parameters = (*names, *RIG_NAMES[-6:])
    return ProjectorFit(device, pose, found.fun.reshape(-1, 2), parameters, covariance)


def linear_projector(xyz: Array, pixels: Array, size: tuple[int, int]) -> ProjectorFit:
    """Return the distortion-free projector by the direct linear transform, skew dropped, principal point anywhere.

    xyz (m, 3) mm, pixels (m, 2) px. Errors: CalibrationError for fewer than eight points or points in one plane.
    """
    if len(xyz) < 8:
        raise CalibrationError(f"the projector needs at least eight points, not {len(xyz)}")
    spread = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    if spread[2] < 1e-3 * spread[0]:
        raise CalibrationError("all points lie in one plane: take views of the board at several depths and tilts")
    to_unit, to_unit_px = _normalization(xyz), _normalization(pixels)
    point = homogeneous(xyz) @ to_unit.T
    x, y, _ = np.hsplit(homogeneous(pixels) @ to_unit_px.T, 3)
    zero = np.zeros_like(point)
    rows = np.concatenate([np.hstack([point, zero, -x * point]), np.hstack([zero, point, -y * point])])
    camera_matrix = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
    camera_matrix = np.linalg.inv(to_unit_px) @ camera_matrix @ to_unit
    # Points in front of the projector have a positive third coordinate; the transform leaves the sign open.
    if np.median(homogeneous(xyz) @ camera_matrix[2]) < 0:
        camera_matrix = -camera_matrix
    from scipy.linalg import rq

    upper, turn = rq(camera_matrix[:, :3])
    signs = np.sign(np.diag(upper))
    upper, turn = upper * signs, signs[:, None] * turn
    if np.linalg.det(turn) < 0:
        sentence = "the points and their projector pixels are mirrored: is the pattern projected mirrored?"
        raise CalibrationError(sentence, (MIRRORED,))
    translation = np.linalg.solve(upper, camera_matrix[:, 3])
    focal_x, focal_y = np.diag(upper)[:2] / upper[2, 2]
    center_x, center_y = upper[:2, 2] / upper[2, 2]
    matrix = np.array([[focal_x, 0, center_x], [0, focal_y, center_y], [0, 0, 1]])
    projector, pose = Pinhole(size, matrix, np.zeros(5)), Pose(turn, translation)
    residual = projector.project(pose.apply(xyz)) - pixels
    return ProjectorFit(projector, pose, residual, (), np.empty((0, 0)))


def _fixed_flags(free: Sequence[str]) -> int:
    flags = 0
    for name, flag in (("k1", cv2.CALIB_FIX_K1), ("k2", cv2.CALIB_FIX_K2), ("k3", cv2.CALIB_FIX_K3)):
        flags |= 0 if name in free else flag
    return flags | (0 if {"p1", "p2"} & set(free) else cv2.CALIB_ZERO_TANGENT_DIST)


def _normalization(points: Array) -> Array:
    """Return Hartley's similarity: centroid to the origin, mean distance sqrt(dimension)."""
    dimension = points.shape[1]
    center = points.mean(axis=0)
    scale = np.sqrt(dimension) / np.linalg.norm(points - center, axis=1).mean()
    matrix = np.eye(dimension + 1) * scale
    matrix[:dimension, -1] = -scale * center
    matrix[-1, -1] = 1
    return matrix
