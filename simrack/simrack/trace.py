"""The recent history of every node, for instruments whose filters remember: kept stretch by stretch, not sampled."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct
from msgspec.structs import replace

from simrack.sources import Sine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import numpy as np
    from numpy.typing import NDArray

    from simrack.components import Component
    from simrack.oscillation import Oscillation
    from simrack.sources import Played


_SAME = 1e-4
"""A phase that is off by less, rad, is a rounded one."""


class Piece(Struct, frozen=True):
    """Voltage of a node over [start_s, stop_s].

    Args:
        start_s, stop_s: bench time.
        dc_v: the constant part.
        sines: the rest, their phases at `start_s`; None where only `at` or `source` tells.
        at: volts at absolute times within it.
        endless: a source's, which `at` tells of earlier times too, as if it had always been so.
        source: what plays there, with the part of it that is seen; None where nothing does.
        beside: a sine of bench time in series with the source.
    """

    start_s: float
    stop_s: float
    dc_v: float
    sines: tuple[Sine, ...] | None
    at: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    endless: bool = False
    source: tuple[Played, float] | None = None
    beside: Sine | None = None

    def reversed(self) -> Piece:
        """Return the piece with the leads reversed."""
        sines = (
            None if self.sines is None else tuple(replace(sine, amplitude_v=-sine.amplitude_v) for sine in self.sines)
        )
        source = None if self.source is None else (self.source[0], -self.source[1])
        beside = None if self.beside is None else replace(self.beside, amplitude_v=-self.beside.amplitude_v)
        return replace(
            self, dc_v=-self.dc_v, sines=sines, at=lambda times: -self.at(times), source=source, beside=beside
        )

    def with_sine(self, sine: Sine) -> Piece:
        """Return the piece with a sine (of bench time) in series."""
        here = replace(sine, phase_rad=sine.phase_rad + math.tau * sine.frequency_hz * self.start_s)
        sines = None if self.sines is None else (*self.sines, here)
        beside = None if self.source is None else sine
        return replace(self, sines=sines, at=lambda times: self.at(times) + sine.at(times), beside=beside)

    def goes_on(self, other: Piece) -> bool:
        """Return True if a piece that begins where this one ends is the same source playing on, or the same sines."""
        if self.sines is not None and other.sines is not None:
            return self._sounds_on(other, self.sines, other.sines)
        if self.source is None or other.source is None:
            return False
        same = self.source[0] is other.source[0] and self.source[1] == other.source[1]
        return same and self.stop_s == other.start_s and self.beside == other.beside

    def _sounds_on(self, other: Piece, own: tuple[Sine, ...], later: tuple[Sine, ...]) -> bool:
        if self.stop_s != other.start_s or self.dc_v != other.dc_v or len(own) != len(later):
            return False
        turn = math.tau * (other.start_s - self.start_s)
        return all(
            (one.amplitude_v, one.frequency_hz) == (two.amplitude_v, two.frequency_hz)
            and abs(math.remainder(one.phase_rad + turn * one.frequency_hz - two.phase_rad, math.tau)) < _SAME
            for one, two in zip(own, later, strict=True)
        )

    def components(self) -> tuple[Component, ...]:
        """Return its components, for looks through a path of limited bandwidth."""
        from simrack.components import Level, Sampled, Scaled, Tone  # noqa: PLC0415  (numpy only where needed)

        if self.sines is not None:
            back = ((each, math.tau * each.frequency_hz * self.start_s) for each in self.sines)
            tones = (replace(each, phase_rad=each.phase_rad - turned) for each, turned in back)
            return Level(self.dc_v), *(Tone(each) for each in tones)
        if self.source is None:
            return (Sampled(self.at, self.start_s, self.stop_s),)
        played, share = self.source
        beside = () if self.beside is None else (Tone(self.beside),)
        return *(Scaled(each, share) for each in played.components()), *beside


def merged(pieces: Iterable[Piece]) -> list[Piece]:
    """Return pieces, those joined into one that the same source plays on."""
    joined: list[Piece] = []
    for piece in pieces:
        if joined and joined[-1].goes_on(piece):
            joined[-1] = replace(joined[-1], stop_s=piece.stop_s)
        else:
            joined.append(piece)
    return joined


class Stretch(Protocol):
    """Voltages of every node of a World over [start_s, stop_s], as the World hands them to its observers."""

    @property
    def start_s(self) -> float:
        """Bench time of its start."""

    @property
    def stop_s(self) -> float:
        """Bench time of its end."""

    def integral(self, node: str) -> float:
        """Return the integral of a node's voltage over it, V s."""

    def at(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a node's voltage at absolute times within it."""

    def finest_s(self, node: str) -> float:
        """Return a time in which a node does next to nothing that a cubic through its ends and neighbours misses."""

    def fed(self, node: str) -> bool:
        """Return True if a node's voltage is put on it from outside the device."""

    def closed_form(self, node: str) -> Oscillation | None:
        """Return the voltage of a node as undamped sines; None without a closed form."""

    def source(self, node: str) -> tuple[Played, float] | None:
        """Return the source that plays on a node, and its share there; None without one."""


class History(Protocol):
    """The history of the nodes that an instrument is wired to."""

    def pieces(self, node: str) -> list[Piece]:
        """Return the pieces known of a node up to now, oldest first."""

    def end(self) -> None:
        """Forget it and keep nothing more."""


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
        """Return the pieces known of a node up to now, oldest first."""
        self._advance()
        return [piece_of(stretch, node) for stretch in self._stretches]

    def end(self) -> None:
        """Forget it and keep nothing more."""
        self._end(self)
        self._stretches.clear()


def piece_of(stretch: Stretch, node: str) -> Piece:
    """Return the voltage of a node over a stretch."""
    known = stretch.closed_form(node)
    sines = None if known is None else tuple(_sine(size, exponent) for size, exponent in known.terms)
    constant = 0.0 if known is None else known.constant_v
    source = stretch.source(node)
    endless = known is not None or source is not None
    return Piece(
        stretch.start_s, stretch.stop_s, constant, sines, lambda times: stretch.at(node, times), endless, source
    )


def _sine(size: complex, exponent: complex) -> Sine:
    """Return Re(size exp(exponent t)) as a sine; an undamped one, as sources are."""
    turned = 1j * size  # Re(a e^{jwt}) = |a| cos(wt + arg a) = |a| sin(wt + arg(ja))
    return Sine(abs(size), exponent.imag / math.tau, math.atan2(turned.imag, turned.real))
