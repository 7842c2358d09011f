"""The largest residual of a line over its span, and how far errors of the outputs can move it.

A residual is a linear functional of the outputs, the largest of several is not. But the largest of all moves by no more
than the one that moves most, so an interval that holds the errors of all that may be the largest at once holds its.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.procedures.uncertainty import Line

__all__ = ["Residuals", "Spread"]

Floats: TypeAlias = "NDArray[np.float64]"
Places: TypeAlias = "NDArray[np.intp]"

_TRIALS = 4000
_MAY_BE_LARGEST = 3.0
"""Standard deviations of its distance from the largest within which a residual may truly be the largest."""


@dataclass(frozen=True, slots=True)
class Residuals:
    """The residuals of a line over its span, ppm, and what errors do to each of them; arrays go over the windows."""

    ppm: Floats
    of_outputs: Floats
    """(n, n): what a volt at each output puts into each residual, ppm/V; the span moves with the slope."""

    @classmethod
    def of(cls, line: Line) -> Residuals:
        """Return those of a line."""
        rate, slope = line.rate_deg_s, line.scale_factor
        to_ppm = 1e6 / (abs(slope) * float(np.ptp(rate)))
        left = np.eye(rate.size) - np.outer(rate, line.slope_weights) - line.bias_weights
        residual_v = line.output_v - slope * rate - line.bias_v
        of_span = np.outer(residual_v / slope, line.slope_weights)
        return cls(to_ppm * residual_v, to_ppm * (left - of_span))


@dataclass(frozen=True, slots=True)
class Spread:
    """How the residuals vary together, ppm; `residuals` (n,) as found."""

    residuals: Floats
    white: Floats
    """(n, n): covariance by readings' scatter, ppm^2, with `degrees` of freedom."""
    flicker: Floats
    """(n, n): covariance by flicker, ppm^2."""
    degrees: float

    @property
    def covariance(self) -> Floats:
        """That of the residuals, (n, n), ppm^2."""
        return self.white + self.flicker

    def may_be_largest(self) -> Places:
        """Return the places of the residuals that may truly be the largest, that which was found among them."""
        covariance = self.covariance
        sign = np.sign(self.residuals)
        variance, size = np.diag(covariance), np.abs(self.residuals)
        k = int(size.argmax())
        apart = np.sqrt(np.maximum(variance + variance[k] - 2.0 * sign * sign[k] * covariance[k], 0.0))
        near = size[k] - size <= _MAY_BE_LARGEST * apart
        near[k] = True
        return np.flatnonzero(near)

    def u95(self, places: Places) -> float:
        """Return what the largest error of the residuals at `places` stays within in 95 % of trials, ppm (JCGM 101)."""
        rng = np.random.default_rng(0)
        scattered = _normal(rng, self.white[np.ix_(places, places)])
        scattered *= np.sqrt(self.degrees / rng.chisquare(self.degrees, (_TRIALS, 1)))
        errors = scattered + _normal(rng, self.flicker[np.ix_(places, places)])
        return float(np.quantile(np.abs(errors).max(axis=1), 0.95))


def _normal(rng: np.random.Generator, covariance: Floats) -> Floats:
    sizes, axes = np.linalg.eigh(covariance)
    return np.asarray(rng.standard_normal((_TRIALS, sizes.size)) @ (axes * np.sqrt(np.maximum(sizes, 0.0))).T)
