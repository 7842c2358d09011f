"""Allan deviation and its relatives, with confidence intervals that are true for overlapping clusters.

Estimators as in NIST SP 1065, sections 5.2 to 5.8, on a record of equally spaced averages. The unit of the result is
that of the record: a record in deg/s gives deg/s. :mod:`vcfbench.analysis.noise_fit` fits what the curve is made of.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.phase_noise import PhaseNoise, correlated_squares
from vcfbench.errors import ConfigError

BIAS_INSTABILITY_FACTOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Floor of the Allan deviation over the bias instability B, 0.66428."""

_BLOCK = 1 << 13
"""Terms handled at once: the blocks stay in the processor's cache, and are too short for BLAS to start threads on."""


class Noise(Enum):
    """The power law that rules a stretch of the Allan curve."""

    QUANTISATION = "quantisation"
    WHITE = "white"
    FLICKER = "flicker"
    RANDOM_WALK = "random walk"


class Estimator(Enum):
    """Which mean of squared differences estimates the deviation."""

    OVERLAPPING = "overlapping Allan"
    """Every pair of neighbouring clusters: the usual choice."""
    PLAIN = "Allan"
    """Clusters that do not overlap: twice as uncertain, for comparison with old figures."""
    MODIFIED = "modified Allan"
    """Averages the phase as well, which tells quantisation from white noise of the phase."""
    HADAMARD = "overlapping Hadamard"
    """Third differences: blind to a linear drift of the rate."""


_UNIT_NOISE = {
    Noise.QUANTISATION: PhaseNoise(quantisation=1.0),
    Noise.WHITE: PhaseNoise(white=1.0),
    Noise.FLICKER: PhaseNoise(flicker=1.0),
    Noise.RANDOM_WALK: PhaseNoise(random_walk=1.0),
}


@dataclass(frozen=True, slots=True)
class AllanPoint:
    """One averaging time: the deviation, its equivalent degrees of freedom and a confidence interval."""

    tau_s: float
    deviation: float
    edf: float
    low: float
    high: float


def deviation(record: ArrayLike, factor: int, estimator: Estimator) -> float:
    """Return the deviation of equally spaced averages at `factor` times their spacing, by `estimator`.

    Raises:
        ConfigError: the record is too short for one term.
    """
    values = np.asarray(record, dtype=np.float64)
    _terms(values.size, factor, estimator)
    return _deviation_of_phase(_phase(values), factor, estimator)


def _terms(samples: int, factor: int, estimator: Estimator) -> int:
    """Return how many squared differences the estimate averages."""
    match estimator:
        case Estimator.OVERLAPPING:
            terms, clusters = samples + 1 - 2 * factor, "two clusters"
        case Estimator.PLAIN:
            terms, clusters = samples // factor - 1 if factor > 0 else 0, "two clusters"
        case Estimator.MODIFIED:
            terms, clusters = samples + 2 - 3 * factor, "three clusters"
        case Estimator.HADAMARD:
            terms, clusters = samples + 1 - 3 * factor, "three clusters"
    if factor < 1 or terms < 1:
        raise ConfigError(f"{samples} samples do not make {clusters} of {factor}")
    return terms


def _phase(values: Floats) -> Floats:
    """Return the running sum from 0; the mean is taken out first, which no estimator sees, to keep its digits."""
    phase = np.empty(values.size + 1)
    phase[0] = 0.0
    np.subtract(values, values.mean(), out=phase[1:])
    np.cumsum(phase[1:], out=phase[1:])
    return phase


def _deviation_of_phase(phase: Floats, factor: int, estimator: Estimator) -> float:
    match estimator:
        case Estimator.OVERLAPPING:
            return math.sqrt(_mean_square(phase, (1.0, -2.0, 1.0), factor) / 2.0) / factor
        case Estimator.PLAIN:
            return math.sqrt(_mean_square(phase[::factor], (1.0, -2.0, 1.0), 1) / 2.0) / factor
        case Estimator.MODIFIED:
            # The running sum of the phase: second differences of its means over n are third differences of that
            twice = _phase(phase)
            return math.sqrt(_mean_square(twice, (1.0, -3.0, 3.0, -1.0), factor) / 2.0) / factor**2
        case Estimator.HADAMARD:
            return math.sqrt(_mean_square(phase, (1.0, -3.0, 3.0, -1.0), factor) / 6.0) / factor


