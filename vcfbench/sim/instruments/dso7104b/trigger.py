"""Looks for an oscilloscope's trigger: comparators make changes of state of voltages, a condition chooses among them.

The hysteresis of noise reject, one division, is known from a note on a sibling; that of none is taken as zero, because
what is looked at here has no noise.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from vcfbench.sim.instruments.dso7104b.conditions import Change

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from vcfbench.sim.instruments.dso7104b.conditions import Condition
    from vcfbench.sim.instruments.dso7104b.inputs import Signals

__all__ = ["Comparator", "Tips", "Trigger", "TriggerSearch"]

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


class Comparator(Struct, frozen=True):
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


class Trigger(Struct, frozen=True):
    """A condition on the outputs of comparators."""

    comparators: Mapping[int, Comparator]
    make: Callable[[], Condition]
    tips: Tips | None = None
    """Television: the level follows the tips of the signal."""


class Tips(Struct, frozen=True):
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
