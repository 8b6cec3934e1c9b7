"""Views of a two-sided board from pictures: printed corners, marks, projected corners."""

from __future__ import annotations

import numpy as np

from slkit.calibration.detect import find_checkerboard, find_projected, picture_size, to_8bit
from slkit.calibration.marks import find_marks
from slkit.data import BoardView, Image
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard


def observe_printed(name: str, picture: Image, printed: Checkerboard) -> BoardView:
    """Return the view of a printed board in a picture; one that says so where the board was not found."""
    found = find_checkerboard(to_8bit(picture), printed.corners)
    if found is None:
        nx, ny = printed.corners
        problem = f"no printed checkerboard with {nx} x {ny} inner corners was found"
        return BoardView.unusable(name, picture_size(picture), problem)
    camera_xy = found.reshape(-1, 2)
    seen = np.isfinite(camera_xy).all(axis=1)
    silent = np.full((int(seen.sum()), 2), np.nan)
    return BoardView(name, picture_size(picture), printed.points()[seen], camera_xy[seen], silent, silent)


def observe_white(
    name: str, white: Image, pattern: Image, marks: CornerMarks, projected: ProjectedCheckerboard
) -> BoardView:
    """Return the view of side B from its pictures under white light and under the pattern, or one that says why not."""
    size = picture_size(white)
    centers = find_marks(to_8bit(white), marks)
    if centers is None:
        count = len(marks.xy_mm)
        return BoardView.unusable(name, size, f"the {count} corner marks were not found on the white side")
    found = find_projected(pattern, white, projected)
    if isinstance(found, str):
        return BoardView.unusable(name, size, found)
    corners, notes = found
    camera_xy = corners.reshape(-1, 2)
    seen = np.isfinite(camera_xy).all(axis=1)
    count, found_corners = len(centers), int(seen.sum())
    silent, exact = np.full((count, 2), np.nan), np.zeros((found_corners, 2))
    return BoardView(
        name,
        size,
        np.concatenate([marks.points(), np.full((found_corners, 2), np.nan)]),
        np.concatenate([centers, camera_xy[seen]]),
        np.concatenate([silent, projected.points()[seen]]),
        np.concatenate([silent, exact]),
        notes=notes,
    )
