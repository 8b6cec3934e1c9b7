"""From a calibration folder to a rig; coded light is decoded here, so that a calibrator never sees a codec."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slkit import registry
from slkit.data import BoardView, Calibration, Capture, Finding, Frames
from slkit.errors import CalibrationError, DecodeError, FileError, InputError, SlkitError
from slkit.files import PICTURE_TABLES, CalibrationFolder, Progress, merged, read_calibration, read_image
from slkit.pipeline._diagnosing import diagnose, diagnosis_table, telling
from slkit.pipeline._patterns import load_codec
from slkit.pipeline._reporting import write_report
from slkit.protocols import Calibrator, Codec

_FEWEST_VIEWS = 3


@dataclass(frozen=True)
class CalibrationTask:
    """A calibrator and what it works on.

    dropped: name and reason of each pose whose pictures cannot be used. kinds: for every pose, used or dropped, the
    tables of calibration.toml it comes from. undecoded: the lit pictures of those whose light could not be decoded.
    """

    calibrator: Calibrator
    captures: tuple[Capture, ...]
    dropped: tuple[tuple[str, str], ...]
    kinds: Mapping[str, str]
    undecoded: tuple[Capture, ...] = ()


def load_calibration(
    folder: str | Path,
    method: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> CalibrationTask:
    """Return the calibrator of a calibration folder and its captures, coded light decoded.

    method, parameters: go before what calibration.toml says; parameters are fields of the calibrator.
    Errors: FileError or InputError naming file and key, PluginError; a pose that cannot be read is dropped instead.
    """
    found = read_calibration(folder)
    if parameters and "projector" in parameters:
        raise InputError("the projector's size belongs to the pictures: change it in calibration.toml")
    plugin = registry.load("slkit.calibrators", method or found.method)
    calibrator = registry.create(plugin, merged(found.parameters, parameters or {}), str(found.file))
    jobs = _picture_jobs(found) + _coded_jobs(found)
    captures: list[Capture] = []
    dropped: list[tuple[str, str]] = []
    undecoded: list[Capture] = []
    for index, (name, _, load) in enumerate(jobs):
        try:
            capture, problem = load()
        except SlkitError as error:
            dropped.append((name, str(error)))
        else:
            (undecoded if problem else captures).append(capture)
            dropped += [(name, problem)] if problem else []
        if progress is not None:
            progress("read", index + 1, len(jobs))
    kinds = {name: kind for name, kind, _ in jobs}
    return CalibrationTask(calibrator, tuple(captures), tuple(dropped), kinds, tuple(undecoded))


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
    calibration = diagnose(calibration, task.calibrator, progress)
    if report is not None:
        write_report(report, calibration, task.captures, str(folder))
    return calibration


def _selected(
    calibrator: Calibrator, calibration: Calibration, progress: Progress | None
) -> tuple[Calibrator, Iterator[str]]:
    """Return the calibrator with the distortion set that predicts left-out views best, and what was compared."""
    from slkit.calibration.diagnose import Solver, solver_of
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
    from slkit.calibration._pictures import picture_findings

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
    from slkit.calibration._pictures import panel_findings
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
    from slkit.calibration._pictures import orientation_findings
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


def decode_capture(name: str, codec: Codec, frames: Frames) -> tuple[Capture, str]:
    """Return the capture of one pose under coded light, and why the light could not be decoded, or "".

    Errors: FileError or InputError where the frames are not what the codec needs.
    """
    lit = codec.lit(frames)
    try:
        return Capture(name, lit=lit, correspondences=codec.decode(frames)), ""
    except DecodeError as error:
        return Capture(name, lit=lit), str(error)


_Job = tuple[str, str, Callable[[], tuple[Capture, str]]]
"""Name, kind, and what gives the capture and why its light could not be decoded, or ""."""


def _picture_jobs(found: CalibrationFolder) -> list[_Job]:
    """A printed picture is a capture of its own; marks and projected pattern of one pose make one together."""
    jobs: list[_Job] = [_job(found, {"printed": path}) for path in found.images.get("printed", ())]
    side_b = {key: paths for key, paths in found.images.items() if key != "printed"}
    if len({len(paths) for paths in side_b.values()}) > 1:
        counts = " and ".join(f"{len(paths)} of [{key}]" for key, paths in side_b.items())
        raise FileError(f"{found.file}: {counts}: each pose needs one picture of each, in the same order")
    poses = zip(*side_b.values(), strict=True)
    return jobs + [_job(found, dict(zip(side_b, paths, strict=True))) for paths in poses]


def _job(found: CalibrationFolder, paths: Mapping[str, Path]) -> _Job:
    first = next(iter(paths.values()))
    inside = first.relative_to(found.root) if first.is_relative_to(found.root) else first
    name = inside.with_suffix("").as_posix()

    def load() -> tuple[Capture, str]:
        pictures = {PICTURE_TABLES[key]: read_image(path) for key, path in paths.items()}
        return Capture(name, pictures.get("printed"), pictures.get("marks"), pictures.get("projected")), ""

    return name, " and ".join(paths), load


def _coded_jobs(found: CalibrationFolder) -> list[_Job]:
    jobs: list[_Job] = []
    for name, folder in found.coded:
        codec = load_codec(folder.codec, folder.projector, folder.parameters, f"{folder.file}: coded")

        def load(name: str = name, folder: Any = folder, codec: Any = codec) -> tuple[Capture, str]:
            return decode_capture(name, codec, folder.frames(codec.encode().names))

        jobs.append((name, "coded", load))
    return jobs
