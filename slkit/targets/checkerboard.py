"""A printed checkerboard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.targets._drawing import INK, PAPER, Ink, check_corners, check_length, checks, grid, inside


@dataclass(frozen=True)
class Checkerboard:
    """A printed checkerboard. corners: inner corners, x then y; square_mm: side of a square.

    Its first inner corner is the origin of the board frame. Errors: InputError for fewer than 3 x 3 inner corners.
    """

    corners: tuple[int, int]
    square_mm: float

    def __post_init__(self) -> None:
        check_corners(self.corners)
        check_length(self.square_mm, "square_mm")

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
        white = 0.5 - 0.5 * checks(place, self.corners, footprint)
        ink = inside(place, np.array([-1.0, -1.0]), np.array(self.corners, dtype=np.float64), footprint) * (1 - white)
        return PAPER + (INK - PAPER) * ink

    def ink(self) -> Ink:
        """Return the black squares."""
        squares = grid((self.corners[0] + 1, self.corners[1] + 1))
        black = (squares[squares.sum(axis=1) % 2 == 0] - 1) * self.square_mm
        return Ink.of_boxes(np.concatenate([black, black + self.square_mm], axis=1))
