"""Bench time: the one place that reads or spends it.

Everything that waits is handed a :class:`Clock`. On hardware it is a :class:`WallClock`; a simulated
run has a :class:`VirtualClock`, whose time moves only because someone waits; a bench that programs open which know
nothing of simulated time has a :class:`ScaledClock`.
"""

import _thread
import sys
import threading
import time
from collections.abc import Callable
from datetime import UTC, date, datetime

from msgspec import Struct
from simrack.clock import Clock, ScaledClock, VirtualClock, WallClock, sleep

__all__ = [
    "CLOCK_SET",
    "Clock",
    "Deadline",
    "PacedClock",
    "ScaledClock",
    "TimeOfDay",
    "VirtualClock",
    "WallClock",
    "sleep",
    "start_thread",
    "today",
    "uptime_s",
    "utc_now",
    "within",
]


def utc_now() -> datetime:
    """Return the date and time of day, for records and locks; never for pacing."""
    return datetime.now(UTC)


def today() -> date:
    """Return the day of the station, by the time zone of its computer: calibrations are due by the calendar there."""
    return utc_now().astimezone().date()


def uptime_s() -> float:
    """Return the time since the computer started, s, with its time asleep if the system reports that."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)


CLOCK_SET = "dates: the computer's clock was set"
"""How it begins what is said of such a clock."""
_SET_S, _SLEWED = 1.0, 1e-3
"""A clock that moves by less than so much, and this part of the time that passes, was not set, but goes wrong."""


class TimeOfDay:
    """The time of day beside the computer's uptime: whether somebody sets it while a run goes on."""

    __slots__ = ("_seen",)

    def __init__(self) -> None:
        self._seen = _looked()

    def was_set(self) -> str:
        """Return how the time of day was set since the last look, in words; empty if it was not."""
        (before, began_s, until_s), self._seen = self._seen, _looked()
        now, first_s, last_s = self._seen
        within_s = 0.5 * (until_s - began_s + last_s - first_s)  # a program may stand still within a look
        took_s = 0.5 * (first_s + last_s - began_s - until_s)
        by_s = (now - before).total_seconds() - took_s
        if abs(by_s) <= _SET_S + _SLEWED * took_s + within_s:
            return ""
        way, stamps = "back" if by_s < 0.0 else "ahead", [f"{each:%Y-%m-%d %H:%M:%S}" for each in (before, now)]
        return f"{CLOCK_SET} {way} by {abs(by_s):.0f} s: it went from {stamps[0]} to {stamps[1]} UTC"


def _looked() -> tuple[datetime, float, float]:
    began_s = uptime_s()
    return utc_now(), began_s, uptime_s()


def within(wall_s: float, act: Callable[[], object]) -> None:
    """Run `act` in a thread and leave it behind when it takes longer than `wall_s` of wall time."""
    if sys.is_finalizing():  # a thread that is started now never begins, and in 3.11 is waited for for ever
        act()
        return
    done = threading.Event()

    def acting() -> None:
        try:
            act()
        finally:
            done.set()

    try:
        start_thread(acting)
    except RuntimeError:  # no threads left, or the interpreter is ending: better without a limit than not at all
        act()
    else:
        done.wait(wall_s)


def start_thread(act: Callable[[], object]) -> None:
    """Run `act` in a thread of its own; RuntimeError where none can be started.

    `threading.Thread.start` waits for a sign of the new thread, for ever where that has no memory to begin with.
    """
    _thread.start_new_thread(act, ())


class PacedClock(VirtualClock):
    """Simulated time that is shown to a person: each wait also takes wall time, `speed` times shorter.

    It gives the same instants as a :class:`VirtualClock`, hence the same results.

    >>> clock = vcfbench.PacedClock(speed=1000.0)
    >>> vcfbench.sleep(clock, 5.0)  # 5 ms on the wall
    >>> clock.now()
    5.0
    """

    __slots__ = ("_start", "pace")

    def __init__(self, speed: float) -> None:
        super().__init__()
        self.pace = speed
        self._start = time.monotonic()

    def sleep_until(self, instant_s: float) -> None:
        """Jump to `instant_s` once the wall clock has come as far."""
        if instant_s > self.now():
            time.sleep(max(0.0, self._start + instant_s / self.pace - time.monotonic()))
            super().sleep_until(instant_s)


class Deadline(Struct, frozen=True):
    """An instant by which something must be done, handed down instead of a time-out.

    >>> deadline = vcfbench.Deadline.after(bench.clock, 10.0)
    >>> vcfbench.sleep(bench.clock, 4.0)
    >>> f"{deadline.remaining():.0f} s left", deadline.expired()
    ('6 s left', False)
    """

    clock: Clock
    started_s: float
    expires_s: float

    @classmethod
    def after(cls, clock: Clock, seconds: float) -> "Deadline":
        """Return the deadline `seconds` of bench time from now."""
        now = clock.now()
        return cls(clock, now, now + seconds)

    def remaining(self) -> float:
        """Return the seconds left, never negative."""
        return max(0.0, self.expires_s - self.clock.now())

    def within(self, seconds: float) -> "Deadline":
        """Return the deadline `seconds` from now, or this one if that is earlier."""
        return Deadline.after(self.clock, min(seconds, self.remaining()))

    def elapsed(self) -> float:
        """Return the seconds since the deadline was set."""
        return self.clock.now() - self.started_s

    def expired(self) -> bool:
        """Return True if the time is up."""
        return self.clock.now() >= self.expires_s
