"""Loops side by side: every part once, errors come out at once, and no caller waits for a stranger."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from slkit.device import one_ahead, side_by_side, threads


@pytest.fixture(params=["1", "2", "5"])
def count(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setenv("NUMBA_NUM_THREADS", request.param)
    return threads()


def test_every_part_is_done_once_also_within_another(count: int):
    done: list[tuple[int, int]] = []

    def outer(first: int, last: int) -> None:
        side_by_side(lambda a, b: done.append((a, b)), list(range(first, last + 1)))

    side_by_side(outer, [0, 4, 9, 9, 12])
    assert sorted(done) == [(i, i + 1) for i in range(12)]
    side_by_side(outer, [3, 3])
    assert len(done) == 12


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_comes_out_and_no_part_begins_after_it(count: int, error: type[BaseException]):
    begun: list[int] = []

    def work(first: int, last: int) -> None:
        begun.append(first)
        if first == 0:
            raise error
        time.sleep(0.05)

    with pytest.raises(error):
        side_by_side(work, list(range(101)))
    assert len(begun) < 20


def test_nobody_waits_for_the_parts_of_another_caller(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "4")
    release, busy, ended = threading.Event(), threading.Semaphore(0), list[int]()

    def long(first: int, last: int) -> None:
        busy.release()
        release.wait(10)
        ended.append(first)

    with ThreadPoolExecutor(1) as other:
        stranger = other.submit(side_by_side, long, [0, 1, 2, 3, 4])
        for _ in range(4):
            assert busy.acquire(timeout=60)
        done: list[int] = []
        try:
            side_by_side(lambda first, last: done.append(first), [0, 1, 2, 3, 4])
            assert sorted(done) == [0, 1, 2, 3] and not ended
        finally:
            release.set()
            stranger.result()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_has_threads_of_its_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    done: list[int] = []
    side_by_side(lambda first, last: done.append(first), [0, 1, 2])
    child = os.fork()
    if child == 0:
        done.clear()
        side_by_side(lambda first, last: done.append(first), [0, 1, 2])
        os._exit(0 if sorted(done) == [0, 1] else 1)
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.parametrize("items", [0, 1, 30])
def test_items_come_in_order_also_within_helpers(count: int, items: int):
    assert list(one_ahead(iter(range(items)))) == list(range(items))
    found: list[list[int]] = []
    side_by_side(lambda first, last: found.append(list(one_ahead(iter(range(items))))), list(range(5)))
    assert found == 4 * [list(range(items))]


def test_the_next_item_is_worked_out_while_one_is_used(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    begun = [threading.Event() for _ in range(3)]

    def worked() -> Iterator[int]:
        for k in range(3):
            begun[k].set()
            yield k

    for k in one_ahead(worked()):
        assert k == 2 or begun[k + 1].wait(10)


def test_items_come_while_every_helper_works_for_another(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    release, busy = threading.Event(), threading.Semaphore(0)

    def long(first: int, last: int) -> None:
        busy.release()
        release.wait(10)

    with ThreadPoolExecutor(1) as other:
        stranger = other.submit(side_by_side, long, [0, 1, 2])
        assert busy.acquire(timeout=60) and busy.acquire(timeout=60)
        try:
            assert list(one_ahead(iter(range(9)))) == list(range(9)) and not stranger.done()
        finally:
            release.set()
            stranger.result()


def test_who_stops_early_leaves_nothing_running(count: int):
    begun: list[int] = []
    items = one_ahead(begun.append(k) or k for k in range(9))
    assert next(items) == 0
    items.close()
    many = len(begun)
    time.sleep(0.05)
    assert many <= len(begun) <= 2


def test_an_item_that_fails_comes_out_after_those_before_it(count: int):
    def worked() -> Iterator[int]:
        yield 1
        raise ValueError("worked out badly")

    items = one_ahead(worked())
    assert next(items) == 1
    with pytest.raises(ValueError, match="badly"):
        next(items)
