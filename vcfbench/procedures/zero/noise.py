"""Noise of a record of rates: Allan curve with honest bounds, coefficients N, B, K, R, stability; tables and figure."""

import math
from collections.abc import Sequence
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis import allan
from vcfbench.analysis.allan import BiasStability, Sampling, Term, bias_stability, deviation_factor
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.noise_fit import NoiseFit, fit_noise, fit_shown_noise
from vcfbench.reports.document import Axis, Figure, Series, Table, Text, heads

_DEG_H = 3600.0
"""deg/h in a deg/s."""
_DEG_RTH = 60.0
"""deg/sqrt(h) in a deg/sqrt(s)."""
_CONFIDENCE = 0.95
_ONE_SIDED = 1.645
"""Standard uncertainties up to a bound of 95 %."""
_PER_OCTAVE = 2
_ALWAYS = (Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY)
_PERHAPS = (Term.RATE_RANDOM_WALK, Term.RATE_RAMP)
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


class NoiseCoefficient(Struct, frozen=True):
    """A coefficient of the Allan curve; `u` None where it comes out as 0, and `upper_95` is all that can be said.

    `value` is None as well where it is not known how much white noise a reading lets through: N may be anything below.
    """

    name: str
    value: float | None
    u: float | None
    upper_95: float
    unit: str


class AllanRow(Struct, frozen=True):
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


class RecordNoise(Struct, frozen=True):
    """Noise of a record: the fit (None without noise), the rows of its Allan curve, coefficients, stability."""

    fit: NoiseFit | None
    rows: tuple[AllanRow, ...]
    coefficients: tuple[NoiseCoefficient, ...]
    stability: BiasStability
    walk_as_read_deg_rth: float
    """N of the record as it stands, deg/sqrt(h)."""
    fitted_from_s: float


def record_noise(rates_deg_s: Floats, sampling: Sampling, *, corrected: bool, u_bandwidth_hz: float) -> RecordNoise:
    """Return the noise of `rates_deg_s`, one every ``sampling.interval_s``.

    Args:
        rates_deg_s: the record, deg/s, shape (n,).
        sampling: how it was taken.
        corrected: whether dead time is taken out; else the record counts as gapless.
        u_bandwidth_hz: standard uncertainty of the noise bandwidth in `sampling`, Hz.
    """
    fitted = sampling if corrected else Sampling.without_gaps(sampling.interval_s)
    size, gapless = rates_deg_s.size, Sampling.without_gaps(sampling.interval_s)
    factors = allan.averaging_factors(size, _PER_OCTAVE)
    curve = allan.allan_deviation(rates_deg_s, sampling.interval_s, factors, confidence=_CONFIDENCE)
    follows, fit = _followed(curve, size, fitted, gapless=sampling.gapless)
    if fit is not None and not fit.coefficients.squares()[:-1].any():
        fit = None  # a drift alone: of noise beside it nothing can be told
    if fit is None:  # N is read off at the shortest time
        walk = follows[0].deviation * math.sqrt(follows[0].tau_s)
    else:
        walk = fit_noise(follows, size, gapless, _ALWAYS).coefficients.angle_random_walk
        fit = with_what_is_let_through(fit, fitted, u_bandwidth_hz)
        # The degrees of freedom that its own noise leaves the curve, not those of white noise
        law, points = fit.coefficients.phase_noise(fitted), []
        for tau_s, deviation in [(point.tau_s, point.deviation) for point in curve]:
            edf = allan.equivalent_dof(size, round(tau_s / fitted.interval_s), law)
            low, high = allan.confidence_interval(edf, _CONFIDENCE)
            points.append(allan.AllanPoint(tau_s, deviation, edf, low * deviation, high * deviation))
        curve = points
    # In the units of data sheets; where the noise bandwidth of a reading is not known, but corrected for, N is a bound
    passed = not corrected or sampling.gapless or sampling.noise_bandwidth_hz is not None
    coefficients = []
    for term, each in ({} if fit is None else fit.terms).items():
        factor, unit = _UNITS[term]
        known = passed or term is not Term.ANGLE_RANDOM_WALK
        value, u = (factor * each.value if known else None), (factor * each.u if known and each.u is not None else None)
        coefficients.append(NoiseCoefficient(term.value, value, u, factor * each.upper_95, unit))
    rows = []
    for point in curve:
        observed, low, high = (_DEG_H * each for each in (point.deviation, point.low, point.high))
        without = fit_deg_h = None
        if fit is not None:
            gapless_deg_s = math.sqrt(float(fit.coefficients.variance(point.tau_s)[0]))
            seen = math.sqrt(fit.variance(fitted, round(point.tau_s / fitted.interval_s))[0])
            without = _DEG_H * point.deviation * gapless_deg_s / seen if corrected else None
            fit_deg_h = _DEG_H * gapless_deg_s
        rows.append(AllanRow(point.tau_s, observed, low, high, point.edf, without, fit_deg_h))
    return RecordNoise(
        fit,
        tuple(rows),
        tuple(coefficients),
        bias_stability(rates_deg_s, sampling, curve, _DEG_H),
        _DEG_RTH * walk,
        follows[0].tau_s,
    )


