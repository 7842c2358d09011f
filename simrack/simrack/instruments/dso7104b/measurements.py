"""Measurements that an InfiniiVision oscilloscope takes from a record, on arrays.

Definitions after the 7000B user's guide: top and base are the modes of the upper and lower part of the histogram where
these stand out, else maximum and minimum; thresholds are 10, 50 and 90 % between them; what needs a cycle is taken on
the one nearest the time reference. Whatever cannot be measured is None, which the instrument answers as 9.9E+37.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from simrack.components import ended

_MODE_SHARE = 0.05
"""Part of all points that a histogram bin must hold to be top or base (the real criterion is unverified)."""
_AT_ONCE = 1 << 17
"""Samples of a record that are looked through in one go."""
_BINS = 256
_OUTER_BINS = 102
"""Where top and base are looked for, 40 % from each end (chosen): a burst rests in the middle, which is neither."""


class Thresholds(Struct, frozen=True):
    """Lower, middle and upper threshold: percent between base and top, or volts."""

    upper: float = 90.0
    middle: float = 50.0
    lower: float = 10.0
    absolute: bool = False


class TraceEdges(Struct, frozen=True):
    """All full transitions in order: whether they rise, where they cross the lower, middle and upper threshold, s."""

    rising: NDArray[np.bool_]
    lower_s: NDArray[np.float64]
    middle_s: NDArray[np.float64]
    upper_s: NDArray[np.float64]


class MeasuredTrace:
    """One channel's record with its measurements.

    Args:
        times_s: sample times, trigger at 0, equally spaced.
        volts: samples as displayed.
        clipped: some sample lies beyond the converter.
        thresholds: for everything that has to do with edges.
        peaks: what peak detection shows at these times instead: largest and smallest values are taken of it.
    """

    def __init__(
        self,
        times_s: NDArray[np.float64],
        volts: NDArray[np.float64],
        *,
        clipped: bool,
        thresholds: Thresholds,
        peaks: NDArray[np.float64] | None = None,
    ) -> None:
        self.times_s = times_s
        self.volts = volts
        self._peaks = volts if peaks is None else peaks
        self.clipped = clipped
        self._thresholds = thresholds
        self._levels_v: tuple[float, float] | None = None
        self._edges: TraceEdges | None = None
        self._span_v = 0.0
        """From the lower to the upper threshold of edges."""

    # --- voltages

    def maximum(self) -> float | None:
        """Return the largest sample, V."""
        return None if self.clipped else float(self._peaks.max())

    def minimum(self) -> float | None:
        """Return the smallest sample, V."""
        return None if self.clipped else float(self._peaks.min())

    def peak_to_peak(self) -> float | None:
        """Return maximum minus minimum, V."""
        return None if self.clipped else float(np.ptp(self._peaks))

    def top(self) -> float | None:
        """Return the upper flat level, V."""
        return None if self.clipped else self._levels()[1]

    def base(self) -> float | None:
        """Return the lower flat level, V."""
        return None if self.clipped else self._levels()[0]

    def amplitude(self) -> float | None:
        """Return top minus base, V."""
        base, top = self._levels()
        return None if self.clipped else top - base

    def average(self, *, cycle: bool) -> float | None:
        """Return the mean over the screen or one cycle, V."""
        return self._mean(self.volts, cycle=cycle)

    def rms(self, *, cycle: bool, ac: bool) -> float | None:
        """Return the root mean square over the screen or one cycle, about zero (DC) or the mean (AC), V."""
        mean = self._mean(self.volts, cycle=cycle)
        if mean is None:
            return None
        about = self.volts - mean if ac else self.volts
        square = self._mean(about**2, cycle=cycle)
        return None if square is None else math.sqrt(square)

    def overshoot(self) -> float | None:
        """Return the amount by which the maximum lies above the top, percent of the amplitude."""
        base, top = self._levels()
        if self.clipped or top == base:
            return None
        return 100.0 * (float(self._peaks.max()) - top) / (top - base)

    def preshoot(self) -> float | None:
        """Return the amount by which the minimum lies below the base, percent of the amplitude."""
        base, top = self._levels()
        if self.clipped or top == base:
            return None
        return 100.0 * (base - float(self._peaks.min())) / (top - base)

    def voltage_at(self, time_s: float) -> float | None:
        """Return the voltage at a time on the screen, V."""
        if not self.times_s[0] <= time_s <= self.times_s[-1]:
            return None
        return float(np.interp(time_s, self.times_s, self.volts))

    # --- times

    def period(self) -> float | None:
        """Return the period of the cycle nearest the time reference, s."""
        cycle = self._cycle()
        return None if cycle is None else cycle[1] - cycle[0]

    def frequency(self) -> float | None:
        """Return one over the period, Hz."""
        period = self.period()
        return None if period is None else 1.0 / period

    def mean_frequency(self) -> float | None:
        """Return the frequency over all cycles on the screen, Hz."""
        rising = self._middles(rising=True)
        return None if len(rising) < 2 else (len(rising) - 1) / float(rising[-1] - rising[0])

    def positive_width(self) -> float | None:
        """Return the time from a rising to the next falling middle crossing, s."""
        return self._width(rising=True)

    def negative_width(self) -> float | None:
        """Return the time from a falling to the next rising middle crossing, s."""
        return self._width(rising=False)

    def duty_cycle(self) -> float | None:
        """Return positive width over period, percent."""
        width, period = self.positive_width(), self.period()
        return None if width is None or period is None else 100.0 * width / period

    def negative_duty_cycle(self) -> float | None:
        """Return negative width over period, percent."""
        width, period = self.negative_width(), self.period()
        return None if width is None or period is None else 100.0 * width / period

    def rise_time(self) -> float | None:
        """Return lower to upper threshold of the rising edge nearest the reference, s."""
        edge, edges = self._nearest(rising=True), self.edges()
        return None if edge is None else float(edges.upper_s[edge] - edges.lower_s[edge])

    def fall_time(self) -> float | None:
        """Return upper to lower threshold of the falling edge nearest the reference, s."""
        edge, edges = self._nearest(rising=False), self.edges()
        return None if edge is None else float(edges.lower_s[edge] - edges.upper_s[edge])

    def slew_rate(self, *, rising: bool | None) -> float | None:
        """Return the volts from threshold to threshold of the edge nearest the reference over their time, V/s."""
        edge, edges = self._nearest(rising=rising), self.edges()
        return None if edge is None else self._span_v / float(edges.upper_s[edge] - edges.lower_s[edge])

    def time_of_maximum(self) -> float | None:
        """Return when the first maximum occurs, s."""
        return None if self.clipped else float(self.times_s[int(self._peaks.argmax())])

    def time_of_minimum(self) -> float | None:
        """Return when the first minimum occurs, s."""
        return None if self.clipped else float(self.times_s[int(self._peaks.argmin())])

    def time_of_edge(self, number: int) -> float | None:
        """Return the middle crossing of the n-th edge from the left, rising for n > 0, falling for n < 0, s."""
        crossings = self._middles(rising=number > 0)
        return float(crossings[abs(number) - 1]) if 1 <= abs(number) <= len(crossings) else None

    def time_of_value(self, level_v: float, number: int) -> float | None:
        """Return when the trace crosses `level_v` for the n-th time, upwards for n > 0, s."""
        above = self.volts >= level_v
        wanted = ~above[:-1] & above[1:] if number > 0 else above[:-1] & ~above[1:]
        places = np.flatnonzero(wanted)
        if not 1 <= abs(number) <= len(places):
            return None
        index = int(places[abs(number) - 1])
        before, after = float(self.volts[index]), float(self.volts[index + 1])
        part = (level_v - before) / (after - before) if after != before else 0.0
        start = float(self.times_s[index])
        return start + min(max(part, 0.0), 1.0) * (float(self.times_s[index + 1]) - start)

    def delay_to(self, other: MeasuredTrace, own_edge: int = 1, other_edge: int = 1) -> float | None:
        """Return the time from an edge of this trace to the edge of `other` nearest to it, s.

        The edge of this trace is the one nearest the reference; of the edge numbers only the slopes count here.
        """
        start = self._nearest(rising=own_edge > 0)
        crossings = other._middles(rising=other_edge > 0)
        if start is None or not len(crossings):
            return None
        away = crossings - self.edges().middle_s[start]
        return float(away[np.abs(away).argmin()])

    def phase_to(self, other: MeasuredTrace) -> float | None:
        """Return the delay in degrees of this trace's period, -180...180."""
        delay, period = self.delay_to(other), self.period()
        if delay is None or period is None:
            return None
        return math.remainder(360.0 * delay / period, 360.0)

    # --- parts

    def leveling(self) -> Generator[None, None, tuple[float, float]]:
        """Return, after slices of work, base and top."""
        if self._levels_v is None:
            low, high = float(self.volts.min()), float(self.volts.max())
            counts, limits = np.zeros(_BINS, dtype=np.int64), np.zeros(0)
            for first in range(0, len(self.volts) if high > low else 0, _AT_ONCE):
                some, limits = np.histogram(self.volts[first : first + _AT_ONCE], bins=_BINS, range=(low, high))
                counts += some
                yield
            if high > low:
                inner, volts = _BINS - _OUTER_BINS, self.volts
                low = _flat_level(volts, counts[:_OUTER_BINS], limits[: _OUTER_BINS + 1], low)
                yield
                high = _flat_level(volts, counts[inner:], limits[inner:], high)
            self._levels_v = low, high
        return self._levels_v

    def _levels(self) -> tuple[float, float]:
        return ended(self.leveling())

    def edges(self) -> TraceEdges:
        """Return every full transition between lower and upper threshold, in order."""
        return ended(self.finding_edges())

    def finding_edges(self) -> Generator[None, None, TraceEdges]:
        """Return the same, after slices of work."""
        if self._edges is None:
            limits = self._thresholds
            lower, middle, upper = limits.lower, limits.middle, limits.upper
            if not limits.absolute:
                base, top = yield from self.leveling()
                lower, middle, upper = (base + (top - base) * each / 100.0 for each in (lower, middle, upper))
            self._span_v = upper - lower
            places = np.zeros(0, dtype=np.int_)
            if lower < middle < upper:
                places = yield from self._places(lambda volts, _: (volts >= upper) | (volts <= lower), middle)
            high = self.volts[places] >= upper
            yield
            turns = high[1:] != high[:-1]
            ends, rising = (places[:-1][turns], places[1:][turns]), high[1:][turns]
            yield
            lowers = yield from self._crossings(ends, rising, lower)
            middles = yield from self._crossings(ends, rising, middle)
            self._edges = TraceEdges(rising, lowers, middles, (yield from self._crossings(ends, rising, upper)))
        return self._edges

    def _crossings(
        self, ends: tuple[NDArray[np.int_], NDArray[np.int_]], rising: NDArray[np.bool_], level: float
    ) -> Generator[None, None, NDArray[np.float64]]:
        """Return, after slices of work, where transitions between two ends cross a level.

        That is midway between the first and the last time where noise does it more than once, or where a step of the
        converter is the level.
        """
        firsts, lasts = ends
        last_near, first_beyond = (np.empty(len(lasts), dtype=int) for _ in range(2))
        for up in (True, False):
            these = rising == up
            if these.any():
                beyond = yield from self._places(
                    np.greater_equal if up else np.less_equal, level, end=[len(self.volts) - 1]
                )
                yield
                first_beyond[these] = beyond[np.searchsorted(beyond, firsts[these])]
                near = yield from self._places(np.less_equal if up else np.greater_equal, level, begin=[0])
                yield
                last_near[these] = near[np.searchsorted(near, lasts[these], side="right") - 1]
                yield
        late = self._straight(np.minimum(last_near, lasts - 1), level)
        yield
        early = self._straight(np.maximum(first_beyond - 1, firsts), level)
        return np.asarray(0.5 * (early + late))

    def _places(
        self,
        wanted: Callable[[NDArray[np.float64], float], NDArray[np.bool_]],
        level: float,
        begin: Sequence[int] = (),
        end: Sequence[int] = (),
    ) -> Generator[None, None, NDArray[np.int_]]:
        """Return, after slices of work, the numbers of the samples that are as wanted to a level, between others."""
        found = [np.array(begin, dtype=np.int_)]
        for first in range(0, len(self.volts), _AT_ONCE):
            found.append(first + np.flatnonzero(wanted(self.volts[first : first + _AT_ONCE], level)))
            yield
        return np.concatenate((*found, np.array(end, dtype=np.int_)))

    def _straight(self, near: NDArray[np.int_], level: float) -> NDArray[np.float64]:
        """Return where straight lines from samples to the next ones come to a level."""
        before, after = self.volts[near], self.volts[near + 1]
        step = np.where(after != before, after - before, 1.0)
        part = np.where(after != before, (level - before) / step, 0.0)
        starts = self.times_s[near]
        return np.asarray(starts + np.clip(part, 0.0, 1.0) * (self.times_s[near + 1] - starts))

    def _middles(self, *, rising: bool) -> NDArray[np.float64]:
        edges = self.edges()
        return np.asarray(edges.middle_s[edges.rising == rising])

    def _nearest(self, *, rising: bool | None) -> int | None:
        """Return which edge is nearest the reference; None is either."""
        edges = self.edges()
        places = np.flatnonzero(edges.rising | True if rising is None else edges.rising == rising)
        return int(places[np.abs(edges.middle_s[places]).argmin()]) if len(places) else None

    def _cycle(self) -> tuple[float, float] | None:
        """Return start and end of the full cycle nearest the reference, rising or falling."""
        both = [self._middles(rising=rising) for rising in (True, False)]
        return _nearest_pair(np.concatenate([each[:-1] for each in both]), np.concatenate([each[1:] for each in both]))

    def _width(self, *, rising: bool) -> float | None:
        edges = self.edges()
        these = edges.rising[:-1] == rising
        pair = _nearest_pair(edges.middle_s[:-1][these], edges.middle_s[1:][these])
        return None if pair is None else pair[1] - pair[0]

    def _mean(self, values: NDArray[np.float64], *, cycle: bool) -> float | None:
        """Return the mean of all samples, or over exactly one cycle with straight lines between them."""
        if self.clipped:
            return None
        if not cycle:
            return float(values.mean())
        limits = self._cycle()
        if limits is None:
            return None
        inner = slice(np.searchsorted(self.times_s, limits[0], side="right"), np.searchsorted(self.times_s, limits[1]))
        times = np.concatenate((limits[:1], self.times_s[inner], limits[1:]))
        first, last = np.interp(limits, self.times_s, values)
        heights = np.concatenate(((first,), values[inner], (last,)))
        return float(np.sum((heights[1:] + heights[:-1]) * np.diff(times))) / (2.0 * (limits[1] - limits[0]))


def _nearest_pair(starts: NDArray[np.float64], stops: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the pair of instants whose middle is nearest the reference."""
    if not len(starts):
        return None
    nearest = np.abs(starts + stops).argmin()
    return float(starts[nearest]), float(stops[nearest])


def _flat_level(
    volts: NDArray[np.float64], counts: NDArray[np.int64], limits: NDArray[np.float64], otherwise: float
) -> float:
    fullest = int(counts.argmax())
    if counts[fullest] < _MODE_SHARE * len(volts):
        return otherwise
    held = volts[(volts >= limits[fullest]) & (volts <= limits[fullest + 1])]
    return float(held.mean())
