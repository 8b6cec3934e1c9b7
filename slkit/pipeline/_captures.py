"""From a calibration folder to captures; coded light is decoded here, so that a calibrator never sees a codec."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slkit import registry
from slkit.data import Capture, Frames
from slkit.errors import DecodeError, FileError, InputError, SlkitError
from slkit.files import PICTURE_TABLES, CalibrationFolder, Progress, loss_notes, merged, read_calibration, read_image
from slkit.pipeline._patterns import load_codec
from slkit.protocols import Calibrator, Codec


@dataclass(frozen=True)
class CalibrationTask:
    """A calibrator and what it works on.

    dropped: name and reason of each pose whose pictures cannot be used. kinds: for every pose, used or dropped, the
    tables of calibration.toml it comes from. undecoded: the lit pictures of those whose light could not be decoded.
    notes: sentences about the files.
    """

    calibrator: Calibrator
    captures: tuple[Capture, ...]
    dropped: tuple[tuple[str, str], ...]
    kinds: Mapping[str, str]
    undecoded: tuple[Capture, ...] = ()
    notes: tuple[str, ...] = ()


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
    notes = loss_notes(_files(found), str(folder))
    return CalibrationTask(calibrator, tuple(captures), tuple(dropped), kinds, tuple(undecoded), notes)


def _files(found: CalibrationFolder) -> Iterator[Path]:
    """Yield the files of all pictures but of those poses whose pictures are missing, which are dropped."""
    for paths in found.images.values():
        yield from paths
    for _, folder in found.coded:
        codec = load_codec(folder.codec, folder.projector, folder.parameters)
        with suppress(FileError):
            yield from folder.source.paths(codec.encode().names, folder.codec)


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
