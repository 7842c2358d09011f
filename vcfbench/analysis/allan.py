"""Overlapping Allan deviation, bias stability, and the effect of dead time between readings on both.

The estimator is that of NIST SP 1065, section 5.2.4, on a record of equally spaced averages. The unit of the result is
that of the record: a record in deg/s gives deg/s. :mod:`vcfbench.analysis.noise_fit` fits what the curve is made of.

A reading is the mean over its aperture. Readings with time between them see white noise as strongly as one aperture
does, and not as the whole interval would: 0.2 s of every second show sqrt(5) = 2.24 times the noise. Slow noise passes
almost unchanged. The factors are those by which the deviation at ``factor * interval`` differs from that of a gapless
record (for one reading a cluster: the bias function B2 of Barnes, NBS Technical Note 375).
"""

import math
from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Self, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats, plain_numbers
from vcfbench.analysis.phase_noise import PhaseNoise, correlated_squares
from vcfbench.errors import ConfigError

BIAS_INSTABILITY_FACTOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Floor of the Allan deviation over the bias instability B, 0.66428."""

_BLOCK = 1 << 13
"""Terms handled at once: the blocks stay in the processor's cache, and are too short for BLAS to start threads on."""


class Term(Enum):
    """One term of the curve, in the order of rising powers of the averaging time."""

    QUANTISATION = "quantisation"
    ANGLE_RANDOM_WALK = "angle random walk"
    """White noise."""
    BIAS_INSTABILITY = "bias instability"
    """Flicker noise."""
    RATE_RANDOM_WALK = "rate random walk"
    RATE_RAMP = "rate ramp"


WHITE_NOISE = PhaseNoise(white=1.0)


class AllanPoint(Struct, frozen=True):
    """One averaging time: the deviation, its equivalent degrees of freedom and a confidence interval.

    >>> point = vcfbench.allan_deviation([0.02, -0.01, 0.03, 0.0, -0.02, 0.01], interval_s=0.1)[0]
    >>> f"{point.deviation:.3f} deg/s at {point.tau_s} s, 68 % within {point.low:.3f} to {point.high:.3f}"
    '0.022 deg/s at 0.1 s, 68 % within 0.017 to 0.038'
    """

    tau_s: float
    deviation: float
    edf: float
    low: float
    high: float


def _deviation(phase: Floats, factor: int, *, from_0: bool) -> float:
    """Return the root of half the mean square of second differences of the phase over all clusters, block by block.

    A phase that is not from 0 lacks the 0 that every running sum begins with.
    """
    terms = phase.size - 2 * factor
    total = 0.0 if from_0 else float(phase[2 * factor - 1] - 2.0 * phase[factor - 1]) ** 2
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
    return math.sqrt(total / (terms + (not from_0)) / 2.0) / factor


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
    overwrite: bool = False,
) -> list[AllanPoint]:
    """Return the overlapping deviation of `record`, sampled every `interval_s`, with chi-square intervals.

    The equivalent degrees of freedom are those of white noise. Takes memory for one more record, unless it may
    `overwrite` this one.

    Raises:
        ConfigError: the record is too short for a factor, holds what is no finite number, or its interval is no time;
            `confidence` is no probability.

    >>> points = vcfbench.allan_deviation([0.02, -0.01, 0.03, 0.0, -0.02, 0.01] * 9, interval_s=0.1)
    >>> [f"{point.tau_s:g} s: {point.deviation:.4f}" for point in points[:2]]
    ['0.1 s: 0.0202', '0.2 s: 0.0118']
    """
    values = plain_numbers(record, "record")
    if not np.isfinite(values).all():
        raise ConfigError("a sample of the record is not a finite number")
    if not 0.0 < interval_s < math.inf:
        raise ConfigError(f"expected an interval above 0 s between samples, got {interval_s:g} s")
    chosen = list(averaging_factors(values.size) if factors is None else factors)
    edfs = [equivalent_dof(values.size, factor) for factor in chosen]
    # The running sum from 0; the mean is taken out first, which no difference sees, to keep its digits
    overwrite = overwrite and values.flags.writeable
    phase = values if overwrite else np.zeros(values.size + 1)
    sums = phase[phase.size - values.size :]
    np.subtract(values, values.mean(), out=sums)
    np.cumsum(sums, out=sums)
    points = []
    for factor, edf in zip(chosen, edfs, strict=True):
        low, high = confidence_interval(edf, confidence)
        found = _deviation(phase, factor, from_0=not overwrite)
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
    if factor < 1 or terms < 1 or factor % 1:
        raise ConfigError(f"{samples} samples do not make two clusters of {factor}")
    squares = correlated_squares(noise, terms, factor, terms, factor)
    return 2.0 * squares.mean_first**2 / squares.covariance


