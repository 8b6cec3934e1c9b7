"""Boards, marks and projected patterns: where their points are, and how they look.

One description serves the printer, the simulator and the detector. Board frames have x right, y down, millimetres;
reflectance is a continuous function of the place, so that every picture of a target is filtered, never aliased.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_floats, as_size

INK = 0.06
"""Reflectance of printed black."""
PAPER = 0.9
"""Reflectance of blank paper."""
ORIGIN_MARK_RADIUS = 0.22
"""Radius of an origin mark, in squares."""
MINIMUM_SQUARES = (5, 4)


@runtime_checkable
class Target(Protocol):
    """A flat printed target: its points, its size, and its reflectance."""

    def points(self) -> npt.NDArray[np.float64]:
        """Return the known points (n, 2) in mm, board frame."""
        ...

    def extent(self) -> tuple[float, float, float, float]:
        """Return the smallest sheet: x min, y min, x max, y max in mm."""
        ...

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm averaged over a footprint in mm."""
        ...


@dataclass(frozen=True)
class Checkerboard:
    """A printed checkerboard. corners: inner corners, x then y; square_mm: side of a square.

    Its first inner corner is the origin of the board frame. Errors: InputError for fewer than 3 x 3 inner corners.
    """

    corners: tuple[int, int]
    square_mm: float

    def __post_init__(self) -> None:
        _check_corners(self.corners)
        if not 0 < self.square_mm < np.inf:
            raise InputError(f"square_mm must be a positive length, not {self.square_mm}")

    def points(self) -> npt.NDArray[np.float64]:
        """Return the inner corners (n, 2) in mm, x fastest."""
        return grid(self.corners) * self.square_mm

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a white margin of one square: x min, y min, x max, y max in mm."""
        nx, ny = self.corners
        s = self.square_mm
        return -2 * s, -2 * s, (nx + 1) * s, (ny + 1) * s

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm; the square before the origin is black."""
        place = np.asarray(xy, dtype=np.float64) / self.square_mm
        footprint = footprint_mm / self.square_mm
        white = 0.5 - 0.5 * _checks(place, self.corners, footprint)
        ink = _inside(place, np.array([-1.0, -1.0]), np.array(self.corners, dtype=np.float64), footprint) * (1 - white)
        return PAPER + (INK - PAPER) * ink


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
        if not 0 < self.cell_mm < np.inf:
            raise InputError(f"cell_mm must be a positive length, not {self.cell_mm}")

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
            black = 0.5 + 0.5 * _edge(local[..., 0], footprint) * _edge(local[..., 1], footprint)
            ink[near] += black * _inside(local, np.array([-1.0, -1.0]), np.array([1.0, 1.0]), footprint)
        return PAPER + (INK - PAPER) * ink


