"""Camera, projector and boards as shapes in the camera frame, for figures in space and in plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slkit.data import Calibration
from slkit.geometry import Floats, Pinhole, Pose, homogeneous
from slkit.report._canvas import CAMERA, PROJECTOR, image_corners, view_colors
from slkit.report._evidence import Placed

_FRUSTUM = 0.22
"""Length of a drawn frustum, as a part of the distance to the boards."""


@dataclass(frozen=True, eq=False)
class Device:
    """Camera or projector with its place and colour."""

    name: str
    lens: Pinhole
    camera_from_device: Pose
    color: str

    @property
    def center_xyz(self) -> Floats:
        """Its centre (3,) mm in the camera frame."""
        return self.camera_from_device.translation


def devices_of(calibration: Calibration) -> list[Device]:
    """Return camera and projector."""
    rig = calibration.rig
    return [
        Device("camera", rig.camera, Pose.identity(), CAMERA),
        Device("projector", rig.projector, rig.projector_from_camera.inverse(), PROJECTOR),
    ]


def frustum(device: Device, placed: Sequence[Placed]) -> Floats:
    """Return the corners (4, 3) mm of a device's image some way in front of it, in the camera frame."""
    length = _FRUSTUM * float(np.median([np.linalg.norm(p.middle_xyz) for p in placed]))
    lens = device.lens
    corners = image_corners(lens)
    # Beyond the fold of its distortion a lens has no ray; the undistorted corner then stands for it.
    straight, bent = Pinhole(lens.size, lens.K, np.zeros(5)).normalize(corners), lens.normalize(corners)
    return device.camera_from_device.apply(length * homogeneous(np.where(np.isfinite(bent), bent, straight)))


def board_colors(placed: Sequence[Placed]) -> list[Any]:
    """Return a colour a board: grey where only the camera used it."""
    lit = [p for p in placed if p.view.projected.any()]
    colors = dict(zip((p.number for p in lit), view_colors(len(lit)), strict=True))
    return [colors.get(p.number, "#9aa4ae") for p in placed]
