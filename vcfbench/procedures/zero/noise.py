"""Noise of a record of rates: Allan curve with honest bounds, coefficients N, B, K, R, stability; tables and figure."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, Self

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis import allan
from vcfbench.analysis.allan import BiasStability, Sampling, Term, bias_stability, deviation_factor, spreads_of_means
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.digit import COARSE, Digit
from vcfbench.analysis.noise_fit import NoiseFit, fit_noise
from vcfbench.analysis.noise_model import NoiseModel, noise_model
from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.errors import ConfigError
from vcfbench.reports.document import Axis, Figure, Series, Table, Text, heads
from vcfbench.values.value import Form, Value

_DEG_H = 3600.0
"""deg/h in a deg/s."""
_DEG_RTH = 60.0
"""deg/sqrt(h) in a deg/sqrt(s)."""
_CONFIDENCE = 0.95
_ONE_SIDED = 1.645
"""Standard uncertainties up to a bound of 95 %."""
_PER_OCTAVE = 2
_ALWAYS = (Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY)
_USUAL_MARGIN = 2
"""Points at the start of a curve that the fit always leaves as a margin."""
_PARTS = 1000
_FOLLOWS = 3.5
"""Uncertainties by which the line through a record may rise less than its curve says."""
_LARGEST = 1e30
"""deg/s: the fourth power of it is still a number."""
_APART = range(8, 17)
"""Intervals between readings by whose differences the scatter of one is known: few share what rings at a mode split."""
_STANDS_OUT = 3.0
"""Uncertainties of its own by which N is a value."""
_SLOW = 0.01
"""Probability below which a curve has slow noise in it."""
_UNITS = {
    Term.QUANTISATION: (3600.0, "arcsec"),
    Term.ANGLE_RANDOM_WALK: (_DEG_RTH, "deg/sqrt(h)"),
    Term.BIAS_INSTABILITY: (_DEG_H, "deg/h"),
    Term.RATE_RANDOM_WALK: (_DEG_H * 60.0, "(deg/h)/sqrt(h)"),
    Term.RATE_RAMP: (_DEG_H**2, "(deg/h)/h"),
}
"""From the units of the fit, seconds and degrees, to those that data sheets have."""


_NO_RAMP: Final = (
    "The curve rises as that of a rate ramp, but the record has no such slope: something slow goes to and fro (a "
    "temperature, a control loop), and B, K, R are not stated. Record at a constant temperature, or for longer."
)
_NO_WALK: Final = (
    "The curve rises as that of a random walk, but the record does not go so far: what is slow comes back (a "
    "thermostat, a swing of the room, a correlated noise), and B, K, R are not stated."
)
_LEAST_WANDER: Final = 0.03
"""K^2 T of a record below which it does not go as far as its walk: K is the larger where its curve is, so 1 of 300."""
_NOTHING: Final = 1e-300
"""Of readings without noise a logarithm is taken too."""
_WAVES: Final = 100
"""Half waves in a record up to which it counts as slow."""
_MOST_SWINGS: Final = 12.0
"""Periods in a record; of more, the curve itself shows that it comes back."""
_FORMS: Final[tuple[Form, Form]] = ("plus-minus", "below")


class NoiseCoefficient(Value, frozen=True):
    """A coefficient of the Allan curve, below `upper_95` with 95 %, which is all that can be said where it has no `u`.

    `value` is None as well where it may be anything below: of N where it is not known how much white noise a reading
    lets through, of all where no sum of these noises describes the curve.
    """

    upper_95: float = 0.0

    @classmethod
    def stating(cls, words: str, value: float | None, u: float | None, upper_95: float, unit: str) -> Self:
        """Return the coefficient that is called by these words."""
        stated, form = (words.replace(" ", "_"), value, unit, u), _FORMS[u is None]
        return cls(*stated, form=form, high=upper_95 if u is None else None, words=words, upper_95=upper_95)

    def in_results(self) -> dict[str, Any]:
        """Return the noise in the form of ``result.json``."""
        return {"name": self.words, "value": self.value, "u": self.u, "upper_95": self.upper_95, "unit": self.unit}


class AllanRow(Struct, frozen=True):
    """The curve at one averaging time, deg/h: as the record shows it with 95 % bounds, and without its dead time.

    `edf` are the degrees of freedom under the noise that was fitted; `fit` is the fitted curve of the gapless noise,
    None at times that are too short for it.
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
    fitted_to_s: float
    described: bool
    """Whether the fit describes the curve from there on, by chi-square."""
    remarks: tuple[str, ...]
    """What the curve does not tell, in sentences."""


