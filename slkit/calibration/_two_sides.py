"""What methods with a two-sided board share: looking at both sides, and placing them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from slkit.calibration import solve
from slkit.calibration._observe import Marks, Printed, Projected, observe_printed, observe_white
from slkit.calibration.detect import picture_size, usual_size, wrong_size
from slkit.calibration.model import Lens
from slkit.data import BoardView, Capture, Image
from slkit.errors import CalibrationError
from slkit.geometry import Pinhole, Pose

SIDES = ("side A", "side B")
_AMBIGUOUS = 2.0
"""A board pose whose mirror solution fits less than this many times worse is reported."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Both sides of a board in space.

    views: as they were given, with what is to be said of their poses; poses: camera_from_board by name; sides: by name
    0 for side A and 1 for side B.
    """

    camera: Pinhole
    views: list[BoardView]
    poses: dict[str, Pose]
    sides: dict[str, int]


def observe_sides(
    captures: Sequence[Capture], printed: Printed, marks: Marks | Printed, projected: Projected
) -> list[BoardView]:
    """Return one view a capture: printed corners of side A, or what gives the pose of side B and projected corners.

    A picture in which nothing is found, or of another size than most, becomes a view that says so.
    """
    size = usual_size([picture for c in captures if (picture := _picture(c)) is not None])
    return [_observe(c, size, printed, marks, projected) for c in captures]


def place_sides(views: Sequence[BoardView], lens: Lens) -> Placed:
    """Return the camera by Zhang's method from side A, and the pose of every view from its printed points.

    Errors: CalibrationError for fewer than two views of a side.
    """
    usable = [v for v in views if v.problem is None]
    printed = [v for v in usable if not v.projected.any()]
    white = [v for v in usable if v.projected.any()]
    for found, side in ((printed, "side A (printed checkerboard)"), (white, "side B (marks and projection)")):
        if len(found) < 2:
            raise CalibrationError(f"{len(found)} usable views of {side}, but at least two are needed")
    camera, poses = solve.calibrate_camera(printed, printed[0].image_size, lens)
    placed = {v.name: _placed(camera, v) for v in white}
    known = {name: pose for name, (_, pose) in placed.items() if pose is not None}
    if len(known) < 2:
        raise CalibrationError(f"{len(known)} views of side B have a pose, but at least two are needed")
    known |= {v.name: pose for v, pose in zip(printed, poses, strict=True)}
    shown = [placed[v.name][0] if v.name in placed else v for v in views]
    return Placed(camera, shown, known, {v.name: int(v.name in placed) for v in shown})


def _observe(
    capture: Capture, size: tuple[int, int], printed: Printed, marks: Marks | Printed, projected: Projected
) -> BoardView:
    pictures = (capture.printed, capture.marks, capture.projected)
    for picture in pictures:
        if picture is not None and picture_size(picture) != size:
            return BoardView.unusable(capture.name, size, wrong_size(picture, size))
    if capture.printed is not None:
        return observe_printed(capture.name, capture.printed, printed)
    if capture.marks is None or capture.projected is None:
        return BoardView.unusable(capture.name, size, "side B needs a picture under white light and one of the pattern")
    return observe_white(capture.name, capture.marks, capture.projected, marks, projected)


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
