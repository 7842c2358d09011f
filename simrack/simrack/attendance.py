"""A clock that does not jump over events of simulated devices.

Simulated time jumps to whatever is waited for. A supply's ramp or a commanded output that falls due in between must
still happen at its own instant, or the World would see it late; so the devices are looked in on as time passes.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol

from simrack.clock import Clock, ScaledClock


class Attended(Protocol):
    """A device that can be attended: every :class:`~simrack.device.Device`."""

    def wake_at(self) -> float | None:
        """Do everything due and return when something next happens by itself."""


class AttendedClock:
    """Bench time that stops at each instant at which a device does something by itself.

    Args:
        clock: the time that is really spent.
        devices: the devices to look in on; more by :meth:`attend`, because a device is made with its clock.
    """

    __slots__ = ("_clock", "_wake_ats", "asleep", "held", "now", "pace")

    def __init__(self, clock: Clock, devices: Iterable[Attended] = ()) -> None:
        self._clock = clock
        self._wake_ats: tuple[Callable[[], float | None], ...] = ()
        self.attend(*devices)
        self.now = clock.now
        self.pace: float = getattr(clock, "pace", math.inf)
        self.asleep: AbstractContextManager[object] = nullcontext()
        """Entered while time passes and no device acts: a wait may be broken off there, and nowhere else in it."""
        self.held: AbstractContextManager[object] = clock if isinstance(clock, ScaledClock) else threading.RLock()
        """Entered around every call of a device: one at a time, and a clock that runs by itself stands still."""

    def attend(self, *devices: Attended) -> None:
        """Look in on `devices` too, once each."""
        self._wake_ats = tuple(dict.fromkeys((*self._wake_ats, *(each.wake_at for each in devices))))

    def sleep_until(self, instant_s: float) -> None:
        """Wait until `instant_s`, stopping wherever a device has something to do."""
        while (due := self._next_due(instant_s)) < instant_s:
            with self.asleep:
                self._clock.sleep_until(due)
        with self.asleep:
            self._clock.sleep_until(instant_s)

    def sleep_to_next(self, latest_s: float) -> None:
        """Wait until a device next does something by itself, at most until `latest_s`."""
        self._clock.sleep_until(self._next_due(latest_s))

    def _next_due(self, instant_s: float) -> float:
        """Return the next instant before `instant_s` at which a device acts, else `instant_s`."""
        due = instant_s
        with self.held:
            now = self.now()
            if instant_s <= now:
                return instant_s
            for wake_at in self._wake_ats:
                wake = wake_at()
                if wake is not None and now < wake < due:
                    due = wake
        return due
