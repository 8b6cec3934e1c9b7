"""The planar method: a two-sided board, printed for the camera, white with corner marks for the projector.

Source: Fernandez and Salvi, Planar-based camera-projector calibration (2011). Their equation (6) maps an image point
to the camera frame by a 3 x 3 homography, which carries no depth; the viewing ray is intersected with the board
instead, which is what the equation stands for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from slkit.calibration import solve
from slkit.calibration._observe import Marks, Printed, Projected, observe_printed, observe_white
from slkit.calibration.detect import picture_size, wrong_size
from slkit.calibration.estimate import estimate
from slkit.calibration.model import Model
from slkit.data import BoardView, Calibration, Capture, Image
from slkit.errors import CalibrationError
from slkit.geometry import Pinhole, Pose, as_size

_SIDES = ("side A", "side B")
_AMBIGUOUS = 2.0
"""A board pose whose mirror solution fits less than this many times worse is reported."""


@dataclass(frozen=True)
class Planar:
    """Calibrate by the paper's method.

    projector: size (w, h) px; printed: side A; marks: side B; projected: the checkerboard in the projector image.
    model: what is estimated. Errors: InputError for a projector size that cannot be.
    """

    projector: tuple[int, int]
    printed: Printed
    marks: Marks
    projected: Projected
    model: Model = field(default_factory=Model)

    def __post_init__(self) -> None:
        as_size(self.projector, "projector")

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        """Return one view a capture: printed corners of side A, or marks and projected corners of side B.

        A picture in which nothing is found, or of another size than the first, becomes a view that says so.
        """
        sizes = [picture_size(picture) for c in captures if (picture := _picture(c)) is not None]
        return [self._observe(c, sizes[0] if sizes else (1, 1)) for c in captures]

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig: camera by Zhang's method, board poses from the marks, projector from all points at once.

        Unless the model says otherwise all of it is then adjusted together.

        Errors: CalibrationError for fewer than two views of a side, or views that do not determine the rig.
        """
        usable = [v for v in views if v.problem is None]
        printed = [v for v in usable if not v.projected.any()]
        white = [v for v in usable if v.projected.any()]
        for found, side in ((printed, "side A (printed checkerboard)"), (white, "side B (marks and projection)")):
            if len(found) < 2:
                raise CalibrationError(f"{len(found)} usable views of {side}, but at least two are needed")
        camera, poses = solve.calibrate_camera(printed, printed[0].image_size, self.model.camera)
        placed = {v.name: _placed(camera, v) for v in white}
        known = {name: pose for name, (_, pose) in placed.items() if pose is not None}
        if len(known) < 2:
            raise CalibrationError(f"{len(known)} views of side B have a pose, but at least two are needed")
        known |= {v.name: pose for v, pose in zip(printed, poses, strict=True)}
        shown = [placed[v.name][0] if v.name in placed else v for v in views]
        sides = {v.name: int(v.name in placed) for v in shown}
        return estimate("planar", shown, known, camera, self.projector, self.model, sides, sides=_SIDES)

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
