"""Capture folders and calibration folders: a TOML file that says what was captured, and the pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from slkit.data import Frames
from slkit.errors import FileError, InputError
from slkit.files.losses import loss_notes
from slkit.files.sources import SEVERAL_ENDINGS, FrameSource, find_files, find_folders
from slkit.files.stacks import STACK_ENDINGS
from slkit.files.tables import Table, read_toml, resolve_root, want
from slkit.geometry import as_size

PICTURE_TABLES = {
    "printed": "printed",
    "marks": "marks",
    "corner_board": "marks",
    "solid": "marks",
    "projected": "projected",
}
"""Tables of calibration.toml that have `images`, and which picture of a Capture these become."""


@dataclass(frozen=True)
class CaptureFolder:
    """Coded light on one scene: which codec, its parameters without the projector, and where the frames lie.

    projector: (width, height) px. file: the TOML file.
    """

    file: Path
    codec: str
    parameters: Table
    projector: tuple[int, int]
    source: FrameSource

    def frames(self, names: Sequence[str]) -> Frames:
        """Return the pictures as the frames `names` of the codec, in that order; each is read when asked for.

        Errors: FileError for a wrong number of pictures, naming the missing ones.
        """
        return self.source.frames(names, self.codec)

    def notes(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return a sentence for each way in which the pictures were stored with loss. Errors: as `frames`."""
        return loss_notes(self.source.paths(names, self.codec), str(self.source.folder))


@dataclass(frozen=True)
class CalibrationFolder:
    """What was captured for a calibration.

    parameters: every key that belongs to the calibrator, `images` taken out of its tables. images: files per picture
    table. coded: per pose its name and its coded light. file: the TOML file.
    """

    file: Path
    method: str
    parameters: Table
    images: Mapping[str, tuple[Path, ...]]
    coded: tuple[tuple[str, CaptureFolder], ...]
    root: Path


def read_capture(path: str | Path) -> CaptureFolder:
    """Return what capture.toml in a folder, or a TOML file itself, says of a scan.

    path may also be a stack or a video with a capture.toml beside it: it holds the frames, whatever `frames` says.
    Errors: FileError naming file and key.
    """
    path = Path(path)
    if path.suffix.lower() in SEVERAL_ENDINGS and not path.is_dir():
        if not path.is_file():
            raise FileError(f"there is no {'stack' if path.suffix.lower() in STACK_ENDINGS else 'video'} {path}")
        found = read_capture(path.parent)
        return replace(found, source=FrameSource(path.parent, {"": (path.name,)}, str(found.file)))
    file = toml_file(path, "capture.toml", "`slkit patterns` writes one to copy into the folder of your pictures")
    table = read_toml(file)
    unknown = set(table) - {"codec", "root", "projector", "parameters", "frames"}
    if unknown:
        raise FileError(f"{file}: {sorted(unknown)[0]!r} is no key of a capture")
    root = resolve_root(file, want(table, "root", str, str(file), "."))
    return _coded(file, table, projector_size(table, file), root)


def read_calibration(path: str | Path) -> CalibrationFolder:
    """Return what calibration.toml in a folder, or a TOML file itself, says of a calibration.

    Errors: FileError naming file and key.
    """
    file = toml_file(path, "calibration.toml", "`slkit patterns checkerboard` writes one to start from")
    table = read_toml(file)
    method = want(table, "method", str, str(file))
    projector = projector_size(table, file)
    root = resolve_root(file, want(table, "root", str, str(file), "."))
    images: dict[str, tuple[Path, ...]] = {}
    parameters: Table = {"projector": list(projector)}
    for key, value in table.items():
        if key in ("method", "root", "projector", "coded"):
            continue
        section = cast("Table", value) if isinstance(value, dict) else {}
        if "images" in section:
            images[key] = _images(file, key, section["images"], root)
        parameters[key] = {k: v for k, v in section.items() if k != "images"} if isinstance(value, dict) else value
    coded = _poses(file, table, projector, root)
    if not images and not coded:
        raise FileError(f"{file} names no pictures: give a table `images`, or a table [coded] with `poses`")
    return CalibrationFolder(file, method, parameters, images, coded, root)


def toml_file(path: str | Path, name: str, hint: str) -> Path:
    """Return the TOML file that a folder or a file stands for. Errors: FileError where there is none."""
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise FileError(f"there is no folder {path}")
    if not (path / name).is_file():
        raise FileError(f"{path} has no {name}: {hint}")
    return path / name


def projector_size(table: Mapping[str, Any], file: Path) -> tuple[int, int]:
    """Return the `projector` of a TOML table as (width, height). Errors: FileError naming file and key."""
    value = want(table, "projector", list, str(file))
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in value):
        raise FileError(f"{file}: projector must be two whole numbers, width and height, not {value}")
    try:
        return as_size(value, "projector")
    except InputError as error:
        raise FileError(f"{file}: {error}") from error


def _coded(file: Path, table: Table, projector: tuple[int, int], folder: Path) -> CaptureFolder:
    codec = want(table, "codec", str, str(file))
    parameters = want(table, "parameters", Mapping, str(file), {})
    source = FrameSource.of(folder, table.get("frames"), str(file))
    return CaptureFolder(file, codec, dict(parameters), projector, source)


def _images(file: Path, key: str, entry: Any, root: Path) -> tuple[Path, ...]:
    where = f"{file}: {key}.images"
    if key not in PICTURE_TABLES:
        raise FileError(f"{where}: only {', '.join(PICTURE_TABLES)} can have images")
    source = FrameSource.of(root, entry, where)
    if set(source.roles) != {""}:
        raise FileError(f"{where} must be a pattern such as '*.png' or a list of names")
    files = find_files(root, source.roles[""], where)
    if not files:
        raise FileError(f"{where}: no picture in {root} matches {entry!r}")
    return tuple(files)


def _poses(file: Path, table: Table, projector: tuple[int, int], root: Path) -> tuple[tuple[str, CaptureFolder], ...]:
    if "coded" not in table:
        return ()
    coded = cast("Table", want(table, "coded", Mapping, str(file)))
    where = f"{file}: coded"
    unknown = set(coded) - {"poses", "codec", "parameters", "frames"}
    if unknown:
        raise FileError(f"{where}: {sorted(unknown)[0]!r} is no key of this table")
    pattern = want(coded, "poses", (str, list), where)
    folders = find_folders(root, pattern, f"{where}: poses")
    if not folders:
        raise FileError(f"{where}: no folder in {root} matches {pattern!r}")
    return tuple((f.relative_to(root).as_posix(), _coded(file, coded, projector, f)) for f in folders)
