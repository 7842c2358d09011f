"""Workers for the runs of a study: this process, or processes of its own. Both yield the same rows.

A process that dies takes its pool with it. What it may have been doing is then done again one run at a time, each in a
process of its own making, so that a run that kills its process is found, and no other run is lost by it.
"""

import gc
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection
from typing import Any, Final

from vcfbench.errors import BenchError
from vcfbench.studies.one_run import PlannedRun, RunRow, perform

LOST: Final = "lost"
"""Status of a run whose process died each time; it is not kept, so that a study that goes on tries it again."""

_TRIES: Final = 3
_FIRST_BREAKS: Final = 7
_MOST_BREAKS: Final = 60
"""Processes that may die one after another without any run done: before the first one, and later."""

_THREADS: Final = "OPENBLAS_NUM_THREADS"


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def here(works: Iterable[PlannedRun]) -> Iterator[RunRow]:
    """Do the runs in this process, one after another."""
    yield from map(perform, works)


def in_processes(works: Iterable[PlannedRun], workers: int) -> Iterator[RunRow]:
    """Do the runs in so many processes, and yield each row when it is there.

    Raises:
        BenchError: processes die again and again without a run done.
    """
    queue: deque[PlannedRun] = deque(works)
    suspects: deque[PlannedRun] = deque()
    breaks, most = 0, _FIRST_BREAKS
    tries: Counter[tuple[int, int]] = Counter()
    while queue or suspects:
        alone = bool(suspects)
        with _pool(1 if alone else workers) as pool:
            lost: list[PlannedRun] = []
            for row in _done(pool, suspects if alone else queue, 1 if alone else 2 * workers, lost):
                breaks, most = 0, _MOST_BREAKS
                yield row
        breaks += bool(lost)
        if breaks > most:
            raise BenchError(
                "the processes of the study die before they have done a run",
                hint="a script needs `if __name__ == '__main__':` around the call; where memory is short, --workers 1",
            )
        for work in lost:
            tries[work.key] += alone
            if tries[work.key] >= _TRIES:
                yield RunRow(*work.key, LOST, f"its process died {_TRIES} times")
            else:
                suspects.appendleft(work) if alone else suspects.append(work)


def _done(pool: ProcessPoolExecutor, queue: deque[PlannedRun], window: int, lost: list[PlannedRun]) -> Iterator[RunRow]:
    """Yield the rows of `queue`, at most `window` of them under way; those lost with a dead process go into `lost`."""
    running: dict[Any, PlannedRun] = {}
    while queue or running:
        try:
            while queue and len(running) < window:
                running[pool.submit(perform, queue[0])] = queue[0]
                queue.popleft()
        except BrokenProcessPool:  # told here first; those under way tell it below
            pass
        if not running:
            lost.append(queue.popleft())
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            work = running.pop(future)
            try:
                row = future.result()
            except BrokenProcessPool:
                lost.append(work)
            else:
                yield row
        if lost:
            yield from _left(running, lost)
            return


def _left(running: dict[Any, PlannedRun], lost: list[PlannedRun]) -> Iterator[RunRow]:
    """Yield the rows done before the pool broke; the rest is lost."""
    for future, work in running.items():
        try:
            yield future.result()
        except BrokenProcessPool:
            lost.append(work)


@contextmanager
def _pool(workers: int) -> Generator[ProcessPoolExecutor]:
    """Make a pool of processes; left by an exception they are killed, so that nobody waits for a long run."""
    before = set(multiprocessing.active_children())
    threads = os.environ.get(_THREADS)
    os.environ.setdefault(_THREADS, "1")  # as the command does; processes are made with it
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin)
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        if threads is None:
            os.environ.pop(_THREADS, None)


def _begin() -> None:
    """Begin a process of the study: Ctrl-C is for the study, and without it there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.set_threshold(200_000)  # as the command does

    def end_with_parent() -> None:
        """Wait until the process of the study is gone, however it went, and be gone too."""
        parent = multiprocessing.parent_process()
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
