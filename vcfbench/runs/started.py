"""A run in a thread of its own: begun, controlled from any other, and waited for."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import TIMEOUT_MAX, Event, Thread
from typing import Any

from vcfbench.archive.run import Run
from vcfbench.arguments import require
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.interfaces import Operator
from vcfbench.records.metadata import RunMetadata
from vcfbench.runs.conduct import run
from vcfbench.safety.control import RunControl, RunState
from vcfbench.safety.trust import Trust
from vcfbench.station.description import BenchDescription
from vcfbench.steps.events import Observer
from vcfbench.strict import refusal


class StartedRun(RunControl):
    """A run that goes on in a thread: stopped, paused and waited for from any other.

    The program does not end before the run: a bench is not left by its own program. `conduct` does the run, with this
    as its `control`.

    >>> started = vcfbench.start("turntable", "lab.toml", settings={"samples": 2}, runs=None)
    >>> print(started.result(timeout_s=60.0).status, started.state)
    complete over
    """

    def __init__(self, conduct: Callable[..., Run]) -> None:
        super().__init__()
        self._run: Run | None = None
        self._error: BaseException | None = None
        self._ended = Event()  # a join that Ctrl-C breaks off would take the thread for ended

        def work() -> None:
            try:
                self._run = conduct(control=self)
            except BaseException as error:  # noqa: BLE001  # raised for whoever waits
                self._error = error
            with self._changed:
                if self._state is not RunState.OVER:  # it failed while it was prepared
                    self._set(RunState.OVER, "")
            self._ended.set()

        Thread(target=work, name="vcfbench run").start()

    def result(self, timeout_s: float | None = None) -> Run:
        """Wait for the end of the run, at most `timeout_s` (wall time, None: as long as it takes), and return it.

        Raises:
            TimeoutError: it goes on.
            ConfigError: `timeout_s` is no time.
            BenchError: it did not come to its end, as of :func:`vcfbench.run`.
        """
        require("timeout_s", timeout_s, float | None)
        if timeout_s is not None and math.isnan(timeout_s):
            raise refusal("timeout_s", "a number or None", "nan")
        if not self._ended.wait(None if timeout_s is None else min(timeout_s, TIMEOUT_MAX)):
            raise TimeoutError(f"the run is not over: it is {self.state}")
        if self._error is not None:
            raise self._error
        assert self._run is not None  # noqa: S101  # else there is an error
        return self._run


def start(
    procedure: str | Path | AnyProcedure,
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    settings: Mapping[str, Any] | None = None,
    observers: Sequence[Observer] = (),
    runs: str | Path | None = "runs",
    speed: str | float | None = None,
    operator: Operator | None = None,
    metadata: Mapping[str, Any] | RunMetadata | None = None,
    trust: Trust = False,
) -> StartedRun:
    """Begin a run in a thread of its own and return its control; the arguments are those of :func:`vcfbench.run`.

    Errors are raised by :meth:`StartedRun.result`. Observers and operator are called in the run's thread.
    Signals are the program's: whoever wants Ctrl-C to stop the run calls `stop`.

    >>> started = vcfbench.start("turntable", "lab.toml", speed=50)
    >>> started.stop("the technician")
    >>> started.result()
    Traceback (most recent call last):
    vcfbench.errors.Aborted: stopped by the technician
    """
    conduct = partial(run, procedure, bench, seed=seed, settings=settings, observers=observers, runs=runs, speed=speed)
    return StartedRun(partial(conduct, operator=operator, metadata=metadata, trust=trust))
