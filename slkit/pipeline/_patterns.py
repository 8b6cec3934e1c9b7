"""Patterns to project, with what is needed to show them and to scan the pictures of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slkit import registry
from slkit.data import Frames
from slkit.errors import FileError
from slkit.files import Progress, make_folder, merged, projector_size, read_toml, write_frames, write_toml
from slkit.pipeline._slideshow import write_slideshow
from slkit.protocols import Codec
from slkit.targets import ProjectedCharuco, ProjectedCheckerboard

_CAPTURE_COMMENT = """\
Copy this file into the folder that holds your pictures of these patterns, one picture a pattern in display order;
`slkit scan` reads that folder as it is. Name the pictures as you like: they are taken in natural order of their names.
If other pictures lie in the folder too, name yours with a pattern: frames = "IMG_*.jpg"."""

_CALIBRATION_COMMENT = """\
What to do: print a checkerboard for side A of a flat board, and four corner marks on the white side B.
1. side_a/          at least 3, better 10 pictures of side A under room light, tilted in all directions
2. side_b_white/    the same number of poses of side B with white.png projected
3. side_b_pattern/  the same poses in the same order with {pattern}.png projected
Measure your prints and change square_mm, corners, xy_mm and cell_mm below: they set the scale of every scan."""


def load_codec(
    name: str, projector: tuple[int, int], parameters: Mapping[str, Any] | None = None, where: str | None = None
) -> Codec:
    """Return the codec of that name for a projector (width, height) with its parameters checked.

    where: what the parameters came from, for messages; default the codec.
    Errors: PluginError, InputError naming the parameter.
    """
    plugin = registry.load("slkit.codecs", name)
    return registry.create(plugin, {"projector": list(projector)} | dict(parameters or {}), where or f"codec {name}")


def recipe_codec(
    recipe: str | Path, projector: tuple[int, int] | None = None, parameters: Mapping[str, Any] | None = None
) -> tuple[str, Codec]:
    """Return name and codec of a TOML recipe (codec, projector, parameters); arguments go before what it says.

    Errors: FileError naming file and key, InputError naming the parameter.
    """
    file = Path(recipe)
    table = read_toml(file)
    name, given = table.get("codec"), table.get("parameters", {})
    if not isinstance(name, str) or not isinstance(given, Mapping):
        raise FileError(f'{file} is no recipe: it needs codec = "name", projector and a table `parameters`')
    size = projector or projector_size(table, file)
    return name, load_codec(name, size, merged(given, parameters or {}), str(file))


def patterns(name: str, codec: Codec, folder: str | Path, progress: Progress | None = None) -> list[Path]:
    """Write the patterns of a codec as 000_name.png ... with a capture.toml template and a slideshow.html.

    name: the codec's registered name. Returns the pictures' paths.
    Errors: FileError where the folder cannot be written or holds another set.
    """
    folder = make_folder(folder)
    paths = write_frames(folder, codec.encode(), progress)
    write_capture_toml(folder, name, codec, _CAPTURE_COMMENT)
    write_slideshow(folder, [path.name for path in paths], _projector(codec))
    return paths


def write_capture_toml(folder: Path, name: str, codec: Codec, comment: str = "", frames: str | None = None) -> None:
    """Write the capture.toml of pictures of a codec's patterns. frames: their glob, None for every picture."""
    parameters = registry.parameters_of(codec)
    table = {"codec": name, "projector": parameters.pop("projector"), "parameters": parameters}
    if frames is not None:
        table["frames"] = frames
    write_toml(
        folder / "capture.toml",
        {k: table[k] for k in ("codec", "projector", "frames", "parameters") if k in table},
        comment,
    )


def projected_checkerboard(projector: tuple[int, int], folder: str | Path) -> None:
    """Write what the planar calibration projects: white.png, checkerboard.png, slideshow.html, calibration.toml.

    projector: (width, height) px. Errors: InputError for a projector too small, FileError where it cannot be written.
    """
    _write_projected("checkerboard", ProjectedCheckerboard.for_projector(projector), projector, folder)


def projected_charuco(projector: tuple[int, int], folder: str | Path) -> None:
    """Write the same with charuco.png, a pattern of which a part may miss the board, in place of the checkerboard.

    projector: (width, height) px. Errors: InputError for a projector too small, FileError where it cannot be written.
    """
    _write_projected("charuco", ProjectedCharuco.for_projector(projector), projector, folder)


def _write_projected(
    name: str, pattern: ProjectedCheckerboard | ProjectedCharuco, projector: tuple[int, int], folder: str | Path
) -> None:
    from slkit.files import write_png

    folder = make_folder(folder)
    white = np.full((projector[1], projector[0]), 255, np.uint8)
    frames = Frames.of([white, pattern.draw(projector)], ["white", name])
    for picture, frame in zip(frames, frames.names, strict=True):
        write_png(folder / f"{frame}.png", picture)
    table = {
        "method": "planar",
        "projector": list(projector),
        "printed": {"images": "side_a/*", "corners": [11, 8], "square_mm": 30.0},
        "marks": {
            "images": "side_b_white/*",
            "xy_mm": [[-185.0, -125.0], [185.0, -125.0], [185.0, 125.0], [-185.0, 125.0]],
            "cell_mm": 12.0,
        },
        "projected": {"images": "side_b_pattern/*"} | registry.parameters_of(pattern),
    }
    write_toml(folder / "calibration.toml", table, _CALIBRATION_COMMENT.format(pattern=name))
    write_slideshow(folder, [f"{frame}.png" for frame in frames.names], projector)


def _projector(codec: Any) -> tuple[int, int]:
    return codec.projector
