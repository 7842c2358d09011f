"""Conditions of an oscilloscope's trigger: which change of its comparators, or of several in a row, fires it.

Definitions after the 7000B user's guide: a pulse (p. 129) and the duration of a pattern (p. 116) trigger at their end,
a time-out when it runs out while the pattern is there, a pattern when the last of its channels comes to it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Protocol

from msgspec import Struct

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


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
        ...

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Take the next change; return when it triggers, None if it does not. `exactly` gives a change's instant."""
        ...

    def until(self, now_s: float) -> float | None:
        """Nothing more has changed until now: return the instant if waiting alone has triggered."""
        ...


class _Patient:
    """A condition that waiting alone does not meet."""

    def until(self, now_s: float) -> float | None:
        """Return None."""
        del now_s
        return None


class NeverMet(_Patient):
    """What nothing on this bench can meet: frames of a serial bus, an open input."""

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start."""
        del highs, now_s

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return None."""
        del change, exactly
        return None


class EdgeCondition(_Patient):
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

    def __init__(self, least_s: float, most_s: float, *, outside: bool = False) -> None:
        self._least_s = least_s
        self._most_s = most_s
        self._outside = outside

    def fits(self, first: Change, last: Change, exactly: Callable[[Change], float]) -> bool:
        shortest, longest = last.early_s - first.late_s, last.late_s - first.early_s
        if self._within(shortest) != self._within(longest) or shortest < self._least_s <= self._most_s < longest:
            shortest = exactly(last) - exactly(first)
        return self._within(shortest) != self._outside

    def _within(self, time_s: float) -> bool:
        return self._least_s <= time_s <= self._most_s


class PulseCondition(_Patient):
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


class _Levels:
    """Which channels must be high, and which low."""

    def __init__(self, wanted: Mapping[int, bool]) -> None:
        self._wanted = dict(wanted)
        self._highs: dict[int, bool] = {}

    def begin(self, highs: Mapping[int, bool]) -> None:
        self._highs = dict(highs)

    def take(self, change: Change) -> None:
        self._highs[change.channel] = change.high

    @property
    def there(self) -> bool:
        wanted = self._wanted
        return bool(wanted) and all(self._highs.get(channel) == high for channel, high in wanted.items())


class Pattern(_Patient):
    """A pattern is entered; or, with an edge, that edge while the others are as wanted."""

    def __init__(self, wanted: Mapping[int, bool], edge: tuple[int, bool] | None = None) -> None:
        self._edge = edge
        others = {channel: high for channel, high in wanted.items() if edge is None or channel != edge[0]}
        self._levels = _Levels(others)
        self._any = not others and edge is not None

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start; a pattern that is there already was entered earlier."""
        del now_s
        self._levels.begin(highs)

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the instant at which the pattern is complete."""
        was_there = self._levels.there
        self._levels.take(change)
        if self._edge is None:
            return exactly(change) if self._levels.there and not was_there else None
        meant = (change.channel, change.high) == self._edge
        return exactly(change) if meant and (self._any or self._levels.there) else None


class Duration:
    """A pattern ends that was there between two times (or not between them), or has been there for a time."""

    def __init__(
        self, wanted: Mapping[int, bool], least_s: float, most_s: float, *, outside: bool = False, timeout: bool = False
    ) -> None:
        self._levels = _Levels(wanted)
        self._length = _Stopwatch(least_s, most_s, outside=outside)
        self._timeout_s = least_s if timeout else math.inf
        self._since: Change | None = None
        self._since_s = math.inf

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start; a pattern that is there already began at an unknown time."""
        del now_s
        self._levels.begin(highs)
        self._since, self._since_s = None, math.inf

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the end of a pattern of the wanted duration."""
        was_there = self._levels.there
        self._levels.take(change)
        if self._levels.there == was_there:
            return None
        since = self._since
        if self._levels.there:
            self._since = change
            self._since_s = exactly(change) if math.isfinite(self._timeout_s) else change.at_s
            return None
        self._since, self._since_s = None, math.inf
        if since is None or math.isfinite(self._timeout_s) or not self._length.fits(since, change, exactly):
            return None
        return exactly(change)

    def until(self, now_s: float) -> float | None:
        """Return when the time ran out, if it has."""
        end_s = self._since_s + self._timeout_s
        if end_s > now_s:
            return None
        self._since, self._since_s = None, math.inf
        return end_s


