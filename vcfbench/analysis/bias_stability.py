"""Bias stability of a static record in every definition in use: they differ, so each is named."""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.allan import BIAS_INSTABILITY_FACTOR, AllanPoint
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.sampling import Sampling, block_means
from vcfbench.errors import ConfigError


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


def bias_stability(
    record: ArrayLike, sampling: Sampling, curve: Sequence[AllanPoint], unit: float = 1.0
) -> BiasStability:
    """Return every definition for a `record` so sampled, and its Allan `curve`, times `unit`.

    Raises:
        ConfigError: fewer than three readings.
    """
    values = np.asarray(record, dtype=np.float64)
    if values.size < 3:
        raise ConfigError(f"bias stability needs at least three readings, got {values.size}")
    means = [_means(values, sampling, seconds) for seconds in (1.0, 10.0, 100.0)]
    sd_1, sd_10, sd_100 = (unit * float(np.std(each, ddof=1)) if each.size > 1 else None for each in means)
    tens = means[1]
    detrended = None
    if tens.size > 2:
        place = np.arange(tens.size) - (tens.size - 1) / 2.0
        left = tens - tens.mean() - place * float(place @ tens / (place @ place))
        detrended = unit * math.sqrt(float(left @ left) / (tens.size - 2))
    lowest = min(curve, key=lambda point: point.deviation)
    return BiasStability(
        *(sd_1, sd_10, sd_100),
        detrended,
        unit * float(np.ptp(tens)) if tens.size > 1 else None,
        *(unit * lowest.deviation, unit * lowest.low, unit * lowest.high, lowest.tau_s),
        unit * (lowest.deviation / BIAS_INSTABILITY_FACTOR),
    )


def _means(values: Floats, sampling: Sampling, seconds: float) -> Floats:
    """Return means over `seconds` of the clock, none where that is no whole number of intervals or longer than all."""
    readings = round(seconds / sampling.interval_s)
    whole = readings >= 1 and math.isclose(readings * sampling.interval_s, seconds, rel_tol=1e-6)
    return block_means(values, readings) if whole and readings <= values.size else np.empty(0)
