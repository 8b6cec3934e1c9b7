"""slkit calibrate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from slkit.cli._common import JsonOption, SetOption, number, parse_settings, print_json, print_table, progress_bar

if TYPE_CHECKING:
    from slkit.data import Calibration


def calibrate(
    folder: Annotated[Path, typer.Argument(metavar="CALIB_DIR", help="A folder with a calibration.toml.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The rig, as JSON.")],
    method: Annotated[
        str | None, typer.Option("--method", metavar="NAME", help="Instead of the file's method.")
    ] = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate camera and projector from pictures of boards."""
    from slkit import pipeline
    from slkit.files import write_rig

    with progress_bar() as progress:
        calibration = pipeline.calibrate(folder, method, parse_settings(settings), progress)
    evidence = pipeline.provenance(calibration)
    write_rig(output, calibration.rig, evidence)
    if as_json:
        views = [view | {"rms_px": view["rms_px"]["joint"]} for view in evidence["views"]]
        told = {"rms_px": evidence["rms_px"], "views": views, "verdict": evidence["verdict"]}
        print_json(told | {"rig": str(output)})
    else:
        _print(calibration, evidence, output)


def _print(calibration: Calibration, evidence: dict[str, Any], output: Path) -> None:
    rows = [
        (
            view.name,
            "yes" if view.used else "no",
            number(view.rms_camera),
            number(view.rms_projector),
            number(view.rms_joint),
            view.reason,
        )
        for view in calibration.views
    ]
    print_table(("view", "used", "camera px", "projector px", "joint px", "reason"), rows)
    rms = evidence["rms_px"]
    print(
        f"rms: camera {number(rms['camera'])} px, projector {number(rms['projector_device'])} px, "
        f"joint {number(rms['joint'])} px ({calibration.method})"
    )
    print(f"verdict: {calibration.verdict.grade}")
    for finding in calibration.verdict.reasons:
        where = f"{finding.view}: " if finding.view else ""
        print(f"  {where}{finding.fault}; {finding.remedy}")
    told = {f"{view.name}: {view.reason}" for view in calibration.views}
    for note in calibration.notes:
        if note not in told:
            print(f"note: {note}")
    print(f"rig: {output}")
