"""Overlapping Allan deviation, with confidence intervals that are true for overlapping clusters.

The estimator is that of NIST SP 1065, section 5.2.4, on a record of equally spaced averages. The unit of the result is
that of the record: a record in deg/s gives deg/s. :mod:`vcfbench.analysis.noise_fit` fits what the curve is made of.
"""

import math
from collections.abc import Iterable
from enum import Enum

import numpy as np
from msgspec import Struct
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


WHITE_NOISE = PhaseNoise(white=1.0)


class AllanPoint(Struct, frozen=True):
    """One averaging time: the deviation, its equivalent degrees of freedom and a confidence interval."""

    tau_s: float
    deviation: float
    edf: float
    low: float
    high: float


def _deviation(phase: Floats, factor: int) -> float:
    """Return the root of half the mean square of second differences of the phase over all clusters, block by block."""
    terms = phase.size - 2 * factor
    total = 0.0
    buffer, scaled = np.empty(min(terms, _BLOCK)), np.empty(min(terms, _BLOCK))
    for start in range(0, terms, _BLOCK):
        count = min(_BLOCK, terms - start)
        difference, part = buffer[:count], scaled[:count]
        difference[:] = phase[start : start + count]
        for place, weight in ((1, -2.0), (2, 1.0)):
            first = start + place * factor
            np.multiply(phase[first : first + count], weight, out=part)
            difference += part
        total += float(difference @ difference)
    return math.sqrt(total / terms / 2.0) / factor


def averaging_factors(samples: int, per_octave: int = 1) -> list[int]:
    """Return averaging factors spaced evenly on a logarithmic scale up to a ninth of the record."""
    longest = max(1, samples // 9)
    count = math.floor(per_octave * math.log2(longest)) + 1
    return sorted({round(2.0 ** (i / per_octave)) for i in range(count)})


def allan_deviation(
    record: ArrayLike, interval_s: float, factors: Iterable[int] | None = None, *, confidence: float = 0.6827
) -> list[AllanPoint]:
    """Return the overlapping deviation of `record`, sampled every `interval_s`, with chi-square intervals.

    The equivalent degrees of freedom are those of white noise. Takes memory for one more record.

    Raises:
        ConfigError: the record is too short for a factor, holds what is no finite number, or its interval is no time.
    """
    values = np.asarray(record, dtype=np.float64)
    if not np.isfinite(values).all():
        raise ConfigError("a sample of the record is not a finite number")
    if not 0.0 < interval_s < math.inf:
        raise ConfigError(f"expected an interval above 0 s between samples, came {interval_s:g} s")
    chosen = list(averaging_factors(values.size) if factors is None else factors)
    edfs = [equivalent_dof(values.size, factor) for factor in chosen]
    # The running sum from 0; the mean is taken out first, which no difference sees, to keep its digits
    phase = np.empty(values.size + 1)
    phase[0] = 0.0
    np.subtract(values, values.mean(), out=phase[1:])
    np.cumsum(phase[1:], out=phase[1:])
    points = []
    for factor, edf in zip(chosen, edfs, strict=True):
        low, high = confidence_interval(edf, confidence)
        found = _deviation(phase, factor)
        points.append(AllanPoint(factor * interval_s, found, edf, low * found, high * found))
    return points


def equivalent_dof(samples: int, factor: int, noise: PhaseNoise = WHITE_NOISE) -> float:
    """Return the equivalent degrees of freedom of an estimate, 2 mean^2 / variance.

    It is exact, for any power law and for a mixture of them: the estimate is the mean of squares of a stationary
    Gaussian sequence (differences of the phase), so its variance is the sum of that sequence's squared autocovariances,
    which follow from the generalised autocovariance of the phase (Greenhall and Riley 2003; their closed forms are
    approximations of that sum, 18 % off for white noise at the shortest averaging time).

    Raises:
        ConfigError: the record is too short for one term.
    """
    terms = samples + 1 - 2 * factor
    if factor < 1 or terms < 1:
        raise ConfigError(f"{samples} samples do not make two clusters of {factor}")
    squares = correlated_squares(noise, terms, factor, terms, factor)
    return 2.0 * squares.mean_first**2 / squares.covariance


def confidence_interval(edf: float, confidence: float = 0.6827) -> tuple[float, float]:
    """Return the factors on a deviation that bound the true one with `confidence`, equal tails of chi-square."""
    from scipy.special import chdtri  # noqa: PLC0415 - SciPy costs more to import than all the rest

    tail = (1.0 - confidence) / 2.0
    return math.sqrt(edf / float(chdtri(edf, tail))), math.sqrt(edf / float(chdtri(edf, 1.0 - tail)))
