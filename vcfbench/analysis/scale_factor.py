"""A scale-factor calibration: everything that one column of outputs against rates is reported with."""

import math
from typing import Any

import numpy as np
from msgspec import Struct, json
from msgspec.structs import asdict
from numpy.typing import ArrayLike

from vcfbench.analysis import regression
from vcfbench.analysis.arrays import Floats, plain_uncertainties
from vcfbench.analysis.column import CalibrationColumn, CubicFit, FittedValue, Nonlinearity, Pair, TypeA
from vcfbench.analysis.nonlinearity import PAPER_DECIMALS, nonlinearity_ppm
from vcfbench.errors import ConfigError

SCALE_FACTOR_UNIT = "V/(deg/s)"
BIAS_UNIT = "V"


class ScaleFactorResult(Struct, frozen=True):
    """One column, characterised; `type_a` is None when the noise of the points is not known.

    >>> found = vcfbench.characterise([-100.0, 0.0, 100.0], [1.21, -0.04, -1.30])
    >>> f"{found.line.scale_factor:.5f} V/(deg/s), u of the fit {found.u_fit_scale_factor:.1g}"
    '-0.01255 V/(deg/s), u of the fit 3e-05'
    """

    rate_deg_s: Floats
    output_v: Floats
    line: regression.LineFit
    nonlinearity_ppm: dict[str, float | None]
    polynomial: regression.Polynomial | None
    """Third order; None with fewer than four different rates."""
    pairs: list[Pair]
    type_a: TypeA | None

    @property
    def u_fit_scale_factor(self) -> float:
        """Standard uncertainty of the slope: from the scatter about the line, never less than the noise alone."""
        return max(self.line.u_scale_factor, 0.0 if self.type_a is None else self.type_a.u_scale_factor)

    @property
    def u_fit_bias(self) -> float:
        """Standard uncertainty of the intercept, from the residuals."""
        return max(self.line.u_bias, 0.0 if self.type_a is None else self.type_a.u_bias)

    @property
    def asymmetry_ppm(self) -> float | None:
        """Difference of the slopes on the two sides of zero, each with its own intercept."""
        return self.nonlinearity_ppm["asym"]

    @property
    def zero_v(self) -> float | None:
        """Mean output at rate 0, V; None when it was not measured."""
        at_zero = self.output_v[self.rate_deg_s == 0.0]
        return float(at_zero.mean()) if at_zero.size else None

    def column(self, null_v: float = 0.0) -> CalibrationColumn:
        """Return everything that the column is reported with, as plain numbers; rates at rest count from `null_v`."""
        line, zero_v, cubic = self.line, self.zero_v, self.polynomial

        def fitted(value: float, unit: str, u_fit: float) -> FittedValue:  # nothing but the points is known
            return FittedValue("", value, unit, missing=("combined uncertainty",), u_fit=u_fit)

        polynomial = None
        if cubic is not None:
            span = abs(line.scale_factor) * float(np.ptp(self.rate_deg_s))
            c0, c1, c2, c3 = cubic.coefficients
            largest = float(np.abs(cubic.residuals_v).max())
            polynomial = CubicFit(c0, c1, c2, c3, s_v=cubic.s_v, max_span_ppm=1e6 * largest / span)
        return CalibrationColumn(
            scale_factor=fitted(line.scale_factor, SCALE_FACTOR_UNIT, self.u_fit_scale_factor),
            bias=fitted(line.bias, BIAS_UNIT, self.u_fit_bias),
            nonlinearity_ppm=Nonlinearity(**self.nonlinearity_ppm),
            asymmetry_ppm=self.asymmetry_ppm,
            bias_deg_s=(line.bias - null_v) / line.scale_factor,
            zero_v=zero_v,
            zero_deg_s=None if zero_v is None else (zero_v - null_v) / line.scale_factor,
            s_v=line.s_v,
            dof=line.dof,
            coverage_factor=line.coverage_factor,
            u95_fit_ppm=1e6 * line.coverage_factor * self.u_fit_scale_factor / abs(line.scale_factor),
            covariance=line.covariance,
            type_a=self.type_a,
            polynomial=polynomial,
            pairs=tuple(self.pairs),
            residuals_v=tuple(line.residuals_v.tolist()),
            durbin_watson=regression.durbin_watson(line.residuals_v),
            sign_runs=regression.sign_runs(line.residuals_v),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the series as plain values ready for JSON; full precision, each with its unit."""
        column = self.column()
        line = {"scale_factor": column.scale_factor.in_results(), "bias": column.bias.in_results()}
        found: dict[str, Any] = json.decode(json.encode({**asdict(column), **line}, enc_hook=float))
        return found


def characterise(rate_deg_s: ArrayLike, output_v: ArrayLike, u_output_v: ArrayLike | None = None) -> ScaleFactorResult:
    """Characterise one column of outputs.

    Args:
        rate_deg_s: applied rates, deg/s.
        output_v: mean output at each rate, V.
        u_output_v: standard uncertainty of each mean (or one for all), V; None when unknown.

    Raises:
        ConfigError: the points do not determine a line, the output does not follow the rate at all, or an uncertainty
            is none.

    >>> found = vcfbench.characterise([-100.0, 0.0, 100.0], [1.21, -0.04, -1.30], u_output_v=1e-4)
    >>> f"{1e3 * found.line.scale_factor:.2f} mV/(deg/s)"
    '-12.55 mV/(deg/s)'
    """
    rate, output = regression.checked_points(rate_deg_s, output_v)
    line = regression.fit_line(rate, output)
    if line.scale_factor == 0.0:
        raise ConfigError("the output does not follow the rate at all (scale factor 0)")
    type_a = None
    if u_output_v is not None:  # noise of the points through the least-squares sums, each with its own weight in them
        variance = np.broadcast_to(plain_uncertainties(u_output_v, rate.size, "V") ** 2, rate.shape)
        slope_weight = (rate - line.rate_mean_deg_s) / line.sxx
        bias_weight = 1.0 / rate.size - line.rate_mean_deg_s * slope_weight
        mean_variance = float(variance.mean())
        type_a = TypeA(
            u_scale_factor=math.sqrt(float(slope_weight**2 @ variance)),
            u_bias=math.sqrt(float(bias_weight**2 @ variance)),
            u_output_v=math.sqrt(mean_variance),
            lack_of_fit_v=math.sqrt(max(0.0, line.s_v**2 - mean_variance)),
        )
    return ScaleFactorResult(
        rate_deg_s=rate,
        output_v=output,
        line=line,
        nonlinearity_ppm=nonlinearity_ppm(rate, output, line),
        polynomial=regression.fit_polynomial(rate, output, 3) if len(set(rate.tolist())) > 3 else None,
        pairs=regression.sign_pairs(rate, output),
        type_a=type_a,
    )


def scale_factor_error_percent(reference: float, other: float, decimals: int | None = None) -> float | None:
    """Return the amount by which the magnitude of `other` is from that of `reference`, per cent of `reference`.

    The two scale factors are first rounded to `decimals` when it is given; the paper's 1.515 % comes from slopes
    rounded to five decimals, 1.533 % from the same slopes unrounded. None when the reference rounds to zero.
    """
    slopes = (reference, other) if decimals is None else (round(reference, decimals), round(other, decimals))
    first, second = slopes
    return 100.0 * (second / first - 1.0) if first else None


class Comparison(Struct, frozen=True):
    """Two calibrations of one gyroscope, the second against the first.

    >>> table = vcfbench.characterise([-100.0, 0.0, 100.0], [1.21, -0.04, -1.30])
    >>> virtual = vcfbench.characterise([-100.0, 0.0, 100.0], [1.23, -0.04, -1.32])
    >>> f"{vcfbench.compare(table, virtual).scale_factor_error_percent:.2f} %"
    '1.59 %'
    """

    scale_factor_error_percent: float
    scale_factor_error_percent_rounded: float | None
    """From slopes rounded to five decimals, as the paper does."""
    u_fit_scale_factor_error_percent: float
    """Standard uncertainty of the error from both fits, lack of fit included, percentage points."""
    e_n: float | None
    """Difference of the scale factors over the root of the sum of their squared 95 % uncertainties of the fits' scatter
    alone, lack of fit included. It lacks the systematic parts: above 1 is no verdict that they disagree, which
    `results.uncertainty.e_n` of a run gives. None when both fits are exact."""
    bias_difference_v: float
    zero_difference_v: float | None
    """Difference of the outputs at zero, V: the same physical state, reached in two ways."""
    residual_correlation: float | None
    """Correlation of the two columns' residuals, where both were measured at the same rates, to 5 %."""

    def as_json(self) -> dict[str, Any]:
        """Return the comparison as plain values ready for JSON."""
        return asdict(self)


def compare(reference: ScaleFactorResult, other: ScaleFactorResult) -> Comparison:
    """Compare `other` with `reference`.

    >>> may = vcfbench.characterise([-100.0, 0.0, 100.0], [1.21, -0.04, -1.30])
    >>> june = vcfbench.characterise([-100.0, 0.0, 100.0], [1.22, -0.03, -1.30])
    >>> f"bias moved by {vcfbench.compare(may, june).bias_difference_v:.4f} V"
    'bias moved by 0.0067 V'
    """
    first, second = reference.line, other.line
    ratio = second.scale_factor / first.scale_factor
    relative = math.hypot(
        reference.u_fit_scale_factor / first.scale_factor, other.u_fit_scale_factor / second.scale_factor
    )
    rates, residuals = (reference.rate_deg_s, other.rate_deg_s), (first.residuals_v, second.residuals_v)
    correlation = None
    if rates[0].shape == rates[1].shape and np.allclose(*rates, rtol=0.05, atol=0.0):
        correlation = float(np.corrcoef(*residuals)[0, 1]) if all(map(np.ptp, residuals)) else None
    both = math.hypot(*(each.line.coverage_factor * each.u_fit_scale_factor for each in (reference, other)))
    error = scale_factor_error_percent(first.scale_factor, second.scale_factor)
    assert error is not None  # noqa: S101 - `characterise` refuses a scale factor of zero
    return Comparison(
        scale_factor_error_percent=error,
        scale_factor_error_percent_rounded=scale_factor_error_percent(
            first.scale_factor, second.scale_factor, PAPER_DECIMALS
        ),
        u_fit_scale_factor_error_percent=100.0 * abs(ratio) * relative,
        e_n=abs(second.scale_factor - first.scale_factor) / both if both > 0.0 else None,
        bias_difference_v=second.bias - first.bias,
        zero_difference_v=None if reference.zero_v is None or other.zero_v is None else other.zero_v - reference.zero_v,
        residual_correlation=correlation,
    )