def confidence_interval(edf: float, confidence: float = 0.6827) -> tuple[float, float]:
    """Return the factors on a deviation that bound the true one with `confidence`, equal tails of chi-square.

    Raises:
        ConfigError: `confidence` is no probability between 0 and 1.
    """
    if not 0.0 < confidence < 1.0:
        raise ConfigError(f"expected a confidence between 0 and 1, got {confidence:g}")
    from scipy.special import chdtri  # noqa: PLC0415 - SciPy costs more to import than all the rest

    tail = (1.0 - confidence) / 2.0
    return math.sqrt(edf / float(chdtri(edf, tail))), math.sqrt(edf / float(chdtri(edf, 1.0 - tail)))


_SUMMED = 1024
"""Most readings a cluster with summed covariances; beyond, noise folded in by dead time falls as white noise."""


class Sampling(Struct, frozen=True):
    """Sampling of a record: one reading every `interval_s`, each the mean over `aperture_s`."""

    interval_s: float
    aperture_s: float
    noise_bandwidth_hz: float | None = None
    """Noise bandwidth of one reading for the instrument's white noise, where it is not 1 / (2 aperture).

    Force noise of a gyroscope with split modes passes through the sense mode first: 3.4 Hz instead of 2.5 Hz at 0.2 s.
    """

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        if not 0.0 < self.aperture_s <= self.interval_s or not math.isfinite(self.interval_s):
            raise ConfigError(f"an aperture of {self.aperture_s:g} s does not fit an interval of {self.interval_s:g} s")
        if self.noise_bandwidth_hz is not None and (self.gapless or self.noise_bandwidth_hz <= 0.0):
            raise ConfigError(
                "a noise bandwidth of the reading needs time between readings: without it neighbours share that noise"
            )

    @classmethod
    def without_gaps(cls, interval_s: float) -> Self:
        """Return the sampling of readings that follow each other directly."""
        return cls(interval_s, interval_s)

    @property
    def gapless(self) -> bool:
        """True if there is no dead time, to a part in a million."""
        return self.interval_s - self.aperture_s <= 1e-6 * self.interval_s


def deviation_factor(sampling: Sampling, noise: Term, factor: int = 1) -> float:
    """Return observed over gapless Allan deviation at `factor` intervals, for one law of noise.

    Divide an observed deviation, or a coefficient read off it, by that. 1 for a gapless record, and for a ramp.

    Raises:
        ConfigError: `factor` is not positive.
    """
    if factor < 1:
        raise ConfigError(f"a cluster needs at least one reading, got {factor}")
    if sampling.gapless or noise is Term.RATE_RAMP:
        return 1.0
    duty = sampling.aperture_s / sampling.interval_s
    match noise:
        case Term.ANGLE_RANDOM_WALK:
            bandwidth = sampling.noise_bandwidth_hz
            return math.sqrt(1.0 / duty if bandwidth is None else 2.0 * bandwidth * sampling.interval_s)
        case Term.QUANTISATION:
            return math.sqrt(2.0 * factor / 3.0) / duty
        case _:
            summed = min(factor, _SUMMED)
            # The variance of the difference of two clusters, one a unit of time over `duty` of it, up to a constant of
            # the law. One cluster follows the other, so they meet at lags of one sign only
            lag = np.arange(2.0 * summed)
            weight = 2.0 * np.maximum(0.0, summed - lag) - np.maximum(0.0, summed - np.abs(lag - summed))
            weight[1:] *= 2.0
            later, ratio = lag[1:], duty / lag[1:]
            if noise is Term.BIAS_INSTABILITY:  # second differences of t^2 ln t; of random walk: of |t|^3 / 12
                spread = (later + duty) ** 2 * np.log1p(ratio) + (later - duty) ** 2 * np.log1p(-ratio)
                covariance = [[-2.0 * math.log(duty)], -2.0 * np.log(later) - spread / duty**2]
                gapless = 8.0 * math.log(2.0)
            else:
                covariance, gapless = [[-duty / 6.0], -later / 2.0], 2.0 * summed / 3.0
            excess = float(weight @ np.concatenate(covariance)) / summed**2 / gapless - 1.0
            gone = summed / factor if noise is Term.BIAS_INSTABILITY else (summed / factor) ** 2
            return math.sqrt(1.0 + excess * gone)


