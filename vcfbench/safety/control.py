"""Control of a run: stopped, paused and continued by terminal, page and scripts, in any thread."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager, suppress
from enum import StrEnum
from threading import Condition
from typing import TYPE_CHECKING

from vcfbench.arguments import require
from vcfbench.errors import PlanError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.safety.signals import StopSignals

_LOOKS_S = 0.1
"""So often a run that waits to go on looks whether it is to stop, wall time."""


class RunState(StrEnum):
    """State of a run; compares with the word.

    >>> control = vcfbench.RunControl()
    >>> control.state == "beginning", control.state is vcfbench.RunState.BEGINNING
    (True, True)
    """

    BEGINNING = "beginning"
    RUNNING = "running"
    PAUSING = "pausing"
    """It was asked to pause, and the step under way goes on, or the bench comes to rest."""
    PAUSED = "paused"
    STOPPING = "stopping"
    OVER = "over"


class RunControl:
    """Stops one run, has it pause and lets it go on; every method may be called from any thread, and returns at once.

    ``vcfbench.run(..., control=control)`` is controlled by it, :func:`vcfbench.start` returns one. `state` says how the
    run is. A stop is heard within 0.2 s in every wait; a pause begins when the step under way is done.

    >>> control = vcfbench.RunControl()  # for vcfbench.run(..., control=control)
    >>> control.stop("the technician")  # from another thread
    >>> print(control.state)
    stopping
    """

    def __init__(self) -> None:
        self._changed = Condition()
        self._signals: StopSignals | None = None
        self.stop_by = ""
        """Who wanted it to stop; empty: nobody."""
        self._state = RunState.BEGINNING
        self.pause_by = ""
        """Who wants it to pause; empty: nobody."""
        self._on_by = ""
        self._listeners: list[Callable[[RunState, str], None]] = []

    @property
    def state(self) -> RunState:
        """State of the run."""
        return self._state

    def stop(self, by: str = "the program") -> None:
        """Stop the run as Ctrl-C does: at its next safe point, the bench made safe; `by` names its author."""
        by = _named(by)
        with self._changed:
            self.stop_by = self.stop_by or by  # of a run that is over too: the next one of its device must not begin
            if self._state is RunState.OVER:
                return
            self._set(RunState.STOPPING, by)
            if self._signals is not None:
                self._signals.stop(by)

    def pause(self, by: str = "the program") -> None:
        """Pause the run after the present step: table at rest, V_Vc 0, rails on."""
        by = _named(by)
        with self._changed:
            if self._state in {RunState.BEGINNING, RunState.RUNNING}:
                self.pause_by = by
                self._set(RunState.PAUSING, by)

    def go_on(self, by: str = "the program") -> None:
        """Continue a run that pauses, or is about to."""
        by = _named(by)
        with self._changed:
            if self._state in {RunState.PAUSING, RunState.PAUSED}:
                self.pause_by, self._on_by = "", by
                self._set(RunState.BEGINNING if self._signals is None else RunState.RUNNING, by)

    def tell(self, listener: Callable[[RunState, str], None]) -> None:
        """Call `listener` at each new state with its source, in any thread."""
        require("listener", listener, Callable)
        self._listeners.append(listener)

    @contextmanager
    def of_run(self, signals: StopSignals) -> Iterator[None]:
        """Control the run that goes on in this context; `signals` stop it.

        Raises:
            PlanError: it controls a run already, or did.
        """
        with self._changed:
            if self._signals is not None or self._state is RunState.OVER:
                raise PlanError("control: it belongs to another run; make a RunControl for each run")
            self._signals = signals
            if self.stop_by:
                signals.stop(self.stop_by)
            elif not self.pause_by:
                self._set(RunState.RUNNING, "")
        try:
            yield
        finally:
            with self._changed:
                self._signals, self.pause_by = None, ""
                self._set(RunState.OVER, "")

    def wait(self) -> str:
        """Wait until the run is to go on; return the name of the person or program that wants that.

        Raises:
            Aborted: it is to stop.
        """
        signals = self._signals
        assert signals is not None  # noqa: S101  # a run that pauses has begun
        with self._changed:
            if self.pause_by:
                self._set(RunState.PAUSED, self.pause_by)
        signals.attend(lambda: self._wait(signals))
        return self._on_by

    def _wait(self, signals: StopSignals) -> None:
        while self.pause_by:
            signals.safe_point()
            with self._changed:
                if self.pause_by:
                    self._changed.wait(_LOOKS_S)

    def _set(self, state: RunState, by: str) -> None:
        self._state = state
        self._changed.notify_all()
        for each in self._listeners:
            with suppress(Exception):  # a display may fail as it likes
                each(state, by)


def _named(by: str) -> str:
    """Return a name in words: a stop by nobody would not be heard."""
    return str(by) if by else "the program"
