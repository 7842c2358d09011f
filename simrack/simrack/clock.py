"""Bench time: the one place of the rack that reads or spends it.

Everything that waits is handed a :class:`Clock`. Time that a program of its own waits in is a :class:`WallClock` or a
:class:`ScaledClock`; a :class:`VirtualClock` moves only because someone waits.
"""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import ClassVar, Protocol, Self


class Clock(Protocol):
    """Bench time in seconds since the clock was made.

    One whose waits take wall time has a `pace`: so many seconds of bench time a second of the wall.

    >>> clock = VirtualClock()
    >>> clock.sleep_until(20.0)
    >>> clock.now()
    20.0
    """

    def now(self) -> float:
        """Return the bench time, s."""

    def sleep_until(self, instant_s: float) -> None:
        """Wait until bench time `instant_s`; return at once if it has passed."""


def sleep(clock: Clock, seconds: float) -> None:
    """Wait `seconds` of bench time.

    >>> clock = ScaledClock(speed=1000.0)
    >>> sleep(clock, 5.0)  # 5 ms on the wall
    """
    clock.sleep_until(clock.now() + seconds)


class WallClock:
    """The clock of a bench of real instruments.

    >>> f"{WallClock().now():.0f} s"
    '0 s'
    """

    __slots__ = ("_start",)

    pace: ClassVar[float] = 1.0

    def __init__(self) -> None:
        self._start = time.monotonic()

    def now(self) -> float:
        """Return the seconds since the clock was made."""
        return time.monotonic() - self._start

    def sleep_until(self, instant_s: float) -> None:
        """Sleep until `instant_s`."""
        remaining = instant_s - self.now()
        if remaining > 0:
            time.sleep(remaining)


class VirtualClock:
    """Simulated time: waiting moves it, nothing else does.

    >>> clock = VirtualClock()
    >>> sleep(clock, 3600.0)
    >>> clock.now()
    3600.0
    """

    __slots__ = ("_now",)

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """Return the simulated time, s."""
        return self._now

    def sleep_until(self, instant_s: float) -> None:
        """Jump to `instant_s`; a clock never goes back."""
        self._now = max(self._now, instant_s)


class ScaledClock:
    """A wall clock that runs `speed` times as fast, for benches that other programs open.

    It can be held: in ``with clock:`` time stands still, so that whatever is computed there sees one instant. One
    thread at a time holds it.

    >>> with ScaledClock(speed=1000.0) as clock:
    ...     clock.now() == clock.now()
    True
    """

    __slots__ = ("_depth", "_held_s", "_lock", "_start", "pace")

    def __init__(self, speed: float = 1.0) -> None:
        self.pace = speed
        self._start = time.monotonic()
        self._lock = threading.RLock()
        self._depth = 0
        self._held_s = 0.0

    def now(self) -> float:
        """Return the scaled seconds since the clock was made."""
        return self._held_s if self._depth else (time.monotonic() - self._start) * self.pace

    def __enter__(self) -> Self:
        self._lock.acquire()
        self._held_s = self.now()
        self._depth += 1
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._depth -= 1
        self._lock.release()

    def sleep_until(self, instant_s: float) -> None:
        """Sleep until `instant_s`."""
        remaining = (instant_s - self.now()) / self.pace
        if remaining > 0:
            time.sleep(remaining)
