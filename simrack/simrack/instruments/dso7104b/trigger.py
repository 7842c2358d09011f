"""Looks for an oscilloscope's trigger: comparators make changes of state of voltages, a condition chooses among them.

The hysteresis of noise reject, one division, is known from a note on a sibling; that of none is taken as zero, because
what is looked at here has no noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from heapq import merge
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from simrack.instruments.dso7104b.conditions import Change, Condition
from simrack.instruments.dso7104b.filters import LowPass, Sines, time_constant_s
from simrack.instruments.dso7104b.inputs import Signals

_GRID_POINTS = 4000
_BLOCK_POINTS, _AT_ONCE = 1 << 16, 1 << 14
_MOST_POINTS = 1 << 20
"""How often one search looks at most: a microsecond's pulse in a second."""
_CHANGES_AT_ONCE = 1 << 7
_REFINE_POINTS = 33
_REFINE_ROUNDS = 2
_CORNER_HZ = 50e3
"""Of HF and LF reject (user's guides of siblings)."""
_TIME_CONSTANT_S = time_constant_s(_CORNER_HZ)
_FILTER_STEP_S = _TIME_CONSTANT_S / 16.0
_REJECTED_STEP_S = 5e-9
"""How closely is looked at what may be too fast for HF reject, where nothing tells how fast it is."""
_SETTLED = 8.0
"""Time constants after which a filter has forgotten that it began somewhere."""


class Comparator(Struct, frozen=True):
    """High above its upper threshold, low below its lower one, unchanged between them."""

    level_v: float
    low_v: float
    high_v: float
    ac: bool = False
    """Behind a blocking capacitor."""
    filter: str = ""
    """"LF" rejects low frequencies, "HF" high ones, by 6 dB an octave from 50 kHz."""

    @classmethod
    def at(
        cls, level_v: float, band_v: float = 0.0, side: float = 0.0, *, ac: bool = False, reject: str = ""
    ) -> Comparator:
        """Return one at a level; `side` 1 has its band below (rising edges are at the level), -1 above, 0 about it."""
        middle = level_v - side * band_v / 2.0
        return cls(level_v, middle - band_v / 2.0, middle + band_v / 2.0, ac, reject)


class Trigger(Struct, frozen=True):
    """A condition on the outputs of comparators."""

    comparators: Mapping[int, Comparator]
    make: Callable[[], Condition]
    tips: SyncTips | None = None
    """Television: the level follows the tips of the signal."""


