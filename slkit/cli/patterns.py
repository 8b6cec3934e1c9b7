"""slkit patterns."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from slkit.cli._common import (
    JsonOption,
    ProjectorOption,
    SetOption,
    parse_settings,
    parse_size,
    print_json,
    progress_bar,
)
from slkit.errors import InputError


def patterns(
    codec: Annotated[
        str,
        typer.Argument(
            metavar="CODEC|RECIPE.toml|checkerboard|charuco|color",
            help="A codec's name, a recipe, or what a calibration projects: checkerboard or charuco, and color.",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the pictures.")],
    projector: ProjectorOption = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the patterns to project, a slideshow that shows them, and a TOML file for the pictures taken."""
    from slkit import pipeline

    size = parse_size(projector, "--projector") if projector is not None else None
    if codec.endswith(".toml"):
        name, built = pipeline.recipe_codec(codec, size, parse_settings(settings))
    elif size is None:
        raise InputError("say how large the projector's image is: --projector 1024x768")
    elif codec in ("checkerboard", "charuco"):
        _projected(codec, size, output, settings, as_json)
        return
    elif codec == "color":
        paths = pipeline.projected_color(size, output, parse_settings(settings))
        _report(len(paths), output, "name the pictures you take of them as they are named", as_json)
        return
    else:
        name, built = codec, pipeline.load_codec(codec, size, parse_settings(settings))
    with progress_bar() as progress:
        count = len(pipeline.patterns(name, built, output, progress))
    _report(count, output, "capture.toml is for the pictures you take", as_json)


def _projected(name: str, size: tuple[int, int], output: Path, settings: list[str] | None, as_json: bool) -> None:
    from slkit import pipeline

    if settings:
        raise InputError(f"the projected {name} has no parameters: leave --set away")
    write = pipeline.projected_charuco if name == "charuco" else pipeline.projected_checkerboard
    write(size, output)
    _report(2, output, "calibration.toml is for the pictures you take", as_json)


def _report(count: int, output: Path, then: str, as_json: bool) -> None:
    if as_json:
        print_json({"patterns": count, "folder": str(output)})
    else:
        print(f"{count} patterns in {output}: show them with slideshow.html; {then}")