def record_noise(
    rates_deg_s: Floats,
    sampling: Sampling,
    *,
    corrected: bool,
    u_bandwidth_hz: float,
    meter_deg_s: float,
    digit: Digit | None = None,
    overwrite: bool = False,
) -> RecordNoise:
    """Return the noise of `rates_deg_s`, one every ``sampling.interval_s``.

    Args:
        rates_deg_s: the record, deg/s, shape (n,).
        sampling: how it was taken.
        corrected: whether dead time is taken out; else the record counts as gapless.
        u_bandwidth_hz: standard uncertainty of the noise bandwidth in `sampling`, Hz.
        meter_deg_s: the most that a reading of the meter may scatter by itself, rms.
        digit: to which the readings of a gapless record were rounded.
        overwrite: whether the memory of a gapless record may be used, for ten million readings.

    Raises:
        ConfigError: a rate is larger than any gyroscope's.
    """
    if max(float(rates_deg_s.max()), -float(rates_deg_s.min())) > _LARGEST:
        raise ConfigError("a rate of the record is larger than any gyroscope's")
    fitted = sampling if corrected else Sampling.without_gaps(sampling.interval_s)
    size, gapless = rates_deg_s.size, Sampling.without_gaps(sampling.interval_s)
    factors = allan.averaging_factors(size, _PER_OCTAVE)
    spreads = spreads_of_means(rates_deg_s, sampling, _DEG_H)
    means, gainsaid = means_of(rates_deg_s), ""
    curve = allan.allan_deviation(
        rates_deg_s, sampling.interval_s, factors, confidence=_CONFIDENCE, overwrite=overwrite
    )
    noisy = all(point.deviation > 0.0 for point in curve)
    model = noise_model(curve, size, fitted) if noisy else None
    follows = curve if model is None else curve[model.begin : max(model.end, model.begin + 1)]
    fit = None
    if model is None:  # N is read off at the shortest time
        walk = follows[0].deviation * math.sqrt(follows[0].tau_s)
    else:
        walk = fit_noise(curve[model.begin :], size, gapless, _ALWAYS).coefficients.angle_random_walk
        fit = with_what_is_let_through(by_scatter(model.fit, rates_deg_s, fitted), fitted, u_bandwidth_hz)
        fit = without_digit(without_meter(fit, fitted, meter_deg_s), digit, follows[0].tau_s, fitted.interval_s)
        gainsaid = gainsaid_by(fit, means, size * sampling.interval_s)
        fit = with_bounds_alone(fit) if gainsaid else fit
    law = PhaseNoise() if fit is None else fit.coefficients.phase_noise(fitted)
    if law.squares().any():
        # The degrees of freedom that its own noise leaves the curve, not those of white noise
        points = []
        for tau_s, deviation in [(point.tau_s, point.deviation) for point in curve]:
            edf = allan.equivalent_dof(size, round(tau_s / fitted.interval_s), law)
            low, high = allan.confidence_interval(edf, _CONFIDENCE)
            points.append(allan.AllanPoint(tau_s, deviation, edf, low * deviation, high * deviation))
        curve = points
    # In the units of data sheets; where the noise bandwidth of a reading is not known, but corrected for, N is a bound
    passed = not corrected or sampling.gapless or sampling.noise_bandwidth_hz is not None
    described, coefficients = (model is None or model.described) and not gainsaid, []
    for term, each in ({} if fit is None or model is None else fit.terms).items():
        factor, unit = _UNITS[term]
        known = (passed or term is not Term.ANGLE_RANDOM_WALK) and (each.u is not None or described)
        value, u = (factor * each.value if known else None), (factor * each.u if known and each.u is not None else None)
        coefficients.append(NoiseCoefficient.stating(term.value, value, u, factor * each.upper_95, unit))
    rows = []
    for point in curve:
        observed, low, high = (_DEG_H * each for each in (point.deviation, point.low, point.high))
        without = fit_deg_h = None
        if fit is not None and point.tau_s >= follows[0].tau_s:
            gapless_deg_s = math.sqrt(max(0.0, float(fit.coefficients.variance(point.tau_s)[0])))
            seen = math.sqrt(max(0.0, fit.variance(fitted, round(point.tau_s / fitted.interval_s))[0]))
            without = _DEG_H * point.deviation * gapless_deg_s / seen if corrected and seen else None
            fit_deg_h = _DEG_H * gapless_deg_s
        rows.append(AllanRow(point.tau_s, observed, low, high, point.edf, without, fit_deg_h))
    return RecordNoise(
        fit,
        tuple(rows),
        tuple(coefficients),
        bias_stability(spreads, curve, _DEG_H),
        _DEG_RTH * walk,
        follows[0].tau_s,
        follows[-1].tau_s,
        described,
        () if model is None else (gainsaid,) if gainsaid else tuple(_remarks(model, curve, coefficients)),
    )


