"""Conditions of an oscilloscope's trigger: which change of its comparators, or of several in a row, fires it.

After the 7000B user's guide (p. 129) a pulse triggers at its end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol


class Change(NamedTuple):
    """A comparator's output changes: between two times, at about `at_s`."""

    channel: int
    high: bool
    early_s: float
    late_s: float
    at_s: float


class Condition(Protocol):
    """Chooses the change that triggers."""

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start with the states of the comparators, remembering nothing."""

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Take the next change; return when it triggers, None if it does not. `exactly` gives a change's instant."""


class NeverMet:
    """A trigger that nothing on this bench fires: single lines and fields of television."""

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start."""
        del highs, now_s

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return None."""
        del change, exactly
        return None


class EdgeCondition:
    """An edge of one channel."""

    def __init__(self, channel: int, *, rising: bool, falling: bool) -> None:
        self._channel = channel
        self._wanted = {True: rising, False: falling}

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start."""
        del highs, now_s

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the instant of a wanted edge."""
        if change.channel != self._channel or not self._wanted[change.high]:
            return None
        return exactly(change)


class _Stopwatch:
    """Compares times between changes with limits, looking closely only where that decides."""

    def __init__(self, least_s: float, most_s: float) -> None:
        self._least_s = least_s
        self._most_s = most_s

    def fits(self, first: Change, last: Change, exactly: Callable[[Change], float]) -> bool:
        shortest, longest = last.early_s - first.late_s, last.late_s - first.early_s
        if self._within(shortest) != self._within(longest) or shortest < self._least_s <= self._most_s < longest:
            shortest = exactly(last) - exactly(first)
        return self._within(shortest)

    def _within(self, time_s: float) -> bool:
        return self._least_s <= time_s <= self._most_s


class PulseCondition:
    """The end of a pulse that lasted between two times."""

    def __init__(self, channel: int, *, positive: bool, least_s: float, most_s: float) -> None:
        self._channel = channel
        self._positive = positive
        self._width = _Stopwatch(least_s, most_s)
        self._began: Change | None = None

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start; a pulse that is there already has an unknown width."""
        del highs, now_s
        self._began = None

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the end of a pulse of the wanted width."""
        if change.channel != self._channel:
            return None
        began, self._began = self._began, change if change.high == self._positive else None
        if change.high == self._positive or began is None or not self._width.fits(began, change, exactly):
            return None
        return exactly(change)


class Video:
    """Synchronising pulses of television: of any line, or of a field.

    A line's pulse lasts 4.7 us and comes each `line_s`; a field begins with broad ones of some 27 us. What has no such
    pulses never triggers. A certain line or one of two fields is not searched for.
    """

    _LINE_PULSE = _Stopwatch(3e-6, 7e-6)
    _BROAD_PULSE = _Stopwatch(20e-6, 35e-6)

    def __init__(self, channel: int, *, negative: bool, line_s: float, field: bool) -> None:
        self._channel = channel
        self._active = not negative
        self._spacing = _Stopwatch(0.98 * line_s, 1.02 * line_s)
        self._field = field
        self._began: Change | None = None
        self._lines: list[Change] = []
        self._in_field = False

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start."""
        del highs, now_s
        self._began = None
        self._lines.clear()
        self._in_field = False

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the start of a line's pulse, or the end of the first broad one, once lines have been seen."""
        if change.channel != self._channel:
            return None
        if change.high == self._active:
            self._began = change
            return None
        began, self._began = self._began, None
        if began is None:
            return None
        if self._LINE_PULSE.fits(began, change, exactly):
            return self._line(began, exactly)
        first = not self._in_field and len(self._lines) == 3
        self._in_field = self._BROAD_PULSE.fits(began, change, exactly)
        return exactly(change) if self._field and first and self._in_field else None

    def _line(self, pulse: Change, exactly: Callable[[Change], float]) -> float | None:
        regular = bool(self._lines) and self._spacing.fits(self._lines[-1], pulse, exactly)
        self._lines = [*self._lines[-2:], pulse] if regular else [pulse]
        self._in_field = False
        return exactly(pulse) if len(self._lines) == 3 and not self._field else None
