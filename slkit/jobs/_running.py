"""Hand jobs to an executor, a few ahead of its workers, through worker deaths and interrupts."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from itertools import islice

from slkit.errors import SlkitError
from slkit.jobs._interrupts import uninterrupted
from slkit.jobs._manifest import Record
from slkit.jobs._pools import Pool
from slkit.jobs._scanning import Job

_TRIES = 3

Work = Callable[[Job], Record]
Tell = Callable[[Record], None]


def run(jobs: Iterable[Job], work: Work, pool: Pool, tell: Tell) -> int:
    """Do the work of all jobs, tell the record of each as it is done, and return how often a worker died.

    Where one dies, nobody knows at which job: those under way are repeated one at a time, and one at which it dies
    again and again has failed. At an interrupt nothing more is begun, and what is finished is told before it goes up.
    Errors: SlkitError where the executor gives up its work.
    """
    queue, deaths = iter(jobs), 0
    while lost := _round(queue, work, pool, tell):
        _check(pool)
        deaths += 1 + _one_by_one(lost, work, pool, tell)
    return deaths


def _one_by_one(lost: list[Job], work: Work, pool: Pool, tell: Tell) -> int:
    """Repeat jobs at which a worker may have died so that its next death tells at which; return how many there were."""
    suspects, deaths = deque(lost), Counter[str]()
    while suspects:
        for job in _round(_taken(suspects), work, Pool(pool.open, 1), tell):
            deaths[job.capture] += 1
            if deaths[job.capture] < _TRIES:
                suspects.appendleft(job)
                continue
            why = f"its worker was killed {_TRIES} times, as it is where memory runs out: try fewer workers"
            tell(Record(job.capture, "", "failed", error=f"{job.source}: {why}"))
    return deaths.total()


def _taken(jobs: deque[Job]) -> Iterator[Job]:
    while jobs:
        yield jobs.popleft()


def _round(queue: Iterator[Job], work: Work, pool: Pool, tell: Tell) -> list[Job]:
    """Work until the queue is empty or the executor breaks; return the jobs that were under way then."""
    under_way: dict[Future[Record], Job] = {}
    lost: list[Job] = []
    executor = pool.open()
    try:
        while not lost:
            for job in islice(queue, pool.ahead - len(under_way)):
                try:
                    with uninterrupted():
                        under_way[executor.submit(work, job)] = job
                except BrokenExecutor:
                    lost.append(job)
                    break
            if not under_way:
                break
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            lost += _settle(done, under_way, tell)
    except BaseException:
        for future in under_way:
            future.cancel()
        raise
    finally:
        executor.shutdown(wait=True)
        finished = [future for future in under_way if not future.cancelled()]
        lost += _settle(finished, under_way, tell)
    return lost


def _settle(done: Iterable[Future[Record]], under_way: dict[Future[Record], Job], tell: Tell) -> list[Job]:
    """Tell what became of futures that are done; return the jobs of those whose worker died."""
    lost: list[Job] = []
    for future in list(done):
        with uninterrupted():
            lost += _settled(future, under_way.pop(future), tell)
    return lost


def _settled(future: Future[Record], job: Job, tell: Tell) -> list[Job]:
    if future.cancelled():
        raise SlkitError("the executor gave up its work, as a cluster does that is shut down: --resume goes on")
    error = future.exception()
    if isinstance(error, BrokenExecutor):
        return [job]
    if error is not None:
        why = " ".join(f"{type(error).__name__}: {error}".split())
        tell(Record(job.capture, "", "failed", error=f"{job.source}: its worker failed: {why}"))
    else:
        tell(future.result())
    return []


def _check(pool: Pool) -> None:
    """Refuse to go on where workers die before they get any work."""
    with pool.open() as executor:
        try:
            executor.submit(int).result()
        except BrokenExecutor as error:
            raise SlkitError(
                'no worker process can be started: in a script, call this below `if __name__ == "__main__":`'
            ) from error
