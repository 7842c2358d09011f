"""TRACK mode's test of the ACUTROL3000: the host must go on sending demands, or the mode ends (TM-8004-C 4.7.7)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.arguments import number
from simrack.rate_tables.acl.refusal import OUT_OF_RANGE, Refusal

if TYPE_CHECKING:
    from simrack.clock import Clock

_INTERVAL_MS = 1.0
"""Interval between demands, if none is given (TM-8004-C 4.7.7)."""


class TrackTest:
    """Waits for the next demand; the first one after the mode starts the test."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._interval_s = _INTERVAL_MS / 1e3
        self.due_s: float | None = None
        """When the next demand must have come; None is no test."""

    def select(self, interval_ms: float) -> None:
        """Take the interval between demands, ms; 0 is no test."""
        self._interval_s = interval_ms / 1e3

    def stop(self) -> None:
        """Wait for no demand."""
        self.due_s = None

    def take(self) -> None:
        """Note that a demand has come, and begin to wait for the next."""
        self.due_s = self._clock.now() + self._interval_s if self._interval_s else None

    def missed(self) -> bool:
        """Tell, once, whether the demand that was due has not come."""
        if self.due_s is None or self._clock.now() < self.due_s:
            return False
        self.due_s = None
        return True


def interval_ms(text: str | None) -> float:
    """Return the interval that an argument of the mode names, ms; 0 is no test."""
    value = _INTERVAL_MS if text is None else number(text)
    if not 0.0 <= value <= 65535.0:
        raise Refusal(OUT_OF_RANGE)
    return value
