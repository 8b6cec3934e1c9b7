"""The table of ratios that `make bench` prints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

START, END = "<!-- measured -->", "<!-- /measured -->"
_WIDTHS = "{:<60}{:>9}  {:<60}{:>8}{:>9}  {}"


@dataclass(frozen=True)
class Row:
    """Two times of one run. ours, theirs: seconds; asked: the ratio that issue 5 asks for, empty where none.

    kind: "floor" for what bounds the work from below, the ratio being ours / theirs; "peer" for the same work done by
    another, the ratio being theirs / ours.
    """

    work: str
    ours: float
    beside: str
    theirs: float
    kind: Literal["floor", "peer"]
    asked: str = ""

    @property
    def ratio(self) -> float:
        return self.ours / self.theirs if self.kind == "floor" else self.theirs / self.ours

    def line(self) -> str:
        told = "<= " if self.kind == "floor" else ">= "
        seconds = [f"{1e3 * s:.1f}" if s < 10 else f"{1e3 * s:.0f}" for s in (self.ours, self.theirs)]
        asked = told + self.asked if self.asked else ""
        return _WIDTHS.format(self.work, seconds[0], self.beside, seconds[1], f"{self.ratio:.2f}", asked).rstrip()


def heading() -> str:
    return _WIDTHS.format("work", "slkit ms", "beside it", "ms", "ratio", "asked")


def page(path: Path, told: list[str]) -> None:
    """Put lines between the marks of a page."""
    head, rest = path.read_text(encoding="utf-8").split(START)
    tail = rest.split(END)[1]
    text = "\n".join(["", "", "```text", *told, "```", "", ""])
    path.write_text(head + START + text + END + tail, encoding="utf-8")
