"""Writes everything in patterns/ that a program can write; `make patterns` runs it, test_patterns.py compares.

python tests/regenerate_patterns.py FOLDER
"""

import sys
from pathlib import Path

from slkit.files import write_png, write_toml
from slkit.pipeline import load_codec, write_board
from slkit.targets import ProjectedCheckerboard

PROJECTORS = ((1024, 768), (1280, 720), (1280, 800), (1920, 1080))
CODECS = {
    "color-fringe": {"axes": "x", "window": 3},
    "color-stripes": {"axes": "x", "window": 3, "width": 4},
    "gray": {"axes": "both", "step": 1, "inverse": True},
    "line-shift": {"axes": "x", "period": 6, "width": 1, "cell": 2, "inverse": True},
    "phase-shift": {"axes": "both", "references": True, "order": "temporal"},
}
REMARKS = {
    "color-fringe": """\
Columns, by a single picture of coloured sinusoids: a value at every pixel of what moves. The sequence is spelt out,
so that a picture taken today can always be decoded. Where the projector stands above or below the camera take
axes = "y".""",
    "color-stripes": """\
Columns, by a single picture of coloured slits: for what moves. The sequence is spelt out, so that a picture taken
today can always be decoded. Where the projector stands above or below the camera take axes = "y".""",
    "gray": "Columns and rows, every pattern followed by its inverse: the most robust, and fit for local-homography.",
    "line-shift": """\
Columns, by lines one pixel wide and six apart. Where a projector pixel covers less than a camera pixel take
period = 8 and width = 2; where the projector stands above or below the camera take axes = "y".""",
    "phase-shift": "Columns and rows, three sets of fringes with four steps each: dense, and fit for local-homography.",
}
PAGES = ("A3", "A4")


def regenerate(folder: Path) -> None:
    """Write recipes, projected checkerboards and printed boards into a folder."""
    for width, height in PROJECTORS:
        size = (width, height)
        for codec in CODECS:
            recipe(folder / f"{codec}-{width}x{height}.toml", codec, size)
        write_png(folder / f"checkerboard-{width}x{height}.png", ProjectedCheckerboard.for_projector(size).draw(size))
    for page in PAGES:
        for kind, side in (("checkerboard", "a"), ("marks", "b")):
            write_board(folder / f"board-{page.lower()}-side-{side}.svg", kind, page)


def recipe(file: Path, name: str, projector: tuple[int, int]) -> None:
    """Write the recipe of a codec, with the fringes or stripes that it would choose spelt out."""
    codec = load_codec(name, projector, CODECS[name])
    parameters = dict(CODECS[name])
    if name == "phase-shift":
        fringes = {axis: codec.fringes(axis) for axis in ("x", "y")}
        parameters |= {axis: {"periods": [int(n) for n in f.periods], "steps": f.steps} for axis, f in fringes.items()}
    if name == "color-stripes":
        parameters |= {"gap": codec.layout.gap, "colors": list(codec.colors), "sequence": list(codec.layout.stripes)}
    if name == "color-fringe":
        parameters |= {
            "period": codec.layout.period,
            "colors": list(codec.colors),
            "sequence": list(codec.layout.stripes),
        }
    table = {"codec": name, "projector": list(projector), "parameters": parameters}
    command = f"{len(codec.encode())} patterns: slkit patterns patterns/{file.name} -o DIR"
    write_toml(file, table, f"{REMARKS[name]}\n{command}")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tests/regenerate_patterns.py FOLDER")
    regenerate(Path(sys.argv[1]))
