"""Phase of a function generator: steady, modulated, keyed, swept, in bursts. In cycles, at any time.

All of them are continuous but for shifts of phase that are asked for, as a direct digital synthesis is. Frequencies
move smoothly: the steps of the real accumulator, below 1 uHz every 20 ns, are not there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simrack.instruments.agilent33220a.waveforms import Cycle, Values, turned

_MOST_BREAKS = 10_000
_NEAR = 1e-4
"""Part of a rhythm's period over which its slope is taken."""
_STEEP = 100.0
"""A rhythm steeper than this, per period, jumps."""
_SHIFTS = 1 << 12


class SteadyRun(NamedTuple):
    """A stretch of constant frequency; 0 Hz is a constant phase."""

    hz: float
    cycles: float
    """Phase where it was asked for."""
    until_s: float


class Rhythm(Struct, frozen=True):
    """A modulating waveform; it runs freely from bench time 0."""

    waveform: Cycle
    hz: float

    def values(self, times_s: Values) -> Values:
        """Return -1...1 at bench times."""
        cycles = self.hz * times_s
        return self.waveform.values(cycles - np.floor(cycles))

    def integral_s(self, times_s: Values) -> Values:
        """Return the integral from bench time 0 on."""
        return turned(self.waveform, self.hz * times_s) / self.hz


class _Going(Struct, frozen=True):
    """Common base: a phase that changes all the time and breaks nowhere."""

    def breaks(self, start_s: float, stop_s: float) -> Values:
        """Return the times between two at which it changes at once."""
        del start_s, stop_s
        return np.empty(0)

    def run(self, time_s: float) -> SteadyRun | None:
        """Return the stretch of constant frequency that goes on or begins at a time."""
        del time_s
        return None


class Steady(_Going, frozen=True):
    """One frequency."""

    hz: float
    cycles: float = 0.0

    @property
    def slowest_hz(self) -> float:
        """The frequency."""
        return self.hz

    @property
    def highest_hz(self) -> float:
        """The frequency."""
        return self.hz

    def hz_at(self, times_s: Values) -> Values:
        """Return the frequency."""
        return np.full_like(times_s, self.hz)

    def at(self, times_s: Values) -> Values:
        """Return the phase."""
        return self.hz * times_s + self.cycles

    def run(self, time_s: float) -> SteadyRun:
        """Return the one run that it is."""
        return SteadyRun(self.hz, self.hz * time_s + self.cycles, math.inf)


class Deviated(_Going, frozen=True):
    """Frequency modulation: hz + deviation_hz times the rhythm."""

    hz: float
    deviation_hz: float
    rhythm: Rhythm
    cycles: float = 0.0

    @property
    def slowest_hz(self) -> float:
        """The frequency at the lower peak."""
        return self.hz - self.deviation_hz

    @property
    def highest_hz(self) -> float:
        """The frequency at the upper peak, by a rhythm that it can follow."""
        return self.hz + self.deviation_hz + self.rhythm.hz

    @property
    def range_hz(self) -> tuple[float, float] | None:
        """Return between which frequencies it moves."""
        return self.slowest_hz, self.hz + self.deviation_hz

    def hz_at(self, times_s: Values) -> Values:
        """Return the frequency."""
        return np.asarray(self.hz + self.deviation_hz * self.rhythm.values(times_s))

    def at(self, times_s: Values) -> Values:
        """Return the phase."""
        return self.hz * times_s + self.cycles + self.deviation_hz * self.rhythm.integral_s(times_s)