def block_means(record: ArrayLike, readings: int) -> Floats:
    """Return the means of successive blocks of `readings`; an incomplete last block is left out.

    Five readings of 0.2 s without gaps make one of 1 s without dead time.

    Raises:
        ConfigError: the record does not fill one block.
    """
    values = plain_numbers(record, "record")
    blocks = values.size // readings if readings > 0 else 0
    if blocks < 1:
        raise ConfigError(f"{values.size} readings do not fill a block of {readings}")
    return np.asarray(values[: blocks * readings].reshape(blocks, readings).mean(axis=1))


class BiasStability(Struct, frozen=True):
    """Bias stability of one static record, rates; None: the record is too short for it."""

    sd_1_s: float | None
    """Standard deviation of 1-s means about their mean (GJB 2426A, JJF 1535-2015 3.3, with 1 s)."""
    sd_10_s: float | None
    """The same of 10-s means, the usual one."""
    sd_100_s: float | None
    sd_10_s_detrended: float | None
    """The same of 10-s means about their least-squares line."""
    peak_to_peak_10_s: float | None
    """Largest less smallest 10-s mean."""
    allan_minimum: float
    """The least of many scattering points: a little low."""
    allan_minimum_low: float
    """Confidence interval of that point of the curve."""
    allan_minimum_high: float
    allan_minimum_tau_s: float
    bias_instability_read_off: float
    """Minimum / 0.6643, the B of IEEE 952 as read off; the fitted one is in `noise_fit`."""


Spreads: TypeAlias = tuple[float | None, float | None, float | None, float | None, float | None]
"""The first five of :class:`BiasStability`."""


def spreads_of_means(record: ArrayLike, sampling: Sampling, unit: float = 1.0) -> Spreads:
    """Return the scatter of means of 1, 10 and 100 s, of a `record` so sampled, times `unit`.

    Raises:
        ConfigError: fewer than three readings.
    """
    values = plain_numbers(record, "record")
    if values.size < 3:
        raise ConfigError(f"bias stability needs at least three readings, got {values.size}")
    means = []
    for seconds in (1.0, 10.0, 100.0):  # none where that is no whole number of intervals, or longer than all
        readings = round(seconds / sampling.interval_s)
        whole = readings >= 1 and math.isclose(readings * sampling.interval_s, seconds, rel_tol=1e-6)
        means.append(block_means(values, readings) if whole and readings <= values.size else np.empty(0))
    sd_1, sd_10, sd_100 = (unit * float(np.std(each, ddof=1)) if each.size > 1 else None for each in means)
    tens = means[1]
    detrended = None
    if tens.size > 2:
        place = np.arange(tens.size) - (tens.size - 1) / 2.0
        left = tens - tens.mean() - place * float(place @ tens / (place @ place))
        detrended = unit * math.sqrt(float(left @ left) / (tens.size - 2))
    return sd_1, sd_10, sd_100, detrended, unit * float(np.ptp(tens)) if tens.size > 1 else None


def bias_stability(spreads: Spreads, curve: Sequence[AllanPoint], unit: float = 1.0) -> BiasStability:
    """Return every definition for a record with these spreads of means, and this Allan curve times `unit`."""
    lowest = min(curve, key=lambda point: point.deviation)
    return BiasStability(
        *spreads,
        *(unit * lowest.deviation, unit * lowest.low, unit * lowest.high, lowest.tau_s),
        unit * (lowest.deviation / BIAS_INSTABILITY_FACTOR),
    )
