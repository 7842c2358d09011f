"""Resources of an open bench, and its end: everything switched off, then closed, once.

A bench may be left by nobody: a script ends, or raises, while it is open; a notebook's kernel is shut down. What is
still open when Python ends is made safe then, while threads can still be started; code 5 says if it could not be.
"""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from mmap import mmap
from types import FrameType
from typing import Any, Final

from vcfbench.bench.ground import UnopenedBench
from vcfbench.bench.interrupted import at_each_interrupt
from vcfbench.errors import Aborted, BenchError, NotSafe
from vcfbench.interfaces import SafeReport
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.stack import SafetyStack, not_safe
from vcfbench.safety.watchdog import Watchdog

_LEFT_TO_PYTHON: Final = ("SIGTERM", "SIGHUP", "SIGBREAK")
"""Signals that end a Python program at once, without a word to anybody."""


class SignalWatch:
    """Periods in which the bench's own `signals` have the handlers: opening, inside of a ``with``, leaving.

    `signals` is None for a bench whose opener watches himself. In between, what would end Python without a word ends it
    in the orderly way.
    """

    def __init__(self, signals: StopSignals | None) -> None:
        self._signals = signals
        self._watching = False

    def begin(self) -> None:
        """Take the handlers."""
        if self._signals is not None and not self._watching:
            self._watching = True
            _STILL_OPEN.give_back_signals()
            self._signals.__enter__()

    def end(self) -> None:
        """Give the handlers back; while something is open Python's own are replaced."""
        if self._signals is not None and self._watching:
            self._watching = False
            self._signals.__exit__(None, None, None)
            _STILL_OPEN.take_signals()


class Holding:
    """Resources held while instruments are open: signals, station with its locks, safety stack.

    `stack` gives back last: the station and the handlers.
    """

    def __init__(
        self, name: str, stand: UnopenedBench, signals: StopSignals, watch: SignalWatch, stack: ExitStack
    ) -> None:
        self.name = name
        self.safety = SafetyStack(stand.clock, patience=stand.patience)
        self.reports: list[SafeReport] = []
        self._signals = signals
        self._stack = stack
        self._watch = watch
        self.watchdog: Watchdog | None = None
        self.stop_table: Callable[[], None] | None = None
        """Brings the table to rest, its servo kept; None on a bench without one."""
        self.reserve: mmap | None = None
        """Memory that is given back before the bench is made safe, for that needs some."""
        self._within: threading.Thread | None = None
        """Thread that is in the context of this bench, None outside of a ``with``."""
        self._closed = False
        self._process = os.getpid()
        _STILL_OPEN.add(self)

    @property
    def closed(self) -> bool:
        """Return True if it was left; in a forked process it is not ours to leave."""
        return self._closed or os.getpid() != self._process

    def watch(self) -> None:
        """Give the bench's own signals the handlers until the end of the context."""
        if not self.closed:
            self._within = threading.current_thread()
            self._watch.begin()

    def leave(self, under_way: BaseException | None = None) -> None:
        """Make everything safe and close it; a second call does nothing.

        Raises:
            NotSafe: something is not safe; from what is `under_way`.
        """
        if self.closed:
            return
        self._watch.begin()
        self._signals.unwind()
        self._closed = True
        _STILL_OPEN.discard(self)
        if self.watchdog is not None:
            self.watchdog.making_safe(self.safety.longest_s)
        if self.reserve is not None:
            self.reserve.close()
        error: NotSafe | None = NotSafe("NOT SAFE: making safe was broken off")
        try:
            with self._stack:
                unsafe: NotSafe | None
                try:
                    self.reports += self.safety.make_safe_until_ended(self._signals)
                    unsafe = not_safe(self.reports)
                except NotSafe as ended:
                    unsafe = ended
                self.safety.close()
                if unsafe is not None:
                    unsafe.reports = tuple(self.reports)
                error = unsafe  # only now: what breaks it off before is not safe
        finally:
            if self.watchdog is not None:  # it needs the locks
                self.watchdog.leave(safe=error is None)
                if error is not None:
                    more = f"its watchdog, process {self.watchdog.number}, tries again until it is safe"
                    error.hint = f"{error.hint}; {more}" if error.hint else more
        if error is None:
            return
        if isinstance(under_way, BenchError):
            error.hint = f"{error.hint}; before that: {under_way}"
        raise error from under_way

    def interrupted(self) -> None:
        """Bring the table to rest after an interrupt at the prompt, but not that of a run in another thread."""
        within = self._within
        elsewhere = within is not None and within.is_alive() and within is not threading.current_thread()
        if self.stop_table is None or self.closed or elsewhere:
            return
        try:
            self.stop_table()
            said = "its table was told to stop, and stays enabled"
        except BenchError as error:
            said = f"its table could not be told to stop ({error}): `close` makes the bench safe"
        _say(f"interrupted while bench {self.name} is open; {said}")

    def abandon(self, when: str) -> None:
        """Make an abandoned bench safe and report that on stderr; NotSafe is code 5 when Python ends."""
        try:
            self.leave()
            said = "it was made safe"
        except NotSafe as error:
            _STILL_OPEN.unsafe = True
            said = str(error)
        _say(f"bench {self.name} was still open when {when}; {said}")


