"""A cloud for every picture of something that moves."""

from __future__ import annotations

import os
import re
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slkit.data import Frames
from slkit.errors import DecodeError, FileError, SlkitError
from slkit.files import Progress, make_folder, merged, read_sequence
from slkit.files.sequences import Load
from slkit.geometry import Rig
from slkit.pipeline._patterns import load_codec
from slkit.pipeline._scanning import bounds, check_rig, with_rig_colors, write_cloud
from slkit.protocols import Bounds, Codec

_CLOUD = re.compile(r"\d{6}\.ply")


@dataclass(frozen=True)
class SequenceResult:
    """scans: how many pictures, or sets of them, were seen; clouds, points: how many came of them.

    seconds: from the first to the last. first_failure: which scan failed first and why, "" where none did. notes:
    sentences about the pictures.
    """

    scans: int
    clouds: int
    points: int
    seconds: float
    first_failure: str
    notes: tuple[str, ...] = ()


def scan_sequence(
    source: str | Path,
    rig: Rig,
    folder: str | Path,
    parameters: Mapping[str, Any] | None = None,
    depth: tuple[float, float] | None = None,
    filters: Any = None,
    progress: Progress | None = None,
) -> SequenceResult:
    """Write the clouds 000000.ply, 000001.ply ... of a folder of pictures or a video; of one picture each, if one-shot.

    source: see `files.read_sequence`; a codec of n patterns makes one cloud of n pictures. parameters, depth: as for
    `scan`. filters: a `triangulation.Filters`, default all but `isolated`, which would take longer than all the rest. A
    picture that gives no cloud is counted and left out. Memory does not grow with the length of the sequence.
    Errors: FileError where the folder holds clouds already; as for `scan`; DecodeError where no picture gives a cloud.
    """
    from slkit.triangulation import Filters

    found = read_sequence(source)
    capture = found.capture
    given = merged(capture.parameters, parameters or {})
    codec = with_rig_colors(load_codec(capture.codec, capture.projector, given, str(capture.file)), rig)
    scan = _Scan(
        codec, tuple(codec.encode().names), rig, depth, filters or Filters(isolated=False), Path(folder), found.name
    )
    folder = make_folder(folder)
    old = sorted(p.name for p in folder.iterdir() if _CLOUD.fullmatch(p.name))
    if old:
        raise FileError(f"{folder} already holds clouds ({old[0]}): choose an empty folder")
    total = (found.count or 0) // len(scan.names)
    started, scans, clouds, points, failure = time.perf_counter(), 0, 0, 0, ""
    for index, outcome in _in_order(_sets(found.loads(), len(scan.names)), scan):
        scans += 1
        if isinstance(outcome, int):
            clouds, points = clouds + 1, points + outcome
        else:
            failure = failure or f"{index:06d}: {outcome}"
        if progress is not None:
            progress("scan", scans, max(total, scans))
    if not clouds:
        raise DecodeError(f"{found.name}: no cloud from {scans} scans: {failure or 'too few pictures for one'}")
    return SequenceResult(scans, clouds, points, time.perf_counter() - started, failure, found.notes())


@dataclass(frozen=True, eq=False)
class _Scan:
    """What all scans of a sequence share."""

    codec: Codec
    names: tuple[str, ...]
    rig: Rig
    depth: tuple[float, float] | None
    filters: Any
    folder: Path
    source: str

    def write(self, index: int, loads: Sequence[Load], limits: Bounds | None) -> int | str:
        """Return how many points the cloud has that was written, or why there is none."""
        from slkit.triangulation import triangulate

        try:
            frames = Frames.of([load() for load in loads], self.names)
            check_rig(self.rig, self.codec, frames[0], f"{self.source}, {index:06d},")
            cloud = triangulate(self.codec.decode(frames, limits), self.rig)
            cloud, _ = self.filters.apply(cloud, self.depth) if len(cloud) else (cloud, {})
            if not len(cloud):
                return "no point is found"
            write_cloud(self.folder / f"{index:06d}.ply", cloud)
        except SlkitError as error:
            return str(error)
        return len(cloud)


def _sets(loads: Iterator[Load], size: int) -> Iterator[list[Load]]:
    """Yield sets of `size` pictures; what is left over at the end is none."""
    some: list[Load] = []
    for load in loads:
        some.append(load)
        if len(some) == size:
            yield some
            some = []


def _in_order(sets: Iterator[list[Load]], scan: _Scan) -> Iterator[tuple[int, int | str]]:
    """Yield number and outcome of every scan; a few are under way at a time, on plain threads."""
    workers = os.cpu_count() or 1
    waiting: deque[tuple[int, Future[int | str]]] = deque()
    limits: Bounds | None = None
    with ThreadPoolExecutor(workers) as pool:
        for index, loads in enumerate(sets):
            if index == 0 and scan.depth is not None:
                limits = bounds(scan.rig, scan.depth)
            waiting.append((index, pool.submit(scan.write, index, loads, limits)))
            while len(waiting) > workers:
                number, future = waiting.popleft()
                yield number, future.result()
        for number, future in waiting:
            yield number, future.result()
