"""Writes everything in patterns/ that a program can write; `make patterns` runs it, test_patterns.py compares.

python tests/regenerate_patterns.py FOLDER
"""

import sys
from pathlib import Path

import numpy as np

from slkit.files import write_png, write_text, write_toml
from slkit.pipeline import load_codec
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard, Target, grid

PROJECTORS = ((1024, 768), (1280, 720), (1280, 800), (1920, 1080))
CODECS = {
    "gray": {"axes": "both", "step": 1, "inverse": True},
    "line-shift": {"axes": "x", "period": 6, "width": 1, "cell": 2, "inverse": True},
    "phase-shift": {"axes": "both", "references": True, "order": "temporal"},
}
REMARKS = {
    "gray": "Columns and rows, every pattern followed by its inverse: the most robust, and fit for local-homography.",
    "line-shift": """\
Columns, by lines one pixel wide and six apart. Where a projector pixel covers less than a camera pixel take
period = 8 and width = 2; where the projector stands above or below the camera take axes = "y".""",
    "phase-shift": "Columns and rows, three sets of fringes with four steps each: dense, and fit for local-homography.",
}
# Sheet in mm, side A, and side B with its marks at the corners.
BOARDS = {
    "a3": ((420, 297), Checkerboard((11, 8), 30.0), (185.0, 125.0), 12.0),
    "a4": ((297, 210), Checkerboard((11, 8), 21.0), (130.0, 88.0), 8.0),
}
RULER_MM = 100


def regenerate(folder: Path) -> None:
    """Write recipes, projected checkerboards and printed boards into a folder."""
    for width, height in PROJECTORS:
        size = (width, height)
        for codec in CODECS:
            recipe(folder / f"{codec}-{width}x{height}.toml", codec, size)
        write_png(folder / f"checkerboard-{width}x{height}.png", ProjectedCheckerboard.for_projector(size).draw(size))
    for name in BOARDS:
        sheet, printed, marks = board(name)
        middle = (printed.points().min(axis=0) + printed.points().max(axis=0)) / 2
        cells = (grid((printed.corners[0] + 1, printed.corners[1] + 1)) - 0.5) * printed.square_mm
        text = f"slkit side A, {name.upper()}: {printed.square_mm:g} mm squares; at 100 % the line is {RULER_MM} mm"
        write_text(folder / f"board-{name}-side-a.svg", svg(sheet, middle, printed, cells, printed.square_mm, text))
        cells = np.concatenate([center + (grid((2, 2)) - 0.5) * marks.cell_mm for center in marks.points()])
        write_text(folder / f"board-{name}-side-b.svg", svg(sheet, np.zeros(2), marks, cells, marks.cell_mm, ""))


def recipe(file: Path, name: str, projector: tuple[int, int]) -> None:
    """Write the recipe of a codec, with the fringes that it would choose spelt out."""
    codec = load_codec(name, projector, CODECS[name])
    parameters = dict(CODECS[name])
    if name == "phase-shift":
        fringes = {axis: codec.fringes(axis) for axis in ("x", "y")}
        parameters |= {axis: {"periods": [int(n) for n in f.periods], "steps": f.steps} for axis, f in fringes.items()}
    table = {"codec": name, "projector": list(projector), "parameters": parameters}
    command = f"{len(codec.encode())} patterns: slkit patterns patterns/{file.name} -o DIR"
    write_toml(file, table, f"{REMARKS[name]}\n{command}")


def board(name: str) -> tuple[tuple[int, int], Checkerboard, CornerMarks]:
    """Return a board's sheet (width, height) mm, side A and side B."""
    sheet, printed, (x, y), cell = BOARDS[name]
    return sheet, printed, CornerMarks(((-x, -y), (x, -y), (x, y), (-x, y)), cell)


def svg(sheet: tuple[int, int], middle: np.ndarray, target: Target, cells: np.ndarray, side: float, text: str) -> str:
    """Return a drawing at true scale: the black ones of a target's cells, their centres (n, 2) mm, `side` mm wide.

    middle (2,): the point of the target that lies in the middle of the sheet.
    """
    width, height = sheet
    left, top = middle - np.array(sheet) / 2
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="{left:g} {top:g} {width} {height}" shape-rendering="crispEdges">'
    ]
    for x, y in cells[target.reflectance(cells, 1e-6) < 0.5] - side / 2:
        lines.append(f'<rect x="{x:g}" y="{y:g}" width="{side:g}" height="{side:g}"/>')
    if text:
        # In the margin below the squares, out of the way of every corner.
        x, y = left + 20, top + height - 5
        lines.append(f'<path d="M{x:g} {y:g}h{RULER_MM}" stroke="#000" stroke-width="0.3"/>')
        lines.append(
            f'<text x="{x + RULER_MM + 4:g}" y="{y + 1:g}" font-family="sans-serif" font-size="3">{text}</text>'
        )
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tests/regenerate_patterns.py FOLDER")
    regenerate(Path(sys.argv[1]))
