"""When an oscilloscope's trigger fires: comparators make changes of state of voltages, conditions choose among them.

Definitions after the 7000B user's guide: a pulse (p. 129) and the duration of a pattern (p. 116) trigger at their end,
a time-out when it runs out while the pattern is there, a pattern when the last of its channels comes to it. The
hysteresis of noise reject, one division, is known from a note on a sibling; the band of none is taken as zero, because
what is looked at here has no noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from vcfbench.sim.instruments.dso_inputs import Signals

__all__ = [
    "Burst",
    "Change",
    "Comparator",
    "Condition",
    "Duration",
    "Edge",
    "Never",
    "Pattern",
    "Pulse",
    "Tips",
    "Trigger",
    "TriggerSearch",
    "Video",
]

_GRID_POINTS = 4000
_BLOCK_POINTS = 1 << 16
_MOST_POINTS = 1 << 20
"""How often one search looks at most: a microsecond's pulse in a second."""
_REFINE_POINTS = 33
_REFINE_ROUNDS = 2
_CORNER_HZ = 50e3
"""Of HF and LF reject (user's guides of siblings)."""
_TIME_CONSTANT_S = 1.0 / (2.0 * math.pi * _CORNER_HZ)
_FILTER_STEP_S = _TIME_CONSTANT_S / 16.0
_SETTLED = 8.0
"""Time constants after which a filter has forgotten that it began somewhere."""


class Change(NamedTuple):
    """A comparator's output changes: between two times, at about `at_s`."""

    channel: int
    high: bool
    early_s: float
    late_s: float
    at_s: float


@dataclass(frozen=True, slots=True)
class Comparator:
    """High above its upper threshold, low below its lower one, as it was between them."""

    level_v: float
    low_v: float
    high_v: float
    ac: bool = False
    """Without the mean of what is searched: a corner of some hertz, as seen on one search."""
    filter: str = ""
    """"LF" rejects low frequencies, "HF" high ones, by 6 dB an octave from 50 kHz."""

    @classmethod
    def at(
        cls, level_v: float, band_v: float = 0.0, side: float = 0.0, *, ac: bool = False, reject: str = ""
    ) -> Comparator:
        """Return one at a level; `side` 1 has its band below (rising edges are at the level), -1 above, 0 about it."""
        middle = level_v - side * band_v / 2.0
        return cls(level_v, middle - band_v / 2.0, middle + band_v / 2.0, ac, reject)


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


class Never(_Patient):
    """What nothing on this bench can meet: frames of a serial bus, an open input."""

    def begin(self, highs: Mapping[int, bool], now_s: float) -> None:
        """Start."""
        del highs, now_s

    def feed(self, change: Change, exactly: Callable[[Change], float]) -> float | None:
        """Return None."""
        del change, exactly
        return None


class Edge(_Patient):
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


class Pulse(_Patient):
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


@dataclass(frozen=True, slots=True)
class Trigger:
    """A condition on the outputs of comparators."""

    comparators: Mapping[int, Comparator]
    make: Callable[[], Condition]
    tips: Tips | None = None
    """Television: the level follows the tips of the signal."""


@dataclass(frozen=True, slots=True)
class Tips:
    """Synchronising tips: below or above everything else, by at least `swing_v`."""

    negative: bool
    swing_v: float

    def comparator(self, volts: NDArray[np.float64]) -> Comparator:
        """Return the comparator that takes the tips off; one that never changes where there is too little signal."""
        if np.ptp(volts) < self.swing_v:
            return Comparator.at(math.inf)
        away = 0.5 * self.swing_v
        return Comparator.at(float(volts.min()) + away if self.negative else float(volts.max()) - away)


