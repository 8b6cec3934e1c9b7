"""The planar method: a two-sided board, printed for the camera, white with corner marks for the projector.

Source: Fernandez and Salvi, Planar-based camera-projector calibration (2011). Their equation (6) maps an image point
to the camera frame by a 3 x 3 homography, which carries no depth; the viewing ray is intersected with the board
instead, which is what the equation stands for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slkit.calibration import solve
from slkit.calibration._observe import observe_printed, observe_white
from slkit.calibration._parameters import DEFAULT_DISTORTION, Array, check_distortion
from slkit.calibration._results import calibration
from slkit.calibration.detect import picture_size, wrong_size
from slkit.calibration.joint import covariance_in_sequence, points_of, residuals_of
from slkit.data import BoardView, Calibration, Capture, Image
from slkit.errors import CalibrationError
from slkit.geometry import Pinhole, Pose, Rig, as_size
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard

_AMBIGUOUS = 2.0
"""A board pose whose mirror solution fits less than this many times worse is reported."""


@dataclass(frozen=True)
class Planar:
    """Calibrate by the paper's method.

    projector: size (w, h) px; printed: side A; marks: side B; projected: the checkerboard in the projector image.
    camera_distortion, projector_distortion: the coefficients of k1 k2 p1 p2 k3 that are estimated, the others are 0.
    Errors: InputError for a projector size or a coefficient that cannot be.
    """

    projector: tuple[int, int]
    printed: Checkerboard
    marks: CornerMarks
    projected: ProjectedCheckerboard
    camera_distortion: tuple[str, ...] = DEFAULT_DISTORTION
    projector_distortion: tuple[str, ...] = DEFAULT_DISTORTION

    def __post_init__(self) -> None:
        as_size(self.projector, "projector")
        check_distortion(self.camera_distortion, "camera_distortion")
        check_distortion(self.projector_distortion, "projector_distortion")

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        """Return one view a capture: printed corners of side A, or marks and projected corners of side B.

        A picture in which nothing is found, or of another size than the first, becomes a view that says so.
        """
        sizes = [picture_size(picture) for c in captures if (picture := _picture(c)) is not None]
        return [self._observe(c, sizes[0] if sizes else (1, 1)) for c in captures]

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig: camera by Zhang's method, board poses from the marks, projector from all points at once.

        Errors: CalibrationError for fewer than two views of a side, or views that do not determine the rig.
        """
        usable = [v for v in views if v.problem is None]
        printed = [v for v in usable if not v.projected.any()]
        white = [v for v in usable if v.projected.any()]
        for found, side in ((printed, "side A (printed checkerboard)"), (white, "side B (marks and projection)")):
            if len(found) < 2:
                raise CalibrationError(f"{len(found)} usable views of {side}, but at least two are needed")
        camera, poses_a = solve.calibrate_camera(printed, printed[0].image_size, self.camera_distortion)
        placed = {v.name: _placed(camera, v) for v in white}
        white = [v for v, _ in placed.values() if v.problem is None]
        if len(white) < 2:
            raise CalibrationError(f"{len(white)} views of side B have a pose, but at least two are needed")
        poses = {name: pose for name, (_, pose) in placed.items() if pose is not None}
        points = {v.name: points_of(camera, poses[v.name], v) for v in white}
        xyz = np.concatenate([points[v.name][v.projected] for v in white])
        pixels = np.concatenate([v.projector_xy[v.projected] for v in white])
        projector = solve.solve_projector(xyz, pixels, self.projector, self.projector_distortion)
        rig = Rig(camera, projector.projector, projector.projector_from_camera)

        joint = {v.name: residuals_of(rig, p, v) for v, p in zip(printed, poses_a, strict=True)}
        joint |= {v.name: residuals_of(rig, poses[v.name], v) for v in white}
        alone = self._projector_alone(rig, white, poses, points)
        own = dict(joint) | {v.name: (joint[v.name][0], r) for v, r in zip(white, alone, strict=True)}
        parameters, covariance = covariance_in_sequence(
            rig,
            [*poses_a, *poses.values()],
            [*printed, *white],
            self.camera_distortion,
            self.projector_distortion,
        )
        shown = [placed[v.name][0] if v.name in placed else v for v in views]
        return calibration("planar", rig, shown, own, joint, parameters, covariance)

    def _projector_alone(
        self, rig: Rig, white: Sequence[BoardView], poses: Mapping[str, Pose], points: Mapping[str, Array]
    ) -> list[Array]:
        """Return the projector's residuals (n, 2) px a view, each view with a pose of its own."""
        boards = [poses[v.name].inverse().apply(points[v.name][v.projected])[:, :2] for v in white]
        pixels = [v.projector_xy[v.projected] for v in white]
        return solve.calibrate_alone(boards, pixels, rig.projector, self.projector_distortion)

    def _observe(self, capture: Capture, size: tuple[int, int]) -> BoardView:
        pictures = (capture.printed, capture.marks, capture.projected)
        for picture in pictures:
            if picture is not None and picture_size(picture) != size:
                return BoardView.unusable(capture.name, size, wrong_size(picture, size))
        if capture.printed is not None:
            return observe_printed(capture.name, capture.printed, self.printed)
        if capture.marks is None or capture.projected is None:
            return BoardView.unusable(
                capture.name, size, "side B needs a picture under white light and one of the pattern"
            )
        return observe_white(capture.name, capture.marks, capture.projected, self.marks, self.projected)


def _placed(camera: Pinhole, view: BoardView) -> tuple[BoardView, Pose | None]:
    """Return a view of side B, with what is to be said of its pose, and the pose; None where there is none."""
    try:
        pose, _, ratio = solve.board_pose(camera, view.board_xy[view.printed], view.camera_xy[view.printed])
    except CalibrationError as error:
        return BoardView.unusable(view.name, view.image_size, str(error)), None
    if ratio < _AMBIGUOUS:
        note = f"its pose is ambiguous (the mirrored one fits only {ratio:.1f} times worse): tilt the board more"
        view = replace(view, notes=(*view.notes, note))
    return view, pose


def _picture(capture: Capture) -> Image | None:
    return capture.printed if capture.printed is not None else capture.marks
