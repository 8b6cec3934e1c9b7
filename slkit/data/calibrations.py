"""A calibration and the evidence for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data.views import BoardView
from slkit.geometry import Pose, Rig

Doubles = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class ViewResult:
    """How one view of a calibration fared.

    rms in px, NaN where the view has no such points: rms_camera and rms_projector under the view's own pose
    (rms_device), rms_joint with both under the one shared pose. reason: why it was not used, or what to know; else "".
    Of a view that was used also, one row a row of `view`: pose camera_from_board; camera_xy_error and
    projector_xy_error (n, 2) px, what the rig predicts minus what was seen, NaN where nothing was; kept (n,): rows that
    were not rejected; board: which of the method's boards the view shows.
    """

    name: str
    used: bool
    reason: str = ""
    rms_camera: float = float("nan")
    rms_projector: float = float("nan")
    rms_joint: float = float("nan")
    view: BoardView | None = None
    pose: Pose | None = None
    camera_xy_error: Doubles | None = None
    projector_xy_error: Doubles | None = None
    kept: npt.NDArray[np.bool_] | None = None
    board: int = 0


@dataclass(frozen=True)
class Finding:
    """One reason of a verdict: what is wrong, in which view ("" = all), and what to do about it.

    code: the fault's name for programs, such as `keystone`; "" for a remark that names no fault. limit: the best grade
    that a calibration can have with it, "" where the code and the view say it.
    """

    fault: str
    view: str
    remedy: str
    code: str = ""
    limit: str = ""


@dataclass(frozen=True)
class Verdict:
    """A grade, good, usable or bad, and the reasons for it in order of weight."""

    grade: str
    reasons: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class ResidualClass:
    """One kind of residuals: how many rows, how many of them rejected, and how they scatter.

    dof: residuals minus the parameters that they pay for; sigma_px: 1 sigma of one coordinate in px, dof counted.
    scale: by how much the scatter exceeds what was claimed beforehand (decoded codes claim their own sigma), else 1.
    """

    rows: int
    rejected: int
    dof: float
    sigma_px: float
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class VolumeMap:
    """A length in mm over the working volume.

    depths_mm (d,); camera_xy (r, c, 2) px; value_mm (d, r, c), NaN where camera or projector does not reach.
    """

    depths_mm: Doubles
    camera_xy: Doubles
    value_mm: Doubles

    @property
    def rms_mm(self) -> float:
        """Root of the mean square over the volume, NaN for an empty one."""
        known = self.value_mm[np.isfinite(self.value_mm)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


@dataclass(frozen=True, eq=False)
class ViewPlace:
    """Where a device sees the board of one view.

    coverage (3, 3): points in each ninth of the image, row by row; depth_mm: of its nearest and its farthest point;
    tilt_deg: of its normal against the device's axis, NaN for a solid.
    """

    coverage: npt.NDArray[np.intp]
    depth_mm: tuple[float, float]
    tilt_deg: float


@dataclass(frozen=True, eq=False)
class DeviceDiagnosis:
    """What the views say of one device.

    coverage (3, 3): points in each ninth of the image, row by row; depth_mm, tilt_deg: least and largest of the board's
    middle and of its normal against the device's axis; parameters: name to value and 1 sigma; views: by name.
    """

    coverage: npt.NDArray[np.intp]
    depth_mm: tuple[float, float]
    tilt_deg: tuple[float, float]
    parameters: Mapping[str, tuple[float, float]]
    views: Mapping[str, ViewPlace] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The numbers behind a verdict.

    devices: `camera` and `projector`. correlations: pairs of parameters above 0.99 and the correlation. repeating: per
    residual class the board points (n, 2) mm or projector px, the mean residual (n, 2) px of each over the views, and
    the 1 sigma (n,) of that mean. left_out_px: per view the rms error of a rig solved without it, left_out_rms_px over
    all. cross_validation: distance between two rigs solved from half of the views each, after rigid alignment, and
    cross_validation_noise_mm: what the covariances of both rigs let expect of it, as its rms.
    uncertainty: 1 sigma of the 3D error that the covariance predicts. None, or empty, where it cannot be had.
    """

    devices: Mapping[str, DeviceDiagnosis]
    correlations: tuple[tuple[str, str, float], ...] = ()
    repeating: Mapping[str, tuple[Doubles, Doubles, Doubles]] = field(default_factory=dict)
    left_out_px: Mapping[str, float] = field(default_factory=dict)
    left_out_rms_px: float = float("nan")
    cross_validation: VolumeMap | None = None
    uncertainty: VolumeMap | None = None
    cross_validation_noise_mm: float = float("nan")


@dataclass(frozen=True, eq=False)
class Calibration:
    """A rig and the evidence for it.

    rms_camera, rms_projector: rms_device in px, each device with its own pose per view; rms_joint: camera and
    projector residuals pooled under the shared pose, unweighted. covariance: {"parameters": names, "matrix": (p, p)}
    of the solver, 1 sigma squared, or None. classes: the kinds of residuals. diagnosis: what `pipeline.diagnose` adds.
    """

    rig: Rig
    method: str
    views: tuple[ViewResult, ...]
    rms_camera: float
    rms_projector: float
    rms_joint: float
    covariance: Mapping[str, Any] | None
    verdict: Verdict
    notes: tuple[str, ...] = ()
    classes: Mapping[str, ResidualClass] = field(default_factory=dict)
    diagnosis: Diagnosis | None = None