def with_what_is_let_through(fit: NoiseFit, sampling: Sampling, u_bandwidth_hz: float) -> NoiseFit:
    """Return the fit, with N's uncertainty by the noise bandwidth of a reading, and by noise that dead time folds in.

    Of flicker between readings it is known neither how far up it goes nor how it goes on there. The fit has taken all
    that a 1/f without end would fold in out of N; anything from that to nothing is as likely, so half of it is given
    back, and the other half is a rectangular limit (ours).
    """
    walk = fit.terms[Term.ANGLE_RANDOM_WALK]
    if sampling.gapless or not walk.value:
        return fit
    white = (deviation_factor(sampling, Term.ANGLE_RANDOM_WALK) * walk.value) ** 2 / sampling.interval_s
    folded = deviation_factor(sampling, Term.BIAS_INSTABILITY) ** 2 - 1.0
    folded *= (allan.BIAS_INSTABILITY_FACTOR * fit.terms[Term.BIAS_INSTABILITY].value) ** 2
    let_through = u_bandwidth_hz / sampling.noise_bandwidth_hz if sampling.noise_bandwidth_hz else 0.0
    value = walk.value * (1.0 + 0.25 * folded / white)
    besides = 0.5 * walk.value * math.hypot(let_through, 0.5 * folded / white / math.sqrt(3.0))
    upper = value + math.hypot(walk.upper_95 - walk.value, _ONE_SIDED * besides)
    wider = replace(walk, value=value, u=math.hypot(walk.u or 0.0, besides), upper_95=upper)
    return replace(fit, terms={**fit.terms, Term.ANGLE_RANDOM_WALK: wider})


def _followed(
    curve: Sequence[allan.AllanPoint], samples: int, sampling: Sampling, *, gapless: bool
) -> tuple[Sequence[allan.AllanPoint], NoiseFit | None]:
    """Return the curve from the shortest averaging time on that the terms can describe, and their fit, None: no noise.

    They are N and B, without gaps Q as well, as noise passed at the split falls as 1/tau; K and R where they are shown.
    Short averages of many readings are known so well that one that no term describes would bend all others.
    """
    if any(point.deviation <= 0.0 for point in curve):
        return curve, None
    always = (Term.QUANTISATION, *_ALWAYS) if gapless else _ALWAYS

    def misses(point: allan.AllanPoint, fit: NoiseFit) -> bool:
        fitted = fit.variance(sampling, round(point.tau_s / sampling.interval_s))[0]
        return abs(point.deviation**2 - fitted) > _BEYOND * fitted * math.sqrt(2.0 / point.edf)

    for start in range(len(curve) - _LEAST_FITTED):
        fit = fit_shown_noise(curve[start:], samples, sampling, always, _PERHAPS)
        if not any(misses(point, fit) for point in curve[start : start + _FIRST]):
            return curve[start:], fit
    return curve, fit_shown_noise(curve, samples, sampling, always, _PERHAPS)


def noise_table(noise: Sequence[NoiseCoefficient]) -> Table | Text:
    """Return the coefficients, or words where there are none."""
    if not noise:
        return Text(
            "no noise: the readings scatter by less than the meter resolves, or a drift outweighs their noise at every "
            "averaging time: record at a constant temperature"
        )
    columns = heads("<noise | value:.4g | u:.2g | below, 95 %:.3g | <unit")
    return Table(columns, [(each.name, each.value, each.u, each.upper_95, each.unit) for each in noise])


def allan_table(rows: Sequence[AllanRow]) -> Table:
    """Return the Allan curve as a table, without a column that says nothing: a gapless record has no dead time."""
    columns = heads(
        "tau [s]:g | Allan deviation [deg/h]:.3f | low 95 % [deg/h]:.3f | high 95 % [deg/h]:.3f | edf:.3g | "
        "without dead time [deg/h]:.3f | fit [deg/h]:.3f"
    )
    cells = [(row.tau_s, row.observed, row.low, row.high, row.edf, row.corrected, row.fit) for row in rows]
    filled = [place for place in range(len(columns)) if any(row[place] is not None for row in cells)]
    return Table([columns[place] for place in filled], [[row[place] for place in filled] for row in cells])


def stability_table(found: BiasStability) -> Table:
    """Return every definition of the bias stability."""
    rows: list[Any] = [
        ("standard deviation of 1-s means", found.sd_1_s),
        ("standard deviation of 10-s means", found.sd_10_s),
        ("standard deviation of 100-s means", found.sd_100_s),
        ("the same of 10-s means about their line", found.sd_10_s_detrended),
        ("10-s means, peak to peak", found.peak_to_peak_10_s),
        (f"Allan minimum, at {found.allan_minimum_tau_s:g} s", found.allan_minimum),
        ("Allan minimum / 0.664", found.bias_instability_read_off),
    ]
    return Table(heads("<bias stability | value [deg/h]:.3g"), rows)


def allan_figure(all_rows: Sequence[AllanRow], white_noise_seen: float) -> Figure | Text:
    """Draw the Allan curve; where white noise is seen too large, that without dead time beside it."""
    rows = [row for row in all_rows if row.observed > 0.0]
    if not rows:
        return Text("no Allan figure: there is no noise to draw")
    tau = [row.tau_s for row in rows]
    low, high = [row.low for row in rows], [row.high for row in rows]
    series = [Series("as the record shows it", tau, [row.observed for row in rows], low=low, high=high)]
    if all(row.corrected is not None for row in rows) and white_noise_seen > 1.0:
        series.append(Series("without dead time", tau, [row.corrected or 0.0 for row in rows]))
    if all(row.fit is not None for row in rows):
        series.append(Series("fit, gapless", tau, [row.fit or 0.0 for row in rows], kind="line"))
    axes = Axis("averaging time", "s", "log"), Axis("Allan deviation", "deg/h", "log")
    return Figure("Allan deviation of the output at rest", *axes, series, "The band holds the true value with 95 %.")
