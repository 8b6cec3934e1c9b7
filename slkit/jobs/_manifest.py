"""batch.jsonl: what became of each capture, one line each time that it was tried."""

from __future__ import annotations

import dataclasses
import json
import os
import time
from dataclasses import dataclass
from typing import Any, BinaryIO, Literal, cast

from slkit.errors import FileError
from slkit.files import make_folder
from slkit.jobs._places import Place

MANIFEST = "batch.jsonl"

# A store that cannot append is given the whole file again, so seldom that this takes a twentieth of the time at most.
_PAUSE, _SHARE = 1.0, 20.0
# File names may hold bytes that are not UTF-8.
_NAMES = "surrogateescape"


@dataclass(frozen=True)
class Record:
    """What became of one capture.

    hash: of its files, the rig, the parameters and the version of slkit, "" where that is not known. status: what is
    "unchanged" is not written. seconds: on the worker. points: of the cloud; cloud: its name in the output folder, ""
    where there is none. error: one sentence, "" where there is none. notes: sentences about the pictures.
    """

    capture: str
    hash: str
    status: Literal["done", "failed", "unchanged"]
    seconds: float = 0.0
    points: int = 0
    cloud: str = ""
    error: str = ""
    notes: tuple[str, ...] = ()


class Manifest:
    """The file that records are appended to, by one process only; a context manager.

    known: the last record of each capture at the time of opening. Opening cuts off a last line that is torn.
    Errors: FileError where the file is there and `resume` is false, or is no manifest, or cannot be written.
    """

    def __init__(self, folder: Place, resume: bool) -> None:
        self._place = folder.child(MANIFEST)
        there = self._place.exists()
        if there and not resume:
            raise FileError(
                f"{folder.url} already holds a {MANIFEST}: go on with --resume, or choose another folder for the clouds"
            )
        text, self.known = _parsed(self._place) if there else (b"", {})
        self._file = self._opened(len(text))
        self._text = text if self._file is None else b""
        self._due = 0.0

    def __enter__(self) -> Manifest:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
        elif self._due:
            self._place.write(self._text)

    def append(self, record: Record) -> None:
        """Write one record, so that a process killed at any moment leaves whole lines and at most one torn at the end.

        Errors: FileError where it cannot be written.
        """
        line = (json.dumps(dataclasses.asdict(record), ensure_ascii=False) + "\n").encode("utf-8", _NAMES)
        if self._file is None:
            self._text += line
            self._put()
            return
        try:
            self._file.write(line)
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileError(f"{self._place.url} cannot be written: {error.strerror or error}") from error

    def _put(self) -> None:
        if (started := time.monotonic()) >= self._due:
            self._place.write(self._text)
            taken = time.monotonic() - started
            self._due = started + max(_PAUSE, _SHARE * taken)

    def _opened(self, size: int) -> BinaryIO | None:
        path = self._place.local
        if path is None:
            return None
        make_folder(path.parent)
        try:
            file = cast("BinaryIO", open(path, "ab", buffering=0))
            file.truncate(size)
        except OSError as error:
            raise FileError(f"{path} cannot be written: {error.strerror or error}") from error
        return file


def _parsed(place: Place) -> tuple[bytes, dict[str, Record]]:
    """Return the text of a manifest without a torn last line, and the last record of each capture."""
    lines = place.read().splitlines(keepends=True)
    records: dict[str, Record] = {}
    for number, line in enumerate(lines, 1):
        record = _record(line)
        if record is None and number == len(lines):
            return b"".join(lines[:-1]), records
        if record is None:
            raise FileError(
                f"{place.url}, line {number}, is no record of a capture: take it out, and that capture is repeated"
            )
        records[record.capture] = record
    return b"".join(lines), records


def _record(line: bytes) -> Record | None:
    """Return the record of a line, None where it is torn or none; keys of a later version are passed over."""
    try:
        # Earlier versions wrote no notes.
        table: dict[str, Any] = {"notes": (), **json.loads(line.decode("utf-8", _NAMES))}
        table["notes"] = tuple(table["notes"])
        record = Record(**{f.name: table[f.name] for f in dataclasses.fields(Record)})
    except (ValueError, TypeError, KeyError):
        return None
    return record if line.endswith(b"\n") else None