def means_of(rates_deg_s: Floats) -> Floats:
    """Return the means of equal parts of a record, a thousand at most."""
    return np.array([part.mean() for part in np.array_split(rates_deg_s, min(rates_deg_s.size, _PARTS))])


def gainsaid_by(fit: NoiseFit, means: Floats, length_s: float) -> str:
    """Return how a record, by means of its parts, gainsays the rate ramp or random walk of its curve, else nothing.

    A slow sine rises like a ramp up to a quarter of its period, and chi-square does not see it in the few long
    averages: the line through a record with a ramp has its slope, and K sqrt(6 / 5 / T) of a walk. What comes back,
    as noise behind a thermostat, rises like a walk up to its memory: a walk has the variance K^2 T / 6, and with 97.5 %
    more than 0.03 K^2 T (Anderson, Darling, Ann. Math. Stat. 23 (1952) 193, table 1).
    """
    ramp, walk = fit.terms.get(Term.RATE_RAMP), fit.terms.get(Term.RATE_RANDOM_WALK)
    k = walk.value if walk is not None and walk.u is not None else 0.0
    if ramp is not None and ramp.u is not None:
        slope = float(np.polyfit(np.arange(means.size), means, 1)[0]) * means.size / length_s
        if abs(slope) < ramp.value - _FOLLOWS * math.hypot(ramp.u, k * math.sqrt(1.2 / length_s)):
            return _NO_RAMP
    if not k:
        return ""
    white = fit.coefficients.angle_random_walk**2 * means.size / length_s
    comes_back = float(np.var(means)) - white < _LEAST_WANDER * k**2 * length_s
    return _NO_WALK if comes_back or is_swing(means) else ""


