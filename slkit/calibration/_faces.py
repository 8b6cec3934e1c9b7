"""Views of an object with flat faces: its tags, and the parts of a projected pattern that fall on each face."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration.detect import homography, picture_size, spacing_of, to_8bit
from slkit.calibration.projected import find_projected
from slkit.calibration.tags import find_tags
from slkit.data import BoardView, Image
from slkit.geometry import transformed
from slkit.targets import Face, ProjectedCheckerboard, ProjectedFaces, SolidTarget

Points = npt.NDArray[np.float64]

_FEWEST_POINTS = 8
"""Printed points by which a face is found, the corners of two tags: those of one would place its far end badly."""
_CLEAR = 0.4
"""How far a projected corner must stay from the edge of its face and from print, in projected squares."""


def observe_solid(name: str, white: Image, pattern: Image, target: SolidTarget, projected: ProjectedFaces) -> BoardView:
    """Return the view of an object from its pictures under white light and under the pattern, or one that says why not.

    The tags give the homography of every face, and each projected checkerboard is looked for on its own face. Corners
    near the edge of a face or near print are left out.
    """
    size = picture_size(white)
    tags = find_tags(to_8bit(white), target.sheet)
    if tags is None:
        return BoardView.unusable(name, size, "the picture under white light shows none of the object's tags")
    board_xy, face = target.sheet.points(), target.face_of(target.sheet.points())
    seen = np.isfinite(tags).all(axis=1)
    lit: list[Points] = []
    labels: list[Points] = []
    on: list[int] = []
    notes: list[str] = []
    for number, (one, board) in enumerate(zip(target.faces, projected.boards, strict=True)):
        mine = seen & (face == number)
        if mine.sum() < _FEWEST_POINTS:
            notes.append(f"face {number} shows fewer than two tags")
            continue
        found = _lit_corners(white, pattern, one, homography(board_xy[mine], tags[mine]), target, board)
        if isinstance(found, str):
            notes.append(f"face {number}: {found}")
            continue
        lit.append(found[0])
        labels.append(found[1])
        on += [number] * len(found[0])
        notes += [f"face {number}: {note}" for note in found[2]]
    if not on:
        return BoardView.unusable(name, size, f"no projected corner lies on a face; {'; '.join(notes)}")
    camera_xy = np.concatenate([tags[seen], *lit])
    silent, exact = np.full((int(seen.sum()), 2), np.nan), np.zeros((len(on), 2))
    return BoardView(
        name,
        size,
        np.concatenate([board_xy[seen], np.full_like(exact, np.nan)]),
        camera_xy,
        np.concatenate([silent, *labels]),
        np.concatenate([silent, exact]),
        notes=tuple(notes),
        face=np.concatenate([face[seen], np.array(on, dtype=np.intp)]),
    )


def _lit_corners(
    white: Image, pattern: Image, face: Face, matrix: Points, target: SolidTarget, projected: ProjectedCheckerboard
) -> tuple[Points, Points, tuple[str, ...]] | str:
    """Return projected corners on one face, camera px and projector px (n, 2) each, with notes, or why there are none.

    matrix (3, 3): homography from the sheet in mm to the picture.
    """
    outline = transformed(matrix, face.outline())
    size = np.array(picture_size(white))
    low = np.clip(np.floor(outline.min(axis=0)), 0, size - 1).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)) + 1, low + 1, size).astype(int)
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    inside: Any = np.zeros(white[window].shape[:2], np.uint8)
    inside = cv2.fillConvexPoly(inside, np.rint(outline - low).astype(np.int32), 1).astype(bool)
    # Beside the face the pattern is as bright as white light: there no corner is seen.
    inside = inside.reshape(inside.shape + (1,) * (white.ndim - 2))
    found = find_projected(np.where(inside, pattern[window], white[window]), white[window], projected)
    if isinstance(found, str):
        return found
    corners = (found[0] + low).reshape(-1, 2)
    back = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    places = transformed(back, np.nan_to_num(corners))
    steps = spacing_of(places.reshape(found[0].shape)).ravel()
    away = np.abs(places[:, None] - target.sheet.centers()).max(axis=2).min(axis=1)
    margin = _CLEAR * float(np.median(steps))
    good = np.isfinite(corners).all(axis=1) & face.holds(places, margin) & (away > target.tag_mm / 2 + margin)
    if not good.any():
        return "all projected corners lie too near its edge or its tags"
    return corners[good], projected.points()[good], found[1]