@dataclass(frozen=True)
class ProjectedCheckerboard:
    """A checkerboard in the projector image, in projector pixels.

    corners: inner corners, x then y; first_xy: the first of them, on a half pixel when edges fall between pixels;
    step_px: side of a square; first_color: of the square above and left of the first corner; origin_marks: the
    squares (column, row), counted from that square, that carry a disc of the other colour. The marks break all eight
    symmetries; () for a foreign pattern without them. Errors: InputError for a pattern that cannot be.
    """

    corners: tuple[int, int]
    first_xy: tuple[float, float]
    step_px: float
    first_color: Literal["black", "white"] = "black"
    origin_marks: tuple[tuple[int, int], ...] = ((1, 1), (3, 1), (1, 2))

    def __post_init__(self) -> None:
        _check_corners(self.corners)
        as_floats(self.first_xy, (2,), "first_xy")
        if not 0 < self.step_px < np.inf:
            raise InputError(f"step_px must be a positive length, not {self.step_px}")
        for column, row in self.origin_marks:
            if not (0 <= column <= self.corners[0] and 0 <= row <= self.corners[1]):
                raise InputError(f"origin_marks: there is no square ({column}, {row})")

    @classmethod
    def for_projector(cls, size: tuple[int, int]) -> ProjectedCheckerboard:
        """Return slkit's own pattern for a projector of size (w, h): about 12 squares high, half a square of margin."""
        width, height = as_size(size, "projector")
        step = max(height // 12 // 2 * 2, 2)
        columns, rows = (max(n // step - 1, least) for n, least in zip((width, height), MINIMUM_SQUARES, strict=True))
        if step * columns > width or step * rows > height or step < 8:
            raise InputError(f"a projector of {width} x {height} px is too small for a checkerboard")
        margin_x, margin_y = (width - columns * step) // 2, (height - rows * step) // 2
        return cls((columns - 1, rows - 1), (margin_x + step - 0.5, margin_y + step - 0.5), float(step))

    def points(self) -> npt.NDArray[np.float64]:
        """Return the inner corners (n, 2) in projector px, x fastest; exact, never detected."""
        return grid(self.corners) * self.step_px + np.array(self.first_xy)

    def square_color(self, column: int, row: int) -> float:
        """Return 1 for a white square and 0 for a black one; square (0, 0) lies above and left of the first corner."""
        first = 1.0 if self.first_color == "white" else 0.0
        return first if (column + row) % 2 == 0 else 1.0 - first

    def draw(self, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
        """Return the pattern (h, w) for a projector of size (w, h), black squares on white, edges filtered."""
        width, height = as_size(size, "projector")
        first = np.array(self.first_xy)
        low, high = first - self.step_px, first + np.array(self.corners) * self.step_px
        if (low < -0.5 - 1e-9).any() or (high > np.array([width, height]) - 0.5 + 1e-9).any():
            raise InputError(f"the checkerboard does not fit on a projector of {width} x {height} px")
        xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        place = (xy - first) / self.step_px
        footprint = 1 / self.step_px
        sign = -1.0 if self.first_color == "white" else 1.0
        white = 0.5 - 0.5 * sign * _checks(place, self.corners, footprint)
        for column, row in self.origin_marks:
            away = np.linalg.norm(place - (np.array([column, row]) - 0.5), axis=-1)
            disc = np.clip((ORIGIN_MARK_RADIUS - away) / footprint + 0.5, 0, 1)
            white = white + (1 - 2 * self.square_color(column, row)) * disc
        board = _inside(place, np.array([-1.0, -1.0]), np.array(self.corners, dtype=np.float64), footprint)
        return np.rint(255 * (1 - board * (1 - white))).astype(np.uint8)


def grid(counts: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Return the points (nx * ny, 2) of a unit grid, x fastest."""
    return np.stack(np.meshgrid(np.arange(counts[0]), np.arange(counts[1])), axis=-1).reshape(-1, 2).astype(np.float64)


def _check_corners(corners: tuple[int, int]) -> None:
    if min(as_size(corners, "corners")) < 3:
        raise InputError(f"corners must be at least 3 x 3 inner corners, not {corners[0]} x {corners[1]}")


def _edge(x: npt.NDArray[np.float64], footprint: float) -> npt.NDArray[np.float64]:
    """Return the sign of x, averaged over a footprint."""
    return np.clip(2 * x / max(footprint, 1e-9), -1, 1)


def _checks(xy: npt.NDArray[np.float64], corners: tuple[int, int], footprint: float) -> npt.NDArray[np.float64]:
    """Return +1 in the square before corner (0, 0) and its kind, -1 in its neighbours, averaged over a footprint."""
    nearest = np.clip(np.rint(xy), 0, np.array(corners) - 1)
    edges = _edge(nearest - xy, footprint) * np.where(nearest % 2 == 0, 1.0, -1.0)
    return edges[..., 0] * edges[..., 1]


def _inside(
    xy: npt.NDArray[np.float64], low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], footprint: float
) -> npt.NDArray[np.float64]:
    """Return the share of the footprint that lies in the box from low to high."""
    distance = np.minimum(xy - low, high - xy)
    # NumPy's min over an axis of two is several times slower.
    return 0.5 + 0.5 * _edge(np.minimum(distance[..., 0], distance[..., 1]), footprint)
