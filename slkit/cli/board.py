"""slkit board."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from slkit.cli._common import JsonOption, parse_size, print_json


def board(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="Side A: checkerboard, charuco, april-tags, circles. Side B: marks, border-marks, tag-marks, "
            "corner-board.",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The drawing, as .pdf or .svg.")],
    page: Annotated[str, typer.Option(metavar="PAGE", help="A1, A2, A3, A4, Letter or Tabloid.")] = "A3",
    landscape: Annotated[bool, typer.Option("--landscape/--portrait", help="How the page lies.")] = True,
    corners: Annotated[
        str | None, typer.Option(metavar="NxM", help="Inner corners, tags or circles in x and y, as 11x8.")
    ] = None,
    square_mm: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Side of a square, of a tag or of a mark's cell; spacing of circles."),
    ] = None,
    two_sided: Annotated[
        bool, typer.Option("--two-sided", help="A second page for the other side of the board (marks or checkerboard).")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Draw a board to print at true scale, and print the TOML block that describes it."""
    from slkit import pipeline
    from slkit.files import toml_text

    count = parse_size(corners, "--corners", "a number in x and y, such as 11x8") if corners is not None else None
    tables = pipeline.write_board(
        output, kind, page, landscape=landscape, corners=count, square_mm=square_mm, two_sided=two_sided
    )
    if as_json:
        print_json(tables | {"file": str(output)})
    else:
        print(toml_text(tables), end="")
