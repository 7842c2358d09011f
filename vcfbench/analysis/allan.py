"""Allan deviation of a zero-rate record, with confidence intervals that are true for overlapping clusters.

Form and read-off factors as in IEEE 952 Annex C; estimator, and equivalent degrees of freedom, as in NIST SP 1065.
The unit of the result is that of the record: a record in deg/s gives deg/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BIAS_INSTABILITY_FACTOR",
    "AllanPoint",
    "Coefficients",
    "Noise",
    "ReadOff",
    "allan_deviation",
    "averaging_factors",
    "confidence_interval",
    "decompose",
    "equivalent_dof",
    "ieee952_uncertainty",
    "overlapping_deviation",
    "read_off",
]

Floats: TypeAlias = "NDArray[np.float64]"

BIAS_INSTABILITY_FACTOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Floor of the Allan deviation over the bias instability B, 0.66428."""


class Noise(Enum):
    """The power law that rules a stretch of the Allan curve."""

    QUANTISATION = "quantisation"
    WHITE = "white"
    FLICKER = "flicker"
    RANDOM_WALK = "random walk"


@dataclass(frozen=True, slots=True)
class AllanPoint:
    """One averaging time: the deviation, its equivalent degrees of freedom and a confidence interval."""

    tau_s: float
    deviation: float
    edf: float
    low: float
    high: float


def overlapping_deviation(record: ArrayLike, factor: int) -> float:
    """Return the overlapping Allan deviation of equally spaced averages at `factor` times their spacing.

    Raises:
        ConfigError: the record is shorter than two clusters.

    """
    values = np.asarray(record, dtype=np.float64)
    if factor < 1 or values.size < 2 * factor:
        raise ConfigError(f"{values.size} samples do not make two clusters of {factor}")
    phase = np.concatenate([[0.0], np.cumsum(values - values.mean())])
    second = phase[2 * factor :] - 2.0 * phase[factor:-factor] + phase[: -2 * factor]
    return math.sqrt(float(np.mean(second**2)) / 2.0) / factor


