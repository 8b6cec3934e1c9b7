"""What the verbs share: reading options, showing progress, printing."""

from __future__ import annotations

import json
import math
import re
import sys
import time
import tomllib
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from slkit.errors import InputError

SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="A parameter, written as in TOML; dots reach into tables."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
ProjectorOption = Annotated[
    str | None, typer.Option("--projector", metavar="WxH", help="Size of the projector image in px, as 1024x768.")
]


def parse_settings(settings: Sequence[str] | None) -> dict[str, Any]:
    """Return the table that --set options mean: values as in TOML, bare words as text, dotted keys as tables.

    Errors: InputError for what is not key=value, or for a key that is both a value and a table.
    """
    result: dict[str, Any] = {}
    for setting in settings or ():
        key, equals, text = setting.partition("=")
        path = [part.strip() for part in key.split(".")]
        if not equals or not all(path):
            raise InputError(f"--set {setting}: write it as key=value")
        table = result
        for part in path[:-1]:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise InputError(f"--set {setting}: {part} has a value already")
        table[path[-1]] = _parse_value(text.strip())
    return result


def parse_size(text: str, option: str, what: str = "width x height in px, such as 1024x768") -> tuple[int, int]:
    """Return "1024x768" as (1024, 768). Errors: InputError naming the option and `what` it must be."""
    match = re.fullmatch(r"(\d+)[xX×](\d+)", text.strip())
    if not match or not min(map(int, match.groups())):
        raise InputError(f"{option} must be {what}, not {text!r}")
    return int(match.group(1)), int(match.group(2))


@contextmanager
def progress_bar(rate: bool = False) -> Generator[Callable[[str, int, int], None] | None]:
    """Give a function that shows progress on a terminal's standard error, or None where that is no terminal.

    rate: show how many are done of how many, and how many a second, too.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TaskID, TextColumn

    counts = (MofNCompleteColumn(), TextColumn("{task.fields[rate]}")) if rate else ()
    with Progress(*Progress.get_default_columns(), *counts, console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, TaskID] = {}
        started = time.monotonic()

        def show(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total, rate="")
            speed = done / max(time.monotonic() - started, 1e-9)
            bar.update(tasks[what], completed=done, total=total, rate=f"{speed:.1f} a second")

        yield show


def print_json(value: dict[str, Any]) -> None:
    """Print one object on standard output; a number that is not finite becomes null."""
    print(json.dumps(_finite(value), ensure_ascii=False))


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> None:
    """Print a table; the first column is left-aligned text, and so is the last."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index in (0, len(columns) - 1) else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    # A pipe has no width: nothing is cut there.
    Console(markup=False, highlight=False, width=None if sys.stdout.isatty() else 160).print(table)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number for a table, a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
