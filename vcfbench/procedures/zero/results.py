"""What a static record comes to: Allan curve, noise coefficients, bias stability, mean and trend, and their report."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from vcfbench.analysis.allan import Noise, allan_deviation, averaging_factors, confidence_interval, equivalent_dof
from vcfbench.analysis.bias_stability import BiasStability, bias_stability
from vcfbench.analysis.noise_fit import NoiseFit, Term, fit_noise
from vcfbench.analysis.sampling import Sampling, deviation_factor
from vcfbench.analysis.type_a import TypeAUncertainty, u_of_combination, u_of_mean
from vcfbench.report.digits import stated_cells
from vcfbench.report.document import Axis, Cell, Column, Figure, Report, Series, Table, Text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from vcfbench.analysis.allan import AllanPoint
    from vcfbench.procedures.known.scale_factor import ScaleFactor

__all__ = ["AllanRow", "Estimate", "NoiseCoefficient", "Stability", "ZeroResult", "zero_report", "zero_results"]

_DEG_H = 3600.0
"""deg/h in a deg/s."""
_DEG_RTH = 60.0
"""deg/sqrt(h) in a deg/sqrt(s)."""
_CONFIDENCE = 0.95
_PER_OCTAVE = 2
_WINDOWS = 60
"""Means that the trend is a straight line through."""
_USUAL = (Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY, Term.RATE_RANDOM_WALK, Term.RATE_RAMP)
_STANDS_OUT = {Term.BIAS_INSTABILITY: 1.0, Term.RATE_RANDOM_WALK: 3.0, Term.RATE_RAMP: 3.0}
"""Terms that grow with time count for mean and trend from so many standard uncertainties of their squares on."""
_FIRST, _BEYOND, _LEAST_FITTED = 3, 5.0, 8
"""A fit holds where none of so many shortest averages misses it by so many standard deviations; of so many points."""
_UNITS = {
    Term.QUANTISATION: (3600.0, "arcsec"),
    Term.ANGLE_RANDOM_WALK: (_DEG_RTH, "deg/sqrt(h)"),
    Term.BIAS_INSTABILITY: (_DEG_H, "deg/h"),
    Term.RATE_RANDOM_WALK: (_DEG_H * 60.0, "(deg/h)/sqrt(h)"),
    Term.RATE_RAMP: (_DEG_H**2, "(deg/h)/h"),
}
"""From the units of the fit, seconds and degrees, to those that data sheets have."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value, its standard uncertainty with the degrees of freedom of that, and the half width of 95 %."""

    value: float
    u: float
    dof: float | None
    """None: as many as one likes."""
    u_95: float | None
    """None where `dof` is below 1: so little does not tell an interval."""
    unit: str


@dataclass(frozen=True, slots=True)
class NoiseCoefficient:
    """A coefficient of the Allan curve; `u` None where it comes out as 0, and `upper_95` is all that can be said.

    `value` is None as well where it is not known how much white noise a reading lets through: N may be anything below.
    """

    name: str
    value: float | None
    u: float | None
    upper_95: float
    unit: str


@dataclass(frozen=True, slots=True)
class AllanRow:
    """The curve at one averaging time, deg/h: as the record shows it with 95 % bounds, and without its dead time.

    `edf` are the degrees of freedom under the noise that was fitted; `fit` is the fitted curve of the gapless noise.
    """

    tau_s: float
    observed: float
    low: float
    high: float
    edf: float
    corrected: float | None
    fit: float | None


@dataclass(frozen=True, slots=True)
class Stability:
    """Bias stability by every definition in use, deg/h; None where the record is too short for it."""

    sd_1_s: float | None
    sd_10_s: float | None
    sd_100_s: float | None
    sd_10_s_detrended: float | None
    peak_to_peak_10_s: float | None
    allan_minimum: float
    allan_minimum_low: float
    allan_minimum_high: float
    allan_minimum_tau_s: float
    bias_instability_read_off: float


