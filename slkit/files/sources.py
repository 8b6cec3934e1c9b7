"""From globs and lists of a TOML file to pictures in the order that a codec names them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

from slkit.data import Frames
from slkit.errors import FileError
from slkit.files.images import PICTURE_ENDINGS, alike, read_image
from slkit.files.stacks import STACK_ENDINGS, Pictures, open_stack
from slkit.files.videos import VIDEO_ENDINGS, open_video

SEVERAL_ENDINGS = (*STACK_ENDINGS, *VIDEO_ENDINGS)
"""Endings of files that can hold several pictures."""

_NAMED = 8


@dataclass(frozen=True)
class FrameSource:
    """Where the frames of one capture lie: a folder, and one or several globs or lists in display order.

    roles: {"": files} for a plain sequence, or one entry a role; the role of a frame is the text of its name before
    the first "_". where: the file and key that say so, for messages.
    """

    folder: Path
    roles: Mapping[str, str | tuple[str, ...]]
    where: str

    @classmethod
    def of(cls, folder: Path, frames: Any, where: str) -> FrameSource:
        """Return the source that the `frames` value of a TOML file means; None: every picture of the folder.

        Errors: FileError where it is neither a glob, nor a list of files, nor a table of roles.
        """
        table = cast("Mapping[str, Any]", frames) if isinstance(frames, Mapping) else {"": frames}
        return cls(
            folder, {role: _entry(value, f"{where}: frames {role}".rstrip()) for role, value in table.items()}, where
        )

    def frames(self, names: Sequence[str], codec: str) -> Frames:
        """Return the pictures as the frames `names`, in that order; none is read yet.

        Errors: FileError for a wrong number of pictures: how many are there, how many are needed, and which.
        """
        pictures = self._pictures(names, codec)
        in_turn = any(picture.held.in_turn for picture in pictures)
        return alike(
            [(picture.where, partial(picture.held.load, picture.index)) for picture in pictures], names, in_turn
        )

    def paths(self, names: Sequence[str], codec: str) -> list[Path]:
        """Return one file a name, the same for pictures that lie in one file. Errors: as `frames`."""
        return [picture.file for picture in self._pictures(names, codec)]

    def _pictures(self, names: Sequence[str], codec: str) -> list[_Picture]:
        if not self.folder.is_dir():
            raise FileError(f"{self.where}: there is no folder {self.folder}")
        wanted: dict[str, list[str]] = {}
        for name in names:
            wanted.setdefault("" if "" in self.roles else name.split("_")[0], []).append(name)
        queues = {role: iter(self._of_role(role, needed, codec)) for role, needed in wanted.items()}
        return [next(queues["" if "" in self.roles else name.split("_")[0]]) for name in names]

    def _of_role(self, role: str, needed: Sequence[str], codec: str) -> list[_Picture]:
        if role not in self.roles:
            raise FileError(f"{self.where}: frames has no entry {role!r}, which {codec} needs ({len(needed)} pictures)")
        files = find_frames(self.folder, self.roles[role], self.where)
        pictures: list[_Picture] = []
        for file in files:
            held = open_pictures(file, len(needed))
            pictures += [_Picture(file, held, index) for index in range(held.count)]
        if len(pictures) == len(needed):
            return pictures
        kind = f"{role} pictures" if role else "pictures"
        holder = files[0] if len(files) == 1 and files[0].suffix.lower() in SEVERAL_ENDINGS else self.folder
        problem = f"{holder} has {len(pictures)} {kind}, but {codec} needs {len(needed)}"
        raise FileError(
            f"{problem}: {_difference([picture.file for picture in pictures], needed)}{self._beside(files)}"
        )

    def _beside(self, files: Sequence[Path]) -> str:
        """Name the stacks and videos that pictures in the same folder hide."""
        others = [f for f in find_files(self.folder, "*", self.where, SEVERAL_ENDINGS) if f not in files]
        return f"; there is {_some([f.name for f in others])}, too: name it as frames in {self.where}" if others else ""


@dataclass(frozen=True, eq=False)
class _Picture:
    """One of the pictures that a file holds."""

    file: Path
    held: Pictures
    index: int

    @property
    def where(self) -> str:
        return str(self.file) if self.held.count == 1 else f"{self.file}, picture {self.index}"


def open_pictures(file: Path, needed: int = 1) -> Pictures:
    """Return what a file of any format holds. needed: how many pictures of it are expected.

    Errors: FileError for a stack or a video that cannot be read; a single picture is not opened yet.
    """
    if file.suffix.lower() in STACK_ENDINGS:
        return open_stack(file)
    if file.suffix.lower() in VIDEO_ENDINGS:
        return open_video(file, needed)
    return Pictures(1, lambda _: read_image(file))


def find_frames(folder: Path, entry: str | tuple[str, ...], where: str) -> list[Path]:
    """Return the same as `find_files`, or the one stack or video of the folder where it takes pictures and finds none.

    Errors: as `find_files`.
    """
    found = find_files(folder, entry, where)
    if not found and isinstance(entry, str) and (not entry or entry.endswith("*")):
        several = find_files(folder, entry, where, SEVERAL_ENDINGS)
        return several if len(several) == 1 else []
    return found


def find_files(
    folder: Path, entry: str | tuple[str, ...], where: str, endings: Sequence[str] = PICTURE_ENDINGS
) -> list[Path]:
    """Return the files of a glob in natural order (2 before 10), or of a list as it stands.

    "" stands for every picture, and a glob that ends in * takes pictures only: files of these `endings`.

    Errors: FileError where a listed file is absent or the glob is none.
    """
    if not isinstance(entry, str):
        files = [folder / name for name in entry]
        for file in files:
            if not file.is_file():
                raise FileError(f"{where}: there is no file {file}")
        return files
    try:
        # Hidden files are left out: some systems put one beside every picture.
        found = [p for p in folder.glob(entry or "*") if p.is_file() and not p.name.startswith(".")]
    except (NotImplementedError, ValueError) as error:
        raise FileError(f"{where}: {entry!r} is no pattern for files below {folder}") from error
    if not entry or entry.endswith("*"):
        found = [p for p in found if p.suffix.lower() in endings]
    return sorted(found, key=lambda path: natural_key(path.relative_to(folder).as_posix()))


def find_folders(root: Path, entry: Any, where: str) -> list[Path]:
    """Return the folders of a glob in natural order, or of a list as it stands.

    Errors: FileError where it is neither.
    """
    names = _entry(entry, where)
    if not isinstance(names, str):
        return [root / name for name in names]
    try:
        found = [p for p in root.glob(names) if p.is_dir() and not p.name.startswith(".")]
    except (NotImplementedError, ValueError) as error:
        raise FileError(f"{where}: {names!r} is no pattern for folders below {root}") from error
    return sorted(found, key=lambda path: natural_key(path.relative_to(root).as_posix()))


def natural_key(text: str) -> list[tuple[int, str]]:
    """Return a sort key that orders numbers in a text by value."""
    parts = re.split(r"([0-9]+)", text)
    return [(int(part), "") if i % 2 else (-1, part) for i, part in enumerate(parts)]


def _entry(value: Any, where: str) -> str | tuple[str, ...]:
    if value is None:
        return ""
    if isinstance(value, str) and value:
        return value
    items = cast("list[Any]", value) if isinstance(value, list) else []
    if items and all(isinstance(item, str) for item in items):
        return tuple(items)
    raise FileError(f"{where} must be a pattern such as '*.png' or a list of names, not {value!r}")


def _difference(files: Sequence[Path], needed: Sequence[str]) -> str:
    """Say which frames are missing or too many, by the numbers in the file names where they carry any."""
    if not files:
        return (
            f"is this the right folder? Its pictures must end in {', '.join(PICTURE_ENDINGS)} or match the pattern, or "
            "lie in one stack or video, which has to be named as `frames` where there are several"
        )
    numbers = {int(m.group()): file.name for file in files if (m := re.match(r"\d+", file.name))}
    if len(numbers) == len(files):
        missing = [f"{i:03d}_{name}" for i, name in enumerate(needed) if i not in numbers]
        spare = [name for number, name in sorted(numbers.items()) if number >= len(needed)]
        if len(files) < len(needed) and len(missing) == len(needed) - len(files):
            return f"missing {_some(missing)}"
        if len(files) > len(needed) and len(spare) == len(files) - len(needed):
            return f"too many are {_some(spare)}"
    return f"needed are, in this order, {_some(needed)}"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