class Shifted(_Going, frozen=True):
    """Phase modulation: deviation_cycles times the rhythm added."""

    hz: float
    deviation_cycles: float
    rhythm: Rhythm
    cycles: float = 0.0

    @property
    def slowest_hz(self) -> float:
        """Nothing is known: edges of the rhythm shift the phase at once."""
        return 0.0

    @property
    def highest_hz(self) -> float:
        """The frequency, and the most that the slope of a sine adds."""
        return self.hz + (2 * math.pi * self.deviation_cycles + 1.0) * self.rhythm.hz

    @property
    def range_hz(self) -> tuple[float, float] | None:
        """Return between which frequencies it moves; None where it jumps or runs backwards."""
        shifts = np.diff(self.rhythm.values(np.linspace(0.0, 1.0 / self.rhythm.hz, _SHIFTS + 1)))
        if float(np.abs(shifts).max()) > _STEEP / _SHIFTS:
            return None
        frequencies = self.hz + self.deviation_cycles * shifts * (_SHIFTS * self.rhythm.hz)
        return float(frequencies.min()), float(frequencies.max())

    def hz_at(self, times_s: Values) -> Values:
        """Return the frequency, by the slope of the rhythm; shifts at once are left out."""
        near_s = _NEAR / self.rhythm.hz
        slopes = (self.rhythm.values(times_s + near_s) - self.rhythm.values(times_s - near_s)) / (2 * near_s)
        smooth = np.where(np.abs(slopes) < _STEEP * self.rhythm.hz, slopes, 0.0)
        return np.asarray(np.abs(self.hz + self.deviation_cycles * smooth))

    def at(self, times_s: Values) -> Values:
        """Return the phase."""
        return self.hz * times_s + self.cycles + self.deviation_cycles * self.rhythm.values(times_s)

    def breaks(self, start_s: float, stop_s: float) -> Values:
        """Return where a square shifts the phase at once, every half period."""
        return _multiples(0.5 / self.rhythm.hz, start_s, stop_s)


class _Between(_Going, frozen=True):
    """Common base of those that move between two frequencies."""

    @property
    def range_hz(self) -> tuple[float, float]:
        """Return between which frequencies it moves, its first two fields."""
        first_hz, second_hz = (getattr(self, name) for name in self.__struct_fields__[:2])
        return min(first_hz, second_hz), max(first_hz, second_hz)

    @property
    def slowest_hz(self) -> float:
        """The lower of both."""
        return self.range_hz[0]

    @property
    def highest_hz(self) -> float:
        """The higher of both."""
        return self.range_hz[1]


class Keyed(_Between, frozen=True):
    """Frequency shift keying: hz for the first half of each period of the rate, hop_hz for the second."""

    hz: float
    hop_hz: float
    rate_hz: float
    cycles: float = 0.0

    def hz_at(self, times_s: Values) -> Values:
        """Return the frequency."""
        periods = self.rate_hz * times_s
        return np.where(periods - np.floor(periods) < 0.5, self.hz, self.hop_hz)

    def at(self, times_s: Values) -> Values:
        """Return the phase."""
        periods = self.rate_hz * times_s
        whole = np.floor(periods)
        hopped_s = (whole / 2 + np.maximum(periods - whole - 0.5, 0.0)) / self.rate_hz
        return np.asarray(self.hz * times_s + self.cycles + (self.hop_hz - self.hz) * hopped_s)

    def breaks(self, start_s: float, stop_s: float) -> Values:
        """Return the hops."""
        return _multiples(0.5 / self.rate_hz, start_s, stop_s)

    def run(self, time_s: float) -> SteadyRun:
        """Return the rest of the half period; a hop less than 1e-9 of it away has been."""
        halves = math.floor(2 * self.rate_hz * time_s + 1e-9)
        cycles = float(self.at(np.array([time_s]))[0])
        return SteadyRun(self.hop_hz if halves % 2 else self.hz, cycles, (halves + 1) / (2 * self.rate_hz))


class Swept(_Between, frozen=True):
    """Sweeps from start_hz to stop_hz in `lasts_s`, one after the other, or one at `from_s` with start_hz around it."""

    start_hz: float
    stop_hz: float
    lasts_s: float
    logarithmic: bool
    from_s: float
    again: bool
    cycles: float = 0.0

    def hz_at(self, times_s: Values) -> Values:
        """Return the frequency."""
        parts = (times_s - self.from_s) / self.lasts_s
        if self.again:
            parts = parts - np.floor(parts)
        parts = np.where((parts >= 0.0) & (parts <= 1.0), parts, 0.0)
        if self.logarithmic:
            return np.asarray(self.start_hz * (self.stop_hz / self.start_hz) ** parts)
        return np.asarray(self.start_hz + (self.stop_hz - self.start_hz) * parts)

    def at(self, times_s: Values) -> Values:
        """Return the phase."""
        since = times_s - self.from_s
        if self.again:
            sweeps = np.floor(since / self.lasts_s)
            passed = self._swept(np.array([self.lasts_s]))[0]
            return np.asarray(self.cycles + sweeps * passed + self._swept(since - sweeps * self.lasts_s))
        inside = np.clip(since, 0.0, self.lasts_s)
        return np.asarray(self.cycles + self._swept(inside) + self.start_hz * (since - inside))

    def _swept(self, since_s: Values) -> Values:
        """Return the cycles since a sweep began."""
        ratio = self.stop_hz / self.start_hz
        if self.logarithmic and abs(ratio - 1.0) > 1e-9:
            speed = math.log(ratio) / self.lasts_s
            return np.asarray(self.start_hz * np.expm1(speed * since_s) / speed)
        return since_s * (self.start_hz + (self.stop_hz - self.start_hz) / (2 * self.lasts_s) * since_s)

    def breaks(self, start_s: float, stop_s: float) -> Values:
        """Return where a sweep begins or ends."""
        if self.again:
            return self.from_s + _multiples(self.lasts_s, start_s - self.from_s, stop_s - self.from_s)
        ends = np.array([self.from_s, self.from_s + self.lasts_s])
        return ends[(ends > start_s) & (ends < stop_s)]

    def run(self, time_s: float) -> SteadyRun | None:
        """Return the wait before or after the only sweep."""
        if self.again or self.from_s <= time_s < self.from_s + self.lasts_s:
            return None
        until = self.from_s if time_s < self.from_s else math.inf
        return SteadyRun(self.start_hz, float(self.at(np.array([time_s]))[0]), until)