def averaging_factors(samples: int, per_octave: int = 1) -> list[int]:
    """Return averaging factors spaced evenly on a logarithmic scale up to a ninth of the record."""
    longest = max(1, samples // 9)
    count = math.floor(per_octave * math.log2(longest)) + 1
    return sorted({round(2.0 ** (i / per_octave)) for i in range(count)})


def allan_deviation(
    record: ArrayLike,
    interval_s: float,
    factors: Iterable[int] | None = None,
    *,
    confidence: float = 0.6827,
    noise: Noise = Noise.WHITE,
) -> list[AllanPoint]:
    """Return the overlapping Allan deviation of `record`, sampled every `interval_s`, with chi-square intervals.

    `noise` is the law that the equivalent degrees of freedom are computed for.
    """
    values = np.asarray(record, dtype=np.float64)
    chosen = averaging_factors(values.size) if factors is None else factors
    return [_point(values, interval_s, factor, confidence, noise) for factor in chosen]


def _point(values: Floats, interval_s: float, factor: int, confidence: float, noise: Noise) -> AllanPoint:
    deviation = overlapping_deviation(values, factor)
    edf = equivalent_dof(values.size, factor, noise)
    low, high = confidence_interval(edf, confidence)
    return AllanPoint(factor * interval_s, deviation, edf, low * deviation, high * deviation)


def equivalent_dof(samples: int, factor: int, noise: Noise = Noise.WHITE) -> float:
    """Return the equivalent degrees of freedom of the overlapping estimate, 2 mean^2 / variance.

    It is exact: the estimate is the mean of squares of a stationary Gaussian sequence (the second differences of the
    phase), so its variance is the sum of that sequence's squared autocorrelations.
    """
    terms = samples + 1 - 2 * factor
    if terms < 1:
        raise ConfigError(f"{samples} samples do not make two clusters of {factor}")
    # Beyond a hundred clusters the autocorrelation of even flicker noise is below 1e-4, its square below 1e-8.
    lags = np.arange(1.0, min(terms, 100 * factor))
    correlation = _second_difference_covariance(lags, factor, noise) / _second_difference_covariance(
        np.zeros(1), factor, noise
    )
    return float(terms / (1.0 + 2.0 * np.sum((1.0 - lags / terms) * correlation**2)))


def _second_difference_covariance(lag: Floats, factor: int, noise: Noise) -> Floats:
    """Return the autocovariance of the second difference of the phase, from the phase's generalised one."""
    near = _phase_covariance(lag - factor, noise) + _phase_covariance(lag + factor, noise)
    far = _phase_covariance(lag - 2 * factor, noise) + _phase_covariance(lag + 2 * factor, noise)
    return np.asarray(6.0 * _phase_covariance(lag, noise) - 4.0 * near + far)


def _phase_covariance(lag: Floats, noise: Noise) -> Floats:
    """Return the generalised autocovariance of the phase (Greenhall and Riley 2003), up to a positive factor."""
    distance = np.abs(lag)
    match noise:
        case Noise.QUANTISATION:
            return np.asarray(distance == 0.0, dtype=np.float64)
        case Noise.WHITE:
            return -distance
        case Noise.FLICKER:
            return np.asarray(distance**2 * np.log(np.maximum(distance, 1.0)))
        case Noise.RANDOM_WALK:
            return np.asarray(distance**3)


def confidence_interval(edf: float, confidence: float = 0.6827) -> tuple[float, float]:
    """Return the factors on a deviation that bound the true one with `confidence`, equal tails of chi-square."""
    from scipy.special import chdtri  # noqa: PLC0415 - SciPy costs more to import than all the rest

    tail = (1.0 - confidence) / 2.0
    return math.sqrt(edf / float(chdtri(edf, tail))), math.sqrt(edf / float(chdtri(edf, 1.0 - tail)))


def ieee952_uncertainty(samples: int, factor: int) -> float:
    """Return the rule of IEEE 952 for the relative standard uncertainty: 1 / sqrt(2 (N/n - 1))."""
    return 1.0 / math.sqrt(2.0 * (samples / factor - 1.0))


@dataclass(frozen=True, slots=True)
class ReadOff:
    """What is read off the curve by eye and ruler; coefficients in the unit of the record and seconds."""

    angle_random_walk: float
    """N: the -1/2 slope through the shortest averaging time, at 1 s. It holds what flicker leaks in."""
    angle_random_walk_duty: float
    """N without the noise that dead time between readings folds in: N * sqrt(aperture / interval)."""
    floor: float
    """Least deviation."""
    floor_tau_s: float
    bias_instability: float
    """B: floor / 0.6643."""


def read_off(curve: list[AllanPoint], aperture_s: float | None = None) -> ReadOff:
    """Read angle random walk and bias instability off a curve; `aperture_s` is how long each reading integrates."""
    first = min(curve, key=lambda point: point.tau_s)
    lowest = min(curve, key=lambda point: point.deviation)
    walk = first.deviation * math.sqrt(first.tau_s)
    duty = 1.0 if aperture_s is None else min(1.0, aperture_s / first.tau_s)
    return ReadOff(
        angle_random_walk=walk,
        angle_random_walk_duty=walk * math.sqrt(duty),
        floor=lowest.deviation,
        floor_tau_s=lowest.tau_s,
        bias_instability=lowest.deviation / BIAS_INSTABILITY_FACTOR,
    )


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Noise coefficients of the whole curve; unit of the record (deg/s) and seconds."""

    quantisation: float
    """Q, deg."""
    angle_random_walk: float
    """N, deg/sqrt(s); 60 times that is deg/sqrt(h)."""
    bias_instability: float
    """B, deg/s; 3600 times that is deg/h."""
    rate_random_walk: float
    """K, (deg/s)/sqrt(s)."""
    rate_ramp: float
    """R, deg/s^2."""

    def variance(self, tau_s: ArrayLike) -> Floats:
        """Return sigma^2(tau) = 3 Q^2/tau^2 + N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + R^2 tau^2/2."""
        squares = np.square(
            [
                self.quantisation,
                self.angle_random_walk,
                self.bias_instability,
                self.rate_random_walk,
                self.rate_ramp,
            ]
        )
        return np.asarray(_variance_terms(np.asarray(tau_s, dtype=np.float64)) @ squares)


def decompose(curve: list[AllanPoint]) -> Coefficients:
    """Fit the five terms to a curve: non-negative least squares of the variances, each weighted by its certainty."""
    from scipy.optimize import nnls  # noqa: PLC0415 - as above

    variance = np.array([point.deviation**2 for point in curve])
    weight = np.sqrt(np.array([point.edf for point in curve])) / variance
    terms = _variance_terms(np.array([point.tau_s for point in curve])) * weight[:, None]
    size = np.linalg.norm(terms, axis=0)
    squares, _ = nnls(terms / size, variance * weight)
    return Coefficients(*np.sqrt(squares / size).tolist())


def _variance_terms(tau_s: Floats) -> Floats:
    tau = np.atleast_1d(tau_s)
    flat = np.full_like(tau, BIAS_INSTABILITY_FACTOR**2)
    return np.column_stack([3.0 / tau**2, 1.0 / tau, flat, tau / 3.0, tau**2 / 2.0])
