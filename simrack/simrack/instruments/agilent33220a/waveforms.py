"""One cycle of each waveform of a function generator, in -1...1, and the integrals of its powers.

The integrals give the mean over any stretch of phase exactly, however fast the waveform runs and wherever its edges
are; the powers are those of a modulator's curvature.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Values = NDArray[np.float64]

POWERS = (1, 2, 3)
FAST_HZ = 64e3
"""From where on nothing but its mean counts of a waveform: the next line, were it modulated by 20 kHz, is at 44 kHz."""
_FEW_SEGMENTS = 64
"""Up to so many the coefficients of a spectrum are summed segment by segment."""


class Cycle(Protocol):
    """One cycle, by its place 0...1; `duty` is the part of it that a pulse is high, where that is modulated."""

    @property
    def corners(self) -> tuple[float, ...] | None:
        """Places between which it is straight; None where it is curved or has too many."""

    def values(self, places: Values, duty: float | Values | None = None) -> Values:
        """Return its values."""

    def integral(self, power: int, places: Values, duty: float | Values | None = None) -> Values:
        """Return the integral of its power 1, 2 or 3 from 0 to the places."""

    @property
    def narrowest(self) -> float:
        """The part of a cycle in which it does something."""

    def spectrum(self, count: int, duty: float | None = None, first: int = 1) -> NDArray[np.complex128]:
        """Return its Fourier coefficients, so many from `first` on.

        It is its mean and 2 Re sum c exp(2 pi j n place).
        """


def turned(waveform: Cycle, cycles: Values) -> Values:
    """Return the integral over all cycles from 0 on."""
    whole = np.floor(cycles)
    one = waveform.integral(1, np.ones(1))[0]
    return np.asarray(whole * one + waveform.integral(1, cycles - whole))


class SineCycle(Struct, frozen=True):
    """A sine."""

    @property
    def corners(self) -> None:
        """It is curved."""
        return

    def values(self, places: Values, duty: float | Values | None = None) -> Values:
        """Return its values."""
        del duty
        return np.asarray(np.sin(2 * math.pi * places))

    def integral(self, power: int, places: Values, duty: float | Values | None = None) -> Values:
        """Return the integral of its power from 0 to the places."""
        del duty
        angles = 2 * math.pi * places
        if power == 1:
            return np.asarray((1 - np.cos(angles)) / (2 * math.pi))
        if power == 2:
            return np.asarray(places / 2 - np.sin(2 * angles) / (8 * math.pi))
        return np.asarray((9 * (1 - np.cos(angles)) - (1 - np.cos(3 * angles))) / (24 * math.pi))

    @property
    def narrowest(self) -> float:
        """A half."""
        return 0.5

    def spectrum(self, count: int, duty: float | None = None, first: int = 1) -> NDArray[np.complex128]:
        """Return its one line."""
        del duty
        return np.where(np.arange(first, first + count) == 1, -0.5j, 0.0j)


class PulseCycle(Struct, frozen=True):
    """High from 0 to `duty`, between the middles of its edges, which last the part `edge` of the cycle.

    Its integrals take the edges, some 10 ns, as jumps.
    """

    duty: float
    edge: float = 0.0

    @property
    def corners(self) -> tuple[float, ...]:
        """Both edges."""
        return 0.0, self.duty

    def values(self, places: Values, duty: float | Values | None = None) -> Values:
        """Return its values."""
        high = self.duty if duty is None else duty
        if not self.edge:
            return np.where(places < high, 1.0, -1.0)
        risen = np.minimum(places / self.edge, 1.0)
        return np.asarray(2 * (risen - np.clip((places - high) / self.edge, 0.0, 1.0)) - 1)

    def integral(self, power: int, places: Values, duty: float | Values | None = None) -> Values:
        """Return the integral of its power from 0 to the places."""
        if power == 2:
            return places
        return np.asarray(2 * np.minimum(places, self.duty if duty is None else duty) - places)

    @property
    def narrowest(self) -> float:
        """Its high or its low part."""
        return min(self.duty, 1.0 - self.duty)

    def spectrum(self, count: int, duty: float | None = None, first: int = 1) -> NDArray[np.complex128]:
        """Return its Fourier coefficients: those of a trapezium."""
        high, order = self.duty if duty is None else duty, np.arange(first, first + count)
        sizes = 2 * high * np.sinc(order * high) * np.sinc(order * self.edge)
        return np.asarray(sizes * np.exp(-1j * math.pi * order * (high + self.edge)))


class Segments(Struct, frozen=True, eq=False):
    """Straight segments from one place to the next: where each starts, its value there, its slope per cycle."""

    starts: Values
    values_there: Values
    slopes: Values
    sums: tuple[Values, Values, Values]

    @classmethod
    def of(cls, starts: Values, values: Values, slopes: Values) -> Segments:
        """Return the waveform with the integrals up to each start worked out."""
        lengths = np.diff(np.append(starts, 1.0))
        parts = [_power_integral(power, values, slopes, lengths) for power in POWERS]
        first, second, third = (np.concatenate(([0.0], np.cumsum(part)[:-1])) for part in parts)
        return cls(starts, values, slopes, (first, second, third))

    def __eq__(self, other: object) -> bool:
        """Two are the same that have the same segments."""
        if self is other or not isinstance(other, Segments):
            return self is other
        same = np.array_equal(self.starts, other.starts) and np.array_equal(self.values_there, other.values_there)
        return same and np.array_equal(self.slopes, other.slopes)

    __hash__ = None  # type: ignore[assignment]

    @property
    def corners(self) -> tuple[float, ...]:
        """Starts of the segments."""
        return tuple(self.starts.tolist())

    def values(self, places: Values, duty: float | Values | None = None) -> Values:
        """Return its values."""
        del duty
        index = self._index(places)
        return np.asarray(self.values_there[index] + self.slopes[index] * (places - self.starts[index]))

    def integral(self, power: int, places: Values, duty: float | Values | None = None) -> Values:
        """Return the integral of its power from 0 to the places."""
        del duty
        index = self._index(places)
        since = places - self.starts[index]
        part = _power_integral(power, self.values_there[index], self.slopes[index], since)
        return np.asarray(self.sums[power - 1][index] + part)

    @property
    def narrowest(self) -> float:
        """The shortest segment, which a ramp's own way up and down are."""
        return float(np.diff(np.append(self.starts, 1.0)).min())

    def spectrum(self, count: int, duty: float | None = None, first: int = 1) -> NDArray[np.complex128]:
        """Return its Fourier coefficients, by its jumps and bends; of many held points by their transform."""
        del duty
        order, points = np.arange(first, first + count), len(self.starts)
        if points > _FEW_SEGMENTS and not self.slopes.any():
            steps = np.fft.fft(self.values_there)[order % points] / points
            return np.asarray(steps * np.sinc(order / points) * np.exp(-1j * math.pi * order / points))
        lengths = np.diff(np.append(self.starts, 1.0))
        jumps = self.values_there - np.roll(self.values_there + self.slopes * lengths, 1)
        bends = self.slopes - np.roll(self.slopes, 1)
        lines, speeds = np.zeros(count, dtype=complex), 2j * math.pi * order
        for start, jump, bend in zip(self.starts, jumps, bends, strict=True):
            lines += (jump + bend / speeds) * np.exp(-speeds * start)
        return np.asarray(lines / speeds)

    def _index(self, places: Values) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.starts, places, side="right") - 1, 0)


