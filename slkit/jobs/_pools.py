"""Executors to scan on: the cores of this machine, or a Dask cluster."""

from __future__ import annotations

import atexit
import gc
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from slkit.device import cores
from slkit.errors import InputError, SlkitError

# Workers are as many as there are cores: threads of their own would be in each other's way.
_ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)
_FEWEST_AHEAD = 64


@dataclass(frozen=True)
class Pool:
    """Where scans run. open: makes an executor, and another one after it broke; it is shut down when all is done.

    ahead: how many captures an executor is given at a time, more than it has workers.
    """

    open: Callable[[], Executor]
    ahead: int


@contextmanager
def local_pool(workers: int | None = None) -> Generator[Pool]:
    """Give processes on this machine, one for each core that this process may use unless `workers` says how many.

    While it is open, environment variables limit new processes to one thread of OpenCV, BLAS and numba each.
    Errors: InputError where `workers` is not at least 1.
    """
    if workers is not None and workers < 1:
        raise InputError(f"there must be at least 1 worker, not {workers}")
    count = workers or cores()
    # Not a fork: threads of this process, such as OpenCV's, would be missing in the child and their locks held.
    context = multiprocessing.get_context("spawn")

    def opened() -> Executor:
        return ProcessPoolExecutor(count, context, initializer=_live_with_parent)

    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        # One capture waits, for the next worker that is free.
        yield Pool(opened, count + 1)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def cluster(address: str) -> Generator[Pool]:
    """Give the workers of a Dask cluster. address: of its scheduler, such as tcp://HOST:8786.

    Errors: SlkitError where Dask is not installed or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise SlkitError("a cluster needs Dask, which is not installed: pip install 'slkit[dask]'") from error
    try:
        client: Any = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise SlkitError(
            f"no Dask scheduler answers at {address}: start one with `dask scheduler` and give the address it prints"
        ) from error
    with client:
        threads = sum(client.nthreads().values())
        yield Pool(client.get_executor, max(_FEWEST_AHEAD, 4 * threads))


def _live_with_parent() -> None:
    # Ctrl-C reaches all processes of a terminal: the workers finish what they have begun, the parent ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A worker whose parent was killed would wait for work for ever.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # At its end Python would look for cycles among all that was imported, a tenth of a second for nothing.
    atexit.register(gc.freeze)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