class Burst(_Patient):
    """The n-th edge of one slope after a time without any edge."""

    def __init__(self, channel: int, *, rising: bool, count: int, idle_s: float) -> None:
        self._channel = channel
        self._rising = rising
        self._count = count
        self._idle = _Stopwatch(idle_s, math.inf)
        self._last: Change | None = None
        self._counted: int | None = None

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start idle as of now."""
        del highs
        self._last = Change(self._channel, high=False, early_s=now_s, late_s=now_s, at_s=now_s)
        self._counted = None

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the instant of the n-th edge."""
        if change.channel != self._channel:
            return None
        last, self._last = self._last, change
        if last is not None and self._idle.fits(last, change, exactly):
            self._counted = 0
        if self._counted is None or change.high != self._rising:
            return None
        self._counted += 1
        if self._counted < self._count:
            return None
        self._counted = None
        return exactly(change)


class Video(_Patient):
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
        return self._broad(began, change, exactly)

    def _line(self, pulse: Change, exactly: Callable[[Change], float]) -> float | None:
        regular = bool(self._lines) and self._spacing.fits(self._lines[-1], pulse, exactly)
        self._lines = [*self._lines[-2:], pulse] if regular else [pulse]
        self._in_field = False
        return exactly(pulse) if len(self._lines) == 3 and not self._field else None

    def _broad(self, began: Change, end: Change, exactly: Callable[[Change], float]) -> float | None:
        first = not self._in_field and len(self._lines) == 3
        self._in_field = self._BROAD_PULSE.fits(began, end, exactly)
        return exactly(end) if self._field and first and self._in_field else None


class SequenceStage(Struct, frozen=True):
    """What one stage of a sequence waits for: a pattern entered or exited, an edge, or an edge within a pattern."""

    pattern: Mapping[int, bool] | None = None
    entered: bool = True
    edge: tuple[int, bool] | None = None


class _Waiting:
    """A stage that follows the changes."""

    def __init__(self, stage: SequenceStage) -> None:
        self._stage = stage
        self._levels = _Levels(stage.pattern or {})

    def begin(self, highs: Mapping[int, bool]) -> None:
        self._levels.begin(highs)

    def met(self, change: Change) -> bool:
        was_there = self._levels.there
        self._levels.take(change)
        if self._stage.edge is None:
            return self._levels.there != was_there and self._levels.there == self._stage.entered
        meant = (change.channel, change.high) == self._stage.edge
        return meant and (self._stage.pattern is None or self._levels.there)


class SequenceCondition(_Patient):
    """One thing, then another, unless a third or too long a time comes between.

    Args:
        find, trigger: the two stages.
        reset: what leads back to the first; None: nothing.
        count: how often the second has to come.
        counts_anew: the first coming again begins the count again.
        timer_s: how long the second may take.
    """

    def __init__(
        self,
        find: SequenceStage,
        trigger: SequenceStage,
        reset: SequenceStage | None = None,
        *,
        count: int = 1,
        counts_anew: bool = True,
        timer_s: float = math.inf,
    ) -> None:
        self._find, self._trigger = _Waiting(find), _Waiting(trigger)
        self._reset = None if reset is None else _Waiting(reset)
        self._count, self._counts_anew, self._timer_s = count, counts_anew, timer_s
        self._found_s: float | None = None
        self._counted = 0

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start with the first stage."""
        del now_s
        for waiting in (self._find, self._trigger, self._reset):
            if waiting is not None:
                waiting.begin(highs)
        self._found_s = None

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return the instant at which the second stage is complete."""
        found, met = self._find.met(change), self._trigger.met(change)
        reset = self._reset is not None and self._reset.met(change)
        if self._found_s is not None and change.at_s > self._found_s + self._timer_s:
            self._found_s = None
        if self._found_s is None:
            self._begin_second(change, exactly, found=found)
            return None
        self._counted += met
        if self._counted >= self._count:
            self._found_s = None
            return exactly(change)
        if reset:
            self._found_s = None
        elif found and self._counts_anew:
            self._counted = 0
        return None

    def _begin_second(self, change: Change, exactly: Callable[[Change], float], *, found: bool) -> None:
        if found:
            self._found_s, self._counted = exactly(change), 0
