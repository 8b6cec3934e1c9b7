"""Rigid motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry.checks import Floats, as_floats

MOTION_NAMES = ("rx", "ry", "rz", "tx", "ty", "tz")
"""A small motion in front of a pose: a rotation vector in radians, then mm."""


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion, named `b_from_a`: it takes points of frame a to frame b.

    rotation (3, 3), orthonormal with determinant +1; translation (3,) in mm.
    Errors: InputError where the rotation is not a rotation.
    """

    rotation: Floats
    translation: Floats

    def __post_init__(self) -> None:
        rotation = as_floats(self.rotation, (3, 3), "rotation")
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise InputError("rotation must be orthonormal with determinant +1")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", as_floats(self.translation, (3,), "translation"))

    @classmethod
    def identity(cls) -> Pose:
        """Return the pose that moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotation_vector(cls, vector: npt.ArrayLike, translation: npt.ArrayLike) -> Pose:
        """Return the pose that turns by |vector| radians about vector (3,) and then shifts by translation (3,) mm.

        Source: Rodrigues' formula.
        """
        v = as_floats(vector, (3,), "rotation vector")
        angle = float(np.linalg.norm(v))
        x, y, z = v
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        sine = np.sinc(angle / np.pi)
        cosine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
        return cls(np.eye(3) + sine * cross + cosine * cross @ cross, np.asarray(translation, dtype=np.float64))

    @property
    def rotation_vector(self) -> npt.NDArray[np.float64]:
        """The rotation as an axis times an angle in radians, (3,)."""
        # The quaternion is the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix: stable at every angle.
        r = self.rotation
        k = np.empty((4, 4))
        k[:3, :3] = r + r.T - np.trace(r) * np.eye(3)
        k[3, :3] = k[:3, 3] = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
        k[3, 3] = np.trace(r)
        q = np.linalg.eigh(k)[1][:, -1]
        q = q if q[3] >= 0 else -q
        length = float(np.linalg.norm(q[:3]))
        scale = 2.0 if length < 1e-12 else 2 * np.arctan2(length, q[3]) / length
        return scale * q[:3]

    @property
    def angle_deg(self) -> float:
        """The angle of the rotation in degrees, 0 to 180."""
        return float(np.degrees(np.linalg.norm(self.rotation_vector)))

    def __matmul__(self, other: Pose) -> Pose:
        """Return the pose that applies `other` first: c_from_b @ b_from_a is c_from_a."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        """Return a_from_b."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, xyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Move points (..., 3) in mm."""
        return np.asarray(np.asarray(xyz, dtype=np.float64) @ self.rotation.T + self.translation, dtype=np.float64)