@dataclass(frozen=True, slots=True)
class ZeroResult:
    """A static record. `mode` says what was done about its dead time; rates are outputs over the scale factor."""

    mode: str
    samples: int
    interval_s: float
    aperture_s: float
    dead_share: float
    """Part of the time that no reading saw."""
    white_noise_seen: float
    """By how much the record's white noise is larger than that of a gapless one."""
    scale_factor_v_per_deg_s: ScaleFactor
    allan_deg_h: tuple[AllanRow, ...]
    noise: tuple[NoiseCoefficient, ...]
    """The fitted coefficients; none where the record scatters by less than the meter resolves."""
    angle_random_walk_as_read: float
    """N of the record as it stands, deg/sqrt(h): what its dead time folds in is in it."""
    stability_deg_h: Stability
    output_v: Estimate | None
    bias: Estimate | None
    """deg/s: the mean as one of such means, Earth's rate along the axis in it; None as above."""
    trend: Estimate | None
    bias_v: float
    bias_deg_s: float
    noise_bandwidth_hz: Estimate | None = None
    """Of one reading, where it was measured: without gaps. What a record with dead time can be corrected by."""
    fitted_from_s: float = 0.0
    """The shortest averaging time in the fit: where readings follow each other fast, what passes at the mode split
    swings from one to the next, and shorter ones follow no power of the time."""

    def acceptance_values(self) -> Mapping[str, float | None]:
        """Return what ``[acceptance]`` limits."""
        return {"bias_v": self.bias_v, "bias_deg_s": self.bias_deg_s}

    @property
    def flicker(self) -> tuple[float, float] | None:
        """The coefficient B with its standard uncertainty, deg/h; None where none was found."""
        found = next((each for each in self.noise if each.name == "bias instability"), None)
        if found is None or not found.value or not found.u:
            return None
        return found.value, found.u

    def coefficient(self, name: str) -> NoiseCoefficient:
        """Return the coefficient of that name, ``"angle random walk"``; KeyError where it was not found."""
        return {each.name: each for each in self.noise}[name]


def zero_results(
    volts: NDArray[np.float64],
    times_s: NDArray[np.float64],
    sampling: Sampling,
    scale: ScaleFactor,
    mode: str,
    *,
    raw: tuple[NDArray[np.float64], int] | None = None,
) -> ZeroResult:
    """Return what the record of `volts` comes to, one mean every ``sampling.interval_s``.

    Args:
        volts: the output, V, shape (n,).
        times_s: when each raw reading was asked for, s; several make one of `volts` in a record without gaps.
        sampling: how the record was taken.
        scale: what turns volts into rates.
        mode: ``"dead-time"`` fits the record as it stands.
        raw: the readings that `volts` are means of, V, and of how many; None where they are the same.
    """
    rates = volts / scale.value
    fitted = Sampling.without_gaps(sampling.interval_s) if mode == "dead-time" else sampling
    curve = allan_deviation(
        rates, sampling.interval_s, averaging_factors(rates.size, _PER_OCTAVE), confidence=_CONFIDENCE
    )
    follows = _follows(curve, rates.size, fitted, gapless=sampling.gapless)
    fit = _fit(follows, rates.size, fitted, gapless=sampling.gapless)
    curve = curve if fit is None else _with_honest_bounds(curve, rates.size, fitted, fit)
    walk = _walk_as_it_stands(follows, rates.size, sampling.interval_s)
    bias, trend = _mean_and_trend(
        rates, fitted, None if fit is None else _terms_shown(follows, rates.size, fitted, fit)
    )
    return ZeroResult(
        mode=mode,
        samples=rates.size,
        interval_s=sampling.interval_s,
        aperture_s=sampling.aperture_s,
        dead_share=_dead_share(times_s, rates.size, sampling),
        white_noise_seen=deviation_factor(sampling, Noise.WHITE),
        scale_factor_v_per_deg_s=scale,
        allan_deg_h=tuple(_row(point, fitted, fit, corrected=mode != "dead-time") for point in curve),
        noise=() if fit is None else _coefficients(fit, passed=_is_passed(sampling, mode)),
        angle_random_walk_as_read=_DEG_RTH * walk,
        stability_deg_h=_stability(bias_stability(rates, sampling, curve)),
        output_v=None if bias is None else _scaled(bias, scale.value, "V"),
        bias=bias,
        trend=trend,
        bias_v=float(volts.mean()),
        bias_deg_s=float(rates.mean()),
        noise_bandwidth_hz=None if fit is None or raw is None else _noise_bandwidth(raw[0] / scale.value, raw[1], fit),
        fitted_from_s=follows[0].tau_s,
    )