def _mean_square(phase: Floats, weights: tuple[float, ...], factor: int) -> float:
    """Return the mean square of ``sum weights[i] * phase[t + i * factor]`` over all t, block by block."""
    terms = phase.size - (len(weights) - 1) * factor
    total = 0.0
    buffer, scaled = np.empty(min(terms, _BLOCK)), np.empty(min(terms, _BLOCK))
    for start in range(0, terms, _BLOCK):
        count = min(_BLOCK, terms - start)
        difference, part = buffer[:count], scaled[:count]
        np.multiply(phase[start : start + count], weights[0], out=difference)
        for place, weight in enumerate(weights[1:], 1):
            first = start + place * factor
            np.multiply(phase[first : first + count], weight, out=part)
            difference += part
        total += float(difference @ difference)
    return total / terms


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
    estimator: Estimator = Estimator.OVERLAPPING,
) -> list[AllanPoint]:
    """Return the deviation of `record`, sampled every `interval_s`, with chi-square intervals.

    `noise` is the law that the equivalent degrees of freedom are computed for. Takes memory for one more record.

    Raises:
        ConfigError: the record is too short for a factor, holds what is no finite number, or its interval is no time.
    """
    values = np.asarray(record, dtype=np.float64)
    if not np.isfinite(values).all():
        raise ConfigError("a sample of the record is not a finite number")
    if not 0.0 < interval_s < math.inf:
        raise ConfigError(f"expected an interval above 0 s between samples, came {interval_s:g} s")
    chosen = list(averaging_factors(values.size) if factors is None else factors)
    for factor in chosen:
        _terms(values.size, factor, estimator)
    phase = _phase(values)
    points = []
    for factor in chosen:
        edf = equivalent_dof(values.size, factor, noise, estimator)
        low, high = confidence_interval(edf, confidence)
        found = _deviation_of_phase(phase, factor, estimator)
        points.append(AllanPoint(factor * interval_s, found, edf, low * found, high * found))
    return points


def equivalent_dof(
    samples: int,
    factor: int,
    noise: Noise | PhaseNoise = Noise.WHITE,
    estimator: Estimator = Estimator.OVERLAPPING,
) -> float:
    """Return the equivalent degrees of freedom of an estimate, 2 mean^2 / variance.

    It is exact, for any power law and for a mixture of them: the estimate is the mean of squares of a stationary
    Gaussian sequence (differences of the phase), so its variance is the sum of that sequence's squared autocovariances,
    which follow from the generalised autocovariance of the phase (Greenhall and Riley 2003; their closed forms are
    approximations of that sum, 18 % off for white noise at the shortest averaging time).
    """
    terms = _terms(samples, factor, estimator)
    law = _UNIT_NOISE[noise] if isinstance(noise, Noise) else noise
    match estimator:
        case Estimator.OVERLAPPING:
            squares = correlated_squares(law, terms, factor, terms, factor)
        case Estimator.PLAIN:
            squares = correlated_squares(law.spaced(factor), terms, 1, terms, 1)
        case Estimator.MODIFIED:
            squares = correlated_squares(law.averaged(factor), terms, factor, terms, factor)
        case Estimator.HADAMARD:
            squares = correlated_squares(law, terms, factor, terms, factor, order=3)
    return 2.0 * squares.mean_first**2 / squares.covariance


def confidence_interval(edf: float, confidence: float = 0.6827) -> tuple[float, float]:
    """Return the factors on a deviation that bound the true one with `confidence`, equal tails of chi-square."""
    from scipy.special import chdtri  # noqa: PLC0415 - SciPy costs more to import than all the rest

    tail = (1.0 - confidence) / 2.0
    return math.sqrt(edf / float(chdtri(edf, tail))), math.sqrt(edf / float(chdtri(edf, 1.0 - tail)))


@dataclass(frozen=True, slots=True)
class ReadOff:
    """Coefficients read off the curve by eye and ruler, in the unit of the record and seconds."""

    angle_random_walk: float
    """N: the -1/2 slope through the shortest averaging time, at 1 s, the share of flicker included."""
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
