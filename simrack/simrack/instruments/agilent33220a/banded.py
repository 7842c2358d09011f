"""Signals of a generator behind a path of limited bandwidth, by the lines of their spectrum.

Modulation is slow beside the time constants of such a path, 0.2 us, so the path does to each cycle what it does to a
steady waveform of that frequency and duty. What it does where a burst begins and ends is worked out once.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from msgspec import Struct, field

from simrack.components import SHORTEST_S, Path, Turning, ended, transform_hz
from simrack.instruments.agilent33220a.envelopes import Envelope, WidthSwing
from simrack.instruments.agilent33220a.phases import Bursts, Phase, Steady
from simrack.instruments.agilent33220a.waveforms import FAST_HZ, Cycle, Values, turned

_CYCLE_PART = 1 / 12
_NARROWEST = 1 / 8192
"""How finely a cycle is looked at: of what is narrower the mean tells, and no counter takes it for a signal."""
_HIGHEST_HZ = 30e6
"""Lines beyond this get through no path."""
_MOST_LINES, _LINES_OF_MANY, _LINES_OF_A_DUTY = 1 << 20, 1 << 15, 1 << 13
"""How many lines are worked out: of one signal, of one whose frequency or duty moves."""
_LINES_AT_ONCE = 1 << 15
_LOOKS, _DUTIES = 33, 9
"""Frequencies and duties at which the loss of a modulated waveform is worked out; it is smooth in between."""
_GROUPS = 1 << 10
_CYCLE_POINTS = 1 << 14
_ENOUGH_HZ = 3e6
"""A cycle whose lines do not come so far has its corners as they are."""
_ALIKE = 1e-9
_BURST_CYCLES, _BURST_POINTS = 32.0, 1 << 16
_RINGING_S = 10e-6


class PlayedCycle(Protocol):
    """A waveform that goes on by its phase, about an offset, swung in amplitude or width or not."""

    @property
    def offset_v(self) -> float:
        """The offset, open circuit."""

    @property
    def peak_v(self) -> float:
        """Peak of the waveform, open circuit."""

    @property
    def waveform(self) -> Cycle:
        """One cycle."""

    @property
    def phase(self) -> Phase:
        """Place in the cycle at a time."""

    @property
    def envelope(self) -> Envelope | None:
        """Envelope of the amplitude, None without AM."""

    @property
    def width(self) -> WidthSwing | None:
        """Swing of the width, None without PWM."""

    def at_frequency(self, hertz: float) -> PlayedCycle:
        """Return the waveform with one constant frequency."""

    def power_means(self, edges_s: Values, powers: Sequence[int], fast_hz: float) -> list[Values]:
        """Return the means of the waveform's powers between each two of the edges; above `fast_hz` those of a cycle."""