def _is_passed(sampling: Sampling, mode: str) -> bool:
    """Tell whether it is known how much white noise a reading lets through, or nobody wants to correct for it."""
    return mode == "dead-time" or sampling.gapless or sampling.noise_bandwidth_hz is not None


def _noise_bandwidth(readings: NDArray[np.float64], a_mean: int, fit: NoiseFit) -> Estimate | None:
    """Return the noise bandwidth of one reading, Hz: half the mean square of differences over an interval, over 2 N^2.

    Readings so far apart share nothing of what the split lets through; of flicker the difference holds some per cent.
    """
    walk = fit.terms[Term.ANGLE_RANDOM_WALK]
    if walk.u is None or not walk.value > 0.0:
        return None
    value = 0.5 * float(np.mean((readings[a_mean:] - readings[:-a_mean]) ** 2)) / (2.0 * walk.value**2)
    u = value * math.hypot(2.0 * walk.u / walk.value, math.sqrt(3.0 / readings.size))
    return Estimate(value, u, None, 1.959964 * u, "Hz")


def _fit(curve: Sequence[AllanPoint], samples: int, sampling: Sampling, *, gapless: bool) -> NoiseFit | None:
    """Fit N, B, K, R, without gaps Q as well, since what passes at the split falls as 1/tau; None without noise."""
    if any(point.deviation <= 0.0 for point in curve):
        return None
    return fit_noise(curve, samples, sampling, (Term.QUANTISATION, *_USUAL) if gapless else _USUAL)


def _follows(curve: Sequence[AllanPoint], samples: int, sampling: Sampling, *, gapless: bool) -> Sequence[AllanPoint]:
    """Return the curve from the averaging time on from which it is what the terms can make.

    Short averages of many readings are known so well that one that no term describes would bend all others.
    """
    for start in range(len(curve) - _LEAST_FITTED):
        rest = curve[start:]
        fit = _fit(rest, samples, sampling, gapless=gapless)
        if fit is None or not any(_misses(point, sampling, fit) for point in rest[:_FIRST]):
            return rest
    return curve


def _misses(point: AllanPoint, sampling: Sampling, fit: NoiseFit) -> bool:
    """Tell whether a point lies beyond `_BEYOND` of its standard deviations from the fit."""
    fitted = fit.variance(sampling, round(point.tau_s / sampling.interval_s))[0]
    return abs(point.deviation**2 - fitted) > _BEYOND * fitted * math.sqrt(2.0 / point.edf)


def _terms_shown(curve: Sequence[AllanPoint], samples: int, sampling: Sampling, fit: NoiseFit) -> NoiseFit:
    """Return the fit of those terms alone that stand out of their own uncertainty (`_STANDS_OUT`).

    What does not would be carried from the longest averaging time to the whole record, and make its mean and trend
    uncertain beyond any use; its upper limit is among the coefficients.
    """
    while shown := [term for term in fit.terms if _stands_out(term, fit)]:
        if len(shown) == len(fit.terms):
            break
        fit = fit_noise(curve, samples, sampling, shown)
    return fit


def _stands_out(term: Term, fit: NoiseFit) -> bool:
    """Tell whether the square of a coefficient, which is what is estimated, is so many of its uncertainties."""
    found = fit.terms[term]
    return found.u is not None and found.value > 2.0 * _STANDS_OUT.get(term, 0.0) * found.u