class _Follower:
    """A comparator that remembers from block to block."""

    def __init__(self, channel: int, comparator: Comparator, bias_v: float) -> None:
        self.comparator = comparator
        self.bias_v = bias_v
        self.began_high: bool | None = None
        self._channel = channel
        self._high = False
        self._filter: _LowPass | None = None

    def threshold_v(self, change: Change) -> float:
        """Return what was crossed, in volts of the input."""
        return (self.comparator.high_v if change.high else self.comparator.low_v) + self.bias_v

    def changes(self, times: NDArray[np.float64], volts: NDArray[np.float64]) -> list[Change]:
        """Return the changes in a block of evenly spaced samples."""
        heights = self._filtered(volts - self.bias_v, float(times[1] - times[0]))
        comparator, new = self.comparator, self.began_high is None
        if new:
            self._high = self.began_high = bool(heights[0] >= comparator.level_v)
        highs = _held(heights, comparator, high_before=self._high)
        self._high = bool(highs[-1])
        places = np.flatnonzero(highs[1:] != highs[:-1])
        if new and comparator.filter:
            places = places[times[places] >= times[0] + _SETTLED * _TIME_CONSTANT_S]
        return [self._change(times, heights, int(place), high=bool(highs[place + 1])) for place in places]

    def _filtered(self, volts: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
        if not self.comparator.filter:
            return volts
        self._filter = self._filter or _LowPass(float(volts[0]))
        slow = self._filter.passed(volts, step_s)
        return slow if self.comparator.filter == "HF" else volts - slow

    def _change(self, times: NDArray[np.float64], heights: NDArray[np.float64], place: int, *, high: bool) -> Change:
        threshold = self.comparator.high_v if high else self.comparator.low_v
        before, after = float(heights[place]), float(heights[place + 1])
        part = (threshold - before) / (after - before) if after != before else 0.0
        early, late = float(times[place]), float(times[place + 1])
        return Change(self._channel, high, early, late, early + min(max(part, 0.0), 1.0) * (late - early))


def _held(heights: NDArray[np.float64], comparator: Comparator, *, high_before: bool) -> NDArray[np.bool_]:
    """Return whether the output is high at each sample: between the thresholds it is as it was."""
    if comparator.low_v == comparator.high_v:
        return np.asarray(heights >= comparator.high_v)
    above, below = heights >= comparator.high_v, heights < comparator.low_v
    last = np.maximum.accumulate(np.where(above | below, np.arange(len(heights)), -1))
    return np.where(last >= 0, above[last], high_before)


class _LowPass:
    """One pole at 50 kHz, exact for what is straight between its samples."""

    def __init__(self, start_v: float) -> None:
        self._out = self._in = start_v

    def passed(self, volts: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
        """Return the filtered samples; blocks overlap by one sample, the last of one being the first of the next."""
        ratio = step_s / _TIME_CONSTANT_S
        decay = math.exp(-ratio)
        mean = (1.0 - decay) / ratio
        driven = (1.0 - mean) * volts[1:] + (mean - decay) * volts[:-1]
        out = np.empty(len(volts))
        out[0] = self._out
        length = max(1, int(25.0 / ratio))
        for start in range(0, len(driven), length):
            part = driven[start : start + length]
            powers = decay ** np.arange(1, len(part) + 1)
            out[start + 1 : start + 1 + len(part)] = powers * (out[start] + np.cumsum(part / powers))
        self._out = float(out[-1])
        return out


class TriggerSearch:
    """Looks for a trigger through stretches of time that follow each other."""

    def __init__(self, trigger: Trigger) -> None:
        self._trigger = trigger
        self._condition = trigger.make()
        self._followers: dict[int, _Follower] = {}
        self._reached_s: float | None = None

    def find(self, signals: Signals, start_s: float, stop_s: float) -> float | None:
        """Return the first trigger in [start_s, stop_s], None if there is none.

        A stretch that begins where the last one ended carries on; anything else starts anew.
        """
        if stop_s <= start_s:
            return None
        if self._reached_s is None or start_s != self._reached_s:
            self._restart(signals, start_s, stop_s)
        for times in self._blocks(signals, start_s, stop_s):
            found = self._look(signals, times)
            if found is not None:
                self._reached_s = None
                return found
        self._reached_s = stop_s
        return None

    def _restart(self, signals: Signals, start_s: float, stop_s: float) -> None:
        self._condition = self._trigger.make()
        grid = np.linspace(start_s, stop_s, _GRID_POINTS)
        self._followers = {
            channel: self._follower(signals, channel, comparator, grid)
            for channel, comparator in self._trigger.comparators.items()
        }
        self._reached_s = None

    def _follower(self, signals: Signals, channel: int, comparator: Comparator, grid: NDArray[np.float64]) -> _Follower:
        if self._trigger.tips is not None:
            comparator = self._trigger.tips.comparator(signals.volts(channel, grid))
        return _Follower(channel, comparator, float(signals.volts(channel, grid).mean()) if comparator.ac else 0.0)

    def _blocks(self, signals: Signals, start_s: float, stop_s: float) -> Iterator[NDArray[np.float64]]:
        """Yield the times to look at: as close as there can be something to see."""
        points = self._points(signals, stop_s - start_s)
        count = max(1, math.ceil((points - 1) / _BLOCK_POINTS))
        edges = np.linspace(start_s, stop_s, count + 1)
        for first, last in pairwise(edges):
            yield np.linspace(first, last, points if count == 1 else _BLOCK_POINTS + 1)

    def _points(self, signals: Signals, span_s: float) -> int:
        finest = min((signals.finest_s(channel) for channel in self._followers), default=math.inf)
        if any(comparator.filter for comparator in self._trigger.comparators.values()):
            finest = min(finest or math.inf, _FILTER_STEP_S)
        if finest * (_GRID_POINTS - 1) >= span_s:
            return _GRID_POINTS
        return min(_MOST_POINTS, math.ceil(2.0 * span_s / finest) + 1) if finest else _MOST_POINTS

    def _look(self, signals: Signals, times: NDArray[np.float64]) -> float | None:
        new = self._reached_s is None
        changes = [
            change
            for channel, follower in self._followers.items()
            for change in follower.changes(times, signals.volts(channel, times))
        ]
        if new:
            highs = {channel: bool(follower.began_high) for channel, follower in self._followers.items()}
            self._condition.begin(highs, float(times[0]))
        self._reached_s = float(times[-1])
        return self._fed(signals, sorted(changes, key=_instant), float(times[-1]))

    def _fed(self, signals: Signals, changes: list[Change], stop_s: float) -> float | None:
        def exactly(change: Change) -> float:
            return self._refined(signals, change)

        for change in changes:
            waited = self._condition.until(change.at_s)
            found = self._condition.feed(change, exactly) if waited is None else waited
            if found is not None:
                return found
        return self._condition.until(stop_s)

    def _refined(self, signals: Signals, change: Change) -> float:
        """Return the instant of a change: looked at closer twice, then straight."""
        follower = self._followers[change.channel]
        if follower.comparator.filter:
            return change.at_s
        threshold = follower.threshold_v(change)
        early, late = change.early_s, change.late_s
        for _ in range(_REFINE_ROUNDS):
            times = np.linspace(early, late, _REFINE_POINTS)
            above = signals.volts(change.channel, times) >= threshold
            places = np.flatnonzero((above[1:] == change.high) & (above[:-1] != change.high))
            if len(places):
                early, late = float(times[places[0]]), float(times[places[0] + 1])
        before, after = (float(each) for each in signals.volts(change.channel, np.array([early, late])))
        part = (threshold - before) / (after - before) if after != before else 0.0
        return early + part * (late - early)


def _instant(change: Change) -> float:
    return change.at_s
