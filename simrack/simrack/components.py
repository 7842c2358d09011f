"""Components of a voltage, for instruments behind a path of limited bandwidth.

A generator's waveform has edges of 13 ns and lasts for seconds: it cannot be sampled. So each of its components says
what it does over stretches of time, however fast it is: its mean, and the mean of its square with what a path leaves of
its spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from simrack.sine import Sine

Values = NDArray[np.float64]
Path = Callable[[Values], NDArray[np.complex128]]
"""The transfer function of what an instrument has behind its input, by frequency, Hz."""
SHORTEST_S = 25e-9
"""Nothing has to be looked at more finely than this: the paths of the instruments end at 1 MHz."""
_Ended = TypeVar("_Ended")
_PARTS = (np.arange(4) + 0.5) / 4
_PROBES = 1 << 14
_FIRST_PROBE_S = 0.5e-3
_FEW = 9
_LOOKS_AN_EVENT = 32.0


class Turning(Struct, frozen=True):
    """Cycles, all alike, that come at a frequency which moves.

    Args:
        cycles: how many there were, at bench times.
        lowest_hz, highest_hz: between which the frequency moves.
        steady: returns the component as it would be at one frequency.
    """

    cycles: Callable[[Values], Values]
    lowest_hz: float
    highest_hz: float
    steady: Callable[[float], Component]


class Component(Protocol):
    """A part of a voltage."""

    @property
    def turning(self) -> Turning | None:
        """Its cycles, where it has them and their frequency moves."""

    @property
    def pace_hz(self) -> float | None:
        """The frequency at which it repeats, 0 of a constant; None where it does not repeat."""

    @property
    def finest_s(self) -> float:
        """A time within which the component is described by its mean."""

    def preparing(self, path: Path) -> Iterator[None]:
        """Work out, slice by slice, the common parts of all stretches behind a path."""

    def means(self, edges_s: Values) -> Values:
        """Return its mean volts between each two of the edges, bench times."""

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return its means, and the means of its square behind a path that lets direct voltage through, V^2."""

    def peak_v(self, path: Path) -> float:
        """Return the largest deviation from its mean behind a path."""


class Simple(Struct, frozen=True):
    """Common base of those of which there is nothing to work out before."""

    def preparing(self, path: Path) -> Iterator[None]:
        """Do nothing."""
        del path
        return iter(())


class Level(Simple, frozen=True):
    """A voltage that stays."""

    volts: float
    pace_hz: float = 0.0
    finest_s: float = math.inf
    turning: None = None

    def means(self, edges_s: Values) -> Values:
        """Return its volts."""
        return np.full(len(edges_s) - 1, self.volts)

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return its volts and their square."""
        del path
        means = self.means(edges_s)
        return means, means**2

    def peak_v(self, path: Path) -> float:
        """Return 0."""
        del path
        return 0.0


class Tone(Simple, frozen=True):
    """A sine."""

    sine: Sine
    turning: None = None

    @property
    def pace_hz(self) -> float:
        """Its frequency."""
        return self.sine.frequency_hz

    @property
    def finest_s(self) -> float:
        """A 32nd of its period."""
        return 1.0 / (32.0 * self.sine.frequency_hz)

    def means(self, edges_s: Values) -> Values:
        """Return its means."""
        middles, lasting = (edges_s[1:] + edges_s[:-1]) / 2, np.diff(edges_s)
        turned = math.tau * self.sine.frequency_hz * middles + self.sine.phase_rad
        return np.asarray(self.sine.amplitude_v * np.sin(turned) * np.sinc(self.sine.frequency_hz * lasting))

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return its means, and the means of its square behind the path."""
        middles, lasting = (edges_s[1:] + edges_s[:-1]) / 2, np.diff(edges_s)
        turned = 2 * (math.tau * self.sine.frequency_hz * middles + self.sine.phase_rad)
        swung = np.cos(turned) * np.sinc(2 * self.sine.frequency_hz * lasting)
        return self.means(edges_s), np.asarray(self.peak_v(path) ** 2 / 2 * (1.0 - swung))

    def peak_v(self, path: Path) -> float:
        """Return its amplitude behind the path."""
        return abs(self.sine.amplitude_v * complex(path(np.array([self.sine.frequency_hz]))[0]))