def is_swing(means: Floats) -> bool:
    """Return True if one sine explains the slow waves of a record better than a random walk, by Schwarz's criterion.

    The cosines of whole half waves are uncorrelated in a walk, with variances as 1/k^2. Both have white noise beside
    them; a sine of unknown amplitude, phase and frequency has two numbers more than a walk.
    """
    order = np.arange(1, min(_WAVES, means.size // 2) + 1)
    middles = (np.arange(means.size) + 0.5) / means.size
    waves = np.cos(math.pi * np.outer(order, middles))
    found = waves @ means

    def likelihood(variances: Floats) -> float:
        return -0.5 * float(np.log(variances).sum()) - 0.5 * order.size * math.log(
            np.mean(found**2 / variances) + _NOTHING
        )

    walk = max(likelihood(1.0 + ratio / order**2) for ratio in np.geomspace(1.0, 1e6, 61))
    turns = 2.0 * math.pi * np.outer(np.arange(1.0, _MOST_SWINGS, 0.1), middles)
    sines, cosines = np.sin(turns) @ waves.T, np.cos(turns) @ waves.T
    left = [
        found - (each := np.stack(pair, 1)) @ np.linalg.lstsq(each, found, rcond=None)[0]
        for pair in zip(sines, cosines, strict=True)
    ]
    sine = -0.5 * order.size * math.log(min(float(np.mean(each**2)) for each in left) + _NOTHING)
    return sine - walk > math.log(order.size)


def _remarks(
    model: NoiseModel, curve: Sequence[allan.AllanPoint], coefficients: Sequence[NoiseCoefficient]
) -> Iterator[str]:
    """Yield remarks for a reader of the coefficients on the curve behind them."""
    last, begin = curve[-1].tau_s, curve[model.begin].tau_s
    if not model.started:
        yield (
            "No sum of these noises describes the curve from any averaging time on, or the record is too short for "
            "that: no coefficient is stated, only upper bounds (95 %). If a drift outweighs the noise, "
            "record at a constant temperature."
        )
        return
    if model.begin > _USUAL_MARGIN:
        yield (
            f"N from averages of {begin:.4g} s on: shorter ones do not follow powers of the time (a filter, held "
            "readings, a vibration)."
        )
    if not model.described:
        found = f" (chi-square {model.chi_square:.3g} of {model.dof}, p {model.p:.1g})" if model.p < _SLOW else ""
        piece = (
            f"N is that of {begin:.4g} to {curve[model.end - 1].tau_s:.4g} s; B, K, R are"
            if model.end > model.begin
            else "N, B, K, R are"
        )
        yield (
            f"No sum of these noises describes the curve from {begin:.4g} to {last:.4g} s{found}: {piece} not "
            "stated, only upper bounds (95 %)."
        )
        return
    slow = [each for each in coefficients if each.words != Term.ANGLE_RANDOM_WALK.value and each.u is not None]
    if not slow and model.white_alone < _SLOW:
        yield (
            "There is slow noise, but this record is too short to separate flicker from a random walk: record 4 times "
            "as long."
        )


def by_scatter(fit: NoiseFit, rates_deg_s: Floats, sampling: Sampling) -> NoiseFit:
    """Return the fit with N by the scatter of readings with dead time: that has the whole noise bandwidth of a reading.

    What passes at the split rings for the sense mode's time constant. Where that is no less than the interval, readings
    share it, and a mean of many has more of it, or less, than so many readings that share nothing: up to 40 % of N, as
    the split is near a whole number of readings a second. The curve of a record that has much slow noise tells N
    better.
    """
    walk, band_hz = fit.terms.get(Term.ANGLE_RANDOM_WALK), sampling.noise_bandwidth_hz
    if band_hz is None or walk is None or walk.u is None:
        return fit
    law, size, interval_s = fit.coefficients, rates_deg_s.size, sampling.interval_s
    phase = PhaseNoise(flicker=law.bias_instability, random_walk=law.rate_random_walk * math.sqrt(interval_s))
    folded = deviation_factor(sampling, Term.BIAS_INSTABILITY) ** 2 - 1.0
    slow = folded * (allan.BIAS_INSTABILITY_FACTOR * law.bias_instability) ** 2
    between = np.array([1.0, -1.0, -1.0, 1.0])  # of phases at the edges of two readings
    for lag in _APART:
        drifted = between @ phase.among(np.array([0.0, 1.0, lag, lag + 1.0])) @ between
        slow += 0.5 * (float(drifted) + (law.rate_ramp * lag * interval_s) ** 2) / len(_APART)
    of_lags = {
        lag: 0.5 * float(np.mean((rates_deg_s[lag:] - rates_deg_s[:-lag]) ** 2)) for lag in range(1, _APART.stop)
    }
    scatter = math.fsum(of_lags[lag] for lag in _APART) / len(_APART)
    white = scatter - slow
    if slow > 0.5 * white:
        return fit
    shared = 2.0 * math.fsum((1.0 - of_lags[lag] / scatter) ** 2 for lag in range(1, _APART.start))
    u_slow = slow * math.sqrt(fit.covariance_of_squares[2, 2]) / (law.bias_instability**2 or math.inf)
    value = math.sqrt(white / (2.0 * band_hz))
    u = 0.5 * value * math.hypot(scatter * math.sqrt((2.0 + shared) / size), u_slow) / white
    return _with_walk(fit, value, u, value + _ONE_SIDED * u)


def without_meter(fit: NoiseFit, sampling: Sampling, meter_deg_s: float) -> NoiseFit:
    """Return the fit with N less the meter's own scatter: between none and all that it may be.

    No data sheet says how much: the middle is stated, and what it may be off by is a rectangular limit (ours). Where
    little else is left, N has a bound alone.
    """
    walk = fit.terms.get(Term.ANGLE_RANDOM_WALK)
    if walk is None or walk.u is None:
        return fit
    white = (deviation_factor(sampling, Term.ANGLE_RANDOM_WALK) * walk.value) ** 2 / sampling.interval_s
    least = walk.value * math.sqrt(max(0.0, 1.0 - meter_deg_s**2 / white))
    value, u = 0.5 * (walk.value + least), math.hypot(walk.u, 0.5 * (walk.value - least) / math.sqrt(3.0))
    if value < _STANDS_OUT * u:
        return _with_walk(fit, 0.0, None, walk.upper_95)
    return _with_walk(fit, value, u, walk.upper_95)


def with_bounds_alone(fit: NoiseFit) -> NoiseFit:
    """Return the fit of which N alone is stated."""
    terms = {term: replace(each, u=None) for term, each in fit.terms.items()}
    return replace(fit, terms={**terms, Term.ANGLE_RANDOM_WALK: fit.terms[Term.ANGLE_RANDOM_WALK]})


def without_digit(fit: NoiseFit, digit: Digit | None, begin_s: float, interval_s: float) -> NoiseFit:
    """Return the fit with N less what rounding adds; of a coarse digit nothing but a bound on N.

    Independent errors add q^2/12 an interval; of held readings they last as long as these, so the part of the variance
    counts. The middle of the two is taken out, the rest is a rectangular limit (ours).
    """
    walk, intervals = fit.terms.get(Term.ANGLE_RANDOM_WALK), round(begin_s / interval_s)
    if walk is None or digit is None or not digit.step:
        return fit
    if digit.in_sd(intervals) > COARSE:  # the noise is half a digit at most, of which the readings show too little
        hidden = max(1.0, 0.5 * digit.step / max(digit.over(intervals), 1e-9 * digit.step))
        return _with_walk(replace(fit, terms={Term.ANGLE_RANDOM_WALK: walk}), 0.0, None, hidden * walk.upper_95)
    if walk.u is None:
        return fit
    added = digit.step**2 / 12.0
    parts = added * interval_s / walk.value**2, added / digit.over(intervals) ** 2
    value = walk.value * math.sqrt(1.0 - 0.5 * math.fsum(parts))
    place = 0.5 * digit.left_by_place(intervals)
    u = math.hypot(walk.u, value * place, 0.25 * walk.value * (parts[1] - parts[0]) / math.sqrt(3.0))
    return _with_walk(fit, value, u, max(value + _ONE_SIDED * u, value / walk.value * walk.upper_95))


def _with_walk(fit: NoiseFit, value: float, u: float | None, upper_95: float) -> NoiseFit:
    walk = replace(fit.terms[Term.ANGLE_RANDOM_WALK], value=value, u=u, upper_95=upper_95)
    return replace(fit, terms={**fit.terms, Term.ANGLE_RANDOM_WALK: walk})


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
    folded *= (allan.BIAS_INSTABILITY_FACTOR * fit.coefficients.bias_instability) ** 2
    let_through = u_bandwidth_hz / sampling.noise_bandwidth_hz if sampling.noise_bandwidth_hz else 0.0
    value = walk.value * (1.0 + 0.25 * folded / white)
    besides = 0.5 * walk.value * math.hypot(let_through, 0.5 * folded / white / math.sqrt(3.0))
    upper = value + math.hypot(walk.upper_95 - walk.value, _ONE_SIDED * besides)
    return _with_walk(fit, value, math.hypot(walk.u or 0.0, besides), upper)


def noise_table(noise: Sequence[NoiseCoefficient]) -> Table | Text:
    """Return the coefficients, or the reason without any."""
    if not noise:
        return Text("no noise: the readings scatter by less than the meter resolves")
    columns = heads("<noise | value:.4g | u:.2g | upper bound, 95 %:.3g | <unit")
    # Of one that does not stand out 0 is no finding: its bound is
    rows = [(each.words, each.value if each.u else None, each.u, each.upper_95, each.unit) for each in noise]
    return Table(columns, rows)


def allan_table(rows: Sequence[AllanRow]) -> Table:
    """Return the Allan curve as a table; a gapless record has no column for dead time."""
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
        ("standard deviation of 10-s means about their line", found.sd_10_s_detrended),
        ("10-s means, peak to peak", found.peak_to_peak_10_s),
        (f"Allan minimum, at {found.allan_minimum_tau_s:g} s", found.allan_minimum),
        ("Allan minimum / 0.664", found.bias_instability_read_off),
    ]
    return Table(heads("<bias stability | value [deg/h]:.3g"), rows)


def allan_figure(all_rows: Sequence[AllanRow], white_noise_seen: float) -> Figure | Text:
    """Draw the Allan curve; with dead time also the curve corrected for it."""
    rows = [row for row in all_rows if row.observed > 0.0]
    if not rows:
        return Text("no Allan figure: there is no noise to draw")
    tau = [row.tau_s for row in rows]
    low, high = [row.low for row in rows], [row.high for row in rows]
    series = [Series("as recorded", tau, [row.observed for row in rows], low=low, high=high)]
    if all(row.corrected is not None for row in rows) and white_noise_seen > 1.0:
        series.append(Series("without dead time", tau, [row.corrected or 0.0 for row in rows]))
    if fitted := [row for row in rows if row.fit]:
        times, deviations = [row.tau_s for row in fitted], [row.fit or 0.0 for row in fitted]
        series.append(Series("fit, gapless", times, deviations, kind="line"))
    axes = Axis("averaging time", "s", "log"), Axis("Allan deviation", "deg/h", "log")
    return Figure(
        "Allan deviation of the output at rest",
        *axes,
        series,
        "The band contains the true value with 95 % probability.",
    )