def _power_integral(power: int, start: Values, slope: Values, length: Values) -> Values:
    """Return the integral of (start + slope x)^power from 0 to `length`."""
    if power == 1:
        return length * (start + slope * length / 2)
    if power == 2:
        return length * (start**2 + length * slope * (start + slope * length / 3))
    tail = start * slope**2 + slope**3 * length / 4
    return length * (start**3 + length * (1.5 * start**2 * slope + length * tail))


def ramp(rising: float) -> Segments:
    """Return a ramp that rises for the part `rising` of its cycle and crosses 0 upwards where that begins.

    Without a rise it begins at the top.
    """
    if rising <= 0.0:
        nodes = [(0.0, 1.0, -2.0)]
    elif rising >= 1.0:
        nodes = [(0.0, 0.0, 2.0), (0.5, -1.0, 2.0)]
    else:
        up, down = 2.0 / rising, -2.0 / (1.0 - rising)
        nodes = [(0.0, 0.0, up), (rising / 2, 1.0, down), (1.0 - rising / 2, -1.0, up)]
    return Segments.of(*(np.array(each) for each in zip(*nodes, strict=True)))


def held(points: list[float]) -> Segments:
    """Return points in -1...1 that are held for an equal part of the cycle each."""
    count = len(points)
    return Segments.of(np.arange(count) / count, np.array(points), np.zeros(count))
