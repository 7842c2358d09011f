"""Standard uncertainty of means, and of quantities computed from them, under the noise that an Allan curve shows.

The scatter of the readings over the root of their number is too small once noise is not white: flicker leaves as much
in the mean of an hour as in that of ten seconds (Witt and Reymann 2000). The noise is that of a fit
(:func:`~vcfbench.analysis.noise_fit.fit_noise`), best of a long record; the degrees of freedom are those of that fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, Term
from vcfbench.analysis.sampling import Sampling
from vcfbench.errors import ConfigError


@dataclass(frozen=True, slots=True)
class TypeAUncertainty:
    """A standard uncertainty in the unit of the record, and its effective degrees of freedom."""

    u: float
    dof: float


def u_of_mean_within(fit: NoiseFit, sampling: Sampling, duration_s: float, horizon_s: float) -> TypeAUncertainty:
    """Return the uncertainty of a mean over `duration_s` as a statement about the mean over the `horizon_s` around it.

    Raises:
        ConfigError: the horizon is not longer than the mean.
    """
    if not 0.0 < duration_s < horizon_s:
        raise ConfigError(f"a horizon of {horizon_s:g} s does not hold a mean over {duration_s:g} s")
    begins = [(horizon_s - duration_s) / 2.0, 0.0]
    return u_of_combination(fit, sampling, begins, [begins[0] + duration_s, horizon_s], [1.0, -1.0])


def u_of_combination(
    fit: NoiseFit, sampling: Sampling, begin_s: ArrayLike, end_s: ArrayLike, weights: ArrayLike
) -> TypeAUncertainty:
    """Return the uncertainty of ``sum weights * mean``, each mean over `begin_s` to `end_s`, correlations included.

    The weights must add up to 0: a slope, a difference, a mean less its zeros. Then slow noise has a finite share. The
    order of the windows counts: a drift goes into a slope of rising rates and not into one of alternating signs.

    Raises:
        ConfigError: the weights do not add up to 0, or a window does not last.
    """
    begin, end, weight = (np.asarray(values, dtype=np.float64) for values in (begin_s, end_s, weights))
    if begin.ndim != 1 or not begin.shape == end.shape == weight.shape or not (end > begin).all():
        raise ConfigError("windows need a begin, a later end and a weight each")
    if abs(float(weight.sum())) > 1e-9 * float(np.abs(weight).sum()):
        raise ConfigError(f"the weights must add up to 0, not to {float(weight.sum()):g}: no mean of slow noise exists")
    times = np.concatenate([end, begin]) / sampling.interval_s
    shares = np.concatenate([weight, -weight]) / np.tile((end - begin) / sampling.interval_s, 2)
    lags = times[:, None] - times
    squares = [_share(term, sampling, lags, shares) for term in Term]
    variance, dof = fit.combined(np.array(squares))
    return TypeAUncertainty(math.sqrt(variance), dof)


def _share(term: Term, sampling: Sampling, lags: Floats, shares: Floats) -> float:
    """Return the contribution of a coefficient of 1 to the variance of the combination."""
    if term is Term.RATE_RAMP:  # no noise: a line of slope 1, and phases of t^2 / 2
        return float(shares @ (lags[0] ** 2 / 2.0)) ** 2 * sampling.interval_s**2
    unit = {
        Term.QUANTISATION: Coefficients(quantisation=1.0),
        Term.ANGLE_RANDOM_WALK: Coefficients(angle_random_walk=1.0),
        Term.BIAS_INSTABILITY: Coefficients(bias_instability=1.0),
        Term.RATE_RANDOM_WALK: Coefficients(rate_random_walk=1.0),
    }[term]
    covariance = unit.phase_noise(sampling).covariance(lags.ravel()).reshape(lags.shape)
    return float(shares @ covariance @ shares)
