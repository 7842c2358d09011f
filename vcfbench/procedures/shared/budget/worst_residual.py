"""The largest residual of a line over its span, and how far errors of outputs and of rates can move it.

A residual is a linear functional of the outputs, the largest of several is not. Where more than one may be it, trials
(JCGM 101) around what was found tell how far it moves. They lie higher than it, since errors make one residual or
another the largest; what was found lies higher than the truth for the same reason, and by about as much. Both cancel:
what is left is the scatter of the trials about their own mean.
"""

from typing import Self, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.procedures.shared.budget.line import Line

Places: TypeAlias = "NDArray[np.intp]"

_TRIALS = 2000
_ONE_RATE = 1e-5
"""Share of the span within which two levels are one: V_Vc that is measured differs by its noise."""
_MAY_BE_LARGEST = 3.0
"""Standard deviations of its distance from the largest within which a residual may truly be the largest."""


class Residuals(Struct, frozen=True):
    """The residuals of a line over its span, ppm, and the effects of errors of its n windows on each of them.

    Windows at one rate have one residual, that of their mean: the largest of many windows would grow with their number.
    """

    rate_deg_s: Floats
    """(m,): each rate once, in the order of the windows."""
    ppm: Floats
    """(m,)."""
    of_outputs: Floats
    """(m, n): change of each residual by a volt at each output, ppm/V; the span moves with the slope."""
    of_rates: Floats
    """(m, n): change of each residual by 1 deg/s of each rate, outputs as they were, ppm/(deg/s)."""

    @classmethod
    def of(cls, line: Line) -> Self:
        """Return those of a line."""
        rate, slope = line.rate_deg_s, line.scale_factor
        to_ppm = 1e6 / (abs(slope) * float(np.ptp(rate)))
        left = np.eye(rate.size) - np.outer(rate, line.slope_weights) - line.bias_weights
        residual_v = line.output_v - slope * rate - line.bias_v
        of_span = np.outer(residual_v / slope, line.slope_weights)
        # The weights (m, n) of the windows in the means at each rate; rates that differ by a hair are one
        steps = np.round(rate / (_ONE_RATE * float(np.ptp(rate))))
        members = (steps == np.array(list(dict.fromkeys(steps.tolist())))[:, None]).astype(np.float64)
        mean = np.asarray(members / members.sum(axis=1, keepdims=True))
        return cls(
            mean @ rate,
            to_ppm * (mean @ residual_v),
            to_ppm * (mean @ (left - of_span)),
            -to_ppm * slope * (mean @ left),
        )


class LargestResidual(Struct, frozen=True):
    """Uncertainty of the largest of several residuals, ppm."""

    u: float
    u95: float
    by_errors: float
    """Limit of the largest by errors alone with 95 %, where there is no non-linearity."""


class ResidualSpread(Struct, frozen=True):
    """Joint uncertainty of the residuals, ppm; `residuals` (n,) as found."""

    residuals: Floats
    scattered: Floats
    """(n, n): covariance by readings' scatter, ppm^2, with `dof` degrees of freedom."""
    dof: float
    normal: Floats
    """(n, n): covariance by flicker and by each level's own error of V_Vc, ppm^2."""
    common: Floats
    """(m, n): change of the residuals by one standard uncertainty of each source that all share, ppm."""
    rectangular: NDArray[np.bool_]
    """(m,): whether that source is; else it is normal."""

    @property
    def covariance(self) -> Floats:
        """Covariance of the residuals by all sources, (n, n), ppm^2."""
        return np.asarray(self.scattered + self.normal + self.common.T @ self.common)

    def near_largest(self) -> Places:
        """Return the places of the residuals that may truly be the largest, that which was found among them."""
        covariance = self.covariance
        sign = np.sign(self.residuals)
        variance, size = np.diag(covariance), np.abs(self.residuals)
        k = int(size.argmax())
        apart = np.sqrt(np.maximum(variance + variance[k] - 2.0 * sign * sign[k] * covariance[k], 0.0))
        near = size[k] - size <= _MAY_BE_LARGEST * apart
        near[k] = True
        return np.flatnonzero(near)

    def largest(self) -> LargestResidual:
        """Return how far the largest of all moves, by trials (JCGM 101) of a fixed seed."""
        rng = np.random.default_rng(0)
        errors = _normal(rng, self.scattered) * np.sqrt(self.dof / rng.chisquare(self.dof, (_TRIALS, 1)))
        errors += _normal(rng, self.normal)
        sizes = rng.standard_normal((_TRIALS, self.rectangular.size))
        flat = rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), sizes.shape)
        errors = errors + np.where(self.rectangular, flat, sizes) @ self.common
        moved = np.abs(self.residuals - errors).max(axis=1) - np.abs(self.residuals).max()
        off = np.abs(moved - moved.mean())
        u95, by_errors = (float(np.quantile(each, 0.95)) for each in (off, np.abs(errors).max(axis=1)))
        return LargestResidual(float(moved.std()), u95, by_errors)


def _normal(rng: np.random.Generator, covariance: Floats) -> Floats:
    sizes, axes = np.linalg.eigh(covariance)
    return np.asarray(rng.standard_normal((_TRIALS, sizes.size)) @ (axes * np.sqrt(np.maximum(sizes, 0.0))).T)
