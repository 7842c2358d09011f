"""Effect of the aperture of a reading and of the dead time between readings on an Allan curve.

A reading is the mean over its aperture. Readings with time between them see white noise as strongly as one aperture
does, and not as the whole interval would: 0.2 s of every second show sqrt(5) = 2.24 times the noise. Slow noise passes
almost unchanged. The factors are those by which the deviation at ``factor * interval`` differs from that of a gapless
record (for one reading a cluster: the bias function B2 of Barnes, NBS Technical Note 375).
"""

import math
from typing import Self

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.allan import Noise
from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError

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


def deviation_factor(sampling: Sampling, noise: Noise, factor: int = 1) -> float:
    """Return observed over gapless Allan deviation at `factor` intervals, for one law of noise.

    Divide an observed deviation, or a coefficient read off it, by that. 1 for a gapless record.

    Raises:
        ConfigError: `factor` is not positive.
    """
    if factor < 1:
        raise ConfigError(f"a cluster needs at least one reading, got {factor}")
    if sampling.gapless:
        return 1.0
    duty = sampling.aperture_s / sampling.interval_s
    match noise:
        case Noise.WHITE:
            bandwidth = sampling.noise_bandwidth_hz
            return math.sqrt(1.0 / duty if bandwidth is None else 2.0 * bandwidth * sampling.interval_s)
        case Noise.QUANTISATION:
            return math.sqrt(2.0 * factor / 3.0) / duty
        case Noise.FLICKER | Noise.RANDOM_WALK:
            summed = min(factor, _SUMMED)
            # The variance of the difference of two clusters, one a unit of time over `duty` of it, up to a constant of
            # the law. One cluster follows the other, so they meet at lags of one sign only
            lag = np.arange(2.0 * summed)
            weight = 2.0 * np.maximum(0.0, summed - lag) - np.maximum(0.0, summed - np.abs(lag - summed))
            weight[1:] *= 2.0
            later, ratio = lag[1:], duty / lag[1:]
            if noise is Noise.FLICKER:  # second differences of t^2 ln t; of random walk: of |t|^3 / 12
                spread = (later + duty) ** 2 * np.log1p(ratio) + (later - duty) ** 2 * np.log1p(-ratio)
                covariance = [[-2.0 * math.log(duty)], -2.0 * np.log(later) - spread / duty**2]
                gapless = 8.0 * math.log(2.0)
            else:
                covariance, gapless = [[-duty / 6.0], -later / 2.0], 2.0 * summed / 3.0
            excess = float(weight @ np.concatenate(covariance)) / summed**2 / gapless - 1.0
            gone = summed / factor if noise is Noise.FLICKER else (summed / factor) ** 2
            return math.sqrt(1.0 + excess * gone)


def block_means(record: ArrayLike, readings: int) -> Floats:
    """Return the means of successive blocks of `readings`; an incomplete last block is left out.

    Five readings of 0.2 s without gaps make one of 1 s without dead time.

    Raises:
        ConfigError: the record does not fill one block.
    """
    values = np.asarray(record, dtype=np.float64)
    blocks = values.size // readings if readings > 0 else 0
    if blocks < 1:
        raise ConfigError(f"{values.size} readings do not fill a block of {readings}")
    return np.asarray(values[: blocks * readings].reshape(blocks, readings).mean(axis=1))
