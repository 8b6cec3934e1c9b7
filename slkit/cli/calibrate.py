"""slkit calibrate."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from slkit.cli._common import JsonOption, SetOption, number, parse_settings, print_json, print_table, progress_bar
from slkit.cli.rig import print_photometry

if TYPE_CHECKING:
    from slkit.data import Calibration


def calibrate(
    folder: Annotated[Path, typer.Argument(metavar="CALIB_DIR", help="A folder with a calibration.toml.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The rig, as JSON.")],
    method: Annotated[
        str | None, typer.Option("--method", metavar="NAME", help="Instead of the file's method.")
    ] = None,
    settings: SetOption = None,
    no_refine: Annotated[
        bool, typer.Option("--no-refine", help="The paper's sequence of camera, poses, projector; no joint adjustment.")
    ] = False,
    select: Annotated[
        bool, typer.Option("--select", help="Choose the distortion coefficients by the views that they predict.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Folder for a page with figures of the evidence.")
    ] = None,
    color: Annotated[
        Path | None, typer.Option("--color", metavar="DIR", help="Pictures of a white plane as of `slkit rig color`.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate camera and projector from pictures of boards."""
    from slkit import pipeline
    from slkit.files import merged, plain, write_rig

    parameters = parse_settings(settings)
    if no_refine:
        parameters = merged(parameters, {"model": {"refine": False}})
    # A mistake in these few pictures is told before minutes of work.
    photometry = None if color is None else pipeline.measure_photometry(color)
    with progress_bar() as progress:
        calibration = pipeline.calibrate(folder, method, parameters, progress, select=select, report=report)
    evidence = pipeline.provenance(calibration)
    rig = calibration.rig if photometry is None else pipeline.with_photometry(calibration.rig, photometry)
    write_rig(output, rig, evidence)
    if as_json:
        views = [view | {"rms_px": view["rms_px"]["joint"]} for view in evidence["views"]]
        told = {name: evidence[name] for name in ("rms_px", "verdict", "notes", "diagnosis")} | {"views": views}
        files = {"rig": str(output)} | ({} if report is None else {"report": str(report / "report.html")})
        print_json(plain(told) | ({} if photometry is None else {"photometry": photometry}) | files)
    else:
        _print(calibration, evidence)
        if photometry is not None:
            print_photometry(photometry)
        print(f"rig: {output}")
        if report is not None:
            print(f"report: {report / 'report.html'}")


def _print(calibration: Calibration, evidence: dict[str, Any]) -> None:
    left_out = calibration.diagnosis.left_out_px if calibration.diagnosis is not None else {}
    counts = Counter(view.reason for view in calibration.views)
    common = [reason for reason, count in counts.items() if reason and count > 2]
    rows = [
        (
            view.name,
            "yes" if view.used else "no",
            number(view.rms_camera),
            number(view.rms_projector),
            number(view.rms_joint),
            number(left_out.get(view.name, math.nan)),
            f"({common.index(view.reason) + 1})" if view.reason in common else view.reason,
        )
        for view in calibration.views
    ]
    print_table(("view", "used", "camera px", "projector px", "joint px", "left-out px", "reason"), rows)
    for index, reason in enumerate(common):
        print(f"({index + 1}) {reason}")
    rms = evidence["rms_px"]
    print(
        f"rms: camera {number(rms['camera'])} px, projector {number(rms['projector_device'])} px, "
        f"joint {number(rms['joint'])} px ({calibration.method})"
    )
    _print_diagnosis(calibration)
    print(f"verdict: {calibration.verdict.grade}")
    for finding in calibration.verdict.reasons:
        where = f"{finding.view}: " if finding.view else ""
        print(f"  {where}{finding.fault}; {finding.remedy}")
    told = {f"{view.name}: {view.reason}" for view in calibration.views}
    for note in calibration.notes:
        if note not in told:
            print(f"note: {note}")


def _print_diagnosis(calibration: Calibration) -> None:
    for name, found in calibration.classes.items():
        rejected = f", {found.rejected} rejected" if found.rejected else ""
        print(f"{name}: {found.rows} points{rejected}, {number(found.sigma_px)} px a coordinate")
    diagnosis = calibration.diagnosis
    if diagnosis is None:
        return
    for name, device in diagnosis.devices.items():
        (near, far), (least, most), filled = device.depth_mm, device.tilt_deg, int((device.coverage > 0).sum())
        # The faces of a solid have no tilt in common.
        tilt = f", tilt {least:.0f} to {most:.0f} deg" if math.isfinite(least) else ""
        print(f"{name}: points in {filled} of 9 ninths of the image, depth {near:.0f} to {far:.0f} mm{tilt}")
        if device.parameters:
            spread = ", ".join(f"{n} {number(3 * sigma)}" for n, (_, sigma) in device.parameters.items())
            print(f"  3 sigma: {spread}")
    for name, (_, means, _) in diagnosis.repeating.items():
        largest = float((means**2).sum(axis=1).max() ** 0.5)
        print(f"{name} points: up to {number(largest)} px off at one place in all views alike")
    if diagnosis.left_out_px:
        print(f"left-out views are predicted to {number(diagnosis.left_out_rms_px)} px in the projector")
    noise = f", {number(diagnosis.cross_validation_noise_mm)} mm by their noise,"
    for name, volume, beside in (
        ("3D uncertainty, 1 sigma after rigid alignment", diagnosis.uncertainty, ""),
        ("two halves of the views, after rigid alignment, differ by", diagnosis.cross_validation, noise),
    ):
        if volume is not None:
            low, high = volume.depths_mm.min(), volume.depths_mm.max()
            print(f"{name}: {number(volume.rms_mm)} mm{beside} at depths of {low:.0f} to {high:.0f} mm")
    for first, second, value in diagnosis.correlations:
        print(
            f"{first} and {second} are known together only (correlation {number(value)}): "
            "harmless while the 3D uncertainty is small, else take views at more tilts and depths"
        )
