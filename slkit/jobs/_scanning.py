"""What a worker does: fetch one capture, scan it, write its cloud."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from slkit.errors import FileError, SlkitError
from slkit.files import read_capture, rig_table
from slkit.geometry import Rig
from slkit.jobs._manifest import Record
from slkit.jobs._places import Place

_BLOCK = 1 << 20


@dataclass(frozen=True, eq=False)
class Recipe:
    """What all captures of a batch share; the fields are those of `pipeline.scan`.

    parameters: fields of the codec, before what capture.toml says. depth: nearest and farthest depth in mm. filters: a
    `triangulation.Filters`, default all.
    """

    rig: Rig
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])
    depth: tuple[float, float] | None = None
    filters: Any = None
    normals: bool = False

    def told(self) -> str:
        """Return everything that decides what a capture's cloud is, the capture apart, as text."""
        from slkit import __version__
        from slkit.triangulation import Filters

        filters = dataclasses.asdict(self.filters or Filters())
        asked = [__version__, rig_table(self.rig), dict(self.parameters), self.depth, filters, self.normals]
        return json.dumps(asked, sort_keys=True, default=str)


@dataclass(frozen=True)
class Job:
    """One capture to scan. source, target: where it lies, and where its cloud goes. cloud: the name of that.

    known: the hash of the inputs that the cloud there was made of, "" where it is not known.
    """

    capture: str
    source: str
    cloud: str
    target: str
    known: str


def scan_one(job: Job, recipe: Recipe) -> Record:
    """Scan a capture, unless its cloud is there and was made of the same; never raises but for an interrupt."""
    started = time.perf_counter()
    record = Record(job.capture, "", "failed")
    folder = ""
    try:
        target = Place.at(job.target)
        with Place.at(job.source).as_folder() as place:
            folder = str(place)
            record = replace(record, hash=content_hash(place, recipe.told()))
            if record.hash == job.known and target.exists():
                return replace(record, status="unchanged")
            points, notes = _scan(place, recipe, target)
        record = replace(record, status="done", points=points, cloud=job.cloud, notes=_named(notes, folder, job))
    except SlkitError as error:
        (sentence,) = _named([str(error)], folder, job)
        notes = _named(getattr(error, "__notes__", ()), folder, job)
        record = replace(record, error=sentence, notes=notes)
    # One capture must not end the batch, not even by a fault of slkit.
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        record = replace(record, error=f"{job.source}: internal error, please report it: {what}")
    return replace(record, seconds=round(time.perf_counter() - started, 4))


def _named(sentences: Iterable[str], folder: str, job: Job) -> tuple[str, ...]:
    """Return sentences, a line each, with the place of the capture: what was fetched is gone when they are read."""
    named = (sentence.replace(folder, job.source) if folder else sentence for sentence in sentences)
    return tuple(" ".join(sentence.split()) for sentence in named)


def content_hash(folder: Path, told: str) -> str:
    """Return a hash of names and content of all files of a capture, and of a text; hidden files are left out.

    Where capture.toml says that the pictures lie outside the folder, they count too.
    Errors: FileError for a folder or a file that cannot be read.
    """
    digest = hashlib.blake2b(told.encode("utf-8"), digest_size=20)
    for root in _roots(folder):
        for file in sorted(_files(root), key=lambda path: path.relative_to(root).as_posix()):
            try:
                digest.update(os.fsencode(f"\0{file.relative_to(root).as_posix()}\0{file.stat().st_size}\0"))
                with open(file, "rb") as data:
                    while block := data.read(_BLOCK):
                        digest.update(block)
            except OSError as error:
                raise FileError(f"{file} cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()


def _roots(folder: Path) -> Iterator[Path]:
    yield folder
    try:
        pictures = read_capture(folder).source.folder.resolve()
    except SlkitError:
        # The scan is going to tell.
        return
    if not pictures.is_relative_to(folder.resolve()):
        yield pictures


def _files(root: Path) -> Iterator[Path]:
    for path in root.rglob("*"):
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(root).parts):
            yield path


def _scan(folder: Path, recipe: Recipe, target: Place) -> tuple[int, tuple[str, ...]]:
    """Write the cloud of a folder and return how many points it has, and what is to be told of the pictures."""
    from slkit import pipeline

    r = recipe
    result = pipeline.scan(folder, r.rig, r.parameters, r.depth, r.filters, r.normals)
    target.write(pipeline.exporter(target.path)(result.cloud))
    return len(result.cloud), result.notes
