"""Processes for the runs of a study, which yield the same rows as the study's own would.

A process that dies takes its pool with it: what was under way is done again, last of all, in another pool.
"""

import gc
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection
from typing import Final

from vcfbench.errors import BenchError
from vcfbench.studies.one_run import PlannedRun, RunRow, perform

_MOST_BREAKS: Final = 7
"""Pools that may break one after another without any run done."""

_THREADS: Final = "OPENBLAS_NUM_THREADS"


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_processes(works: Iterable[PlannedRun], workers: int) -> Iterator[RunRow]:
    """Do the runs in so many processes, and yield each row when it is there.

    Raises:
        BenchError: processes die again and again without a run done.
    """
    queue: deque[PlannedRun] = deque(works)
    lost: deque[PlannedRun] = deque()
    breaks = 0
    while queue or lost:
        with _pool(workers) as pool:
            # those lost before are done one at a time: only what kills its process is lost again
            for row in _done(pool, queue, lost, 2 * workers) if queue else _done(pool, lost, lost, 1):
                breaks = 0
                yield row
        breaks += 1
        left = [*lost, *queue]
        if left and breaks > _MOST_BREAKS:
            (case, seed), others = left[0].key, f" (and {len(left) - 1} more)" if len(left) > 1 else ""
            raise BenchError(
                f"the processes of the study die before they have done case {case}, seed {seed}{others}",
                hint="a script needs `if __name__ == '__main__':` around the call; with little memory use --workers 1",
            )


def _done(
    pool: ProcessPoolExecutor, queue: deque[PlannedRun], lost: deque[PlannedRun], window: int
) -> Iterator[RunRow]:
    """Yield the rows of `queue`, at most `window` of them under way; those lost with a dead process go into `lost`."""
    running: dict[Future[RunRow], PlannedRun] = {}
    try:
        while queue or running:
            while queue and len(running) < window:
                running[pool.submit(perform, queue[0])] = queue[0]
                queue.popleft()
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                row = future.result()
                del running[future]
                yield row
    except BrokenProcessPool:
        for future, work in running.items():
            if future.done() and future.exception() is None:
                yield future.result()
            else:
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
