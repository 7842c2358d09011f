"""Effect of signals on an open bench.

The first stops the run at its next safe point, the second at once; both leave the bench through the safety stack.
While that runs signals only count; the third of all ends even the making safe: everything is told once more to stop
or to switch off, without waiting for any answer, and what is not proved to be safe is said.
"""

from __future__ import annotations

import _thread
import math
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Self, TypeVar

from vcfbench.errors import Aborted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType, TracebackType

    from vcfbench.clock import Clock

_T = TypeVar("_T")

_WATCHED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""A closed terminal stops the bench as well; the last is Windows'."""

_HEARD_S = 0.1
"""Wall time after which a wait looks whether another thread has stopped the bench."""

_AT_ONCE = 2
"""The signal that waits for no safe point."""


class LeaveNow(BaseException):
    """Raised into the making safe by a third signal: stop proving, report the unsafe ones."""


class StopSignals:
    """Turns SIGINT and its kin into Aborted while the bench is open; gives the handlers back when left.

    Handlers belong to the main thread; entered elsewhere it changes nothing.
    """

    def __init__(self) -> None:
        self._count = 0
        self._name = ""
        self._by = ""
        self._at_safe_point = False
        self._delivered = False
        self._unwinding = False
        self._endable = False
        self._held = False
        self._previous: dict[signal.Signals, object] = {}
        self.asleep = _Asleep(self)

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for name in _WATCHED:
                number = getattr(signal.Signals, name, None)
                if number is not None and signal.getsignal(number) not in {None, signal.SIG_IGN}:  # nohup stays nohup
                    self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]  # what signal.signal returned
        self._previous.clear()

    def stop(self, by: str) -> None:
        """Stop the bench from another thread as the first watched signal does; `by` names the person or program.

        The main thread is woken by that signal. Where none is watched, as in a thread of Python's, every wait looks
        whether it is to end.
        """
        number = next(iter(self._previous), None)
        if number is None:
            self._count, self._name = self._count + 1, by
            return
        self._by = by
        main = threading.main_thread().ident
        if hasattr(signal, "pthread_kill") and main is not None:
            signal.pthread_kill(main, number)
        else:  # Windows
            _thread.interrupt_main(number)

    def safe_point(self) -> None:
        """Raise Aborted if a signal has come; called between two actions."""
        if self._count and not self._unwinding:
            self._delivered = True  # a second one could keep the unwinding from beginning
            raise self._aborted()

    def wait(self, clock: Clock, instant_s: float) -> None:
        """Wait on `clock`; the wait as a whole is a safe point, and is heard of from other threads too."""
        heard_s = _HEARD_S * getattr(clock, "pace", math.inf)
        while instant_s - (now_s := clock.now()) > heard_s:
            self._wait(clock, now_s + heard_s)
        self._wait(clock, instant_s)

    def _wait(self, clock: Clock, instant_s: float) -> None:
        if getattr(clock, "asleep", None) is not self.asleep:
            self.attend(lambda: clock.sleep_until(instant_s))
            return
        before, self.asleep.waiting = self.asleep.waiting, True
        try:
            clock.sleep_until(instant_s)  # enters `asleep`, a safe point
        finally:
            self.asleep.waiting = before

    def attend(self, act: Callable[[], _T]) -> _T:
        """Wait as `act` waits, for a person for instance; the wait as a whole is a safe point."""
        before, self._at_safe_point = self._at_safe_point, True  # it may be part of a longer one
        try:
            self.safe_point()
            return act()
        finally:
            self._at_safe_point = before

    @contextmanager
    def undivided(self) -> Iterator[None]:
        """Do all of this context: a signal within it stops the bench afterwards."""
        before, self._held = self._held, True
        try:
            yield
        finally:
            self._held = before
        if self._count >= _AT_ONCE and not (self._held or self._delivered or self._unwinding):
            self._delivered = True
            raise self._aborted()

    @property
    def came(self) -> bool:
        """Return True if any signal has come."""
        return self._count > 0

    def unwind(self) -> None:
        """Say that the bench is being made safe: from now on signals only count."""
        self._unwinding = True

    def allow_end(self) -> None:
        """Say that the proving begins: from now on a third signal raises LeaveNow, which the caller catches.

        One that has come before ends nothing.
        """
        self._endable = True

    def close(self) -> None:
        """End the handling of signals, because the bench is safe."""
        self._unwinding, self._endable = True, False

    def break_off_from_now(self, *, possible: bool) -> bool:
        """Set whether signals end everything at once; return the state before."""
        before, self._at_safe_point = self._at_safe_point, possible
        if possible:
            self.safe_point()
        return before

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        self._count += 1
        self._name, self._by = self._by or signal.Signals(number).name, ""
        if self._unwinding:
            if self._count >= 3 and self._endable:
                self._endable = False  # once: a fourth one shall not keep anything from being told to stop
                raise LeaveNow
        elif not (self._delivered or self._held) and (self._at_safe_point or self._count >= _AT_ONCE):
            self._delivered = True  # once is enough: a second one could hit the very start of the unwinding
            raise self._aborted()

    def _aborted(self) -> Aborted:
        return Aborted(f"stopped by {self._name}")


class _Asleep:
    """The parts of a wait in which time passes and no simulated device acts: there the wait can be broken off.

    A signal in the middle of what a device works out would leave a world that is half worked out.
    """

    __slots__ = ("_before", "_signals", "waiting")

    def __init__(self, signals: StopSignals) -> None:
        self._signals = signals
        self._before = self.waiting = False

    def __enter__(self) -> None:
        if self.waiting:
            self._before = self._signals.break_off_from_now(possible=True)

    def __exit__(self, *_: object) -> None:
        if self.waiting:
            self._signals.break_off_from_now(possible=self._before)


class ControlClock:
    """The clock handed to procedures: the bench's, with a safe point at every wait.

    Instruments are given the bench's own clock, so that no exchange is broken off in the middle. It is `ahead_s` ahead
    of that: the bench time of what went before, where something goes on.
    """

    __slots__ = ("_ahead_s", "_clock", "_signals", "now")

    def __init__(self, clock: Clock, signals: StopSignals, ahead_s: float = 0.0) -> None:
        self._clock = clock
        self._signals = signals
        self._ahead_s = ahead_s
        self.now = (lambda: clock.now() + ahead_s) if ahead_s else clock.now

    def sleep_until(self, instant_s: float) -> None:
        """Wait until bench time `instant_s`; raises Aborted at a signal."""
        self._signals.wait(self._clock, instant_s - self._ahead_s)
