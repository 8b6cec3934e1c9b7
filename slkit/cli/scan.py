"""slkit scan and slkit view."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from slkit.cli._common import JsonOption, SetOption, number, parse_settings, print_json, progress_bar
from slkit.device import on_device
from slkit.errors import InputError

if TYPE_CHECKING:
    from slkit.geometry import Rig
    from slkit.pipeline import ScanResult


def scan(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="SCAN_DIR", help="A folder with a capture.toml and the pictures, or a video or stack beside it."
        ),
    ],
    rig: Annotated[Path, typer.Option("--rig", metavar="FILE", help="The rig that `slkit calibrate` wrote.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="The cloud; its ending is the format.")
    ],
    sequence: Annotated[
        bool, typer.Option("--sequence", help="A cloud of every picture, or of every set of them, into the folder -o.")
    ] = False,
    settings: SetOption = None,
    depth: Annotated[
        tuple[float, float] | None, typer.Option("--depth", metavar="MIN MAX", help="Depths in mm that can occur.")
    ] = None,
    no_filter: Annotated[
        list[str] | None, typer.Option("--no-filter", metavar="NAME", help="Switch a filter off; may be repeated.")
    ] = None,
    normals: Annotated[bool, typer.Option("--normals", help="Estimate a normal for every point.")] = False,
    device: Annotated[
        str, typer.Option("--device", metavar="NAME", help="cpu, or cuda for what a graphics processor can do.")
    ] = "cpu",
    as_json: JsonOption = False,
) -> None:
    """Turn pictures of projected patterns into a point cloud."""
    from slkit import pipeline
    from slkit.files import read_rig

    if sequence:
        if device != "cpu":
            raise InputError("--device is for single scans: a sequence runs on the processor")
        off = ["isolated", *(no_filter or ())]
        _scan_sequence(folder, read_rig(rig), output, parse_settings(settings), depth, off, normals, as_json)
        return
    pipeline.exporter(output)
    filters = pipeline.make_filters(no_filter or ())
    with on_device(device), progress_bar() as progress:
        result = pipeline.scan(
            folder, read_rig(rig), parse_settings(settings), depth, filters, normals=normals, progress=progress
        )
    started = time.perf_counter()
    pipeline.write_cloud(output, result.cloud)
    seconds = {**result.seconds, "write": time.perf_counter() - started}
    _report(result, seconds, output, as_json)


def _scan_sequence(
    source: Path,
    rig: Rig,
    folder: Path,
    settings: dict[str, Any],
    depth: tuple[float, float] | None,
    off: list[str],
    normals: bool,
    as_json: bool,
) -> None:
    from slkit import pipeline

    if normals:
        raise InputError("--normals is for single scans: a sequence has none")
    filters = pipeline.make_filters(off)
    with progress_bar() as progress:
        result = pipeline.scan_sequence(source, rig, folder, settings, depth, filters, progress)
    rate = result.scans / result.seconds
    if as_json:
        print_json({**dataclasses.asdict(result), "scans_per_second": rate, "folder": str(folder)})
        return
    print(f"clouds: {result.clouds} of {result.scans} scans in {folder}, {result.points} points")
    print(f"seconds: {number(result.seconds, 2)}, {number(rate, 1)} scans a second")
    if result.first_failure:
        print(f"without a cloud: {result.scans - result.clouds}, first {result.first_failure}")
    _print_notes(result.notes)


def _report(result: ScanResult, seconds: dict[str, float], output: Path, as_json: bool) -> None:
    cloud = result.cloud
    sigmas = {n: _spread(getattr(cloud, n)) for n in ("sigma_mm", "sigma_decoding_mm", "sigma_cal_mm")}
    if as_json:
        print_json({"points": len(cloud), "seconds": seconds, **sigmas, "notes": result.notes, "cloud": str(output)})
        return
    print(f"points: {len(cloud)} in {output}")
    removed = ", ".join(f"{name} {count}" for name, count in result.removed.items())
    print(f"removed by filter: {removed or 'none'}")
    whole, decoding, calibration = sigmas.values()
    print(f"sigma along the ray: median {number(whole['median'])} mm, 95 % below {number(whole['p95'])} mm")
    print(f"  of it from decoding: median {number(decoding['median'])} mm, from calibration: {_known(calibration)}")
    print("seconds: " + ", ".join(f"{stage} {number(value, 2)}" for stage, value in seconds.items()))
    _print_notes(result.notes)


def _print_notes(notes: Sequence[str]) -> None:
    for note in notes:
        print(f"note: {note}")


def _spread(values: Any) -> dict[str, float]:
    """Return median and 95th percentile of those values (m,) that are known, NaN without any."""
    import numpy as np

    known = values[np.isfinite(values)]
    if not len(known):
        return {"median": float("nan"), "p95": float("nan")}
    # NumPy's percentiles ask for two neighbours each, which takes ten times as long.
    at = {"median": len(known) // 2, "p95": round(0.95 * (len(known) - 1))}
    return {name: float(np.partition(known, k)[k]) for name, k in at.items()}


def _known(sigma: dict[str, float]) -> str:
    if math.isnan(sigma["median"]):
        return "not known, for the rig has no covariance"
    return f"median {number(sigma['median'])} mm"


def view(
    cloud: Annotated[Path, typer.Argument(metavar="CLOUD.ply")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The picture, as PNG.")],
    as_json: JsonOption = False,
) -> None:
    """Draw a picture of a cloud, without a display."""
    from slkit import pipeline

    pipeline.view(cloud, output)
    if as_json:
        print_json({"picture": str(output)})
    else:
        print(f"picture: {output}")
