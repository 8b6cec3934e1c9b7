"""Where the heaviest loops run: side by side on the processor, or on a graphics processor that speaks CUDA."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import TypeVar, cast

from slkit.errors import InputError

DEVICES = ("cpu", "cuda")

_chosen = ContextVar("device", default="cpu")
_thread = threading.local()

_T = TypeVar("_T")


@contextmanager
def on_device(name: str) -> Generator[None]:
    """Run within on a device, "cpu" or "cuda", what can run there: Gray code's bits and ray-plane triangulation.

    The choice holds for the calling thread. Errors: InputError for another name, or with the reason why there is no
    CUDA.
    """
    if name not in DEVICES:
        raise InputError(f"device must be one of {', '.join(DEVICES)}, not {name!r}")
    if name == "cuda" and (why := why_no_cuda()):
        raise InputError(f"there is no CUDA device to run on: {why}; leave --device away")
    token = _chosen.set(name)
    try:
        yield
    finally:
        _chosen.reset(token)


def on_cuda() -> bool:
    """Whether the calling thread chose CUDA."""
    return _chosen.get() == "cuda"


def why_no_cuda() -> str:
    """Return the reason why CUDA cannot be used here, "" where it can."""
    try:
        from numba import cuda

        cuda.current_context()
    # The driver, numba and its settings have errors of their own, over several lines.
    except Exception as error:
        text = " ".join(str(error).split()).removeprefix("Error at driver init: ")
        return text.partition(". ")[0].strip(" .:") or type(error).__name__
    return "" if cuda.is_available() else "numba finds no CUDA toolkit"


def threads() -> int:
    """Return how many threads may work at a time: NUMBA_NUM_THREADS, else as many as there are cores to use."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else cores()


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def side_by_side(work: Callable[[int, int], None], cuts: Sequence[int]) -> None:
    """Call work(first, last) for each two neighbours of `cuts`, several at a time if it lets go of Python's lock.

    Whoever is free takes the next. Plain threads, because numba's own do not survive a fork, and a pool of processes
    may call this.
    """
    parts = iter(list(zip(cuts[:-1], cuts[1:], strict=True)))

    def take_turns() -> None:
        try:
            for ends in parts:
                work(*ends)
        except BaseException:
            # Nobody begins another part of what has failed or was interrupted.
            deque(parts, 0)
            raise

    helpers = 0 if getattr(_thread, "helps", False) else min(threads(), len(cuts) - 1) - 1
    others = [_helpers(os.getpid(), threads()).submit(take_turns) for _ in range(helpers)]
    try:
        take_turns()
    finally:
        # Who has not begun yet helps another caller meanwhile, and there is nothing left to do.
        begun = [other for other in others if not other.cancel()]
        wait(begun)
    for other in begun:
        other.result()


def one_ahead(items: Iterator[_T]) -> Iterator[_T]:
    """Give the items; while one is used a helper works out the next, where more than one thread may work.

    The helper does not know what the caller chose by `on_device`. Errors: what an item raises comes in its turn.
    """
    if threads() == 1 or getattr(_thread, "helps", False):
        yield from items
        return
    end, coming = object(), None
    try:
        while (item := _taken(coming, items, end)) is not end:
            coming = _helpers(os.getpid(), threads()).submit(next, items, end)
            yield cast("_T", item)
    finally:
        if coming is not None:
            coming.cancel()
        # An error in it would hold this very frame.
        del coming


def _taken(coming: Future[object] | None, items: Iterator[object], end: object) -> object:
    """Return the next item, worked out here where no helper has begun: it may be another caller's for long."""
    return next(items, end) if coming is None or coming.cancel() else coming.result()


@cache
def _helpers(process: int, count: int) -> ThreadPoolExecutor:
    """Return threads that help the one that asks, in the process of this number: a fork has none of its parent's."""
    return ThreadPoolExecutor(max(count - 1, 1), initializer=lambda: setattr(_thread, "helps", True))
