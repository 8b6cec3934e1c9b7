"""A printed grid of discs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_size
from slkit.targets._drawing import INK, PAPER, Ink, check_length, grid


@dataclass(frozen=True)
class CircleGrid:
    """Black discs in rows, or in staggered rows.

    circles: in a row, and rows; spacing_mm: between centres in a row and between rows; asymmetric: every other row is
    moved by spacing_mm, and discs in a row stand twice as far apart; diameter_mm: of a disc. The first centre is the
    origin. An asymmetric grid with an odd number of rows looks different when it is turned; others do not.
    Errors: InputError for discs that touch or a grid that cannot be. Source: OpenCV's findCirclesGrid.
    """

    kind: Literal["circles"] = field(default="circles", kw_only=True)
    circles: tuple[int, int]
    spacing_mm: float
    diameter_mm: float
    asymmetric: bool = False

    def __post_init__(self) -> None:
        if min(as_size(self.circles, "circles")) < 3:
            raise InputError(f"circles must be at least 3 x 3, not {self.circles[0]} x {self.circles[1]}")
        check_length(self.spacing_mm, "spacing_mm")
        check_length(self.diameter_mm, "diameter_mm")
        apart = self.spacing_mm * (2**0.5 if self.asymmetric else 1)
        if self.diameter_mm >= 0.9 * apart:
            raise InputError(f"discs of {self.diameter_mm} mm leave no white between centres {apart:.4g} mm apart")

    def points(self) -> npt.NDArray[np.float64]:
        """Return the centres (n, 2) in mm, row by row."""
        places = grid(self.circles)
        if self.asymmetric:
            places[:, 0] = 2 * places[:, 0] + places[:, 1] % 2
        return places * self.spacing_mm

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a white margin of one spacing: x min, y min, x max, y max in mm."""
        x, y = self.points().max(axis=0)
        margin = self.spacing_mm + self.diameter_mm / 2
        return -margin, -margin, float(x) + margin, float(y) + margin

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm; edges are as wide as the footprint."""
        x, y = np.moveaxis(np.asarray(xy, dtype=np.float64) / self.spacing_mm, -1, 0)
        away = np.full(x.shape, np.inf)
        # Staggered discs reach beyond the middle between their rows.
        for row in (np.floor(y), np.floor(y) + 1):
            row = np.clip(row, 0, self.circles[1] - 1)
            shift, pitch = (row % 2, 2) if self.asymmetric else (0.0, 1)
            col = np.clip(np.rint((x - shift) / pitch), 0, self.circles[0] - 1)
            away = np.minimum(away, np.hypot(x - pitch * col - shift, y - row))
        depth = (self.diameter_mm / 2 - away * self.spacing_mm) / max(footprint_mm, 1e-9)
        return PAPER + (INK - PAPER) * np.clip(depth + 0.5, 0, 1)

    def ink(self) -> Ink:
        """Return the discs."""
        points = self.points()
        return Ink(np.empty((0, 4)), np.concatenate([points, np.full((len(points), 1), self.diameter_mm / 2)], axis=1))
