"""Bias stability of a static record in every definition in use: they differ, so each is named."""

from __future__ import annotations

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
    """One static record; unit of the record (deg/s), `slope_per_s` in that a second. None: the record is too short."""

    sd_1_s: float | None
    """Standard deviation of 1-s means about their mean (GJB 2426A, JJF 1535-2015 3.3, with 1 s)."""
    sd_10_s: float | None
    """The same of 10-s means, the usual one."""
    sd_100_s: float | None
    sd_10_s_detrended: float | None
    """The same of 10-s means about their least-squares line."""
    peak_to_peak_10_s: float | None
    """Largest less smallest 10-s mean."""
    slope_per_s: float
    """Slope of the least-squares line through the record."""
    floor: float
    """Minimum of the Allan deviation. The least of many scattering points: a little low."""
    floor_tau_s: float
    floor_low: float
    """Confidence interval of that point of the curve."""
    floor_high: float
    bias_instability: float
    """Floor / 0.6643, the B of IEEE 952 as read off; the fitted one is in `noise_fit`."""


def bias_stability(record: ArrayLike, sampling: Sampling, curve: Sequence[AllanPoint]) -> BiasStability:
    """Return every definition for a `record` so sampled, and its Allan `curve`.

    Raises:
        ConfigError: fewer than three readings.
    """
    values = np.asarray(record, dtype=np.float64)
    if values.size < 3:
        raise ConfigError(f"bias stability needs at least three readings, got {values.size}")
    tens = _means(values, sampling, 10.0)
    lowest = min(curve, key=lambda point: point.deviation)
    times = sampling.interval_s * (np.arange(values.size) - (values.size - 1) / 2.0)
    return BiasStability(
        sd_1_s=_sd(_means(values, sampling, 1.0)),
        sd_10_s=_sd(tens),
        sd_100_s=_sd(_means(values, sampling, 100.0)),
        sd_10_s_detrended=_sd_about_line(tens),
        peak_to_peak_10_s=float(np.ptp(tens)) if tens.size > 1 else None,
        slope_per_s=float(times @ values / (times @ times)),
        floor=lowest.deviation,
        floor_tau_s=lowest.tau_s,
        floor_low=lowest.low,
        floor_high=lowest.high,
        bias_instability=lowest.deviation / BIAS_INSTABILITY_FACTOR,
    )


def _means(values: Floats, sampling: Sampling, seconds: float) -> Floats:
    """Return means over `seconds` of the clock, none where that is no whole number of intervals or longer than all."""
    readings = round(seconds / sampling.interval_s)
    whole = readings >= 1 and math.isclose(readings * sampling.interval_s, seconds, rel_tol=1e-6)
    return block_means(values, readings) if whole and readings <= values.size else np.empty(0)


def _sd(means: Floats) -> float | None:
    return float(np.std(means, ddof=1)) if means.size > 1 else None


def _sd_about_line(means: Floats) -> float | None:
    if means.size < 3:
        return None
    place = np.arange(means.size) - (means.size - 1) / 2.0
    left = means - means.mean() - place * float(place @ means / (place @ place))
    return math.sqrt(float(left @ left) / (means.size - 2))
