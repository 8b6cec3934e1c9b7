"""A batch: all captures, one recipe, one folder of clouds and its manifest."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from slkit.errors import InputError
from slkit.files import Progress
from slkit.jobs._captures import find_captures
from slkit.jobs._manifest import Manifest, Record
from slkit.jobs._places import Place
from slkit.jobs._pools import Pool, local_pool
from slkit.jobs._running import run
from slkit.jobs._scanning import Job, Recipe, scan_one


@dataclass(frozen=True)
class BatchResult:
    """captures: how many there are; scanned: how many clouds were written; unchanged: how many were there already.

    failures: the records of those without a cloud; noted: of those with notes on their pictures, unchanged ones too.
    points: of the clouds written. seconds: from first to last.
    """

    captures: int
    scanned: int
    unchanged: int
    failures: tuple[Record, ...]
    noted: tuple[Record, ...]
    points: int
    seconds: float


class Interrupted(KeyboardInterrupt):
    """A batch was stopped by an interrupt. result: what was done until then."""

    def __init__(self, result: BatchResult) -> None:
        super().__init__()
        self.result = result


def scan_all(
    captures: str | Sequence[str],
    recipe: Recipe,
    folder: str,
    pool: Pool | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> BatchResult:
    """Scan captures into clouds named after them, and keep a manifest, batch.jsonl, of what became of each.

    captures: see `find_captures`. folder: a path or URL. pool: default one process for each core. resume: repeat what
    the manifest lacks, what failed, what has other inputs now, and what has lost its cloud. A capture that cannot be
    scanned is a failure in the result and stops nothing.
    Errors: as `find_captures`; InputError for an impossible depth range; FileError where the folder holds a manifest
    and `resume` is false, or where it is damaged or cannot be written; Interrupted at an interrupt.
    """
    from slkit.pipeline import check_depth

    check_depth(recipe.depth)
    found = find_captures([captures] if isinstance(captures, str) else captures)
    target = Place.at(folder)
    found = _apart(found, target)
    if pool is None:
        with local_pool() as own, Manifest(target, resume) as manifest:
            return _scan_all(found, recipe, target, own, manifest, progress)
    with Manifest(target, resume) as manifest:
        return _scan_all(found, recipe, target, pool, manifest, progress)


def _apart(found: Mapping[str, Place], target: Place) -> dict[str, Place]:
    """Return the captures without the output folder, which a pattern may match once it is there.

    Errors: InputError where the output folder lies inside a capture, which clouds would change.
    """
    out = target.url.rstrip("/") + "/"
    for place in found.values():
        if place.url != target.url and out.startswith(place.url.rstrip("/") + "/"):
            raise InputError(f"{target.url} lies inside the capture {place.url}: choose an output folder outside of it")
    return {name: place for name, place in found.items() if not f"{place.url}/".startswith(out)}


def _scan_all(
    found: Mapping[str, Place],
    recipe: Recipe,
    target: Place,
    pool: Pool,
    manifest: Manifest,
    progress: Progress | None,
) -> BatchResult:
    started = time.perf_counter()
    tally: dict[str, Record] = {}

    def tell(record: Record) -> None:
        if record.status == "unchanged":
            record = replace(record, notes=manifest.known[record.capture].notes)
        else:
            manifest.append(record)
        tally[record.capture] = record
        if progress is not None:
            progress("scan", len(tally), len(found))

    def result() -> BatchResult:
        status = [record.status for record in tally.values()]
        failures = tuple(record for record in tally.values() if record.status == "failed")
        noted = tuple(record for record in tally.values() if record.notes)
        points = sum(record.points for record in tally.values())
        seconds = time.perf_counter() - started
        done, unchanged = status.count("done"), status.count("unchanged")
        return BatchResult(len(found), done, unchanged, failures, noted, points, seconds)

    if manifest.known:
        target.sweep()
    try:
        deaths = run(_jobs(found, target, manifest.known), partial(scan_one, recipe=recipe), pool, tell)
    except KeyboardInterrupt:
        raise Interrupted(result()) from None
    if deaths:
        target.sweep()
    return result()


def _jobs(found: Mapping[str, Place], target: Place, known: Mapping[str, Record]) -> Iterator[Job]:
    for name, place in found.items():
        before = known.get(name)
        valid = before is not None and before.status == "done"
        cloud = f"{name}.ply"
        yield Job(name, place.url, cloud, target.child(cloud).url, before.hash if valid and before else "")
