"""ChArUco boards, printed and projected: a checkerboard whose white squares carry numbered markers."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_floats, as_size
from slkit.targets._dictionaries import check_dictionary, markers
from slkit.targets._drawing import INK, PAPER, Cells, Ink, check_length, grid

_FEWEST_SQUARES = 3
_MARKER_SHARE = 0.72
_SMALLEST_MODULE_PX = 3


@dataclass(frozen=True)
class Charuco:
    """A printed ChArUco board; a view of a part of it counts.

    squares: in x and y; square_mm, marker_mm: their sides; dictionary: of the markers, such as 4x4_100, which are
    numbered from 0 row by row. The first square is black; its inner corner is the origin of the board frame.
    Errors: InputError for a board that cannot be. Source: OpenCV's CharucoBoard, whose corners have the same order.
    """

    kind: Literal["charuco"] = field(default="charuco", kw_only=True)
    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    dictionary: str = "4x4_100"

    def __post_init__(self) -> None:
        _check(self.squares, self.square_mm, self.marker_mm, "mm", self.dictionary)

    @property
    def corners(self) -> tuple[int, int]:
        """Inner corners, x then y."""
        return self.squares[0] - 1, self.squares[1] - 1

    def points(self) -> npt.NDArray[np.float64]:
        """Return the inner corners (n, 2) in mm, x fastest."""
        return grid(self.corners) * self.square_mm

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a white margin of half a square: x min, y min, x max, y max in mm."""
        (nx, ny), s = self.squares, self.square_mm
        return -1.5 * s, -1.5 * s, (nx - 0.5) * s, (ny - 0.5) * s

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm."""
        return PAPER + (INK - PAPER) * self.cells.mean(xy, footprint_mm)

    def ink(self) -> Ink:
        """Return the black squares and the black cells of the markers."""
        return Ink.of_boxes(self.cells.boxes())

    @cached_property
    def cells(self) -> Cells:
        """The board in mm."""
        return _cells(self.squares, self.square_mm, self.marker_mm, self.dictionary, (0.0, 0.0))


@dataclass(frozen=True)
class ProjectedCharuco:
    """A ChArUco board in the projector image, in projector pixels; parts of it may miss the board or the picture.

    squares: in x and y; first_xy: the first inner corner, on a half pixel when edges fall between pixels; step_px,
    marker_px: sides of a square and of a marker. Errors: InputError for a pattern that cannot be.
    """

    kind: Literal["charuco"] = field(default="charuco", kw_only=True)
    squares: tuple[int, int]
    first_xy: tuple[float, float]
    step_px: float
    marker_px: float
    dictionary: str = "4x4_100"

    def __post_init__(self) -> None:
        as_floats(self.first_xy, (2,), "first_xy")
        _check(self.squares, self.step_px, self.marker_px, "px", self.dictionary)

    @classmethod
    def for_projector(cls, size: tuple[int, int]) -> ProjectedCharuco:
        """Return slkit's own pattern for a projector of size (w, h): about nine squares high, edges between pixels."""
        width, height = as_size(size, "projector")
        step = height // 9 // 2 * 2
        module = int(_MARKER_SHARE * step / 6)
        if module < _SMALLEST_MODULE_PX or width // step < _FEWEST_SQUARES:
            raise InputError(f"a projector of {width} x {height} px is too small for a ChArUco pattern")
        columns, rows = width // step, height // step
        # A rim as white as the paper keeps the outer markers apart from the dark around the projector's image.
        columns, rows = columns - (columns * step == width), rows - (rows * step == height)
        margin_x, margin_y = (width - columns * step) // 2, (height - rows * step) // 2
        first = (margin_x + step - 0.5, margin_y + step - 0.5)
        needed = columns * rows // 2
        return cls((columns, rows), first, float(step), 6.0 * module, f"4x4_{100 if needed <= 100 else 1000}")

    @property
    def corners(self) -> tuple[int, int]:
        """Inner corners, x then y."""
        return self.squares[0] - 1, self.squares[1] - 1

    def points(self) -> npt.NDArray[np.float64]:
        """Return the inner corners (n, 2) in projector px, x fastest; exact, never detected."""
        return grid(self.corners) * self.step_px + np.array(self.first_xy)

    def draw(self, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
        """Return the pattern (h, w) for a projector of size (w, h), black on white, edges filtered."""
        width, height = as_size(size, "projector")
        first = np.array(self.first_xy)
        low, high = first - self.step_px, first + np.array(self.corners) * self.step_px
        if (low < -0.5 - 1e-9).any() or (high > np.array([width, height]) - 0.5 + 1e-9).any():
            raise InputError(f"the ChArUco pattern does not fit on a projector of {width} x {height} px")
        cells = _cells(self.squares, self.step_px, self.marker_px, self.dictionary, self.first_xy)
        xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        return np.rint(255 * (1 - cells.mean(xy, 1.0))).astype(np.uint8)


def _check(squares: tuple[int, int], square: float, marker: float, unit: str, dictionary: str) -> None:
    if min(as_size(squares, "squares")) < _FEWEST_SQUARES:
        raise InputError(f"squares must be at least 3 x 3, not {squares[0]} x {squares[1]}")
    check_length(square, "square_mm" if unit == "mm" else "step_px")
    check_length(marker, f"marker_{unit}")
    if marker >= square:
        raise InputError(f"a marker of {marker} {unit} does not fit into a square of {square} {unit}")
    check_dictionary(dictionary, squares[0] * squares[1] // 2)


def _cells(
    squares: tuple[int, int], square: float, marker: float, dictionary: str, first: tuple[float, float]
) -> Cells:
    """Return the board's cells. square, marker: sides; first: the first inner corner."""
    nx, ny = squares
    bits = markers(dictionary, nx * ny // 2)
    count = bits.shape[1]
    ink = np.ones((ny, count + 2, nx, count + 2))
    odd = np.argwhere(np.indices((ny, nx)).sum(axis=0) % 2 == 1)
    for marker_bits, (row, col) in zip(bits, odd, strict=True):
        ink[row, :, col] = np.pad(marker_bits, 1)
    inner = (square - marker) / 2 + np.arange(count + 1) * (marker / count)
    lines = [
        np.append((np.arange(n)[:, None] * square + np.append(0.0, inner)).ravel(), n * square) + start - square
        for n, start in zip(squares, first, strict=True)
    ]
    return Cells(lines[0], lines[1], ink.reshape(ny * (count + 2), nx * (count + 2)))