class Scaled(Struct, frozen=True):
    """A component behind a divider, or with its leads reversed."""

    component: Component
    factor: float

    @property
    def turning(self) -> Turning | None:
        """That of the component, as much of it."""
        whole = self.component.turning
        if whole is None:
            return None
        return replace(whole, steady=lambda hertz: Scaled(whole.steady(hertz), self.factor))

    @property
    def pace_hz(self) -> float | None:
        """That of the component."""
        return self.component.pace_hz

    @property
    def finest_s(self) -> float:
        """That of the component."""
        return self.component.finest_s

    def preparing(self, path: Path) -> Iterator[None]:
        """Work out the needs of the component."""
        return self.component.preparing(path)

    def means(self, edges_s: Values) -> Values:
        """Return its means."""
        return np.asarray(self.factor * self.component.means(edges_s))

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return means of the path's output, and means of its square."""
        means, squares = self.component.powers(edges_s, path)
        return np.asarray(self.factor * means), np.asarray(self.factor**2 * squares)

    def peak_v(self, path: Path) -> float:
        """Return the amount by which it goes from its mean."""
        return abs(self.factor) * self.component.peak_v(path)


class Sampled(Simple, frozen=True):
    """A node whose voltage is a slow function of time, so that paths do not change it.

    Args:
        at: volts at bench times.
        start_s, stop_s: from when to when it can be asked.
    """

    at: Callable[[Values], Values]
    start_s: float
    stop_s: float
    pace_hz: None = None
    turning: None = None

    @property
    def finest_s(self) -> float:
        """A part of the shortest time between two of its rises that a first look finds."""
        span = min(_FIRST_PROBE_S, self.stop_s - self.start_s)
        while True:
            times = np.asarray(self.start_s + (np.arange(_PROBES) + 0.5) * (span / _PROBES), dtype=np.float64)
            volts = self.at(times)
            rises = np.flatnonzero((volts[:-1] < volts.mean()) & (volts[1:] >= volts.mean()))
            if len(rises) >= _FEW or span >= self.stop_s - self.start_s:
                shortest = int(np.diff(rises).min()) if len(rises) > 1 else _PROBES
                return max(shortest * span / _PROBES / _LOOKS_AN_EVENT, SHORTEST_S)
            span = min(8.0 * span, self.stop_s - self.start_s)

    def means(self, edges_s: Values) -> Values:
        """Return its means, of four points each."""
        times = edges_s[:-1, None] + _PARTS * np.diff(edges_s)[:, None]
        return np.asarray(self.at(times.ravel()).reshape(times.shape).mean(axis=1))

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return it in the middles, and its square."""
        del path
        volts = self.at((edges_s[1:] + edges_s[:-1]) / 2)
        return volts, volts**2

    def peak_v(self, path: Path) -> float:
        """Return 0: the samples give the peak."""
        del path
        return 0.0


def ended(labour: Generator[Any, None, _Ended]) -> _Ended:
    """Return the results of slices of work, all done at once."""
    while True:
        try:
            next(labour)
        except StopIteration as end:
            return cast("_Ended", end.value)


def transform_hz(points: int, step_s: float) -> Values:
    """Return the frequencies of the transform of so many real points."""
    return np.asarray(np.fft.rfftfreq(points, step_s), dtype=np.float64)


def summed_powers(components: Sequence[Component], edges_s: Values, path: Path) -> tuple[Values, Values]:
    """Return means of a sum, and the means of its square behind a path.

    Two components together have the product of their means beside their own squares: of two fast ones, whose means say
    nothing of them, it is taken that they do not beat within a stretch.
    """
    means, squares = np.zeros(len(edges_s) - 1), np.zeros(len(edges_s) - 1)
    for component in components:
        own, square = component.powers(edges_s, path)
        squares = squares + square + 2.0 * means * own
        means = means + own
    return means, squares