class Bursts(Struct, frozen=True):
    """`count` cycles from the phase `cycles` on, at `from_s` and then every `period_s`; in between the phase stands."""

    hz: float
    count: float
    from_s: float
    period_s: float
    cycles: float = 0.0

    @property
    def slowest_hz(self) -> float:
        """It stands still at times."""
        return 0.0

    @property
    def highest_hz(self) -> float:
        """The frequency of a burst."""
        return self.hz

    def at(self, times_s: Values) -> Values:
        """Return the phase."""
        since = times_s - self.from_s
        if math.isinf(self.period_s):
            return np.asarray(self.cycles + np.clip(self.hz * since, 0.0, self.count))
        bursts = np.maximum(np.floor(since / self.period_s), 0.0)
        done = np.clip(self.hz * (since - bursts * self.period_s), 0.0, self.count)
        return np.asarray(self.cycles + bursts * self.count + done)

    def breaks(self, start_s: float, stop_s: float) -> Values:
        """Return where bursts begin and end."""
        begun = np.array([self.from_s])
        if math.isfinite(self.period_s):
            begun = self.from_s + _multiples(self.period_s, start_s - self.from_s - self.period_s, stop_s - self.from_s)
        both = np.concatenate((begun, begun + self.count / self.hz))
        return both[(both > start_s) & (both < stop_s) & (both >= self.from_s)]

    def run(self, time_s: float) -> SteadyRun:
        """Return the rest of a burst, or of the wait for the next; an edge less than 1 ps away has been."""
        since = time_s - self.from_s + 1e-12 * max(1.0, abs(time_s))
        cycles = float(self.at(np.array([time_s]))[0])
        if since < 0.0:
            return SteadyRun(0.0, self.cycles, self.from_s)
        start = self.from_s if math.isinf(self.period_s) else self.from_s + since // self.period_s * self.period_s
        end = start + self.count / self.hz
        if since - (start - self.from_s) < end - start:
            return SteadyRun(self.hz, cycles, end)
        return SteadyRun(0.0, self.cycles, start + self.period_s)


def _multiples(period_s: float, start_s: float, stop_s: float) -> Values:
    """Return the multiples of a period between two times; none where they are too many to matter."""
    if (stop_s - start_s) / period_s > _MOST_BREAKS:
        return np.empty(0)
    first, last = math.floor(start_s / period_s) + 1, math.ceil(stop_s / period_s)
    return np.arange(first, last, dtype=np.float64) * period_s


Phase = Steady | Deviated | Shifted | Keyed | Swept | Bursts
"""Phase by time: `at` in cycles at bench times, `hz_at` its speed then (all but bursts), `highest_hz` what that never
exceeds, `run` the stretch of constant frequency that goes on or begins then (None while it changes), `breaks` the times
between two at which it changes at once, `slowest_hz` what it never goes below, `cycles` the phase at bench time 0 or
where a burst or sweep begins."""


def continued(phase: Phase, before: Phase | None, now_s: float) -> Phase:
    """Return `phase` shifted so that it continues `before` without a jump."""
    if before is None:
        return phase
    if replace(before, cycles=phase.cycles) == phase:
        return before
    now = np.array([now_s])
    gap = float((before.at(now) - phase.at(now))[0])
    return replace(phase, cycles=math.remainder(phase.cycles + gap, 1.0))
