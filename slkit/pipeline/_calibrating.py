"""From captures to a rig with its verdict: the views that can be used, what their pictures tell, the solution."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slkit.data import BoardView, Calibration, Finding
from slkit.errors import CalibrationError, InputError
from slkit.files import Progress
from slkit.pipeline._captures import CalibrationTask, load_calibration
from slkit.pipeline._diagnosing import diagnose, diagnosis_table, telling
from slkit.pipeline._reporting import write_report
from slkit.protocols import Calibrator

_FEWEST_VIEWS = 3


def calibrate(
    folder: str | Path,
    method: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    *,
    select: bool = False,
    report: str | Path | None = None,
) -> Calibration:
    """Return the calibration of a folder with a calibration.toml, with its diagnosis.

    select: compare distortion sets by the views that they predict, and take the leanest that predicts well.
    report: a folder for a page with figures. Errors: as `load_calibration`, and CalibrationError where the usable views
    do not suffice.
    """
    task = load_calibration(folder, method, parameters, progress)
    views, findings = observed(task, str(folder), progress)
    calibration = solved(task, views, findings, progress)
    if select:
        model, told = _selected(task.calibrator, calibration, progress)
        task = dataclasses.replace(task, calibrator=model)
        calibration = solved(task, views, findings, progress)
        calibration = dataclasses.replace(calibration, notes=(*calibration.notes, *told))
    calibration = dataclasses.replace(calibration, notes=(*calibration.notes, *task.notes))
    calibration = diagnose(calibration, task.calibrator, progress)
    if report is not None:
        write_report(report, calibration, task.captures, str(folder))
    return calibration


def _selected(
    calibrator: Calibrator, calibration: Calibration, progress: Progress | None
) -> tuple[Calibrator, Iterator[str]]:
    """Return the calibrator with the distortion set that predicts left-out views best, and what was compared."""
    from slkit.calibration.left_out import Solver, solver_of
    from slkit.calibration.model import Model
    from slkit.calibration.select import select_distortion

    known: Any = calibrator
    if not isinstance(getattr(known, "model", None), Model):
        raise InputError(f"--select needs a calibrator with a field `model`, which {calibration.method} has not")

    def solver(model: Model) -> Solver:
        return solver_of(calibration, known, model)

    model, candidates = select_distortion(calibration, known.model, solver, telling(progress, "compare models"))
    return dataclasses.replace(known, model=model), _comparison(candidates)


def _comparison(candidates: Sequence[Any]) -> Iterator[str]:
    for device in dict.fromkeys(c.device for c in candidates):
        mine = [c for c in candidates if c.device == device]
        taken = next(c for c in mine if c.taken)
        others = ", ".join(f"{_set(c.distortion)} {c.left_out_px:.4f}" for c in mine if not c.taken)
        yield (
            f"the {device}'s distortion is {_set(taken.distortion)}: views left out are predicted to "
            f"{taken.left_out_px:.4f} px, and no leaner set does as well ({others})"
        )


def _set(distortion: Sequence[str]) -> str:
    return " ".join(distortion) or "none"


def calibrate_captures(task: CalibrationTask, where: str, progress: Progress | None = None) -> Calibration:
    """Return the calibration of captures that are in memory. where: what to call them in messages.

    Errors: CalibrationError where the usable views do not suffice; its `findings` are the mistakes that pictures show.
    """
    return solved(task, *observed(task, where, progress), progress)


def observed(
    task: CalibrationTask, where: str, progress: Progress | None = None
) -> tuple[list[BoardView], tuple[Finding, ...]]:
    """Return one view a capture, and the mistakes that the pictures show; errors as `calibrate_captures`."""
    from slkit.calibration.pictures import picture_findings

    if progress is not None:
        progress("find boards", 0, 1)
    views = list(task.calibrator.observe(task.captures))
    size = views[0].image_size if views else (1, 1)
    views += [BoardView.unusable(name, size, reason) for name, reason in task.dropped]
    findings = picture_findings((*task.captures, *task.undecoded), views, task.calibrator)
    _check_views(views, task.kinds, where, findings, getattr(task.calibrator, "fewest_views", _FEWEST_VIEWS))
    if progress is not None:
        progress("find boards", 1, 1)
    return views, findings


def solved(
    task: CalibrationTask, views: Sequence[BoardView], findings: Sequence[Finding], progress: Progress | None = None
) -> Calibration:
    """Return the calibration of what was observed, its verdict with what the pictures told; errors as `solve_views`."""
    from slkit.calibration.pictures import panel_findings
    from slkit.calibration.verdict import judged

    if progress is not None:
        progress("solve", 0, 1)
    calibration = solve_views(task.calibrator, views, findings)
    if progress is not None:
        progress("solve", 1, 1)
    if any(f.code == "wrong-marks" for f in findings):
        return calibration
    sizes = panel_findings(task.captures, views, task.calibrator, calibration.rig.camera)
    return dataclasses.replace(calibration, verdict=judged(calibration, sizes))


def solve_views(calibrator: Calibrator, views: Sequence[BoardView], findings: Sequence[Finding] = ()) -> Calibration:
    """Return the calibration of board views with its verdict. findings: what the pictures of the views told before.

    Errors: CalibrationError where the views do not suffice, with `findings` that say why.
    """
    from slkit.calibration.pictures import orientation_findings
    from slkit.calibration.verdict import judged

    told = tuple(findings) if findings else tuple(orientation_findings(views))
    try:
        calibration = calibrator.solve(views)
    except CalibrationError as error:
        told = (*told, *(f for f in error.findings if f.code not in {t.code for t in told}))
        raise CalibrationError(f"{error}{_told(told)}", told) from error
    calibration = dataclasses.replace(calibration, verdict=judged(calibration, told))
    if calibration.rig.covariance is None and calibration.covariance is not None:
        rig = dataclasses.replace(calibration.rig, covariance=calibration.covariance)
        return dataclasses.replace(calibration, rig=rig)
    return calibration


def provenance(calibration: Calibration) -> dict[str, Any]:
    """Return where a rig comes from as rig.json keeps it: method, rms in px, views, verdict and notes."""
    from slkit import __version__

    return {
        "slkit": __version__,
        "method": calibration.method,
        "rms_px": rms_table(calibration),
        "views": [
            {"name": v.name, "used": v.used, "reason": v.reason, "rms_px": rms_table(v)} for v in calibration.views
        ],
        "verdict": dataclasses.asdict(calibration.verdict),
        "notes": list(calibration.notes),
        "diagnosis": diagnosis_table(calibration),
    }


def rms_table(evidence: Any) -> dict[str, float | None]:
    """Return the three rms in px of a calibration or of one of its views; None where there is none."""
    values = {
        "camera": evidence.rms_camera,
        "projector_device": evidence.rms_projector,
        "joint": evidence.rms_joint,
    }
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}


def _check_views(
    views: Sequence[BoardView], kinds: Mapping[str, str], where: str, findings: Sequence[Finding], fewest: int
) -> None:
    """Refuse a set of pictures of which too few can be used, and say what is the matter with the others."""
    for kind in dict.fromkeys(kinds.values()):
        mine = [v for v in views if kinds.get(v.name) == kind]
        usable = sum(v.problem is None for v in mine)
        if usable < fewest:
            problems = _grouped(mine)
            raise CalibrationError(
                f"{where}: {usable} of {len(mine)} {kind} views can be used, at least {fewest} are needed: "
                + (f"take more, or mend these: {problems}" if problems else "take more pictures")
                + _told(findings),
                tuple(findings),
            )


def _grouped(views: Sequence[BoardView]) -> str:
    """Return what is the matter with views, each problem once."""
    names: dict[str, list[str]] = {}
    for view in views:
        if view.problem is not None:
            names.setdefault(view.problem, []).append(view.name)
    return "; ".join(
        f"{mine[0]}{f' and {len(mine) - 1} more' * (len(mine) > 1)}: {problem}" for problem, mine in names.items()
    )


def _told(findings: Sequence[Finding]) -> str:
    """Return what the pictures show as the end of a sentence, each mistake once."""
    first = {finding.code: finding for finding in reversed(findings)}
    told = [f"{f.view}: {f.fault} ({f.remedy})" if f.view else f"{f.fault} ({f.remedy})" for f in first.values()]
    return f". The pictures show: {'; '.join(reversed(told))}" if told else ""
