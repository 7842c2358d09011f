"""The straight line through a calibration, and its diagnostics.

Notation: `rate_deg_s` is the applied rate, `output_v` the mean output at each rate; one-dimensional, of one length.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats, plain_numbers
from vcfbench.analysis.column import Pair
from vcfbench.errors import ConfigError
from vcfbench.values.quantile import t_quantile

_LARGEST = 1e100
"""Far above all physical values; squares and products of smaller ones neither overflow nor vanish."""


class LineFit(Struct, frozen=True):
    """An ordinary least-squares line ``output = scale_factor * rate + bias`` and its standard uncertainties.

    The uncertainties come from the scatter `s_v` about the line, so they hold lack of fit as well as noise: of the
    slope, V/(deg/s), s / sqrt(Sxx); of the intercept, V, s * sqrt(1/n + mean(rate)^2 / Sxx).
    """

    scale_factor: float
    bias: float
    u_scale_factor: float
    u_bias: float
    covariance: float
    """Covariance of slope and intercept, V^2/(deg/s)."""
    s_v: float
    """Residual standard deviation with n - 2 degrees of freedom, V."""
    dof: int
    """Degrees of freedom, n - 2."""
    sxx: float
    """Sum of squares of the rates about their mean, (deg/s)^2."""
    rate_mean_deg_s: float
    residuals_v: Floats
    """Output minus line, V, in the order of the points."""

    @property
    def coverage_factor(self) -> float:
        """Two-sided 95 % quantile of Student's t with `dof` degrees of freedom."""
        return t_quantile(0.05, self.dof)

    @property
    def bias_deg_s(self) -> float:
        """The bias as an equivalent rate, deg/s, sign kept."""
        return self.bias / self.scale_factor


class Polynomial(Struct, frozen=True):
    """A least-squares polynomial of the output in the rate."""

    coefficients: tuple[float, ...]
    """c0, c1, ... in V/(deg/s)^i."""
    s_v: float | None
    """Residual standard deviation, V; None when no degree of freedom is left."""
    residuals_v: Floats


def slope(rate_deg_s: Floats, output_v: Floats) -> float:
    """Return the least-squares slope, V/(deg/s)."""
    deviation = rate_deg_s - rate_deg_s.mean()
    return float(deviation @ (output_v - output_v.mean()) / (deviation @ deviation))


def fit_line(rate_deg_s: ArrayLike, output_v: ArrayLike) -> LineFit:
    """Fit the least-squares line.

    Raises:
        ConfigError: fewer than three points, a value that is not finite, or a rate that never changes.
    """
    rate, output = checked_points(rate_deg_s, output_v)
    deviation = rate - rate.mean()
    sxx = float(deviation @ deviation)
    scale_factor = slope(rate, output)
    bias = float(output.mean() - scale_factor * rate.mean())
    residuals = output - scale_factor * rate - bias
    dof = rate.size - 2
    variance = float(residuals @ residuals) / dof
    mean = float(rate.mean())
    return LineFit(
        scale_factor=scale_factor,
        bias=bias,
        u_scale_factor=math.sqrt(variance / sxx),
        u_bias=math.sqrt(variance * (1.0 / rate.size + mean**2 / sxx)),
        covariance=0.0 - mean * variance / sxx,
        s_v=math.sqrt(variance),
        dof=dof,
        sxx=sxx,
        rate_mean_deg_s=mean,
        residuals_v=residuals,
    )


def checked_points(rate_deg_s: ArrayLike, output_v: ArrayLike) -> tuple[Floats, Floats]:
    """Return both as arrays a line can be fitted to; raises ConfigError otherwise."""
    rate, output = plain_numbers(rate_deg_s, "rates", "deg/s"), plain_numbers(output_v, "outputs", "V")
    if rate.ndim != 1 or rate.shape != output.shape:
        raise ConfigError(f"as many outputs as rates are needed, got {output.shape} and {rate.shape}")
    if rate.size < 3:
        raise ConfigError(f"at least three points are needed for a line and its uncertainty, got {rate.size}")
    if not (np.isfinite(rate).all() and np.isfinite(output).all()):
        raise ConfigError("a rate or an output is not a finite number")
    largest = float(np.abs(rate).max())
    if max(largest, float(np.abs(output).max())) > _LARGEST:
        raise ConfigError("a rate or an output is larger than any gyroscope's")
    if np.ptp(rate) <= max(1e-12 * largest, 1.0 / _LARGEST):
        raise ConfigError(f"the rate never changes ({rate[0]:g} deg/s at every point), so there is no scale factor")
    return rate, output


def fit_polynomial(rate_deg_s: ArrayLike, output_v: ArrayLike, degree: int) -> Polynomial:
    """Fit ``sum c_i * rate^i`` by least squares; the rates are scaled to 1 inside so that high degrees stay exact."""
    rate, output = checked_points(rate_deg_s, output_v)
    scale = float(np.abs(rate).max())
    powers = np.vander(rate / scale, degree + 1, increasing=True)
    scaled, *_ = np.linalg.lstsq(powers, output, rcond=None)
    residuals = output - powers @ scaled
    dof = rate.size - degree - 1
    s_v = math.sqrt(float(residuals @ residuals) / dof) if dof > 0 else None
    return Polynomial(tuple(float(c) / scale**i for i, c in enumerate(scaled)), s_v, residuals)


def durbin_watson(residuals_v: Floats) -> float | None:
    """Return Durbin and Watson's statistic: 2 for independent residuals, towards 0 for a trend left in them."""
    total = float(residuals_v @ residuals_v)
    return float(np.square(np.diff(residuals_v)).sum()) / total if total > 0.0 else None


def sign_runs(residuals_v: Floats) -> int:
    """Return the number of runs of equal sign in the ordered residuals."""
    return 1 + int(np.count_nonzero(np.diff(np.signbit(residuals_v))))


def line_so_far(rate_deg_s: Sequence[float], output_v: Sequence[float]) -> LineFit | None:
    """Return the least-squares line through the points so far, with their residuals, or None.

    Args:
        rate_deg_s: rates of the points of one calibration, in the order in which they were measured.
        output_v: their outputs.
    """
    if len(set(rate_deg_s)) < 3:  # every line goes through two
        return None
    try:
        return fit_line(rate_deg_s, output_v)
    except ConfigError:  # values that are no measurement: the results will say so
        return None


def sign_pairs(rate_deg_s: ArrayLike, output_v: ArrayLike) -> list[Pair]:
    """Return the pairs by falling magnitude; outputs measured repeatedly at one rate are averaged first.

    A pair of rates +w and -w gives the chopped scale factor (y(+w) - y(-w)) / 2w, free of bias and of every even term,
    and the even part (y(+w) + y(-w)) / 2, which holds exactly those.
    """
    rate, output = checked_points(rate_deg_s, output_v)
    rates = np.array(sorted(set(rate.tolist())))  # np.unique would load numpy.ma
    place = np.searchsorted(rates, rate)
    means = np.bincount(place, weights=output) / np.bincount(place)
    positive = rates[::-1][rates[::-1] > 0.0]
    opposite = np.searchsorted(rates, -positive)
    paired = rates[opposite] == -positive
    plus = means[np.searchsorted(rates, positive[paired])]
    minus = means[opposite[paired]]
    columns = (positive[paired], (plus - minus) / (2.0 * positive[paired]), (plus + minus) / 2.0)
    return [Pair(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]
