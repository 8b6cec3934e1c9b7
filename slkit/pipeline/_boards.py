"""Boards to print: pages, their two sides, and the TOML tables that describe them."""

from __future__ import annotations

import math
from bisect import bisect
from pathlib import Path
from typing import Any

from slkit import registry
from slkit.errors import InputError
from slkit.files import toml_text, write_bytes
from slkit.pipeline._layouts import BOARDS, MARGIN_MM, Corners, Kind, Size
from slkit.targets import BorderMarks, Checkerboard, CornerMarks, Printable

PAGES = {
    "A1": (841.0, 594.0),
    "A2": (594.0, 420.0),
    "A3": (420.0, 297.0),
    "A4": (297.0, 210.0),
    "Letter": (279.4, 215.9),
    "Tabloid": (431.8, 279.4),
}
"""Width and height in mm of the pages, landscape."""
_SMALLEST_MM = 0.5
"""Smallest square drawn: gaps, discs and markers are parts of it, rounded to tenths of a mm, and must not vanish."""


def write_board(
    path: str | Path,
    kind: str,
    page: str = "A3",
    *,
    landscape: bool = True,
    corners: tuple[int, int] | None = None,
    square_mm: float | None = None,
    two_sided: bool = False,
) -> dict[str, Any]:
    """Write a board as vector PDF or SVG at true scale, and return the tables of calibration.toml that describe it.

    kind: one of `BOARDS`; page: one of `PAGES`. corners: inner corners, tags or circles in x and y; square_mm: side of
    a square, a tag or a cell of a mark, or the spacing of circles; both are chosen from the page where they are None.
    two_sided: a second page for the other side of the board, which registers in a duplex print.
    Errors: InputError for an unknown kind, page or ending, or for corners or squares that do not suit the page.
    """
    from slkit.report.sheets import render

    path, size = Path(path), _page(page, landscape)
    name = f"{page} {'landscape' if landscape else 'portrait'}"
    kinds = [kind, _kind(kind).other_side] if two_sided else [kind]
    # Side A comes first, whichever was named.
    kinds.sort(key=lambda k: _kind(k).table != "printed")
    targets = {k: _target(k, size, name, *((corners, square_mm) if k == kind else (None, None))) for k in kinds}
    tables = {_kind(k).table: registry.parameters_of(target) for k, target in targets.items()}
    sheets = [_sheet(k, target, size, name, two_sided) for k, target in targets.items()]
    write_bytes(path, render(sheets, path.suffix.lower()))
    return tables


def _page(page: str, landscape: bool) -> Size:
    sizes = {name.lower(): size for name, size in PAGES.items()}
    if page.lower() not in sizes:
        raise InputError(f"page must be one of {', '.join(PAGES)}, not {page!r}")
    width, height = sizes[page.lower()]
    return (width, height) if landscape else (height, width)


def _kind(name: str) -> Kind:
    if name not in BOARDS:
        raise InputError(f"there is no board called {name!r}; there are: {', '.join(BOARDS)}")
    return BOARDS[name]


def _target(kind: str, size: Size, page: str, corners: Corners | None, square_mm: float | None) -> Printable:
    """Return the board. page: the name of that size. Errors: InputError for counts or squares that do not suit it."""
    _check_counts(kind, size, page, corners)
    design = _kind(kind).design
    if square_mm is None:
        return design(size, corners, None)
    if not _fits(kind, size, corners, square_mm):
        # In tenths of a mm: the largest that fits is one before the first that does not.
        tenths = range(round(10 * _SMALLEST_MM), math.ceil(10 * max(size)) + 1)
        most = bisect(tenths, False, key=lambda n: not _fits(kind, size, corners, n / 10))
        raise InputError(
            f"--square-mm must be {_SMALLEST_MM:g} to {tenths[most - 1] / 10:g} for {_named(kind, corners)} on {page}, "
            f"not {square_mm:g}"
        )
    return design(size, corners, square_mm)


def _check_counts(kind: str, size: Size, page: str, corners: Corners | None) -> None:
    """Refuse counts that no size of the squares makes right. Errors: InputError."""
    # The first keeps a board of millions of squares from being drawn.
    crowded = any(n * _SMALLEST_MM > length for n, length in zip(corners or (), size, strict=False))
    if not crowded:
        # What is wrong with the counts themselves, the design says.
        _kind(kind).design(size, corners, _SMALLEST_MM)
    if crowded or not _fits(kind, size, corners, _SMALLEST_MM):
        raise InputError(f"there is no room for {_named(kind, corners)} on {page}: take a larger page or fewer corners")


def _named(kind: str, corners: Corners | None) -> str:
    return kind if corners is None else f"{kind} with --corners {corners[0]}x{corners[1]}"


def _fits(kind: str, size: Size, corners: Corners | None, square_mm: float) -> bool:
    """Return whether a board with squares of that size can be drawn, its ink within the margins of the page."""
    if not _SMALLEST_MM <= square_mm <= max(size):
        return False
    try:
        target = _kind(kind).design(size, corners, square_mm)
    except InputError:
        return False
    x0, y0, x1, y1 = target.ink().extent()
    x, y = _origin(kind, target, size)
    room = MARGIN_MM - 1e-6
    return min(x + x0, y + y0, size[0] - x - x1, size[1] - y - y1) >= room


def _origin(kind: str, target: Printable, size: Size) -> Size:
    """Return where the target's origin lies: its ink in the middle, or near the corner of a sheet white elsewhere."""
    x0, y0, x1, y1 = target.ink().extent()
    if kind == "corner-board" and isinstance(target, Checkerboard):
        return MARGIN_MM - x0 + target.square_mm / 2, MARGIN_MM - y0 + target.square_mm / 2
    return (size[0] - x0 - x1) / 2, (size[1] - y0 - y1) / 2


def _sheet(kind: str, target: Printable, size: Size, page: str, two_sided: bool) -> Any:
    """Return the page with the drawing and what is to be told about it."""
    from slkit.report.sheets import CROSS_MM, RULER_MM, Sheet

    table = _kind(kind).table
    side = "side A" if table == "printed" else "side B"
    block = ", ".join(toml_text(registry.parameters_of(target)).splitlines())
    scale = f"print at 100 %, then both rulers measure {RULER_MM:g} mm"
    duplex = "; print duplex, flip on the long edge, so that the crosses of both sides coincide" if two_sided else ""
    lines = (f"slkit board {kind}, {side}, {page}; {scale}{duplex}", f"[{table}] {block}")
    crosses = _crosses(size, table == "printed", CROSS_MM) if two_sided else ()
    return Sheet(size, target, _origin(kind, target, size), lines, size[0] - 2 * _text_from_side(target), crosses)


def _text_from_side(target: Printable) -> float:
    """Return how far text stays from the sides of the page in mm: clear of the marks in its corners."""
    if isinstance(target, CornerMarks | BorderMarks):
        return 3 * MARGIN_MM + 2 * target.cell_mm
    return 2 * MARGIN_MM


def _crosses(size: Size, front: bool, edge: float) -> tuple[tuple[float, float], ...]:
    """Return three crosses; on the back where a sheet turned about its long edge brings them.

    Three, because four would also coincide when the sheet is turned about its short edge.
    """
    width, height = size
    at = ((edge, edge), (width - edge, edge), (edge, height - edge))
    if front:
        return at
    return tuple((x, height - y) if width > height else (width - x, y) for x, y in at)
