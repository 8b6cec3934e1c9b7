"""slkit simulate calibration, scan and color."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slkit.cli._common import JsonOption, SetOption, parse_settings, print_json, progress_bar
from slkit.errors import InputError

if TYPE_CHECKING:
    from slkit.geometry import Rig
    from slkit.simulation import Optics

app = typer.Typer(
    help="Render the pictures of a virtual rig, with the truth beside them.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

OutputOption = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the pictures.")]
RigOption = Annotated[Path | None, typer.Option("--rig", metavar="FILE", help="A rig.json; default the paper's rig.")]
NoiseOption = Annotated[
    float | None, typer.Option("--noise", metavar="DN", help="1 sigma of the noise in grey levels, 0 for none.")
]
OpticsOption = Annotated[
    list[str] | None,
    typer.Option("--optics", metavar="KEY=VALUE", help="How bright, sharp and noisy, such as crosstalk=0.15."),
]
SeedOption = Annotated[int, typer.Option("--seed", metavar="N", help="Of poses and noise.")]
CodecOption = Annotated[
    list[str] | None, typer.Option("--codec", metavar="NAME", help="A codec's name or recipe; may be repeated.")
]


@app.command()
def calibration(
    output: OutputOption,
    codec: CodecOption = None,
    rig: RigOption = None,
    poses: Annotated[int, typer.Option("--poses", metavar="N", help="How many poses of the board.")] = 10,
    noise: NoiseOption = None,
    optics: OpticsOption = None,
    seed: SeedOption = 0,
    settings: SetOption = None,
    fault: Annotated[
        str | None, typer.Option("--fault", metavar="NAME", help="A mistake that the user makes; docs/faults.md.")
    ] = None,
    strength: Annotated[str, typer.Option("--strength", metavar="mild|strong", help="Of the mistake.")] = "mild",
    as_json: JsonOption = False,
) -> None:
    """Render boards as `slkit calibrate` reads them: two-sided, or with a codec's light on the printed side."""
    from slkit import pipeline

    if len(codec or ()) > 1:
        raise InputError("a calibration has one codec: give --codec once")
    if settings and not codec:
        raise InputError("--set gives fields of a codec: name one with --codec")
    name = codec[0] if codec else None
    with progress_bar() as progress:
        light = _optics(noise, optics)
        pipeline.simulate_calibration(
            output, _rig(rig), poses, name, parse_settings(settings), light, seed, progress, fault, strength
        )
    _report([output], as_json)


@app.command()
def scan(
    output: OutputOption,
    scene: Annotated[str, typer.Option("--scene", metavar="NAME", help="A scene's name or a mesh file.")] = "free-form",
    codec: CodecOption = None,
    rig: RigOption = None,
    noise: NoiseOption = None,
    optics: OpticsOption = None,
    seed: SeedOption = 0,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Render an object under patterns as `slkit scan` reads it; several codecs make one subfolder each."""
    from slkit import pipeline

    with progress_bar() as progress:
        light = _optics(noise, optics)
        folders = pipeline.simulate_scan(
            output, _rig(rig), scene, codec or ["gray"], parse_settings(settings), light, seed, progress
        )
    _report(folders, as_json)


@app.command()
def color(
    output: OutputOption,
    rig: RigOption = None,
    noise: NoiseOption = None,
    optics: OpticsOption = None,
    seed: SeedOption = 0,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Render a white plane under every color as `slkit rig color` reads it; --set levels=[64,128] adds levels."""
    from slkit import pipeline

    with progress_bar() as progress:
        pipeline.simulate_color(output, _rig(rig), parse_settings(settings), _optics(noise, optics), seed, progress)
    _report([output], as_json)


def _rig(path: Path | None) -> Rig | None:
    from slkit.files import read_rig

    return None if path is None else read_rig(path)


def _optics(noise: float | None, given: list[str] | None) -> Optics:
    from slkit import registry
    from slkit.simulation import Optics

    for setting in given or ():
        if not re.match(r"\s*\w+\s*=", setting):
            raise InputError(f"--optics {setting}: write it as key=value")
    fields = {} if noise is None else {"read_noise": noise, "shot_noise": 0.0}
    return registry.create(Optics, fields | parse_settings(given), "optics")


def _report(folders: list[Path], as_json: bool) -> None:
    if as_json:
        print_json({"folders": [str(folder) for folder in folders]})
        return
    for folder in folders:
        print(f"folder: {folder}")
