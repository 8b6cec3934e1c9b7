"""slkit batch."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Annotated, Any

import typer

from slkit.cli._common import JsonOption, SetOption, number, parse_settings, print_json, print_table, progress_bar
from slkit.errors import InputError

if TYPE_CHECKING:
    from slkit.jobs import BatchResult

_SHOWN = 20


def batch(
    captures: Annotated[
        list[str],
        typer.Argument(metavar="CAPTURES...", help="Folders with a capture.toml each: paths or URLs, * in quotes."),
    ],
    rig: Annotated[str, typer.Option("--rig", metavar="FILE", help="The rig that `slkit calibrate` wrote.")],
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="DIR", help="Where clouds and batch.jsonl go: a path or a URL.")
    ],
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", help="How many processes; default: one for each core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="URL", help="Scan on a Dask cluster, tcp://HOST:PORT.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Only what is missing, has failed, or has other inputs now.")
    ] = False,
    settings: SetOption = None,
    depth: Annotated[
        tuple[float, float] | None, typer.Option("--depth", metavar="MIN MAX", help="Depths in mm that can occur.")
    ] = None,
    no_filter: Annotated[
        list[str] | None, typer.Option("--no-filter", metavar="NAME", help="Switch a filter off; may be repeated.")
    ] = None,
    normals: Annotated[bool, typer.Option("--normals", help="Estimate a normal for every point.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Scan many captures, on all cores or on a cluster; exit code 3 says that some failed."""
    from slkit import jobs, pipeline

    if scheduler is not None and workers is not None:
        raise InputError("--workers is for this machine: a cluster has its own, leave it away beside --scheduler")
    filters = pipeline.make_filters(no_filter or ())
    recipe = jobs.Recipe(jobs.read_rig(rig), parse_settings(settings), depth, filters, normals)
    pools = jobs.local_pool(workers) if scheduler is None else jobs.cluster(scheduler)
    code = 0
    with pools as pool, progress_bar(rate=True) as progress:
        try:
            result = jobs.scan_all(captures, recipe, output, pool, resume, progress)
        except jobs.Interrupted as stopped:
            result, code = stopped.result, 130
    _report(result, output, as_json)
    if code or result.failures:
        raise typer.Exit(code or 3)


def _report(result: BatchResult, folder: str, as_json: bool) -> None:
    rate = (result.scanned + len(result.failures)) / result.seconds
    if as_json:
        print_json({**_plain(result), "captures_per_second": rate, "folder": folder})
        return
    left = result.captures - result.scanned - result.unchanged - len(result.failures)
    columns = ("captures", "clouds", "unchanged", "failed", "points", "seconds", "captures a second")
    counts = (result.captures, result.scanned, result.unchanged, len(result.failures), result.points)
    print_table(columns, [(*map(str, counts), number(result.seconds, 1), number(rate, 1))])
    print(f"clouds and batch.jsonl: {folder}")
    if left:
        print(f"interrupted: {left} captures are left, which the same command with --resume scans")
    if result.noted:
        # All captures of a batch tend to have the same.
        first, *others = result.noted
        print(f"note: {first.notes[0]}" + (f" (and {len(others)} more, in batch.jsonl)" if others else ""))
    if result.failures:
        print_table(("failed", "why"), [(r.capture, r.error) for r in result.failures[:_SHOWN]])
    if len(result.failures) > _SHOWN:
        print(f"and {len(result.failures) - _SHOWN} more, in batch.jsonl")


def _plain(result: BatchResult) -> dict[str, Any]:
    failures = [{"capture": record.capture, "error": record.error} for record in result.failures]
    noted = [{"capture": record.capture, "notes": record.notes} for record in result.noted]
    return {**dataclasses.asdict(result), "failures": failures, "noted": noted}
