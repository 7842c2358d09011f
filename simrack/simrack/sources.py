"""Sources on the inputs of the PCB: generators and supplies.

A generator's source is a :class:`Drive`, which goes on for ever in closed form, or something :class:`Played`: it can
say its voltage at any instant, for pictures, and one piece after the other what a memoryless input makes of it, for
the chain behind that input.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct
from msgspec.structs import replace

from simrack.sine import Sine, sines

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from simrack.components import Component

__all__ = ["HIGHEST_HZ", "NOTHING_V", "Approach", "Bend", "Drive", "Piece", "Played", "Ripple", "Sine"]

HIGHEST_HZ = 16e3
"""Up to where a piece holds what an input makes of its source.

The gyro hears of V_Vc what the modulator shifts to its modes, at 3489 Hz, hence V_Vc around 0 Hz and around 6978 Hz.
Content apart from both by d Hz moves the sense mode 25 Hz / d as much as slow content does, and its output by another
(100 Hz / d)^4. From 16 kHz on (d > 9 kHz) 0.3 % of it is left in V_s and 4e-11 at the output. What is cut off leaks a
little at the ends of a piece: of a jump of 1 V the output misses some 3e-5 V, for as long as the modes ring.
"""


NOTHING_V = 1e-6
"""What is left of an approach when it is taken as over: below all that a meter shows of a rail."""
_BEYOND_V = 1e-9
_BEYOND_S = 1e-9
"""How far past a level an approach has to be, or how much later, to have crossed it."""
_SEARCHES = 100

Bend = tuple[float, float, float, float]
"""A memoryless input: b0 + b1 V + b2 V^2 + b3 V^3 of the open-circuit voltage."""


class Drive(Struct, frozen=True):
    """Output of a generator, open circuit.

    dc_v + amplitude_v sin(2 pi frequency_hz t + phase_rad), t in bench time, and `overtones`: the sidebands of a
    modulated one.
    """

    dc_v: float
    amplitude_v: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0
    source_ohm: float = 50.0
    overtones: tuple[Sine, ...] = ()

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return its volts at bench times."""
        return sines((Sine(self.amplitude_v, self.frequency_hz, self.phase_rad), *self.overtones), times_s) + self.dc_v

    def components(self) -> tuple[Component, ...]:
        """Return its components."""
        from simrack.components import Level, Tone  # noqa: PLC0415  (kept out of the import of the package)

        own = Sine(self.amplitude_v, self.frequency_hz, self.phase_rad)
        sounding = [each for each in (own, *self.overtones) if each.amplitude_v and each.frequency_hz]
        still_v = sum(each.value_v(0.0) for each in (own, *self.overtones) if not each.frequency_hz)
        return Level(self.dc_v + still_v), *(Tone(each) for each in sounding)

    def divided(self, share: float) -> Drive:
        """Return the source behind a resistance that leaves `share` of its open voltage (Thevenin)."""
        return replace(
            self,
            dc_v=self.dc_v * share,
            amplitude_v=self.amplitude_v * share,
            source_ohm=self.source_ohm * share,
            overtones=tuple(replace(sine, amplitude_v=sine.amplitude_v * share) for sine in self.overtones),
        )


class Piece(Struct, frozen=True):
    """constant + slope_per_s t + Re sum a exp(s t) over [start_s, stop_s], terms (a, s), t from `start_s`."""

    start_s: float
    stop_s: float
    constant: float
    slope_per_s: float = 0.0
    terms: tuple[tuple[complex, complex], ...] = ()


class Played(Protocol):
    """A source that changes with time: modulated, sweeping or in bursts."""

    @property
    def source_ohm(self) -> float:
        """Series resistance, ohm."""

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the open-circuit volts at bench times; the same instant gives the same volts to every caller."""

    def piece(self, start_s: float, bend: Bend) -> Piece:
        """Return the signal after the input's non-linearity, from `start_s`, up to `HIGHEST_HZ`."""

    def divided(self, share: float) -> Played:
        """Return the source behind a resistance that leaves `share` of its open voltage (Thevenin)."""

    def components(self) -> tuple[Component, ...]:
        """Return its components, open circuit, for looks through a path of limited bandwidth."""


class Ripple(Struct, frozen=True):
    """Ripple of the rectified mains on a supply's output: a sine, its phase at bench time 0.

    `beside` is what else is on the output, harmonics and noise: sines of bench time, of which nothing goes further.
    """

    rms_v: float
    frequency_hz: float
    phase_rad: float
    beside: tuple[Sine, ...] = ()


class Approach(Struct, frozen=True):
    """A supply's voltage on its way: `goal_v` and the sum of size exp(-t / tau), t from `origin_s`.

    Args:
        goal_v: where it ends.
        origin_s: bench time at which `terms` have their size.
        terms: size (V) and time constant (s) of each exponential.
    """

    goal_v: float
    origin_s: float = 0.0
    terms: tuple[tuple[float, float], ...] = ()

    def at(self, instant_s: float) -> float:
        """Return the voltage at a bench time."""
        if not self.terms:
            return self.goal_v
        elapsed = instant_s - self.origin_s
        return self.goal_v + sum(size * math.exp(-elapsed / tau) for size, tau in self.terms)

    def later(self, now_s: float) -> Approach:
        """Return the same from `now_s` on; it is over when `NOTHING_V` is left."""
        elapsed = now_s - self.origin_s
        left = tuple((size * math.exp(-elapsed / tau), tau) for size, tau in self.terms)
        over = sum(abs(size) for size, _ in left) <= NOTHING_V
        return Approach(self.goal_v, now_s, () if over else tuple(term for term in left if term[0]))

    def ends_s(self, now_s: float) -> float:
        """Return the bench time at which it is over; inf of one that is."""
        travel_v = self.travel_v(now_s)
        return self.moved_s(now_s, travel_v - NOTHING_V + _BEYOND_V) + _BEYOND_S if travel_v else math.inf

    def travel_v(self, now_s: float) -> float:
        """Return the amount by which it goes from now on at most; exact of one exponential."""
        return sum(abs(size) for size, _ in self.later(now_s).terms)

    def moved_s(self, now_s: float, distance_v: float) -> float:
        """Return a bench time up to which it moves by at most `distance_v` from now on; exact of one exponential.

        Of several it is when all of them together have moved so far, found by Newton's method from below.
        """
        terms = self.later(now_s).terms
        if distance_v >= sum(abs(size) for size, _ in terms):
            return math.inf
        if len(terms) == 1:
            size, tau = terms[0]
            return now_s - tau * math.log1p(-distance_v / abs(size))
        elapsed = 0.0
        for _ in range(_SEARCHES):
            missing = distance_v + sum(abs(size) * math.expm1(-elapsed / tau) for size, tau in terms)
            if missing <= 1e-3 * _BEYOND_V:
                break
            elapsed += missing / sum(abs(size) / tau * math.exp(-elapsed / tau) for size, tau in terms)
        return now_s + elapsed

    def crosses_s(self, now_s: float, level_v: float) -> float:
        """Return when it has crossed a level, within 1 nV or 1 ns; inf if it never does.

        It cannot be there before it has moved as far as the level is away, so it is asked again and again from there.
        """
        above, instant = self.at(now_s) > level_v, now_s
        if len(self.terms) <= 1 and (self.goal_v > level_v) == above:
            return math.inf
        for _ in range(_SEARCHES):
            reached = self.moved_s(instant, abs(self.at(instant) - level_v) + _BEYOND_V)
            if reached == math.inf:
                return math.inf
            instant = max(reached, instant + _BEYOND_S)
            if (self.at(instant) > level_v) != above:
                break
        return instant
