"""Path between an input of the DSO7104B and its converter: blocking capacitor, low-pass filters.

Each is of first order. Sums of sines go through in closed form; what can only be asked for its volts is run through,
from so long before that the beginning is forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from simrack.components import ended
from simrack.sources import Sine
from simrack.trace import Piece


def time_constant_s(corner_hz: float) -> float:
    """Return the time constant of a corner."""
    return 1.0 / (2.0 * math.pi * corner_hz)


COUPLING_S = time_constant_s(3.5)
"""Of AC coupling, for the trigger too (user's guides of siblings)."""
REMEMBERED_S = 12.0 * COUPLING_S
"""How much of the past the capacitor knows: 6e-6 are left of what was before."""
_SETTLED = 20.0
"""Time constants after which a fast filter has forgotten."""
_MOST_PAST_POINTS = 1 << 18
UNKNOWN_AT_ONCE = 1 << 11
"""Looks that are one slice of work, at a waveform of which nothing tells: each of these costs most."""
_SAME = 1e-6
_MOST_SHARE = 32
_STEPS = 8
"""Of a time constant: how closely a waveform is looked at in which there may be anything."""
_SMOOTH = 6.0
_LAGUERRE = ((2.0 - math.sqrt(2.0), (2.0 + math.sqrt(2.0)) / 4.0), (2.0 + math.sqrt(2.0), (2.0 - math.sqrt(2.0)) / 4.0))
"""Places and weights of Gauss and Laguerre: exact for cubics."""
_QUANTILES = -np.log((np.arange(64) + 0.5) / 64.0)
"""Time constants ago, equally likely ones."""


class Sines(Struct, frozen=True):
    """dc_v and sines, whose phases are those at `origin_s`."""

    dc_v: float
    origin_s: float
    sines: tuple[Sine, ...]

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the volts at bench times."""
        elapsed, volts = times_s - self.origin_s, np.full(len(times_s), self.dc_v)
        for each in self.sines:
            volts += each.amplitude_v * np.sin(math.tau * each.frequency_hz * elapsed + each.phase_rad)
        return volts

    def low_passed(self, tau_s: float) -> Sines:
        """Return the sum behind a settled low-pass."""
        return replace(self, sines=tuple(_turned(each, _low(each.frequency_hz, tau_s)) for each in self.sines))

    def high_passed(self, tau_s: float) -> Sines:
        """Return the sum behind a settled high-pass."""
        sines = tuple(_turned(each, 1.0 - _low(each.frequency_hz, tau_s)) for each in self.sines)
        return replace(self, dc_v=0.0, sines=sines)

    def scaled(self, factor: float) -> Sines:
        """Return it so many times as large."""
        sines = tuple(replace(each, amplitude_v=factor * each.amplitude_v) for each in self.sines)
        return replace(self, dc_v=factor * self.dc_v, sines=sines)

    def later(self, delay_s: float) -> Sines:
        """Return the same, so much later."""
        return replace(self, origin_s=self.origin_s + delay_s)

    def reach_v(self) -> tuple[float, float]:
        """Return the lowest and the highest voltage that it can reach."""
        swing = sum(abs(each.amplitude_v) for each in self.sines)
        return self.dc_v - swing, self.dc_v + swing


def _low(frequency_hz: float, tau_s: float) -> complex:
    return 1.0 / (1.0 + 1j * math.tau * frequency_hz * tau_s)


def _turned(sine: Sine, gain: complex) -> Sine:
    phase = sine.phase_rad + math.atan2(gain.imag, gain.real)
    return Sine(sine.amplitude_v * abs(gain), sine.frequency_hz, phase)


def closed_form(pieces: Sequence[Piece], start_s: float, stop_s: float) -> Sines | None:
    """Return constant and sines that go on unchanged from before `start_s` to after `stop_s`; None where others do."""
    within = [piece for piece in pieces if piece.stop_s > start_s and piece.start_s < stop_s]
    if not within or within[0].start_s > start_s + _SAME or within[-1].stop_s < stop_s - _SAME:
        return None
    first = within[0]
    if first.sines is None or not all(_goes_on(first, later) for later in within[1:]):
        return None
    return Sines(first.dc_v, first.start_s, first.sines)


def _goes_on(first: Piece, later: Piece) -> bool:
    if first.sines is None or later.sines is None or len(first.sines) != len(later.sines):
        return False
    elapsed = later.start_s - first.start_s
    return abs(first.dc_v - later.dc_v) <= _SAME * abs(first.dc_v) and all(
        one.frequency_hz == two.frequency_hz
        and abs(one.amplitude_v - two.amplitude_v) <= _SAME * abs(one.amplitude_v)
        and abs(math.remainder(one.phase_rad + math.tau * one.frequency_hz * elapsed - two.phase_rad, math.tau)) < 1e-3
        for one, two in zip(first.sines, later.sines, strict=True)
    )


class LowPass:
    """One pole, exact for signals that are straight between their samples."""

    def __init__(self, start_v: float, tau_s: float) -> None:
        self._out = start_v
        self._tau_s = tau_s

    def passed(self, volts: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
        """Return the filtered samples; blocks overlap by one sample, the last of one being the first of the next."""
        return ended(self.passing(volts, step_s))

    def passing(self, volts: NDArray[np.float64], step_s: float) -> Generator[None, None, NDArray[np.float64]]:
        """Return the same, after slices of work."""
        ratio = step_s / self._tau_s
        decay = math.exp(-ratio)
        mean = -math.expm1(-ratio) / ratio
        driven = (1.0 - mean) * volts[1:] + (mean - decay) * volts[:-1]
        yield
        out = np.empty(len(volts))
        out[0] = self._out
        length = max(1, int(25.0 / ratio))
        for start in range(0, len(driven), length):
            part = driven[start : start + length]
            powers = decay ** np.arange(1, len(part) + 1)
            yield
            out[start + 1 : start + 1 + len(part)] = powers * (out[start] + np.cumsum(part / powers))
            yield
        self._out = float(out[-1])
        return out


def looks(step_s: float, tau_s: float, finest_s: float) -> int:
    """Return the number of looks at a waveform for each of its values behind a low-pass."""
    if finest_s >= _SMOOTH * tau_s:
        return len(_LAGUERRE)
    share = step_s / min(tau_s / _STEPS, finest_s or math.inf)
    return len(_QUANTILES) if share > _MOST_SHARE else max(1, math.ceil(share))


def low_passed(
    read: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    times_s: NDArray[np.float64],
    tau_s: float,
    finest_s: float,
) -> NDArray[np.float64]:
    """Return a waveform behind a low-pass at evenly spaced times.

    Args:
        read: the volts at times.
        times_s: where it is asked for.
        tau_s: time constant.
        finest_s: time in which a cubic tells the waveform; 0 where that is unknown.
    """
    if finest_s >= _SMOOTH * tau_s:
        return sum((weight * read(times_s - place * tau_s) for place, weight in _LAGUERRE), np.zeros(len(times_s)))
    step_s = float(times_s[-1] - times_s[0]) / (len(times_s) - 1) if len(times_s) > 1 else math.inf
    share = step_s / min(tau_s / _STEPS, finest_s or math.inf)
    if share > _MOST_SHARE:
        ago = times_s[:, None] - tau_s * _QUANTILES
        return np.asarray(read(ago.reshape(-1)).reshape(ago.shape).mean(axis=1))
    parts = max(1, math.ceil(share))
    before = math.ceil(_SETTLED * tau_s / step_s)
    places = np.arange(-before * parts, (len(times_s) - 1) * parts + 1)
    volts = read(times_s[0] + places * (step_s / parts))
    return LowPass(float(volts[0]), tau_s).passed(volts, step_s / parts)[before * parts :: parts]


class _Settling(Struct, frozen=True):
    """Voltage of the capacitor while the signal is a sum of sines: the settled part, and the rest of its beginning."""

    sines: Sines
    start_s: float
    left_v: float

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.sines.at(times_s) + self.left_v * np.exp(-np.maximum(times_s - self.start_s, 0.0) / COUPLING_S)


class _Run(Struct, frozen=True):
    """The capacitor at evenly spaced times."""

    times_s: NDArray[np.float64]
    volts: NDArray[np.float64]

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.interp(times_s, self.times_s, self.volts))


class Capacitor:
    """The voltage across the blocking capacitor of an input: the slow part of the signal, 3 dB down at 3.5 Hz.

    Before the first piece it is settled: a source is taken to have gone on as it does then, of anything else the mean
    is taken.

    Args:
        pieces: the signal, oldest first, without gaps.
        finest_s: time in which a cubic tells it; 0 where that is unknown.
    """

    def __init__(self, pieces: Sequence[Piece], finest_s: float) -> None:
        first = pieces[0]
        if first.sines is None and first.endless:
            pieces = [replace(first, start_s=first.start_s - REMEMBERED_S, stop_s=first.start_s), *pieces]
        self._pieces = pieces
        self._finest_s = finest_s
        self._step_s = max(finest_s, (pieces[-1].stop_s - pieces[0].start_s) / _MOST_PAST_POINTS)
        self._starts_s = [piece.start_s for piece in pieces]
        self._parts: list[_Settling | _Run] = []

    def charging(self) -> Iterator[None]:
        """Run through the signal, slice by slice."""
        reached: float | None = None
        for piece in self._pieces:
            self._parts.append((yield from self._passed(piece, reached)))
            reached = float(self._parts[-1].at(np.array([piece.stop_s]))[0])

    def _passed(self, piece: Piece, start_v: float | None) -> Generator[None, None, _Settling | _Run]:
        if piece.sines is not None:
            settled = Sines(piece.dc_v, piece.start_s, piece.sines).low_passed(COUPLING_S)
            left = 0.0 if start_v is None else start_v - float(settled.at(np.array([piece.start_s]))[0])
            return _Settling(settled, piece.start_s, left)
        lasts_s = piece.stop_s - piece.start_s
        times = np.linspace(piece.start_s, piece.stop_s, max(2, math.ceil(lasts_s / self._step_s) + 1))
        at_once = len(times) if self._finest_s else UNKNOWN_AT_ONCE
        blocks = list[NDArray[np.float64]]()
        for first in range(0, len(times), at_once):
            blocks.append(np.asarray(piece.at(times[first : first + at_once]), dtype=np.float64))
            yield
        volts = np.concatenate(blocks)
        filter_ = LowPass(float(volts.mean()) if start_v is None else start_v, COUPLING_S)
        return _Run(times, (yield from filter_.passing(volts, lasts_s / (len(times) - 1))))

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return its voltage at bench times."""
        held = np.clip(np.searchsorted(self._starts_s, times_s, side="right") - 1, 0, None)
        volts = np.empty(len(times_s))
        for index in np.unique(held):
            volts[held == index] = self._parts[index].at(times_s[held == index])
        return volts
