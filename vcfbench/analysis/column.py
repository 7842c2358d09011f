"""One series of a calibration as reported: plain numbers, which compare, hash and pickle."""

from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.values.value import Value


class FittedValue(Value, frozen=True):
    """A value of a line through points; of points alone it has no `u`, and is incomplete."""

    if TYPE_CHECKING:
        value: float
    u_fit: float | None = None
    """Standard uncertainty by the fit and the readings alone."""

    def in_results(self) -> dict[str, Any]:
        """Return the series in the form of ``result.json``."""
        found = {"value": self.value, "u": self.u, "unit": self.unit, "u_fit": self.u_fit}
        return {**found, "complete": not self.missing, "missing": self.missing}


class TypeA(Struct, frozen=True):
    """Uncertainty by the noise of the readings alone (Type A), apart from the lack of fit of a straight line."""

    u_scale_factor: float
    """Standard uncertainty of the slope from the readings' own scatter, V/(deg/s)."""
    u_bias: float
    """The same of the intercept, V."""
    u_output_v: float
    """Root mean square of the standard uncertainties of the points, V."""
    lack_of_fit_v: float
    """Residual standard deviation beyond that noise, V."""


class Nonlinearity(Struct, frozen=True):
    """Non-linearity by every definition in use, ppm; None where the points do not allow the definition.

    The names are those of :data:`vcfbench.analysis.nonlinearity.DEFINITIONS`, which says in words what each means.

    >>> f"{run.results.nonlinearity_ppm.max_fs:.0f} ppm of full scale"
    '368 ppm of full scale'
    """

    max_span: float | None
    max_span_rounded: float | None
    max_fs: float | None
    max_out: float | None
    rms_fs: float | None
    sd_fs: float | None
    pp_fs: float | None
    bsl_fs: float | None
    endpoint_span: float | None
    reading: float | None
    asym: float | None
    asym_common: float | None


class CubicFit(Struct, frozen=True):
    """A least-squares cubic of the output in the rate, ``c0 + c1 rate + c2 rate^2 + c3 rate^3``, V/(deg/s)^i."""

    c0: float
    c1: float
    c2: float
    c3: float
    s_v: float | None
    """Residual standard deviation, V; None when no degree of freedom is left."""
    max_span_ppm: float
    """Largest residual over the span of the line, ppm."""


class Pair(Struct, frozen=True):
    """Chopped scale factor and even part of the points at +`rate_deg_s` and -`rate_deg_s`."""

    rate_deg_s: float
    scale_factor: float
    """Chopped scale factor, V/(deg/s)."""
    even_v: float
    """Half the sum of the two outputs, V."""


class CalibrationColumn(Struct, frozen=True, kw_only=True):
    """One column of outputs against rates: the line ``output = scale_factor * rate + bias`` and its residuals.

    >>> column = run.results  # TurntableResult is one
    >>> f"{column.scale_factor.value:.5f} V/(deg/s), bias {column.bias_deg_s:.2f} deg/s"
    '-0.01256 V/(deg/s), bias 3.29 deg/s'
    """

    scale_factor: FittedValue
    """Slope; its `u_fit` is from the scatter about the line, never less than the noise alone."""
    bias: FittedValue
    """Intercept, likewise."""
    nonlinearity_ppm: Nonlinearity
    asymmetry_ppm: float | None
    """Difference of the slopes on the two sides of zero, each with its own intercept."""
    bias_deg_s: float
    """The bias as an equivalent rate, sign kept."""
    zero_v: float | None
    """Mean output at rate 0, and the same as an equivalent rate; None when it was not measured."""
    zero_deg_s: float | None
    s_v: float
    """Residual standard deviation with `dof` degrees of freedom."""
    dof: int
    """Degrees of freedom of the line, n - 2."""
    coverage_factor: float
    """Two-sided 95 % quantile of Student's t with `dof` degrees of freedom."""
    u95_fit_ppm: float
    """Expanded uncertainty of the slope by the fit alone at 95 %, relative to the slope."""
    covariance: float
    """Covariance of slope and intercept, V^2/(deg/s)."""
    type_a: TypeA | None
    """None when the noise of the points is not known."""
    polynomial: CubicFit | None
    """None with fewer than four different rates."""
    pairs: tuple[Pair, ...]
    """Pairs of points at +rate and -rate, by falling magnitude."""
    residuals_v: tuple[float, ...]
    """Output minus line, in the order of the points."""
    durbin_watson: float | None
    """2 for independent residuals, towards 0 for a trend left in them; None when there are none."""
    sign_runs: int
    """Runs of equal sign of the residuals, in their order."""
