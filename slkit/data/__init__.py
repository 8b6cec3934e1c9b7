"""What travels through slkit: pictures, correspondences, clouds, board views and calibrations.

All are frozen; the shape and unit of a field stand in the line below it.
"""

from __future__ import annotations

from slkit.data.calibrations import (
    Calibration,
    DeviceDiagnosis,
    Diagnosis,
    Finding,
    ResidualClass,
    Verdict,
    ViewPlace,
    ViewResult,
    VolumeMap,
)
from slkit.data.clouds import Correspondences, Float32s, PointCloud
from slkit.data.frames import Frames, Image, check_image, describe_image
from slkit.data.views import BoardView, Capture

__all__ = [
    "BoardView",
    "Calibration",
    "Capture",
    "Correspondences",
    "DeviceDiagnosis",
    "Diagnosis",
    "Finding",
    "Float32s",
    "Frames",
    "Image",
    "PointCloud",
    "ResidualClass",
    "Verdict",
    "ViewResult",
    "ViewPlace",
    "VolumeMap",
    "check_image",
    "describe_image",
]
