"""slkit compare."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from slkit.cli._common import JsonOption, print_json, print_table, progress_bar
from slkit.cli.simulate import CodecOption, NoiseOption, OpticsOption, _optics
from slkit.errors import InputError

if TYPE_CHECKING:
    from slkit.report.comparison import Comparison

FoldersArgument = Annotated[
    list[Path] | None, typer.Argument(metavar="SCAN_DIR...", help="Folders with a capture.toml and the pictures.")
]
OutputOption = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for page, numbers, pictures and clouds.")
]
RigOption = Annotated[Path | None, typer.Option("--rig", metavar="FILE", help="The rig of all scans.")]
TruthOption = Annotated[
    Path | None, typer.Option("--truth", metavar="MESH", help="The true surface, in mm and in the camera frame.")
]
AlignOption = Annotated[bool, typer.Option("--align", help="Move each cloud onto the true surface first.")]
PlaneOption = Annotated[bool, typer.Option("--plane", help="The object is a flat plate.")]
SpheresOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--spheres", metavar="D1 D2 DISTANCE", help="The object is two balls of known size, in mm."),
]
SimulateOption = Annotated[
    str | None, typer.Option("--simulate", metavar="SCENE", help="A scene's name or a mesh file to render.")
]
SeedOption = Annotated[int | None, typer.Option("--seed", metavar="N", help="Of a simulation's noise, default 0.")]
NearOption = Annotated[float, typer.Option("--near", metavar="MM", help="How near a point makes the truth complete.")]
OutlierOption = Annotated[float, typer.Option("--outlier", metavar="MM", help="From how far a point is an outlier.")]
RadiusOption = Annotated[
    float | None, typer.Option("--radius", metavar="MM", help="Of the roughness; default by the sparsest cloud.")
]
BlurOption = Annotated[
    tuple[float, float] | None,
    typer.Option("--blur", metavar="CAMERA PROJECTOR", help="1 sigma in px, for the limits; default 0.6 0.6."),
]
DepthOption = Annotated[
    tuple[float, float] | None, typer.Option("--depth", metavar="MIN MAX", help="Depths in mm that can occur.")
]


def compare(
    output: OutputOption,
    folders: FoldersArgument = None,
    rig: RigOption = None,
    truth: TruthOption = None,
    align: AlignOption = False,
    plane: PlaneOption = False,
    spheres: SpheresOption = None,
    simulate: SimulateOption = None,
    codec: CodecOption = None,
    noise: NoiseOption = None,
    optics: OpticsOption = None,
    seed: SeedOption = None,
    near: NearOption = 1.0,
    outlier: OutlierOption = 2.0,
    radius: RadiusOption = None,
    blur: BlurOption = None,
    depth: DepthOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare methods on one rig: a table, pictures and a page, from scans or from a simulation."""
    from slkit import pipeline
    from slkit.files import read_provenance, read_rig

    objects = {"--truth": truth, "--plane": plane or None, "--spheres": spheres}
    of_simulation = {"--codec": codec, "--optics": optics, "--noise": noise, "--seed": seed}
    _check_object(_given(objects), align)
    _check_positive({"--near": near, "--outlier": outlier} | ({} if radius is None else {"--radius": radius}))
    if simulate is None:
        _check_scans(folders, rig, _given(of_simulation))
    else:
        _check_simulation(folders, _given(objects), codec, blur)
    rules = pipeline.Rules(radius, blur or (0.6, 0.6), depth)
    if output.exists() and not output.is_dir():
        raise InputError(f"{output} is no folder: name another one with -o")
    limits = (near, outlier)
    with progress_bar() as progress:
        if simulate is not None:
            light, known = _optics(noise, optics), None if rig is None else read_rig(rig)
            comparison = pipeline.compare_simulated(
                output, simulate, codec or [], known, light, seed or 0, rules, limits, progress=progress
            )
        else:
            reference = _reference(truth, align, plane, spheres, limits)
            found, origin = read_rig(rig or ""), read_provenance(rig or "")
            comparison = pipeline.compare(folders or [], found, reference, rules, origin, progress=progress)
    page = pipeline.write_comparison(output, comparison, simulate or "")
    _report(comparison, page, as_json)


def _given(options: dict[str, Any]) -> list[str]:
    return [option for option, value in options.items() if value is not None]


def _check_object(objects: list[str], align: bool) -> None:
    if len(objects) > 1:
        raise InputError(f"{' and '.join(objects)} exclude each other: the object is one of them")
    if align and "--truth" not in objects:
        raise InputError("--align moves clouds onto a true surface: name one with --truth")


def _check_scans(folders: list[Path] | None, rig: Path | None, of_simulation: list[str]) -> None:
    if of_simulation:
        raise InputError(f"{of_simulation[0]} is of a simulation: add --simulate SCENE, or leave it away")
    if not folders:
        raise InputError("nothing to compare: name scan folders, or a scene with --simulate")
    if rig is None:
        raise InputError("--rig is missing: name the rig.json that `slkit calibrate` wrote for these scans")


def _check_simulation(
    folders: list[Path] | None, objects: list[str], codec: list[str] | None, blur: tuple[float, float] | None
) -> None:
    if folders:
        raise InputError("--simulate makes its own scans: leave the folders away")
    if objects or blur is not None:
        raise InputError(f"--simulate knows the truth: leave {[*objects, '--blur'][0]} away")
    if not codec:
        raise InputError("--simulate needs codecs: name each with --codec")


def _check_positive(values: dict[str, float]) -> None:
    for option, value in values.items():
        if not 0 < value < float("inf"):
            raise InputError(f"{option} must be a positive length in mm, not {value:g}")


def _reference(
    truth: Path | None,
    align: bool,
    plane: bool,
    spheres: tuple[float, float, float] | None,
    limits_mm: tuple[float, float],
) -> Any:
    """Return what the options say the object is, None where they say nothing."""
    from slkit import pipeline
    from slkit.files import read_mesh

    if truth is not None:
        vertices, faces = read_mesh(truth)
        return pipeline.Truth(vertices, faces, truth.name, *limits_mm, align)
    if spheres is not None:
        _check_positive({"--spheres": min(spheres)})
        return pipeline.Balls(spheres[:2], spheres[2])
    return pipeline.Plate() if plane else None


def _report(comparison: Comparison, page: Path, as_json: bool) -> None:
    from slkit.report.comparison import calibration_table, comparison_json, methods_table

    if as_json:
        print_json({"page": str(page)} | comparison_json(comparison))
        return
    grade = comparison.verdict.get("grade", "none")
    print(f"calibration: {comparison.calibration}; verdict: {grade}")
    print(f"compared with {comparison.reference}")
    for table in (methods_table(comparison), calibration_table(comparison)):
        if table.rows:
            print_table(table.columns, table.rows, table.title)
        else:
            print(table.missing)
    for reason in comparison.failed.values():
        print(f"not compared: {reason}")
    for note in [*comparison.notes, *(f"{m.name}: {n}" for m in comparison.methods for n in m.notes)]:
        print(note)
    print(f"page: {page}")
