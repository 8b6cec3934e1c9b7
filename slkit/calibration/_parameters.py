"""The numbers that a calibration estimates: lenses, poses, and their covariance.

Angles and lengths of a pose are refined as a small motion in front of it, so that no rotation is singular.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Pinhole, Pose

Array = npt.NDArray[np.float64]
DISTORTION_NAMES = ("k1", "k2", "p1", "p2", "k3")
DEFAULT_DISTORTION = ("k1", "k2", "p1", "p2")


def rms(residual_xy: Array) -> float:
    """Return sqrt(mean(dx^2 + dy^2)) of residuals (m, 2) px, NaN without residuals."""
    return float(np.sqrt((residual_xy**2).sum(axis=1).mean())) if len(residual_xy) else float("nan")


def check_distortion(free: Sequence[str], name: str) -> None:
    """Refuse unknown distortion coefficients. Errors: InputError naming the field `name`."""
    for coefficient in free:
        if coefficient not in DISTORTION_NAMES:
            known = ", ".join(DISTORTION_NAMES)
            raise InputError(f"{name}: there is no coefficient {coefficient!r}; there are {known}")
    if ("p1" in free) != ("p2" in free):
        raise InputError(f"{name}: p1 and p2 are estimated together or not at all")


def homogeneous_zero(xy: Array) -> npt.NDArray[np.float32]:
    """Return board points (n, 2) mm as (n, 3) with z = 0, float32 as OpenCV wants them."""
    return np.pad(xy, ((0, 0), (0, 1))).astype(np.float32)


class Device:
    """The free parameters of a pinhole: focal lengths, principal point and the chosen distortion coefficients."""

    def __init__(self, name: str, start: Pinhole, free: Sequence[str]) -> None:
        self._start = start
        self._free = [i for i, n in enumerate(DISTORTION_NAMES) if n in free]
        self.names = tuple(f"{name}.{p}" for p in ("fx", "fy", "cx", "cy", *(DISTORTION_NAMES[i] for i in self._free)))
        K = start.K
        self.values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *start.distortion[self._free]])
        self.scale = np.array([K[0, 0], K[1, 1], K[0, 0], K[1, 1], *([1.0] * len(self._free))])

    def at(self, values: Array) -> Pinhole:
        """Return the pinhole that `values` (p,), in the order of `names`, stand for."""
        K = np.array(self._start.K)
        K[0, 0], K[1, 1], K[0, 2], K[1, 2] = np.maximum(values[0], 1e-3), np.maximum(values[1], 1e-3), *values[2:4]
        distortion = np.array(self._start.distortion)
        distortion[self._free] = values[4:]
        return replace(self._start, K=K, distortion=distortion)


def moved_pose(pose: Pose, motion: Array) -> Pose:
    """Return a pose after a small motion (6,): rotation vector in radians, then translation in mm."""
    turn = Pose.from_rotation_vector(motion[:3], np.zeros(3)).rotation
    return Pose(turn @ pose.rotation, pose.translation + motion[3:])


def pose_scale(pose: Pose) -> Array:
    """Return what a motion (6,) of this pose is measured in: radians, and its distance in mm."""
    return np.array([1.0, 1.0, 1.0] + [max(float(np.linalg.norm(pose.translation)), 1e-3)] * 3)


def pose_names(name: str) -> tuple[str, ...]:
    """Return the names of a motion's six values."""
    return tuple(f"{name}.{part}" for part in ("rx", "ry", "rz", "tx", "ty", "tz"))


def covariance_of(jacobian: Array, residuals: Array) -> Array:
    """Return s^2 (J^T J)^-1 with s^2 = |r|^2 / (observations - parameters)."""
    observations, parameters = jacobian.shape
    if observations <= parameters:
        return np.full((parameters, parameters), np.inf)
    return float(residuals @ residuals) / (observations - parameters) * np.linalg.pinv(jacobian.T @ jacobian)