def _with_honest_bounds(
    curve: Sequence[AllanPoint], samples: int, sampling: Sampling, fit: NoiseFit
) -> list[AllanPoint]:
    """Return the curve with the degrees of freedom that its own noise leaves it, not those of white noise."""
    law = fit.coefficients.phase_noise(sampling)
    points = []
    for point in curve:
        edf = equivalent_dof(samples, round(point.tau_s / sampling.interval_s), law)
        low, high = confidence_interval(edf, _CONFIDENCE)
        points.append(type(point)(point.tau_s, point.deviation, edf, low * point.deviation, high * point.deviation))
    return points


def _walk_as_it_stands(curve: Sequence[AllanPoint], samples: int, interval_s: float) -> float:
    """Return N of the record taken for gapless, deg/sqrt(s): fitted where it can be, else read off at the shortest."""
    fit = _fit(curve, samples, Sampling.without_gaps(interval_s), gapless=False)
    return curve[0].deviation * math.sqrt(curve[0].tau_s) if fit is None else fit.coefficients.angle_random_walk


def _dead_share(times_s: NDArray[np.float64], means: int, sampling: Sampling) -> float:
    """Return the part of the record that no reading saw; between bursts without gaps the times tell it."""
    if not sampling.gapless:
        return 1.0 - sampling.aperture_s / sampling.interval_s
    seen_s = means * sampling.interval_s
    reading_s = seen_s / times_s.size
    return max(0.0, 1.0 - seen_s / (float(times_s[-1] - times_s[0]) + reading_s))


def _row(point: AllanPoint, sampling: Sampling, fit: NoiseFit | None, *, corrected: bool) -> AllanRow:
    observed, low, high = _DEG_H * point.deviation, _DEG_H * point.low, _DEG_H * point.high
    if fit is None:
        return AllanRow(point.tau_s, observed, low, high, point.edf, None, None)
    gapless = math.sqrt(float(fit.coefficients.variance(point.tau_s)[0]))
    seen = math.sqrt(fit.variance(sampling, round(point.tau_s / sampling.interval_s))[0])
    without = _DEG_H * point.deviation * gapless / seen if corrected else None
    return AllanRow(point.tau_s, observed, low, high, point.edf, without, _DEG_H * gapless)


def _coefficients(fit: NoiseFit, *, passed: bool) -> tuple[NoiseCoefficient, ...]:
    """Return them in the units of data sheets; where it is not known what a reading lets pass, N has a bound only."""
    found = []
    for term, each in fit.terms.items():
        factor, unit = _UNITS[term]
        known = passed or term is not Term.ANGLE_RANDOM_WALK
        value, u = (factor * each.value if known else None), (factor * each.u if known and each.u is not None else None)
        found.append(NoiseCoefficient(term.value, value, u, factor * each.upper_95, unit))
    return tuple(found)


def _stability(found: BiasStability) -> Stability:
    def deg_h(value: float | None) -> float | None:
        return None if value is None else _DEG_H * value

    return Stability(
        deg_h(found.sd_1_s),
        deg_h(found.sd_10_s),
        deg_h(found.sd_100_s),
        deg_h(found.sd_10_s_detrended),
        deg_h(found.peak_to_peak_10_s),
        _DEG_H * found.floor,
        _DEG_H * found.floor_low,
        _DEG_H * found.floor_high,
        found.floor_tau_s,
        _DEG_H * found.bias_instability,
    )


def _mean_and_trend(
    rates: NDArray[np.float64], sampling: Sampling, fit: NoiseFit | None
) -> tuple[Estimate | None, Estimate | None]:
    """Return mean (deg/s) and slope ((deg/h)/h) with what the fitted noise leaves them uncertain by."""
    if fit is None:
        return None, None
    mean = _estimate(float(rates.mean()), u_of_mean(fit, sampling, rates.size), 1.0, "deg/s")
    edges = np.linspace(0, rates.size, _WINDOWS + 1).round().astype(int)
    means = np.array([rates[a:b].mean() for a, b in pairwise(edges.tolist())])
    begin_s, end_s = edges[:-1] * sampling.interval_s, edges[1:] * sampling.interval_s
    middle_s = 0.5 * (begin_s + end_s)
    away_s = middle_s - middle_s.mean()
    weights = away_s / float(away_s @ away_s)
    u = u_of_combination(_without_ramp(fit), sampling, begin_s, end_s, weights)
    return mean, _estimate(float(weights @ means), u, _DEG_H**2, "(deg/h)/h")


