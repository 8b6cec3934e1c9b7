"""The boards that can be printed, each as large as fits a page."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from slkit.errors import InputError
from slkit.targets import (
    AprilTags,
    BorderMarks,
    Charuco,
    Checkerboard,
    CircleGrid,
    CornerMarks,
    Printable,
    TagMarks,
)

MARGIN_MM = 10.0
"""White around the drawing, for rulers and text."""
_MARK_TEXT_MM = 8.0
"""Part of the margin that text and rulers take."""

Size = tuple[float, float]
Corners = tuple[int, int]
Design = Callable[[Size, Corners | None, float | None], Printable]


@dataclass(frozen=True)
class Kind:
    """A kind of board: the table of calibration.toml that describes it, and how it is laid out on a page."""

    table: str
    design: Design
    other_side: str


def _whole(length_mm: float) -> float:
    """Return a length rounded down to whole mm, or to tenths where it is small."""
    steps = 1 if length_mm >= 5 else 10
    return math.floor(length_mm * steps + 1e-9) / steps


def _room(page: Size) -> Size:
    return page[0] - 2 * MARGIN_MM, page[1] - 2 * MARGIN_MM


def _turned(counts: Corners, page: Size) -> Corners:
    """Return counts for a landscape page, turned where the page is portrait."""
    return counts if page[0] > page[1] else (counts[1], counts[0])


def _checkerboard(page: Size, corners: Corners | None, square_mm: float | None) -> Checkerboard:
    corners = corners or _turned((11, 8), page)
    return Checkerboard(corners, _square(page, corners) if square_mm is None else square_mm)


def _square(page: Size, corners: Corners) -> float:
    return _whole(min(length / (n + 1) for length, n in zip(_room(page), corners, strict=True)))


def _charuco(page: Size, corners: Corners | None, square_mm: float | None) -> Charuco:
    corners = corners or _turned((11, 8), page)
    square = _square(page, corners) if square_mm is None else square_mm
    squares = corners[0] + 1, corners[1] + 1
    enough = next((n for n in (50, 100, 250) if n >= squares[0] * squares[1] // 2), 1000)
    return Charuco(squares, square, _whole(0.72 * square), f"4x4_{enough}")


def _april_tags(page: Size, corners: Corners | None, square_mm: float | None) -> AprilTags:
    tags = corners or _turned((7, 5), page)
    largest = _whole(min(length / (1.3 * n) for length, n in zip(_room(page), tags, strict=True)))
    tag = largest if square_mm is None else square_mm
    return AprilTags(tags, tag, _whole(0.3 * tag))


def _circles(page: Size, corners: Corners | None, square_mm: float | None) -> CircleGrid:
    circles = corners or ((6, 9) if page[0] > page[1] else (4, 11))
    # A disc, and white around it that its detection relies on, beside the outer centres.
    spans = 2 * circles[0] - 1 + 1.2, circles[1] - 1 + 1.2
    largest = min(length / n for length, n in zip(_room(page), spans, strict=True))
    spacing = _whole(largest) if square_mm is None else square_mm
    if spacing > largest + 1e-6:
        raise InputError(
            f"circles {spacing:g} mm apart leave no white around them: take a larger page or fewer circles"
        )
    return CircleGrid(circles, spacing, _whole(0.8 * spacing), asymmetric=True)


def _corner_board(page: Size, corners: Corners | None, square_mm: float | None) -> Checkerboard:
    corners = corners or (7, 6)
    # Half a square of white lies before the first square too.
    largest = min(length / (n + 1.5) for length, n in zip(_room(page), corners, strict=True))
    return Checkerboard(corners, _whole(min(min(page) / 18, largest)) if square_mm is None else square_mm)


def _marks(page: Size, corners: Corners | None, square_mm: float | None) -> CornerMarks:
    cell = _cell(corners, square_mm, round(min(page) / 25))
    # Three cells from centre to centre leave one of white between two marks.
    return CornerMarks(_at_corners(page, cell + MARGIN_MM, 3 * cell), cell)


def _border_marks(page: Size, corners: Corners | None, square_mm: float | None) -> BorderMarks:
    cell = _cell(corners, square_mm, round(min(page) / 32))
    inset = max(1.5 * cell + _MARK_TEXT_MM, cell + MARGIN_MM)
    x, y = (_fives(length / 2 - inset) for length in page)
    return BorderMarks((2 * x, 2 * y), cell)


def _tag_marks(page: Size, corners: Corners | None, square_mm: float | None) -> TagMarks:
    tag = _cell(corners, square_mm, round(min(page) / 10))
    return TagMarks(_at_corners(page, 0.6 * tag + MARGIN_MM, tag), tag)


def _at_corners(page: Size, inset_mm: float, apart_mm: float) -> tuple[tuple[float, float], ...]:
    """Return four places, TL TR BR BL, that far from the edges of the page. Errors: InputError where marks overlap."""
    x, y = (_fives(length / 2 - inset_mm) for length in page)
    if 2 * min(x, y) < apart_mm:
        raise InputError(f"marks {2 * min(x, y):g} mm apart overlap: take a larger page, or smaller squares")
    return (-x, -y), (x, -y), (x, y), (-x, y)


def _cell(corners: Corners | None, square_mm: float | None, default: float) -> float:
    if corners is not None:
        raise InputError("marks have no corners to count: leave --corners away")
    return float(default) if square_mm is None else square_mm


def _fives(length_mm: float) -> float:
    return 5.0 * math.floor(length_mm / 5)


BOARDS = {
    "checkerboard": Kind("printed", _checkerboard, "marks"),
    "charuco": Kind("printed", _charuco, "marks"),
    "april-tags": Kind("printed", _april_tags, "marks"),
    "circles": Kind("printed", _circles, "marks"),
    "marks": Kind("marks", _marks, "checkerboard"),
    "border-marks": Kind("marks", _border_marks, "checkerboard"),
    "tag-marks": Kind("marks", _tag_marks, "checkerboard"),
    "corner-board": Kind("corner_board", _corner_board, "checkerboard"),
}
"""The boards that can be printed, by name."""
