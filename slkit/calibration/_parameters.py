"""Small motions of poses, rms and covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.geometry import Pose, flat

Array = npt.NDArray[np.floating[Any]]


def rms(residual_xy: Array) -> float:
    """Return sqrt(mean(dx^2 + dy^2)) of residuals (m, 2) px, NaN without residuals."""
    return float(np.sqrt((residual_xy**2).sum(axis=1).mean())) if len(residual_xy) else float("nan")


def homogeneous_zero(xy: Array) -> npt.NDArray[np.float32]:
    """Return board points (n, 2) mm as (n, 3) with z = 0, float32 as OpenCV wants them."""
    return flat(xy).astype(np.float32)


def moved_pose(pose: Pose, motion: Array) -> Pose:
    """Return a pose after a small motion (6,): rotation vector in radians, then translation in mm."""
    turn = Pose.from_rotation_vector(motion[:3], np.zeros(3)).rotation
    return Pose(turn @ pose.rotation, pose.translation + motion[3:])


def left_jacobian(vector: Array) -> Array:
    """Return (3, 3) how the turn by a rotation vector (3,) itself turns, in front of it, when the vector changes.

    Source: the left Jacobian of the rotation group.
    """
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = float(np.linalg.norm(vector))
    if angle < 1e-6:
        return np.eye(3) + cross / 2
    return np.eye(3) + (1 - np.cos(angle)) / angle**2 * cross + (angle - np.sin(angle)) / angle**3 * cross @ cross


def pose_scale(pose: Pose) -> Array:
    """Return what a motion (6,) of this pose is measured in: radians, and its distance in mm."""
    return np.array([1.0, 1.0, 1.0] + [max(float(np.linalg.norm(pose.translation)), 1e-3)] * 3)


def covariance_of(jacobian: Array, residuals: Array) -> Array:
    """Return s^2 (J^T J)^-1 with s^2 = |r|^2 / (observations - parameters)."""
    observations, parameters = jacobian.shape
    if observations <= parameters:
        return np.full((parameters, parameters), np.inf)
    return float(residuals @ residuals) / (observations - parameters) * np.linalg.pinv(jacobian.T @ jacobian)