def _without_ramp(fit: NoiseFit) -> NoiseFit:
    """Return the noise alone: a ramp is what the trend shows, and not what it is uncertain by."""
    covariance = fit.covariance_of_squares.copy()
    covariance[-1, :] = covariance[:, -1] = 0.0
    return replace(fit, coefficients=replace(fit.coefficients, rate_ramp=0.0), covariance_of_squares=covariance)


def _estimate(value: float, found: TypeAUncertainty, factor: float, unit: str) -> Estimate:
    from scipy.special import stdtrit  # noqa: PLC0415 - SciPy costs more to import than all the rest

    u, dof = factor * found.u, found.dof if math.isfinite(found.dof) else None
    if dof is not None and dof < 1.0:
        return Estimate(factor * value, u, dof, None, unit)
    coverage = 1.959964 if dof is None else float(stdtrit(dof, 0.5 + 0.5 * _CONFIDENCE))
    return Estimate(factor * value, u, dof, coverage * u, unit)


def _scaled(found: Estimate, factor: float, unit: str) -> Estimate:
    u_95 = None if found.u_95 is None else found.u_95 * abs(factor)
    return Estimate(found.value * factor, found.u * abs(factor), found.dof, u_95, unit)


def zero_report(results: ZeroResult, *, bandwidth_stated: bool) -> Report:
    """Report a static record: how it was taken, what it comes to, the Allan table and its figure."""
    return Report(
        [
            Text(_taken(results, bandwidth_stated=bandwidth_stated)),
            _noise_table(results),
            _bias_table(results),
            _stability_table(results.stability_deg_h),
            _allan_table(results),
            Text("\n".join([*_for_budgets(results), _WHAT_U_HOLDS])),
            _figure(results),
        ]
    )


def _for_budgets(results: ZeroResult) -> list[str]:
    """Say what budgets may know of the flicker, as the key of the bench file; nothing where none was found."""
    found = results.flicker
    return [] if found is None else [f"for [uncertainty] of the bench file: bias_instability_deg_h = {found[0]:.3g}"]


_WHAT_U_HOLDS = """\
u is the standard uncertainty that the noise of this very record leaves, all averaging times and their correlations
counted (type A). It does not hold the scale factor's, nor the meter's offset, nor how far the bias wanders in times
longer than the record. The mean holds the Earth's rate along the axis."""


def _taken(results: ZeroResult, *, bandwidth_stated: bool) -> str:
    scale = results.scale_factor_v_per_deg_s
    lines = [f"scale factor {scale.value:.6g} V/(deg/s): {scale.source}"]
    if results.mode == "gapless":
        lines.append(
            f"readings without gaps, means over {results.interval_s:g} s; {100.0 * results.dead_share:.2f} % of the "
            "time was lost between bursts"
        )
        if (found := results.noise_bandwidth_hz) is not None:
            band = f"{found.value:.2f} Hz, u {found.u:.2f}"
            lines.append(f"noise bandwidth of one reading {band}: noise_bandwidth_hz of records with dead time")
        return "\n".join([*lines, *_left_out(results)])
    lines.append(
        f"one reading of {results.aperture_s:g} s every {results.interval_s:g} s: white noise is seen "
        f"{results.white_noise_seen:.3g} times too large, {results.angle_random_walk_as_read:.3g} deg/sqrt(h) as it "
        "stands"
    )
    if results.mode == "dead-time":
        lines.append("NOT corrected: N and the curve hold what the dead time folds in")
    elif not bandwidth_stated and results.white_noise_seen > 1.0:
        lines.append(
            "corrected with a noise bandwidth of 1 / (2 integration time), the least that a reading can have: a sense "
            "mode with a split lets more through, so N has an upper bound only; set noise_bandwidth_hz, or measure it "
            "with mode=gapless"
        )
    return "\n".join([*lines, *_left_out(results)])


