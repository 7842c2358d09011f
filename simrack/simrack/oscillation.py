"""A voltage as a line and sines: the closed form of a node in a World."""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

if TYPE_CHECKING:
    from numpy.typing import NDArray

_FINEST_RAD = 0.05


class Oscillation(Struct, frozen=True):
    """A line and sines: `constant_v + slope_v_s t + Re sum a exp(j w t)`, terms (a, j w), t from its own origin."""

    constant_v: float
    terms: list[tuple[complex, complex]]
    slope_v_s: float = 0.0

    def later(self, elapsed_s: float) -> Oscillation:
        """Return the same from `elapsed_s` after its origin on."""
        if not self.terms and not self.slope_v_s:
            return self
        terms = [(a * cmath.exp(s * elapsed_s), s) for a, s in self.terms]
        return Oscillation(self.constant_v + self.slope_v_s * elapsed_s, terms, self.slope_v_s)

    def at(self, elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltage at times from its origin."""
        swung = ((a * np.exp(s * elapsed_s)).real for a, s in self.terms)
        return np.asarray(self.constant_v + self.slope_v_s * elapsed_s + sum(swung, start=np.zeros_like(elapsed_s)))

    def integral(self, duration_s: float) -> float:
        """Return the integral from its origin on, V s."""
        swung = sum([(a * (cmath.exp(s * duration_s) - 1) / s).real for a, s in self.terms])
        return self.constant_v * duration_s + 0.5 * self.slope_v_s * duration_s**2 + swung

    def finest_s(self) -> float:
        """Return a time in which it does next to nothing that a cubic through its ends and neighbours misses."""
        fastest = max((abs(exponent) for _, exponent in self.terms), default=0.0)
        return _FINEST_RAD / fastest if fastest else math.inf
