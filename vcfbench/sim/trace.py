"""The recent history of every node, for instruments whose filters remember: kept stretch by stretch, not sampled."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.sim.sources import Sine

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.sim.gyro.stretch import Stretch

__all__ = ["History", "Piece", "Trace", "piece_of"]


class Piece(Struct, frozen=True):
    """What a node did over [start_s, stop_s].

    Args:
        start_s, stop_s: bench time.
        dc_v: the constant part.
        sines: the rest, their phases at `start_s`; None where only `at` tells.
        at: volts at absolute times within it.
        endless: a source's, which `at` tells of earlier times too, as if it had always been so.
    """

    start_s: float
    stop_s: float
    dc_v: float
    sines: tuple[Sine, ...] | None
    at: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    endless: bool = False

    def reversed(self) -> Piece:
        """Return what is seen with the leads reversed."""
        sines = (
            None if self.sines is None else tuple(replace(sine, amplitude_v=-sine.amplitude_v) for sine in self.sines)
        )
        return Piece(self.start_s, self.stop_s, -self.dc_v, sines, lambda times: -self.at(times), self.endless)

    def with_sine(self, sine: Sine) -> Piece:
        """Return what is seen with a sine (of bench time) in series."""
        here = replace(sine, phase_rad=sine.phase_rad + math.tau * sine.frequency_hz * self.start_s)
        sines = None if self.sines is None else (*self.sines, here)
        return replace(self, sines=sines, at=lambda times: self.at(times) + sine.at(times))


class History(Protocol):
    """The history of what an instrument is wired to."""

    def pieces(self, node: str) -> list[Piece]:
        """Return what is known of a node up to now, oldest first."""
        ...

    def end(self) -> None:
        """Forget it and keep nothing more."""
        ...


class Trace:
    """A history of the World's nodes from when it is registered on.

    Args:
        start_s: bench time at which it begins.
        span_s: how much of it is kept.
        advance: takes the World to now. end: takes this off it.
    """

    __slots__ = ("_advance", "_end", "_span_s", "_stretches", "start_s", "stop_s")

    def __init__(
        self, start_s: float, span_s: float, advance: Callable[[], None], end: Callable[[Trace], None]
    ) -> None:
        self.start_s = start_s
        self.stop_s = math.inf
        self._span_s = span_s
        self._advance = advance
        self._end = end
        self._stretches: deque[Stretch] = deque()

    def take(self, stretch: Stretch) -> None:
        """Keep a stretch and drop those that are too old."""
        self._stretches.append(stretch)
        oldest = stretch.stop_s - self._span_s
        while self._stretches[0].stop_s < oldest:
            self._stretches.popleft()

    def pieces(self, node: str) -> list[Piece]:
        """Return what is known of a node up to now, oldest first."""
        self._advance()
        return [piece_of(stretch, node) for stretch in self._stretches]

    def end(self) -> None:
        """Forget it and keep nothing more."""
        self._end(self)
        self._stretches.clear()


def piece_of(stretch: Stretch, node: str) -> Piece:
    """Return what a node did over a stretch."""
    known = stretch.closed_form(node)
    sines = None if known is None else tuple(_sine(size, exponent) for size, exponent in known.terms)
    constant = 0.0 if known is None else known.constant_v
    endless = known is not None or stretch.played(node)
    return Piece(stretch.start_s, stretch.stop_s, constant, sines, lambda times: stretch.at(node, times), endless)


def _sine(size: complex, exponent: complex) -> Sine:
    """Return Re(size exp(exponent t)) as a sine; an undamped one, as sources are."""
    turned = 1j * size  # Re(a e^{jwt}) = |a| cos(wt + arg a) = |a| sin(wt + arg(ja))
    return Sine(abs(size), exponent.imag / math.tau, math.atan2(turned.imag, turned.real))
