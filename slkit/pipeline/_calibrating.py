"""From a calibration folder to a rig; coded light is decoded here, so that a calibrator never sees a codec."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slkit import registry
from slkit.data import BoardView, Calibration, Capture
from slkit.errors import CalibrationError, FileError, InputError, SlkitError
from slkit.files import CalibrationFolder, Progress, merged, read_calibration, read_image
from slkit.pipeline._patterns import load_codec
from slkit.protocols import Calibrator

_FEWEST_VIEWS = 3


@dataclass(frozen=True)
class CalibrationTask:
    """A calibrator and what it works on.

    dropped: name and reason of each pose whose pictures cannot be used. kinds: for every pose, used or dropped, the
    tables of calibration.toml it comes from.
    """

    calibrator: Calibrator
    captures: tuple[Capture, ...]
    dropped: tuple[tuple[str, str], ...]
    kinds: Mapping[str, str]


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
    for index, (name, _, load) in enumerate(jobs):
        try:
            captures.append(load())
        except SlkitError as error:
            dropped.append((name, str(error)))
        if progress is not None:
            progress("read", index + 1, len(jobs))
    kinds = {name: kind for name, kind, _ in jobs}
    return CalibrationTask(calibrator, tuple(captures), tuple(dropped), kinds)


def calibrate(
    folder: str | Path,
    method: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Return the calibration of a folder with a calibration.toml.

    Errors: as `load_calibration`, and CalibrationError where the usable views do not suffice.
    """
    task = load_calibration(folder, method, parameters, progress)
    if progress is not None:
        progress("find boards", 0, 1)
    views = list(task.calibrator.observe(task.captures))
    size = views[0].image_size if views else (1, 1)
    views += [BoardView.unusable(name, size, reason) for name, reason in task.dropped]
    _check_views(views, task.kinds, str(folder))
    if progress is not None:
        progress("find boards", 1, 1)
        progress("solve", 0, 1)
    calibration = task.calibrator.solve(views)
    if progress is not None:
        progress("solve", 1, 1)
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
    }


def rms_table(evidence: Any) -> dict[str, float | None]:
    """Return the three rms in px of a calibration or of one of its views; None where there is none."""
    values = {
        "camera": evidence.rms_camera,
        "projector_device": evidence.rms_projector,
        "joint": evidence.rms_joint,
    }
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}


def _check_views(views: Sequence[BoardView], kinds: Mapping[str, str], folder: str) -> None:
    """Refuse a set of pictures of which too few can be used, and say what is the matter with the others."""
    for kind in dict.fromkeys(kinds.values()):
        mine = [v for v in views if kinds.get(v.name) == kind]
        usable = sum(v.problem is None for v in mine)
        if usable < _FEWEST_VIEWS:
            problems = "; ".join(f"{v.name}: {v.problem}" for v in mine if v.problem is not None)
            raise CalibrationError(
                f"{folder}: {usable} of {len(mine)} {kind} views can be used, at least {_FEWEST_VIEWS} are needed: "
                + (f"take more, or mend these: {problems}" if problems else "take more pictures")
            )


_Job = tuple[str, str, Callable[[], Capture]]


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

    def load() -> Capture:
        pictures = {key: read_image(path) for key, path in paths.items()}
        return Capture(name, pictures.get("printed"), pictures.get("marks"), pictures.get("projected"))

    return name, " and ".join(paths), load


def _coded_jobs(found: CalibrationFolder) -> list[_Job]:
    jobs: list[_Job] = []
    for name, folder in found.coded:
        codec = load_codec(folder.codec, folder.projector, folder.parameters, f"{folder.file}: coded")

        def load(name: str = name, folder: Any = folder, codec: Any = codec) -> Capture:
            frames = folder.frames(codec.encode().names)
            return Capture(name, lit=codec.lit(frames), correspondences=codec.decode(frames))

        jobs.append((name, "coded", load))
    return jobs
