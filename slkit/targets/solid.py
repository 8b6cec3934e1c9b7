"""A reference object: a printed sheet folded along straight lines, so that its faces stand at known angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Pose, as_floats
from slkit.targets._drawing import check_length
from slkit.targets.projected import ProjectedCheckerboard
from slkit.targets.tags import TagMarks

Floats = npt.NDArray[np.float64]
_LEAST_ANGLE = 0.1
"""Faces whose normals lie on one line but for this much (singular value, about 8 degrees) are no solid."""


@dataclass(frozen=True)
class Face:
    """One flat face of a folded sheet.

    extent_mm: x min, y min, x max, y max of the part of the sheet that it is; turn_deg: axis times angle in degrees,
    shift_mm: what then is added, which take points (x, y, 0) of the sheet to the object.
    Errors: InputError for an empty part or values that cannot be.
    """

    extent_mm: tuple[float, float, float, float]
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        x0, y0, x1, y1 = as_floats(self.extent_mm, (4,), "extent_mm")
        as_floats(self.turn_deg, (3,), "turn_deg")
        as_floats(self.shift_mm, (3,), "shift_mm")
        if not (x0 < x1 and y0 < y1):
            raise InputError(f"extent_mm must be x min, y min, x max, y max, not {list(self.extent_mm)}")

    @property
    def solid_from_face(self) -> Pose:
        """The motion from the sheet to the object, mm."""
        return Pose.from_rotation_vector(np.radians(self.turn_deg), self.shift_mm)

    def holds(self, xy: npt.ArrayLike, margin_mm: float = 0.0) -> npt.NDArray[np.bool_]:
        """Return which places (..., 2) mm of the sheet lie on this face, its border moved in by a margin in mm."""
        x, y = np.moveaxis(np.asarray(xy, dtype=np.float64), -1, 0)
        x0, y0, x1, y1 = self.extent_mm
        inside = (x >= x0 + margin_mm) & (x <= x1 - margin_mm) & (y >= y0 + margin_mm) & (y <= y1 - margin_mm)
        return np.asarray(inside)

    def outline(self) -> Floats:
        """Return the corners (4, 2) in mm on the sheet, TL TR BR BL."""
        x0, y0, x1, y1 = self.extent_mm
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


@dataclass(frozen=True)
class SolidTarget:
    """A sheet with numbered tags, folded to two or more flat faces that do not lie in one plane.

    faces: their parts of the sheet and their places; xy_mm: centres of the tags on the unfolded sheet, number 0 first;
    tag_mm: side of a tag's black border; dictionary: of the tags. Two tags or more on each face, far apart.
    Errors: InputError for a tag that is not on one face whole, or faces that do not give a solid.
    """

    faces: tuple[Face, ...]
    xy_mm: tuple[tuple[float, float], ...]
    tag_mm: float
    dictionary: str = "apriltag_25h9"

    def __post_init__(self) -> None:
        check_length(self.tag_mm, "tag_mm")
        points = self.sheet.points().reshape(-1, 4, 2)
        on = np.array([face.holds(points).all(axis=1) for face in self.faces]).reshape(-1, len(points))
        for number, count in enumerate(on.sum(axis=0)):
            if count != 1:
                where = "no face" if count == 0 else "several faces"
                raise InputError(
                    f"tag {number} at {list(self.xy_mm[number])} mm must lie on one face, but is on {where}"
                )
        for number, count in enumerate(on.sum(axis=1)):
            if count < 2:
                raise InputError(f"faces[{number}] carries {count} tags, but two or more are needed")
        normals = np.array([face.solid_from_face.rotation[:, 2] for face in self.faces]).reshape(-1, 3)
        if len(normals) < 2 or np.linalg.svd(normals, compute_uv=False)[1] < _LEAST_ANGLE:
            raise InputError("the faces must stand at an angle to each other: check turn_deg")

    @classmethod
    def book(cls, page_mm: tuple[float, float], tag_mm: float, angle_deg: float = 100.0) -> SolidTarget:
        """Return two pages (width, height) that meet in the vertical line x = 0, the printed sides outside.

        angle_deg: between the pages, inside the object; 180 is flat.
        """
        (w, h), turn = page_mm, (180 - angle_deg) / 2
        faces = Face((-w, -h / 2, 0, h / 2), (0, turn, 0)), Face((0, -h / 2, w, h / 2), (0, -turn, 0))
        return cls(faces, _centers(faces, tag_mm), tag_mm)

    @classmethod
    def cube_corner(cls, side_mm: float, tag_mm: float) -> SolidTarget:
        """Return three squares of an L-shaped sheet that fold to the corner of a cube, the printed sides outside.

        The corner, where the squares meet, is the origin.
        """
        s = side_mm
        faces = Face((-s, -s, 0, 0)), Face((0, -s, s, 0), (0, -90, 0)), Face((-s, 0, 0, s), (90, 0, 0))
        return cls(faces, _centers(faces, tag_mm), tag_mm)

    @property
    def sheet(self) -> TagMarks:
        """What is printed, unfolded."""
        return TagMarks(self.xy_mm, self.tag_mm, self.dictionary)

    def face_of(self, xy: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Return on which face places (n, 2) mm of the sheet lie, -1 where on none."""
        on = np.array([face.holds(xy) for face in self.faces])
        return np.where(on.any(axis=0), on.argmax(axis=0), -1)


@dataclass(frozen=True)
class ProjectedFaces:
    """Checkerboards in the projector image, one for each face of an object, in the order of its faces.

    Errors: InputError for boards that overlap.
    """

    boards: tuple[ProjectedCheckerboard, ...]

    def __post_init__(self) -> None:
        low, high = (np.array(v).reshape(-1, 2) for v in zip(*(_outer(b) for b in self.boards), strict=True))
        for first in range(len(low)):
            for second in range(first):
                if (np.minimum(high[first], high[second]) > np.maximum(low[first], low[second])).all():
                    raise InputError(f"boards[{second}] and boards[{first}] overlap in the projector image")

    def points(self) -> Floats:
        """Return the inner corners (n, 2) in projector px, board by board."""
        return np.concatenate([board.points() for board in self.boards])

    def draw(self, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
        """Return the pattern (h, w) for a projector of size (w, h), black squares on white, edges filtered."""
        return np.minimum.reduce([board.draw(size) for board in self.boards])


def _outer(board: ProjectedCheckerboard) -> tuple[Floats, Floats]:
    """Return the first and the last outer corner of a checkerboard, each (2,) px."""
    first = np.array(board.first_xy)
    return first - board.step_px, first + np.array(board.corners) * board.step_px


def _centers(faces: tuple[Face, ...], tag_mm: float) -> tuple[tuple[float, float], ...]:
    """Return a tag's centre (x, y) mm in each corner of each face, a third of a tag of white around it."""
    inset = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * tag_mm * 5 / 6
    return tuple((float(x), float(y)) for face in faces for x, y in face.outline() + inset)
