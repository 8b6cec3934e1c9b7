"""A camera, a projector, and where the projector stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.geometry.lenses import LENS_NAMES, Pinhole
from slkit.geometry.poses import MOTION_NAMES, Pose
from slkit.geometry.rays import homogeneous, intersect_rays

RIG_NAMES = (
    *(f"camera.{n}" for n in LENS_NAMES),
    *(f"projector.{n}" for n in LENS_NAMES),
    *(f"projector_from_camera.{n}" for n in MOTION_NAMES),
)
"""The parameters of a rig that move points, in the order of every derivative over a rig."""


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera and a projector, and where the projector stands.

    projector_from_camera takes camera-frame points (mm) to the projector's frame. covariance maps names to arrays as
    the solver left them; photometry maps names to arrays (colour mixing, response).
    """

    camera: Pinhole
    projector: Pinhole
    projector_from_camera: Pose
    covariance: Mapping[str, Any] | None = None
    photometry: Mapping[str, Any] | None = None

    @property
    def projector_center(self) -> npt.NDArray[np.float64]:
        """The projector's centre in the camera frame, (3,) mm."""
        return np.array(self.projector_from_camera.inverse().translation, dtype=np.float64)

    def to_projector(self, xyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the projector pixels (..., 2) that light camera-frame points (..., 3) in mm."""
        return self.projector.project(self.projector_from_camera.apply(xyz))

    def meet(self, camera_xy: npt.ArrayLike, projector_xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the camera-frame points (..., 3) mm half-way between the rays of pixels (..., 2) of both devices.

        NaN for a pixel that is not known; infinite or NaN for parallel rays.
        """
        rays = homogeneous(self.camera.normalize(camera_xy))
        light = homogeneous(self.projector.normalize(projector_xy)) @ self.projector_from_camera.rotation
        return intersect_rays(np.zeros(3), rays, self.projector_center, light)[0]


def sigmas_of(covariance: Mapping[str, Any] | None) -> dict[str, float]:
    """Return 1 sigma of every parameter that a covariance names, in radians for rotations; empty without one."""
    if covariance is None:
        return {}
    variances = np.diag(np.asarray(covariance["matrix"], dtype=np.float64))
    return dict(zip(covariance["parameters"], np.sqrt(np.maximum(variances, 0)).tolist(), strict=True))
