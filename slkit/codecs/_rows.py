"""Runs a compiled loop over the rows of a picture, in parts on plain threads."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from slkit.device import side_by_side, threads

# So many pixels stay in a processor's cache with what is worked out for them.
_BLOCK_PX = 65_536
_LARGE_BLOCK_PX = 131_072

S = TypeVar("S")


def over_blocks(work: Callable[[slice], None], shape: tuple[int, ...]) -> None:
    """Call work(rows) for blocks of a few rows of a picture (h, w), in parts of it side by side; see `over_rows`.

    For work that passes over the same pixels several times: they stay in the processor's cache meanwhile.
    """
    height, width = shape
    step = max(_BLOCK_PX // width, 1)

    def part(first: int, last: int) -> None:
        for start in range(first, last, step):
            work(slice(start, min(start + step, last)))

    over_rows(part, height)


def over_large_blocks(scratch: Callable[[int], S], work: Callable[[slice, S], None], shape: tuple[int, ...]) -> None:
    """Call work(rows, scratch(most rows)) for blocks of many rows of a picture (h, w); see `over_blocks`.

    For work of several calls a block, each of which costs as much as hundreds of pixels. What it keeps aside is made
    once a thread, because fresh memory costs more than the work on it.
    """
    height, width = shape
    step = max(_LARGE_BLOCK_PX // width, 1)

    def part(first: int, last: int) -> None:
        aside = scratch(min(step, last - first))
        for start in range(first, last, step):
            work(slice(start, min(start + step, last)), aside)

    over_rows(part, height)


def over_rows(work: Callable[[int, int], None], height: int, multiple: int = 1) -> None:
    """Call work(first, last) for parts of the rows of a picture, side by side; parts begin at whole multiples."""
    pieces = -(-height // multiple)
    cuts = np.linspace(0, pieces, max(min(threads(), pieces), 1) + 1).astype(int) * multiple
    side_by_side(work, np.minimum(cuts, height).tolist())
