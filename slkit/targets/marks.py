"""Marks of 2 x 2 cells on a white plane: the place of the board, without hiding what is projected on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_floats
from slkit.targets._drawing import INK, PAPER, Ink, check_length, edge, grid, inside


@dataclass(frozen=True)
class CornerMarks:
    """Marks of 2 x 2 cells on a white plane. xy_mm: their centres in the board frame; cell_mm: side of a cell.

    The top-left and bottom-right cell of every mark are black. Errors: InputError for fewer than four marks.
    """

    xy_mm: tuple[tuple[float, float], ...]
    cell_mm: float

    def __post_init__(self) -> None:
        points = as_floats(self.xy_mm, (None, 2), "xy_mm")
        if len(points) < 4:
            raise InputError(f"xy_mm must hold four marks (TL TR BR BL) or more, not {len(points)}")
        check_length(self.cell_mm, "cell_mm")

    def points(self) -> npt.NDArray[np.float64]:
        """Return the centres (n, 2) in mm."""
        return np.array(self.xy_mm, dtype=np.float64)

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a margin of two cells around the marks: x min, y min, x max, y max in mm."""
        points, margin = self.points(), 3 * self.cell_mm
        (x0, y0), (x1, y1) = points.min(axis=0) - margin, points.max(axis=0) + margin
        return float(x0), float(y0), float(x1), float(y1)

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm."""
        place = np.asarray(xy, dtype=np.float64)
        ink = np.zeros(place.shape[:-1])
        footprint = footprint_mm / self.cell_mm
        reach = (1 + footprint / 2) * self.cell_mm
        for center in self.points():
            # Most of the sheet is blank: only places that a mark's ink can reach are worth the arithmetic.
            near = (np.abs(place[..., 0] - center[0]) <= reach) & (np.abs(place[..., 1] - center[1]) <= reach)
            local = (place[near] - center) / self.cell_mm
            black = 0.5 + 0.5 * edge(local[..., 0], footprint) * edge(local[..., 1], footprint)
            ink[near] += black * inside(local, np.array([-1.0, -1.0]), np.array([1.0, 1.0]), footprint)
        return PAPER + (INK - PAPER) * ink

    def ink(self) -> Ink:
        """Return the black cells, two a mark."""
        before = (self.points()[:, None] + np.array([[-1.0, -1.0], [0.0, 0.0]]) * self.cell_mm).reshape(-1, 2)
        return Ink.of_boxes(np.concatenate([before, before + self.cell_mm], axis=1))


@dataclass(frozen=True)
class BorderMarks:
    """Twelve marks of 2 x 2 cells around a white plane, which give its pose more surely than four.

    size_mm: width and height of the rectangle on which their centres lie, the origin in its middle; cell_mm: side of a
    cell. Each side holds four marks at equal distances. Errors: InputError for lengths that cannot be.
    """

    kind: Literal["border"] = field(default="border", kw_only=True)
    size_mm: tuple[float, float]
    cell_mm: float

    def __post_init__(self) -> None:
        for length in self.size_mm:
            check_length(length, "size_mm")
        check_length(self.cell_mm, "cell_mm")
        if min(self.size_mm) < 9 * self.cell_mm:
            raise InputError(
                f"size_mm = {list(self.size_mm)} leaves no white between marks of {self.cell_mm} mm cells: "
                "each side must be at least nine cells long"
            )

    def points(self) -> npt.NDArray[np.float64]:
        """Return the centres (12, 2) in mm: TL TR BR BL, then the others row by row."""
        at = grid((4, 4)) / 3 - 0.5
        corners = [0, 3, 15, 12]
        others = [1, 2, 4, 7, 8, 11, 13, 14]
        return at[corners + others] * np.array(self.size_mm)

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a margin of two cells around the marks: x min, y min, x max, y max in mm."""
        return self.marks.extent()

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm."""
        return self.marks.reflectance(xy, footprint_mm)

    def ink(self) -> Ink:
        """Return the black cells, two a mark."""
        return self.marks.ink()

    @property
    def marks(self) -> CornerMarks:
        """The same marks, one by one."""
        return CornerMarks(tuple((float(x), float(y)) for x, y in self.points()), self.cell_mm)