class Banded(Struct, frozen=True):
    """A generator's output as one component."""

    playing: PlayedCycle
    losses: dict[Any, Any] = field(default_factory=dict)
    """How much of the square of its shape paths keep back: the same for all stretches that are asked for."""

    @property
    def pace_hz(self) -> float | None:
        """Its frequency, if nothing modulates it."""
        playing = self.playing
        steady = isinstance(playing.phase, Steady) and playing.envelope is None and playing.width is None
        return playing.phase.highest_hz if steady else None

    @property
    def turning(self) -> Turning | None:
        """Its cycles, where nothing but their frequency is modulated."""
        playing, phase = self.playing, self.playing.phase
        if isinstance(phase, Steady | Bursts) or playing.envelope is not None or playing.width is not None:
            return None
        if (range_hz := phase.range_hz) is None:
            return None
        return Turning(phase.at, *range_hz, lambda hertz: Banded(playing.at_frequency(hertz)))

    @property
    def finest_s(self) -> float:
        """A small part of its shortest cycle, or of the narrowest feature in it."""
        playing = self.playing
        part = max(min(playing.waveform.narrowest / 2, _CYCLE_PART), _NARROWEST)
        rhythms_hz = sum(each.rhythm.hz for each in (playing.envelope, playing.width) if each is not None)
        return max(part / (playing.phase.highest_hz + rhythms_hz), SHORTEST_S)

    def means(self, edges_s: Values) -> Values:
        """Return its means; intervals with a break of the phase are split there."""
        breaks = self.playing.phase.breaks(float(edges_s[0]), float(edges_s[-1]))
        if not len(breaks) or isinstance(self.playing.phase, Bursts):
            return self._means(edges_s)
        parts = np.union1d(edges_s, breaks)
        areas = self._means(parts) * np.diff(parts)
        return np.asarray(np.add.reduceat(areas, np.searchsorted(parts, edges_s[:-1])) / np.diff(edges_s))

    def _means(self, edges_s: Values) -> Values:
        (shape,) = self._shape_means(edges_s, (1,), math.inf)
        return np.asarray(self.playing.offset_v + self._peak_v(edges_s) * shape)

    def _shape_means(self, edges_s: Values, powers: tuple[int, ...], fast_hz: float) -> list[Values]:
        """Return the means of the powers of the shape; a burst stands still in a part of the time."""
        made = self.playing.power_means(edges_s, powers, fast_hz)
        if not isinstance(self.playing.phase, Bursts):
            return made
        active = self._active(edges_s)
        return [mean * active + self._idle**power * (1.0 - active) for mean, power in zip(made, powers, strict=True)]

    def _active(self, edges_s: Values) -> Values:
        """Return the part of each stretch in which the phase goes on."""
        phase = self.playing.phase
        return np.asarray(np.diff(phase.at(edges_s)) / (phase.highest_hz * np.diff(edges_s)))

    @property
    def _idle(self) -> float:
        """Level of the shape between bursts."""
        return float(self.playing.waveform.values(np.array([self.playing.phase.cycles % 1.0]))[0])

    def _peak_v(self, edges_s: Values) -> float | Values:
        envelope = self.playing.envelope
        return self.playing.peak_v * (1.0 if envelope is None else envelope.means(edges_s))

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return its means, and the means of its square behind the path."""
        playing, middles = self.playing, (edges_s[1:] + edges_s[:-1]) / 2
        first, second = self._shape_means(edges_s, (1, 2), FAST_HZ)
        swung_v = self._peak_v(edges_s) * first
        top_v = playing.peak_v * (1.0 if playing.envelope is None else playing.envelope.values(middles))
        squares = playing.offset_v * (playing.offset_v + 2 * swung_v) + top_v**2 * (second - self._lost(path, edges_s))
        return np.asarray(playing.offset_v + swung_v), np.asarray(squares)

    def _lost(self, path: Path, edges_s: Values) -> float | Values:
        """Return the part of the square of the shape that the path keeps back in each stretch."""
        playing, times_s = self.playing, (edges_s[1:] + edges_s[:-1]) / 2
        if playing.width is not None:
            duties = playing.width.values(times_s)
            hertz = playing.phase.highest_hz
            return _looked_up(duties, _DUTIES, lambda duty: ended(self._losing(path, hertz, duty, _LINES_OF_A_DUTY)))
        if isinstance(playing.phase, Steady | Bursts):
            deque(self.preparing(path), maxlen=0)
            loss: float = self.losses[path]
            return loss if isinstance(playing.phase, Steady) else self._active(edges_s) * loss
        hertz_then = playing.phase.hz_at(times_s)
        return _looked_up(hertz_then, _LOOKS, self._grouped_loss(path, float(hertz_then.min())))

    def preparing(self, path: Path) -> Iterator[None]:
        """Work out, slice by slice, the loss of a waveform whose frequency and width stay."""
        phase = self.playing.phase
        if path in self.losses or self.playing.width is not None or not isinstance(phase, Steady | Bursts):
            return
        steady = yield from self._losing(path, phase.hz)
        self.losses[path] = (
            steady if isinstance(phase, Steady) else (yield from self._losing_of_a_burst(path, phase, steady))
        )

    def _losing_of_a_burst(self, path: Path, phase: Bursts, steady: float) -> Generator[None, None, float]:
        """Return, after slices of work, the loss of the path during a burst, its beginning and end included."""
        waveform, cycles = self.playing.waveform, min(phase.count, _BURST_CYCLES)
        lasts = cycles / phase.hz + _RINGING_S
        edges = np.asarray(np.arange(_BURST_POINTS + 1) * (lasts / _BURST_POINTS), dtype=np.float64)
        passed, lasting = np.clip(phase.hz * edges, 0.0, cycles), float(edges[1])
        above = np.diff(turned(waveform, passed + phase.cycles)) - self._idle * np.diff(passed)
        yield
        lines = np.fft.rfft(above / phase.hz / lasting)
        yield
        powers = np.abs(lines) ** 2 * (1.0 - np.abs(path(transform_hz(_BURST_POINTS, lasting))) ** 2)
        kept_back = (2.0 * powers.sum() - powers[0]) * lasting / _BURST_POINTS
        yield
        return steady + (float(kept_back) * phase.hz - cycles * steady) / phase.count

    def _grouped_loss(self, path: Path, lowest_hz: float) -> Callable[[float], float]:
        """Return the loss by frequency, down to the lowest; lines that are close together count as one."""
        waveform, one = self.playing.waveform, np.ones(1)
        whole = float((waveform.integral(2, one) - waveform.integral(1, one) ** 2)[0])
        count = min(max(math.ceil(_HIGHEST_HZ / max(lowest_hz, 1.0)), 1), _LINES_OF_MANY)
        if count not in self.losses:
            powers = 2.0 * np.abs(waveform.spectrum(count)) ** 2
            firsts = np.unique(np.geomspace(1, count, _GROUPS).astype(np.int64)) - 1
            orders = np.add.reduceat(np.arange(1.0, count + 1), firsts) / np.diff(np.append(firsts, count))
            self.losses[count] = np.add.reduceat(powers, firsts), orders
        grouped, orders = self.losses[count]
        return lambda hertz: whole - float(grouped @ np.abs(path(np.asarray(hertz * orders))) ** 2)

    def _losing(
        self, path: Path, hertz: float, duty: float | None = None, most: int = _MOST_LINES
    ) -> Generator[None, None, float]:
        """Return, after slices of work, the loss at one frequency and duty."""
        waveform, one = self.playing.waveform, np.ones(1)
        whole = float((waveform.integral(2, one, duty) - waveform.integral(1, one, duty) ** 2)[0])
        count, passed = min(max(math.ceil(_HIGHEST_HZ / hertz), 1), most), 0.0
        for first in range(1, count + 1, _LINES_AT_ONCE):
            some = min(_LINES_AT_ONCE, count + 1 - first)
            lines = waveform.spectrum(some, duty, first)
            yield
            lines = lines * path(_harmonics_hz(hertz, some, first))
            passed += float(np.vdot(lines, lines).real)
            yield
        return whole - 2.0 * passed

    def peak_v(self, path: Path) -> float:
        """Return the amount by which it goes from the mean of a cycle, at the lowest of its frequencies."""
        playing = self.playing
        hertz = max(playing.phase.slowest_hz, 0.0) or playing.phase.highest_hz
        count = min(max(math.ceil(_HIGHEST_HZ / hertz), 1), _CYCLE_POINTS // 2)
        if count * hertz < _ENOUGH_HZ:
            values = playing.waveform.values((np.arange(_CYCLE_POINTS) + 0.5) / _CYCLE_POINTS)
            swing = float(np.abs(values - values.mean()).max())
        else:
            lines = np.zeros(_CYCLE_POINTS // 2 + 1, dtype=complex)
            lines[1 : count + 1] = playing.waveform.spectrum(count) * path(_harmonics_hz(hertz, count))
            swing = float(np.abs(np.fft.irfft(lines) * _CYCLE_POINTS).max())
        envelope = playing.envelope
        top = 1.0 if envelope is None else min((1.0 + envelope.depth) / 2.0, envelope.most)
        return abs(playing.peak_v) * top * swing


def _looked_up(keys: Values, count: int, loss: Callable[[float], float]) -> Values:
    """Return the loss, interpolated in a table of so many looks."""
    low, high = float(keys.min()), float(keys.max())
    if high - low <= _ALIKE * high:
        return np.full_like(keys, loss(high))
    looks = np.geomspace(max(low, _ALIKE * high), high, count)
    return np.interp(keys, looks, [loss(float(each)) for each in looks])


def _harmonics_hz(hertz: float, count: int, first: int = 1) -> Values:
    return np.asarray(hertz * np.arange(first, first + count), dtype=np.float64)