class SyncTips(Struct, frozen=True):
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

    def __init__(self, channel: int, comparator: Comparator) -> None:
        self.comparator = comparator
        self.began_high: bool | None = None
        self._channel = channel
        self._high = False
        self._filter: LowPass | None = None

    def threshold_v(self, change: Change) -> float:
        """Return the threshold of a change, in volts of the input."""
        return self.comparator.high_v if change.high else self.comparator.low_v

    def volts(self, signals: Signals, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltage before the filter."""
        return signals.volts(self._channel, times, ac=self.comparator.ac)

    def changes(self, signals: Signals, times: NDArray[np.float64]) -> Generator[None, None, Iterator[Change]]:
        """Return, after slices of work, the changes in a block of evenly spaced samples, each made when asked for."""
        heights, settled_s = yield from self._heights(signals, times)
        comparator, new = self.comparator, self.began_high is None
        if new:
            self._high = self.began_high = bool(heights[0] >= comparator.level_v)
        highs = held(heights, comparator, high_before=self._high)
        self._high = bool(highs[-1])
        places = np.flatnonzero(highs[1:] != highs[:-1])
        if new:
            places = places[times[places] >= times[0] + settled_s]
        return (self._change(times, heights, int(place), high=bool(highs[place + 1])) for place in places)

    def sines(self, signals: Signals, start_s: float, stop_s: float) -> Sines | None:
        """Return the filtered signal in closed form; None without a filter, or where it has none."""
        if not self.comparator.filter:
            return None
        known = signals.sines(self._channel, start_s, stop_s)
        if known is None:
            return None
        rejects_high = self.comparator.filter == "HF"
        return known.low_passed(_TIME_CONSTANT_S) if rejects_high else known.high_passed(_TIME_CONSTANT_S)

    def finest_s(self, signals: Signals, start_s: float, stop_s: float) -> float:
        """Return the longest step that misses nothing of the compared signal; inf where it never comes to the level."""
        finest, comparator = signals.finest_s(self._channel), self.comparator
        if not comparator.filter:
            return finest
        known = self.sines(signals, start_s, stop_s)
        if known is not None and not comparator.ac and not self._blocked(signals):
            low_v, high_v = known.reach_v()
            if high_v < comparator.high_v or low_v >= comparator.low_v:
                return math.inf
        if not finest and comparator.filter == "HF":
            return _REJECTED_STEP_S
        return min(finest or math.inf, _FILTER_STEP_S)

    def _blocked(self, signals: Signals) -> bool:
        view = signals.views.get(self._channel)
        return self.comparator.ac or (view is not None and view.ac)

    def _heights(
        self, signals: Signals, times: NDArray[np.float64]
    ) -> Generator[None, None, tuple[NDArray[np.float64], float]]:
        """Return, after slices of work, the compared signal, and for how long it is not settled."""
        known = self.sines(signals, float(times[0]), float(times[-1]))
        if known is not None:
            heights = known.at(times)
            slow = self.comparator.filter == "HF" and self._blocked(signals)
            return (heights - signals.slow(self._channel, times) if slow else heights), 0.0
        yield from signals.preparing(self._channel, ac=self.comparator.ac)
        at_once, parts = signals.at_once(self._channel, float(times[1] - times[0]), _AT_ONCE), []
        for part in np.array_split(times, math.ceil(len(times) / at_once)):
            parts.append(self.volts(signals, part))
            yield
        volts = np.concatenate(parts)
        if not self.comparator.filter:
            return volts, 0.0
        self._filter = self._filter or LowPass(float(volts[0]), _TIME_CONSTANT_S)
        low = self._filter.passed(volts, float(times[1] - times[0]))
        return (low if self.comparator.filter == "HF" else volts - low), _SETTLED * _TIME_CONSTANT_S

    def _change(self, times: NDArray[np.float64], heights: NDArray[np.float64], place: int, *, high: bool) -> Change:
        threshold = self.comparator.high_v if high else self.comparator.low_v
        before, after = float(heights[place]), float(heights[place + 1])
        part = (threshold - before) / (after - before) if after != before else 0.0
        early, late = float(times[place]), float(times[place + 1])
        return Change(self._channel, high, early, late, early + min(max(part, 0.0), 1.0) * (late - early))


def held(heights: NDArray[np.float64], comparator: Comparator, *, high_before: bool = False) -> NDArray[np.bool_]:
    """Return True if the output is high at each sample; between the thresholds it is unchanged."""
    if comparator.low_v == comparator.high_v:
        return np.asarray(heights >= comparator.high_v)
    above, below = heights >= comparator.high_v, heights < comparator.low_v
    last = np.maximum.accumulate(np.where(above | below, np.arange(len(heights)), -1))
    return np.where(last >= 0, above[last], high_before)


class TriggerSearch:
    """Looks for a trigger through stretches of time that follow each other."""

    def __init__(self, trigger: Trigger) -> None:
        self._trigger = trigger
        self._condition = trigger.make()
        self._followers: dict[int, _Follower] = {}
        self._reached_s: float | None = None

    def finding(self, signals: Signals, start_s: float, stop_s: float) -> Generator[None, None, float | None]:
        """Return, after slices of work, the first trigger in [start_s, stop_s], or None.

        A stretch that begins where the last one ended carries on; anything else starts anew.
        """
        if stop_s <= start_s:
            return None
        if self._reached_s is None or start_s != self._reached_s:
            self._condition = self._trigger.make()
            grid = np.linspace(start_s, stop_s, _GRID_POINTS)
            self._followers = {
                channel: self._follower(signals, channel, comparator, grid)
                for channel, comparator in self._trigger.comparators.items()
            }
            self._reached_s = None
        for times in self._blocks(signals, start_s, stop_s):
            found = yield from self._look(signals, times)
            if found is not None:
                self._reached_s = None
                return found
            yield
        self._reached_s = stop_s
        return None

    def _follower(self, signals: Signals, channel: int, comparator: Comparator, grid: NDArray[np.float64]) -> _Follower:
        if self._trigger.tips is not None:
            comparator = self._trigger.tips.comparator(signals.volts(channel, grid))
        return _Follower(channel, comparator)

    def _blocks(self, signals: Signals, start_s: float, stop_s: float) -> Iterator[NDArray[np.float64]]:
        """Yield the times to look at: as close as there can be something to see."""
        points = self._points(signals, start_s, stop_s)
        count = max(1, math.ceil((points - 1) / _BLOCK_POINTS))
        edges = np.linspace(start_s, stop_s, count + 1)
        for first, last in pairwise(edges):
            yield np.linspace(first, last, points if count == 1 else _BLOCK_POINTS + 1)

    def _points(self, signals: Signals, start_s: float, stop_s: float) -> int:
        span_s, followers = stop_s - start_s, self._followers.values()
        finest = min((each.finest_s(signals, start_s, stop_s) for each in followers), default=math.inf)
        if finest * (_GRID_POINTS - 1) >= span_s:
            return _GRID_POINTS
        if not finest:
            return _MOST_POINTS
        wanted = math.ceil(2.0 * span_s / finest) + 1
        return wanted if finest == _REJECTED_STEP_S else min(_MOST_POINTS, wanted)

    def _look(self, signals: Signals, times: NDArray[np.float64]) -> Generator[None, None, float | None]:
        new, changes = self._reached_s is None, []
        for follower in self._followers.values():
            found = yield from follower.changes(signals, times)
            changes.append(found)
            yield
        if new:
            highs = {channel: bool(follower.began_high) for channel, follower in self._followers.items()}
            self._condition.begin(highs, float(times[0]))
        self._reached_s = float(times[-1])
        return (yield from self._fed(signals, merge(*changes, key=lambda change: change.at_s)))

    def _fed(self, signals: Signals, changes: Iterable[Change]) -> Generator[None, None, float | None]:
        def exactly(change: Change) -> float:
            # Instant of a change: looked at closer twice, then straight
            follower = self._followers[change.channel]
            if follower.comparator.filter:
                return change.at_s
            threshold = follower.threshold_v(change)
            early, late = change.early_s, change.late_s
            for _ in range(_REFINE_ROUNDS):
                times = np.linspace(early, late, _REFINE_POINTS)
                above = follower.volts(signals, times) >= threshold
                places = np.flatnonzero((above[1:] == change.high) & (above[:-1] != change.high))
                if len(places):
                    early, late = float(times[places[0]]), float(times[places[0] + 1])
            before, after = (float(each) for each in follower.volts(signals, np.array([early, late])))
            part = (threshold - before) / (after - before) if after != before else 0.0
            return early + part * (late - early)

        for number, change in enumerate(changes):
            found = self._condition.feed(change, exactly)
            if found is not None:
                return found
            if number % _CHANGES_AT_ONCE == _CHANGES_AT_ONCE - 1:
                yield
        return None
