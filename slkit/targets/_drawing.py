"""What all targets are drawn with: filtered edges, cells between straight lines, and the ink of a printer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_size

INK = 0.06
"""Reflectance of printed black."""
PAPER = 0.9
"""Reflectance of blank paper."""
_FINEST = 1e-3
"""Smallest footprint, in cells, over which cells are averaged: below it only rounding errors change."""

Floats = npt.NDArray[np.float64]


@runtime_checkable
class Target(Protocol):
    """A flat printed target: its points, its size, and its reflectance."""

    def points(self) -> Floats:
        """Return the known points (n, 2) in mm, board frame."""
        ...

    def extent(self) -> tuple[float, float, float, float]:
        """Return the smallest sheet: x min, y min, x max, y max in mm."""
        ...

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> Floats:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm averaged over a footprint in mm."""
        ...


@dataclass(frozen=True, eq=False)
class Ink:
    """What a printer blackens: boxes (n, 4) as x min, y min, x max, y max, and discs (m, 3) as x, y, radius; all mm."""

    boxes: Floats
    discs: Floats

    @classmethod
    def of_boxes(cls, boxes: npt.ArrayLike) -> Ink:
        """Return ink that has no discs."""
        return cls(np.asarray(boxes, dtype=np.float64).reshape(-1, 4), np.empty((0, 3)))

    def extent(self) -> tuple[float, float, float, float]:
        """Return what the ink covers: x min, y min, x max, y max in mm."""
        rings = np.concatenate([self.discs[:, :2] - self.discs[:, 2:], self.discs[:, :2] + self.discs[:, 2:]], axis=1)
        every = np.concatenate([self.boxes, rings])
        (x0, y0), (x1, y1) = every[:, :2].min(axis=0), every[:, 2:].max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)


@runtime_checkable
class Printable(Target, Protocol):
    """A target that a printer can draw."""

    def ink(self) -> Ink:
        """Return the black parts."""
        ...


@dataclass(frozen=True, eq=False)
class Cells:
    """Black and white cells between straight lines at x (nx + 1,) and y (ny + 1,); ink (ny, nx) is 1 where black.

    Outside the lines all is white.
    """

    x: Floats
    y: Floats
    ink: Floats

    def mean(self, xy: npt.ArrayLike, footprint: float) -> Floats:
        """Return the share of ink (...) in squares of side `footprint` around points (..., 2).

        Cells are constant, so that their summed-area table, linear between the lines, gives the mean exactly.
        """
        place = np.asarray(xy, dtype=np.float64)
        width = max(footprint, _FINEST * min(np.diff(self.x).min(), np.diff(self.y).min()))
        low = [np.interp(place[..., k] - width / 2, v, np.arange(len(v))) for k, v in enumerate((self.x, self.y))]
        high = [np.interp(place[..., k] + width / 2, v, np.arange(len(v))) for k, v in enumerate((self.x, self.y))]
        col, row = (np.minimum(v.astype(np.intp), n - 1) for v, n in zip(low, self.ink.shape[::-1], strict=True))
        result = np.array(self.ink[row, col])
        # Most footprints lie within one cell.
        mixed = (high[0] > col + 1) | (high[1] > row + 1) | (low[0] <= 0) | (low[1] <= 0)
        mixed |= (high[0] >= self.ink.shape[1]) | (high[1] >= self.ink.shape[0])
        (x0, y0), (x1, y1) = ([v[mixed] for v in values] for values in (low, high))
        area = self._sum(x1, y1) - self._sum(x0, y1) - self._sum(x1, y0) + self._sum(x0, y0)
        result[mixed] = np.clip(area / width**2, 0, 1)
        return result

    def boxes(self) -> Floats:
        """Return the black cells as boxes (n, 4), neighbours in a row joined."""
        found: list[tuple[float, float, float, float]] = []
        for row, values in enumerate(self.ink):
            steps = np.diff(np.concatenate([[0], values > 0.5, [0]]))
            for first, last in zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0), strict=True):
                found.append((self.x[first], self.y[row], self.x[last], self.y[row + 1]))
        return np.array(found)

    def _sum(self, col: Floats, row: Floats) -> Floats:
        """Return the ink above and left of places that are given in fractions of cells."""
        table = np.zeros((len(self.y), len(self.x)))
        table[1:, 1:] = (self.ink * np.diff(self.y)[:, None] * np.diff(self.x)).cumsum(axis=0).cumsum(axis=1)
        i = np.minimum(row.astype(np.intp), len(self.y) - 2)
        j = np.minimum(col.astype(np.intp), len(self.x) - 2)
        v, u = row - i, col - j
        above = table[i, j] * (1 - u) + table[i, j + 1] * u
        below = table[i + 1, j] * (1 - u) + table[i + 1, j + 1] * u
        return above * (1 - v) + below * v


def grid(counts: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Return the points (nx * ny, 2) of a unit grid, x fastest."""
    return np.stack(np.meshgrid(np.arange(counts[0]), np.arange(counts[1])), axis=-1).reshape(-1, 2).astype(np.float64)


def check_corners(corners: tuple[int, int]) -> None:
    if min(as_size(corners, "corners")) < 3:
        raise InputError(f"corners must be at least 3 x 3 inner corners, not {corners[0]} x {corners[1]}")


def edge(x: npt.NDArray[np.float64], footprint: float) -> npt.NDArray[np.float64]:
    """Return the sign of x, averaged over a footprint."""
    return np.clip(2 * x / max(footprint, 1e-9), -1, 1)


def checks(xy: npt.NDArray[np.float64], corners: tuple[int, int], footprint: float) -> npt.NDArray[np.float64]:
    """Return +1 in the square before corner (0, 0) and its kind, -1 in its neighbours, averaged over a footprint."""
    nearest = np.clip(np.rint(xy), 0, np.array(corners) - 1)
    edges = edge(nearest - xy, footprint) * np.where(nearest % 2 == 0, 1.0, -1.0)
    return edges[..., 0] * edges[..., 1]


def inside(
    xy: npt.NDArray[np.float64], low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], footprint: float
) -> npt.NDArray[np.float64]:
    """Return the share of the footprint that lies in the box from low to high."""
    distance = np.minimum(xy - low, high - xy)
    # NumPy's min over an axis of two is several times slower.
    return 0.5 + 0.5 * edge(np.minimum(distance[..., 0], distance[..., 1]), footprint)


def check_length(value: float, name: str) -> None:
    """Refuse what is no length. Errors: InputError naming the field."""
    if not 0 < value < np.inf:
        raise InputError(f"{name} must be a positive length, not {value}")