def _left_out(results: ZeroResult) -> list[str]:
    if results.fitted_from_s <= results.allan_deg_h[0].tau_s:
        return []
    from_s = f"fitted from {results.fitted_from_s:g} s on: what passes at the mode split swings from reading to reading"
    return [f"{from_s}, and shorter averages follow no power of the time"]


def _noise_table(results: ZeroResult) -> Table | Text:
    if not results.noise:
        return Text("no noise: the readings scatter by less than the meter resolves")
    columns = [Column("noise", align="left"), Column("value", format=".4g"), Column("u", format=".2g")]
    rows = [(each.name, each.value, each.u, each.upper_95, each.unit) for each in results.noise]
    return Table([*columns, Column("below, 95 %", format=".3g"), Column("unit", align="left")], rows)


def _bias_table(results: ZeroResult) -> Table:
    columns = [Column("", align="left"), Column("value", format=".6g"), Column("u", format=".2g")]
    columns += [Column("dof", format=".3g"), Column("U95", format=".2g"), Column("unit", align="left")]
    named: list[tuple[str, Estimate | None, float, str]] = [
        ("output, mean", results.output_v, results.bias_v, "V"),
        ("bias, mean", results.bias, results.bias_deg_s, "deg/s"),
    ]
    rows: list[Any] = [
        (name, value, None, None, None, unit) if found is None else (name, *_cells(found))
        for name, found, value, unit in named
    ]
    if results.trend is not None:
        rows.append(("trend", *_cells(results.trend)))
    return Table(columns, rows)


def _cells(found: Estimate) -> tuple[Any, ...]:
    value, u, u_95 = stated_cells(found.value, found.u, found.u_95 or found.u)
    return (value, u, found.dof, "not found" if found.u_95 is None else u_95, found.unit)


def _stability_table(found: Stability) -> Table:
    rows: list[Any] = [
        ("standard deviation of 1-s means", found.sd_1_s),
        ("standard deviation of 10-s means", found.sd_10_s),
        ("standard deviation of 100-s means", found.sd_100_s),
        ("the same of 10-s means about their line", found.sd_10_s_detrended),
        ("10-s means, peak to peak", found.peak_to_peak_10_s),
        (f"Allan minimum, at {found.allan_minimum_tau_s:g} s", found.allan_minimum),
        ("Allan minimum / 0.664", found.bias_instability_read_off),
    ]
    return Table([Column("bias stability", align="left"), Column("value", "deg/h", ".3g")], rows)


def _allan_table(results: ZeroResult) -> Table:
    columns = [Column("tau", "s", "g"), Column("Allan deviation", "deg/h", ".3f"), Column("low 95 %", "deg/h", ".3f")]
    columns += [Column("high 95 %", "deg/h", ".3f"), Column("edf", format=".3g")]
    columns += [Column("without dead time", "deg/h", ".3f"), Column("fit", "deg/h", ".3f")]
    rows = [(r.tau_s, r.observed, r.low, r.high, r.edf, r.corrected, r.fit) for r in results.allan_deg_h]
    return Table(columns, [tuple(Cell(None) if value is None else value for value in row) for row in rows])


def _figure(results: ZeroResult) -> Figure | Text:
    rows = [row for row in results.allan_deg_h if row.observed > 0.0]
    if not rows:
        return Text("no Allan figure: there is no noise to draw")
    tau = [row.tau_s for row in rows]
    low, high = [row.low for row in rows], [row.high for row in rows]
    series = [Series("as the record shows it", tau, [row.observed for row in rows], low=low, high=high)]
    if all(row.corrected is not None for row in rows) and results.white_noise_seen > 1.0:
        series.append(Series("without dead time", tau, [row.corrected or 0.0 for row in rows]))
    if all(row.fit is not None for row in rows):
        series.append(Series("fit, gapless", tau, [row.fit or 0.0 for row in rows], kind="line"))
    axes = Axis("averaging time", "s", "log"), Axis("Allan deviation", "deg/h", "log")
    return Figure("Allan deviation of the output at rest", *axes, series, "The band holds the true value with 95 %.")
