"""A checkerboard in the projector image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_floats, as_size
from slkit.targets._drawing import check_corners, check_length, checks, grid, inside

ORIGIN_MARK_RADIUS = 0.22
"""Radius of an origin mark, in squares."""
MINIMUM_SQUARES = (5, 4)


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
        check_corners(self.corners)
        as_floats(self.first_xy, (2,), "first_xy")
        check_length(self.step_px, "step_px")
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
        white = 0.5 - 0.5 * sign * checks(place, self.corners, footprint)
        for column, row in self.origin_marks:
            away = np.linalg.norm(place - (np.array([column, row]) - 0.5), axis=-1)
            disc = np.clip((ORIGIN_MARK_RADIUS - away) / footprint + 0.5, 0, 1)
            white = white + (1 - 2 * self.square_color(column, row)) * disc
        board = inside(place, np.array([-1.0, -1.0]), np.array(self.corners, dtype=np.float64), footprint)
        return np.rint(255 * (1 - board * (1 - white))).astype(np.uint8)
