"""slkit rig show, color, export and import."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from slkit.cli._common import JsonOption, number, print_json
from slkit.errors import InputError

if TYPE_CHECKING:
    from slkit.geometry import Pinhole, Rig

app = typer.Typer(help="Show a rig, or exchange it with other programs.", no_args_is_help=True, rich_markup_mode=None)

Format = Annotated[Literal["opencv"], typer.Option("--format", help="The other program's form: YAML of OpenCV.")]


@app.command()
def show(
    rig: Annotated[Path, typer.Argument(metavar="RIG.json")],
    as_json: JsonOption = False,
) -> None:
    """Print both lenses, how the projector stands, and the evidence that the file keeps."""
    from slkit.files import read_provenance, read_rig

    found, origin = read_rig(rig), read_provenance(rig)
    table = _table(found, origin)
    if as_json:
        print_json(table)
        return
    for name, device in (("camera", found.camera), ("projector", found.projector)):
        print(_describe(name, device, table["sigma"]))
    center = _row(table["projector_center_mm"], 2)
    print(f"baseline: {number(table['baseline_mm'], 2)} mm; projector centre at {center} mm")
    print(f"rotation camera to projector: {number(table['rotation_deg'], 3)} deg")
    rms = table["rms_px"]
    if rms:
        print("rms: " + ", ".join(f"{name} {number(value)} px" for name, value in rms.items()))
    if found.photometry is not None:
        print_photometry(found.photometry)


@app.command()
def color(
    rig: Annotated[Path, typer.Argument(metavar="RIG.json")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Pictures of a white plane: white, black, red, ...")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Default: RIG.json.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write into a rig.json how its camera sees the colors of its projector; `slkit patterns color` shows them."""
    from slkit import pipeline

    photometry = pipeline.add_photometry(rig, folder, output)
    if as_json:
        print_json({"photometry": photometry, "rig": str(output or rig)})
        return
    print_photometry(photometry)
    print(f"rig: {output or rig}")


@app.command("export")
def export_rig(
    rig: Annotated[Path, typer.Argument(metavar="RIG.json")],
    form: Format = "opencv",
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Default: RIG.yml.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a rig.json for another program: matrices, distortion, R and T as cv2.stereoCalibrate returns them."""
    from slkit.files import read_rig, write_opencv

    target = output or rig.with_suffix(".yml")
    write_opencv(target, read_rig(rig))
    _report({form: str(target)}, as_json)


@app.command("import")
def import_rig(
    source: Annotated[Path, typer.Argument(metavar="FILE")],
    form: Format = "opencv",
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Default: FILE.json.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write another program's rig as a rig.json."""
    from slkit.files import read_opencv, write_rig

    target = output or source.with_suffix(".json")
    if target == source:
        raise InputError(f"{source} would be overwritten: name the new file with -o")
    write_rig(target, read_opencv(source), {"imported": {"format": form, "file": source.name}})
    _report({"rig": str(target)}, as_json)


def _report(written: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(written)
        return
    for what, path in written.items():
        print(f"{what}: {path}")


def _table(rig: Rig, origin: dict[str, Any]) -> dict[str, Any]:
    import numpy as np

    from slkit.files import plain
    from slkit.geometry import sigmas_of

    pose = rig.projector_from_camera
    devices = {
        name: {"size": list(d.size), "K": d.K.tolist(), "distortion": d.distortion.tolist()}
        for name, d in (("camera", rig.camera), ("projector", rig.projector))
    }
    return devices | {
        "baseline_mm": float(np.linalg.norm(pose.translation)),
        "projector_center_mm": rig.projector_center.tolist(),
        "rotation_deg": float(np.degrees(np.linalg.norm(pose.rotation_vector))),
        "sigma": sigmas_of(rig.covariance),
        "rms_px": origin.get("rms_px"),
        "method": origin.get("method"),
        "photometry": plain(rig.photometry),
    }


def print_photometry(photometry: Mapping[str, Any]) -> None:
    """Print how a camera sees the colors of a projector, as far as it is known, and the evidence."""
    print("color mixing, rows seen, columns projected, red green blue:")
    for row in photometry.get("mixing", ()):
        print(f"  {_row(row, 4)}")
    if "ambient" in photometry:
        print(f"ambient: {_row(photometry['ambient'], 4)} of full scale")
    told = _row(photometry["response"], 3) if "response" in photometry else "not measured"
    print(f"projector response, exponents: {told}")
    evidence = photometry.get("evidence")
    if evidence:
        extra = 100 * max((float(v) for v in evidence["additivity"]), key=abs)
        print(
            f"evidence: {int(evidence['pixels'])} pixels, {100 * evidence['neutral']:.0f} % of the lit field neutral, "
            f"{100 * evidence['saturated']:.1f} % saturated; red + green + blue differ from white by {extra:+.1f} %"
        )
    for warning in photometry.get("warnings", ()):
        print(f"warning: {warning}")


def _describe(name: str, device: Pinhole, sigmas: dict[str, float]) -> str:
    import numpy as np

    def spread(*parameters: str) -> str:
        known = [sigmas.get(f"{name}.{p}") for p in parameters]
        return "" if None in known else f" (+- {_row(known, 2)})"

    width, height = device.size
    focal = np.array([device.K[0, 0], device.K[1, 1]])
    # Edge to edge through the principal point, without the lens's distortion.
    edges = (np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]]) - device.K[:2, 2]) / focal
    angles = np.degrees(np.arctan(edges[1]) - np.arctan(edges[0]))
    lines = [
        f"{name}: {width} x {height} px, angle of view {_row(angles, 1)} deg",
        f"  focal length {_row(focal, 2)}{spread('fx', 'fy')} px, principal point {_row(device.K[:2, 2], 2)}"
        f"{spread('cx', 'cy')} px, skew {device.K[0, 1]:.4g}",
        f"  distortion k1 k2 p1 p2 k3: {_row(device.distortion, 5)}",
    ]
    return "\n".join(lines)


def _row(values: Any, digits: int) -> str:
    return " ".join(number(float(v), digits) for v in values)
