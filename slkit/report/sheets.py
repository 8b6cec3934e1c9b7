"""Boards on paper: vector pages at true scale, with rulers that show what the printer did."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.targets import Ink, Printable

RULER_MM = 100.0
"""Length of the rulers, between the middles of their end ticks."""
CROSS_MM = 7.0
"""Distance of a register cross from the two nearest edges of the page."""
_LINE_MM = 0.2
_RULER_FROM_EDGE_MM = 5.5
_TEXT_MM = 2.4
_TEXT_FROM_TOP_MM, _TEXT_STEP_MM = 5.6, 3.2
_POINTS_PER_MM = 72 / 25.4


@dataclass(frozen=True, eq=False)
class Sheet:
    """A page with one target.

    size_mm: width and height; origin_mm: where the target's origin lies, right of and below the upper left corner of
    the page; lines: text for the upper margin, text_mm wide at most; crosses_mm: centres of register crosses.
    """

    size_mm: tuple[float, float]
    target: Printable
    origin_mm: tuple[float, float]
    lines: tuple[str, ...] = ()
    text_mm: float = 100.0
    crosses_mm: tuple[tuple[float, float], ...] = ()

    def ink(self) -> Ink:
        """Return all that is black but the text, in mm right of and below the upper left corner of the page."""
        drawn, shift = self.target.ink(), np.array(self.origin_mm)
        boxes = [drawn.boxes + np.tile(shift, 2), *_rulers(self.size_mm)]
        boxes += [box for at in self.crosses_mm for box in _cross(at)]
        return Ink(np.concatenate(boxes), drawn.discs + np.append(shift, 0.0))


def render(sheets: Sequence[Sheet], ending: str) -> bytes:
    """Return the pages as a file. ending: ".pdf", or ".svg" for one page.

    Errors: InputError for another ending, or an SVG of more than one page.
    """
    if ending not in (".pdf", ".svg"):
        raise InputError(f"a board is written as .pdf or .svg, not as {ending or 'a file without an ending'}")
    if ending == ".svg" and len(sheets) != 1:
        raise InputError("an SVG has one page: write a two-sided board as .pdf")
    import matplotlib

    buffer = io.BytesIO()
    # A fixed salt, and no date, make equal boards equal files.
    with matplotlib.rc_context({"svg.hashsalt": "slkit", "pdf.fonttype": 42, "path.simplify": False}):
        if ending == ".svg":
            _figure(sheets[0]).savefig(buffer, format="svg", metadata={"Date": None, "Creator": "slkit"})
        else:
            from matplotlib.backends.backend_pdf import PdfPages

            with PdfPages(buffer, metadata={"Creator": "slkit", "CreationDate": None}) as pages:
                for sheet in sheets:
                    pages.savefig(_figure(sheet))
    return buffer.getvalue()


def _figure(sheet: Sheet) -> Any:
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    width, height = sheet.size_mm
    figure = Figure(figsize=(width / 25.4, height / 25.4))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()
    ink = sheet.ink()
    parts = [Path(_outline(box), closed=True) for box in ink.boxes]
    parts += [Path.circle((float(x), float(y)), float(r)) for x, y, r in ink.discs]
    # One path: boxes of their own would show hairlines where they touch.
    axes.add_patch(PathPatch(Path.make_compound_path(*parts), facecolor="black", linewidth=0))
    longest = max((len(line) for line in sheet.lines), default=1)
    size = min(_TEXT_MM, sheet.text_mm / (0.6 * longest))
    for i, line in enumerate(sheet.lines):
        y = _TEXT_FROM_TOP_MM + i * _TEXT_STEP_MM
        axes.text(width / 2, y, line, fontsize=size * _POINTS_PER_MM, ha="center", va="baseline", parse_math=False)
    label = (width / 2 + RULER_MM / 2 + 2, height - _RULER_FROM_EDGE_MM + 0.8, f"{RULER_MM:g} mm")
    axes.text(*label, fontsize=_TEXT_MM * _POINTS_PER_MM, va="baseline")
    return figure


def _outline(box: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    x0, y0, x1, y1 = box
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])


def _rulers(size_mm: tuple[float, float]) -> list[npt.NDArray[np.float64]]:
    """Return the boxes (n, 4) of a ruler in the lower margin and of one in the left margin."""
    width, height = size_mm
    at = np.linspace(-RULER_MM / 2, RULER_MM / 2, 11)
    long = np.where(np.arange(11) % 5 == 0, 2.5, 1.2)
    half = _LINE_MM / 2
    ticks = np.stack([at - half, -long, at + half, np.zeros(11)], axis=1)
    line = np.array([[at[0] - half, -half, at[-1] + half, half]])
    across = np.concatenate([line, ticks])
    # The same turned by a quarter: its ticks point to the right, into the page.
    down = np.stack([-across[:, 3], across[:, 0], -across[:, 1], across[:, 2]], axis=1)
    return [
        across + np.tile([width / 2, height - _RULER_FROM_EDGE_MM], 2),
        down + np.tile([_RULER_FROM_EDGE_MM, height / 2], 2),
    ]


def _cross(at: tuple[float, float]) -> list[npt.NDArray[np.float64]]:
    x, y = at
    half, reach = _LINE_MM / 2, 2.0
    return [
        np.array([[x - reach, y - half, x + reach, y + half]]),
        np.array([[x - half, y - reach, x + half, y + reach]]),
    ]
