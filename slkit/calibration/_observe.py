"""Views of a two-sided board from pictures: printed points, marks, projected corners."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from slkit.calibration.circles import find_circles
from slkit.calibration.detect import find_checkerboard, picture_size, to_8bit
from slkit.calibration.marks import find_marks
from slkit.calibration.projected import find_projected
from slkit.calibration.tags import find_charuco, find_tags
from slkit.data import BoardView, Image
from slkit.targets import (
    AprilTags,
    BorderMarks,
    Charuco,
    Checkerboard,
    CircleGrid,
    CornerMarks,
    ProjectedCharuco,
    ProjectedCheckerboard,
    TagMarks,
)

Printed: TypeAlias = Checkerboard | Charuco | AprilTags | CircleGrid
Marks: TypeAlias = CornerMarks | BorderMarks | TagMarks
Projected: TypeAlias = ProjectedCheckerboard | ProjectedCharuco


def observe_printed(name: str, picture: Image, printed: Printed) -> BoardView:
    """Return the view of a printed board in a picture; one that says so where the board was not found."""
    found = find_points(picture, printed)
    size = picture_size(picture)
    if found is None:
        return BoardView.unusable(name, size, f"no printed {_describe(printed)} was found")
    seen = np.isfinite(found).all(axis=1)
    silent = np.full((int(seen.sum()), 2), np.nan)
    return BoardView(name, size, printed.points()[seen], found[seen], silent, silent)


def observe_white(name: str, white: Image, pattern: Image, marks: Marks | Printed, projected: Projected) -> BoardView:
    """Return the view of side B from its pictures under white light and under the pattern, or one that says why not.

    marks: what gives the pose of the white board; a printed board in one of its corners serves too.
    """
    size = picture_size(white)
    place = find_points(white, marks)
    if place is None:
        return BoardView.unusable(name, size, f"the picture of the white side does not show the {_describe(marks)}")
    found = find_projected(pattern, white, projected)
    if isinstance(found, str):
        return BoardView.unusable(name, size, found)
    corners, notes = found
    corners = corners.reshape(-1, 2)
    on_board, lit = np.asarray(np.isfinite(place).all(axis=1)), np.asarray(np.isfinite(corners).all(axis=1))
    silent, exact = np.full((int(on_board.sum()), 2), np.nan), np.zeros((int(lit.sum()), 2))
    if isinstance(marks, TagMarks) and not on_board.all():
        notes = (*notes, f"{on_board.sum() // 4} of {len(on_board) // 4} tags were seen")
    return BoardView(
        name,
        size,
        np.concatenate([marks.points()[on_board], np.full_like(exact, np.nan)]),
        np.concatenate([place[on_board], corners[lit]]),
        np.concatenate([silent, projected.points()[lit]]),
        np.concatenate([silent, exact]),
        notes=notes,
    )


def find_points(picture: Image, target: Marks | Printed) -> npt.NDArray[np.float64] | None:
    """Return the points (n, 2) px of a printed target in the order of `target.points()`, or None where it is not found.

    NaN for a point that is not seen.
    """
    image = to_8bit(picture)
    if isinstance(target, CornerMarks | BorderMarks):
        return find_marks(image, target)
    if isinstance(target, AprilTags | TagMarks):
        return find_tags(image, target)
    if isinstance(target, CircleGrid):
        return find_circles(image, target)
    found = find_charuco(image, target) if isinstance(target, Charuco) else find_checkerboard(image, target.corners)
    return None if found is None else found.reshape(-1, 2)


def _describe(target: Marks | Printed) -> str:
    """Return what a target is, in words for a message."""
    if isinstance(target, CornerMarks | BorderMarks):
        return f"{len(target.points())} corner marks"
    if isinstance(target, AprilTags | TagMarks):
        return f"{len(target.centers())} tags of {target.dictionary}"
    if isinstance(target, CircleGrid):
        return f"grid of {target.circles[0]} x {target.circles[1]} circles"
    kind = "ChArUco board" if isinstance(target, Charuco) else "checkerboard"
    return f"{kind} with {target.corners[0]} x {target.corners[1]} inner corners"