def _say(words: str) -> None:
    with suppress(OSError, ValueError, AttributeError):  # nobody may be there to read it
        sys.stderr.write(f"vcfbench: {words}\n")
        sys.stderr.flush()


class _StillOpen:
    """Everything that is held in this process, for its end.

    While a bench is open outside of a ``with``, signals that would end Python without a word end it in the orderly way.
    """

    def __init__(self) -> None:
        self._held: dict[Holding, None] = {}
        self._watching = False
        self._taken: list[signal.Signals] = []
        self.unsafe = False

    def add(self, holding: Holding) -> None:
        """Take care of `holding` until it is left."""
        self._held[holding] = None
        if not self._watching:
            self._watching = True
            # atexit alone comes too late: no thread can be started any more (3.12), or one is waited for for ever
            atexit.register(self._leave_with_code)
            atexit.register(self._end)
            at_each_interrupt(self._interrupted)
            with suppress(AttributeError, RuntimeError):  # it is not there, or Python is ending already
                threading._register_atexit(self._end)  # type: ignore[attr-defined]  # noqa: SLF001  # no other is in time

    def discard(self, holding: Holding) -> None:
        """Forget a bench that was left."""
        self._held.pop(holding, None)
        if not self._held:
            self.give_back_signals()

    def take_signals(self) -> None:
        """Turn signals that would end Python at once into a SystemExit, unless another handler has them."""
        if not self._held or threading.current_thread() is not threading.main_thread():
            return
        for name in _LEFT_TO_PYTHON:
            number = getattr(signal.Signals, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, self._stop)
                self._taken.append(number)

    def give_back_signals(self) -> None:
        """Leave the signals to Python again."""
        if self._taken and threading.current_thread() is threading.main_thread():
            for number in self._taken:
                if signal.getsignal(number) == self._stop:
                    signal.signal(number, signal.SIG_DFL)
            self._taken.clear()

    def _stop(self, _number: int, _frame: FrameType | None) -> None:
        raise SystemExit(Aborted.exit_code)

    def _interrupted(self) -> None:
        for holding in tuple(self._held):
            holding.interrupted()

    def _end(self) -> None:
        """Make safe the benches still open; Python is ending."""
        for holding in tuple(self._held):
            holding.abandon("Python ended")

    def _leave_with_code(self) -> None:
        """End with the code of NotSafe; the interpreter knows no other way at this point."""
        if not self.unsafe:
            return
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        logging: Any = sys.modules.get("logging")
        if logging is not None:
            logging.shutdown()
        os._exit(NotSafe.exit_code)


_STILL_OPEN: Final = _StillOpen()
"""One a process: Python ends once."""
