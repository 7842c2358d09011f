"""Results of a static record: Allan curve, noise coefficients, bias stability, mean and trend, and their report."""

import math
from collections.abc import Iterator
from enum import Enum
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import astuple, replace

from vcfbench.analysis.allan import BiasStability, Sampling, Term, block_means, deviation_factor
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, NoiseTerm, u_of_combination
from vcfbench.analysis.plausibility import doubts_of_record
from vcfbench.instructions.kept import KeptSettings
from vcfbench.instructions.routines import can_answer
from vcfbench.instructions.scale_factor import (
    LookedAtSettings,
    ScaleFactor,
    rates_by,
    scale_factor_used,
    tells_scale_factor,
)
from vcfbench.instructions.v_vc import away_from_warm_k
from vcfbench.procedures.zero import noise as noises
from vcfbench.reports.document import Report, Table, Text, heads
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.uncertainty.at_rest import about_horizon, as_rate, flicker_found, flicker_part, parts_at_rest
from vcfbench.uncertainty.measurand import budget_table, finite, measurand, printed
from vcfbench.values.printing import incomplete
from vcfbench.values.value import Measurand, UncertaintyPart, Value

_DEG_H = 3600.0
"""deg/h in a deg/s."""
_DEG_RTH = 60.0
"""deg/sqrt(h) in a deg/sqrt(s)."""
_FLICKER = list(Term).index(Term.BIAS_INSTABILITY)
_WINDOWS = 60
"""Means that the trend is a straight line through."""
_LEAST_READINGS = 200
"""Fewer have no averaging times for four coefficients."""
_EXACTLY = 1e-6
_Q_LIMIT = 0.3
"""Assumed limit of a gyroscope's Q about that of its kind, relative: ours, no data sheet of one says it."""


class Mode(Enum):
    """Treatment of the time between readings."""

    DEAD_TIME = "dead-time"
    CORRECTED = "corrected"
    GAPLESS = "gapless"


class ZeroSettings(KeptSettings, LookedAtSettings, frozen=True, kw_only=True):
    """Settings of the static record, in addition to those of all procedures."""

    waits: ClassVar[str] = "powered_s"
    powered_s: Annotated[float, ranged(0.0, 86_400.0, "time under power before the record, at least warm_up_s")] = (
        1800.0
    )
    duration_s: Annotated[float, ranged(10.0, 864_000.0, "length of the record")] = 3600.0
    mode: Annotated[
        Mode,
        said("dead time between readings: kept, corrected for, or none (the meter samples by itself)", option=True),
    ] = Mode.CORRECTED
    noise_bandwidth_hz: Annotated[
        float,
        ranged(0.0, 1e4, "noise bandwidth of one reading, if a mode split widens it; 0: not known, N has only a bound"),
    ] = 0.0
    u_noise_bandwidth_hz: Annotated[
        Annotated[float, ranged(0.0, 1e4)] | None,
        said("standard uncertainty of noise_bandwidth_hz; None: 30 % of the part that a split adds, which is assumed"),
    ] = None
    noise_bandwidth_nplc: Annotated[
        Literal[1, 10, 100],
        said("integration time for which noise_bandwidth_hz holds; with another nplc it is not known"),
    ] = 10
    burst_readings: Annotated[int, ranged(10, 50_000, "readings without gaps that the meter's memory holds")] = 500

    validity_days: Annotated[float, Meta(gt=0.0, le=36_500.0, description="validity of the kept flicker, days")] = 365.0

    @property
    def start_up_s(self) -> float:
        """Wait after power-on, s."""
        return max(self.powered_s, self.warm_up_s, self.settle_s)

    @property
    def sampling(self) -> Sampling:
        """Sampling of the record; without a correction for dead time it has no noise bandwidth."""
        if self.mode is Mode.GAPLESS:
            return Sampling.without_gaps(self.sample_interval_s)
        passed_hz = self.passed_hz if self.mode is Mode.CORRECTED else None
        return Sampling(self.sample_interval_s, self.aperture_s, passed_hz)

    @property
    def passed_hz(self) -> float | None:
        """Noise bandwidth of one reading at this integration time, Hz; None where it is not known."""
        return self.noise_bandwidth_hz or None if self.nplc == self.noise_bandwidth_nplc else None

    @property
    def u_passed_hz(self) -> float:
        """Standard uncertainty of that, Hz; where it is not stated, `_Q_LIMIT` of the part that the split lets through.

        What is above the bandwidth of a mere mean is proportional to the sense mode's Q.
        """
        if self.u_noise_bandwidth_hz is not None:
            return self.u_noise_bandwidth_hz
        excess_hz = max(0.0, self.noise_bandwidth_hz - 0.5 / self.aperture_s)
        return _Q_LIMIT * excess_hz / math.sqrt(3.0)

    @property
    def readings_a_mean(self) -> int:
        """Number of readings without gaps that make one mean over the interval."""
        return max(1, round(self.sample_interval_s / self.aperture_s))

    @property
    def readings(self) -> int:
        """Number of readings that the meter takes."""
        means = round(self.duration_s / self.sample_interval_s)
        return means * self.readings_a_mean if self.mode is Mode.GAPLESS else means

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.duration_s < _LEAST_READINGS * self.sample_interval_s * (1.0 - _EXACTLY):
            least_s = _LEAST_READINGS * self.sample_interval_s
            expected = f"at least {least_s:g} s, {_LEAST_READINGS} times sample_interval_s"
            yield InvalidValue("duration_s", expected, self.duration_s)
        if self.duration_s > 1e6 * self.aperture_s:
            expected = f"at most {1e6 * self.aperture_s:g} s, a million integration times"
            yield InvalidValue("duration_s", expected, self.duration_s)
        if self.mode is Mode.GAPLESS and self.station.stream:
            expected = "corrected or dead-time: a stream has no memory for gapless bursts"
            yield InvalidValue("mode", expected, self.mode.value)
        if self.station.output_unit == "LSB" and not tells_scale_factor(self):
            yield InvalidValue("scale_factor_v_per_deg_s", "LSB/(deg/s) of this gyroscope: nothing else tells it", None)
        least_hz = 0.5 / self.aperture_s
        if self.mode is Mode.CORRECTED and (self.passed_hz or least_hz) < 0.99 * least_hz:
            expected = f"at least the {least_hz:g} Hz of an integration time of {self.aperture_s:g} s, or 0: not known"
            yield InvalidValue("noise_bandwidth_hz", expected, self.noise_bandwidth_hz)
        whole_s = self.readings_a_mean * self.aperture_s
        if self.mode is Mode.GAPLESS and abs(whole_s - self.sample_interval_s) > _EXACTLY * whole_s:
            expected = f"a whole number of integration times of {self.aperture_s:g} s, without gaps"
            yield InvalidValue("sample_interval_s", expected, self.sample_interval_s)
        if self.mode is Mode.GAPLESS and self.readings_a_mean > self.burst_readings:
            expected = f"at least the {self.readings_a_mean} readings of one interval"
            yield InvalidValue("burst_readings", expected, self.burst_readings)


_BY_SCALE = ("scale factor",)
_UNSEEN = "no table and no generator has shown that the output answers so: its flicker is not kept of a device"


class ZeroResult(Struct, frozen=True):
    """A static record. `mode` is the treatment of its dead time; rates are outputs over the scale factor."""

    mode: str
    samples: int
    interval_s: float
    aperture_s: float
    dead_share: float
    """Part of the time that no reading saw."""
    white_noise_seen: float
    """By how much the record's white noise is larger than that of a gapless one."""
    scale_factor_v_per_deg_s: ScaleFactor
    allan_deg_h: tuple[noises.AllanRow, ...]
    noise: tuple[noises.NoiseCoefficient, ...]
    """The fitted coefficients; none where the record scatters by less than the meter resolves."""
    angle_random_walk_as_read: float
    """N of the record as it stands, deg/sqrt(h): noise folded in by dead time is in it."""
    stability_deg_h: BiasStability
    output_v: Measurand | None
    bias: Measurand | None
    """deg/s: the mean as that of the horizon about the record, Earth's rate along the axis in it; None as above."""
    trend: Measurand | None
    """(deg/h)/h, of this record."""
    bias_v: float
    bias_deg_s: float
    noise_bandwidth_hz: Measurand | None = None
    """Noise bandwidth of one reading, where it was measured: without gaps. It can correct a record with dead time."""
    fitted_from_s: float = 0.0
    """The shortest averaging time in the fit: where readings follow each other fast, noise passed at the mode split
    swings from one to the next, and shorter ones follow no power of the time."""
    described: bool = True
    """Whether the fit describes the curve: if not, B, K and R have bounds alone."""
    remarks: tuple[str, ...] = ()

    def stated(self) -> Iterator[Value]:
        """Yield its values; of a record without noise the means alone."""
        if self.output_v is None or self.bias is None or self.trend is None:
            yield Value("output_v", self.bias_v, "V", kind="bias_at_rest")
            yield Value("bias", self.bias_deg_s, "deg/s", kind="bias_at_rest_deg_s")
            return
        yield self.output_v.called("output_v", "bias_at_rest")
        yield self.bias.called("bias", "bias_at_rest_deg_s")
        missing = _BY_SCALE if self.scale_factor_v_per_deg_s.u is None else ()
        yield from (replace(each, missing=(*each.missing, *missing)) for each in self.noise)
        yield self.trend.called("trend")
        if self.noise_bandwidth_hz is not None:
            yield self.noise_bandwidth_hz.called("noise_bandwidth_hz")

    @property
    def flicker(self) -> tuple[float, float] | None:
        """The coefficient B with its standard uncertainty, deg/h; None where none was found."""
        found = next((each for each in self.noise if each.words == "bias instability"), None)
        return (found.value, found.u) if found is not None and found.value and found.u else None

    def coefficient(self, name: str) -> noises.NoiseCoefficient:
        """Return the coefficient of that name, ``"angle random walk"``; KeyError where it was not found."""
        return {each.words: each for each in self.noise}[name]


class ForeseenZero(Struct, frozen=True):
    """Expected statement of a static record before the run; none without noise."""

    output_v: Measurand | None = None
    bias: Measurand | None = None
    trend: Measurand | None = None


def foreseen_zero(settings: ZeroSettings, output_v: float, white_v_sqrt_s: float) -> ForeseenZero:
    """Return the expected statement of a record at `output_v`, its white noise and B known."""
    scale, known = scale_factor_used(settings), settings.station.sources.bias_instability_deg_h or 0.0
    if white_v_sqrt_s < settings.meter_resolution_v * settings.aperture_s**0.5:
        return ForeseenZero()
    walk, unstable = white_v_sqrt_s / abs(scale.value), known / _DEG_H
    named = {Term.ANGLE_RANDOM_WALK: walk, Term.BIAS_INSTABILITY: unstable}
    terms = {term: NoiseTerm(value, None, value, 0.0) for term, value in named.items()}
    fit = NoiseFit(Coefficients(angle_random_walk=walk, bias_instability=unstable), terms)
    sampling = replace(settings.sampling, noise_bandwidth_hz=None)
    volts = np.full(round(settings.duration_s / sampling.interval_s), output_v)
    return ForeseenZero(*_stated(volts, sampling, scale, settings, fit))


def zero_results(settings: ZeroSettings, scale: ScaleFactor, readings_v: Floats, times_s: Floats) -> ZeroResult:
    """Return the results of a record: its readings, V, and when each was asked for, s, both of shape (n,)."""
    sampling, gapless = settings.sampling, settings.mode is Mode.GAPLESS
    volts = block_means(readings_v, settings.readings_a_mean) if gapless else readings_v
    rates, corrected = volts / scale.value, settings.mode is not Mode.DEAD_TIME
    fitted = sampling if corrected else Sampling.without_gaps(sampling.interval_s)
    readings = readings_v / scale.value
    # Without gaps the readings themselves, whose short averages tell N better than means over an interval
    of_noise, each = (readings, Sampling.without_gaps(settings.aperture_s)) if gapless else (rates, sampling)
    noise = noises.record_noise(
        *(of_noise, each),
        corrected=corrected,
        u_bandwidth_hz=settings.u_passed_hz,
        meter_deg_s=(settings.station.meter_resolution_v or 0.0) / abs(scale.value),
    )
    fit = noise.fit
    dead_share = 1.0 - sampling.aperture_s / sampling.interval_s
    if sampling.gapless:  # between bursts without gaps the times tell it
        seen_s = rates.size * sampling.interval_s
        dead_share = max(0.0, 1.0 - seen_s / (float(times_s[-1] - times_s[0]) + seen_s / times_s.size))
    output, bias, trend = (None, None, None) if fit is None else _stated(volts, fitted, scale, settings, fit)
    return ZeroResult(
        mode=settings.mode.value,
        samples=rates.size,
        interval_s=sampling.interval_s,
        aperture_s=sampling.aperture_s,
        dead_share=dead_share,
        white_noise_seen=deviation_factor(sampling, Term.ANGLE_RANDOM_WALK),
        scale_factor_v_per_deg_s=scale,
        allan_deg_h=noise.rows,
        noise=noise.coefficients,
        angle_random_walk_as_read=noise.walk_as_read_deg_rth,
        stability_deg_h=noise.stability,
        output_v=output,
        bias=bias,
        trend=trend,
        bias_v=float(volts.mean()),
        bias_deg_s=float(rates.mean()) - settings.null_v / scale.value,
        noise_bandwidth_hz=_noise_bandwidth(readings, settings.readings_a_mean, fit) if fit and gapless else None,
        fitted_from_s=noise.fitted_from_s,
        described=noise.described,
        remarks=(
            *noise.remarks,
            *(() if can_answer(settings) else (_UNSEEN,)),
            *(f"from reading {each.row + 1} on: {each.words}" for each in doubts_of_record(rates)),
        ),
    )


def _noise_bandwidth(readings: Floats, a_mean: int, fit: NoiseFit) -> Measurand | None:
    """Return the noise bandwidth of one reading, Hz: half the mean square of differences over an interval, over 2 N^2.

    Readings so far apart share nothing of what the split lets through; of flicker the difference holds some per cent.
    """
    walk = fit.terms[Term.ANGLE_RANDOM_WALK]
    if walk.u is None or not walk.value > 0.0:
        return None
    value = 0.5 * float(np.mean((readings[a_mean:] - readings[:-a_mean]) ** 2)) / (2.0 * walk.value**2)
    u = value * math.hypot(2.0 * walk.u / walk.value, math.sqrt(3.0 / readings.size))
    return measurand(value, "Hz", [UncertaintyPart("noise of the record", u)])


def _stated(
    volts: Floats, sampling: Sampling, scale: ScaleFactor, settings: ZeroSettings, fit: NoiseFit
) -> tuple[Measurand, Measurand, Measurand]:
    """Return mean output (V), bias (deg/s) and trend ((deg/h)/h) with all that is known to make them uncertain."""
    known, per_deg_s, lasted_s = settings.station.sources, abs(scale.value), volts.size * sampling.interval_s
    # The flicker of the record, or the stated one where the record is too short to know it
    square, variance = fit.coefficients.bias_instability**2, fit.covariance_of_squares[_FLICKER, _FLICKER]
    flicker = flicker_found(known, _DEG_H**2 * square, _DEG_H**2 * math.sqrt(float(variance)))
    middle, half = lasted_s / 2.0, known.horizon_h * 1800.0
    begin, end = np.array([0.0, middle - half]), np.array([lasted_s, middle + half])
    output = measurand(
        float(volts.mean()),
        "V",
        [
            *_noise_parts(fit, sampling, (begin, end, np.array([1.0, -1.0])), per_deg_s),
            flicker_part(flicker, per_deg_s / _DEG_H * about_horizon([0.0], [lasted_s], known.horizon_h)),
            *parts_at_rest(settings, float(volts.mean()), scale.value, lasted_s),
        ],
        known.missing("bias"),
    )
    # The slope of the least-squares line through means: noise alone bends it, and the warm-up
    edges = np.linspace(0, volts.size, _WINDOWS + 1).round().astype(int)
    means = np.array([(volts[a:b] / scale.value).mean() for a, b in pairwise(edges.tolist())])
    begin, end = edges[:-1] * sampling.interval_s, edges[1:] * sampling.interval_s
    at_s = 0.5 * (begin + end)
    weights = (at_s - at_s.mean()) / float(np.sum((at_s - at_s.mean()) ** 2))
    unit = NoiseFit(Coefficients(bias_instability=1.0))
    parts = [
        *_noise_parts(fit, sampling, (begin, end, weights), _DEG_H**2),
        flicker_part(flicker, _DEG_H * u_of_combination(unit, sampling, begin, end, weights).u),
    ]
    if (left_k := away_from_warm_k(settings, 0.0).get("warm-up")) is not None:
        bent = abs(float(weights @ np.exp(-at_s / known.warm_up_time_s)))
        parts.append(UncertaintyPart("warm-up", _DEG_H * (known.bias_deg_h_k or 0.0) * left_k * bent))
    missing = [name for name in known.missing("bias") if name == "warm-up"]
    trend = measurand(_DEG_H**2 * float(weights @ means), "(deg/h)/h", parts, missing)
    return output, as_rate(output, scale.value, scale.u, settings.null_v), trend


def _noise_parts(
    fit: NoiseFit, sampling: Sampling, windows: tuple[Floats, ...], factor: float
) -> Iterator[UncertaintyPart]:
    """Yield the contribution of each noise but flicker to a sum of means, `windows` (begins, ends, weights).

    A ramp is what a trend shows, and is no noise. What a filter takes from short averages is not taken off.
    """
    for place, term in enumerate(Term):
        if term in {Term.BIAS_INSTABILITY, Term.RATE_RAMP} or not fit.coefficients.squares()[place] > 0.0:
            continue
        alone = np.zeros_like(fit.covariance_of_squares)
        alone[place, place] = fit.covariance_of_squares[place, place]
        values = [each if place == n else 0.0 for n, each in enumerate(astuple(fit.coefficients))]
        found = u_of_combination(NoiseFit(Coefficients(*values), {}, alone), sampling, *windows)
        yield UncertaintyPart(term.value, factor * found.u, finite(found.dof))


def zero_report(settings: ZeroSettings, _measured: object, results: ZeroResult) -> Report:
    """Report a static record: its sampling, its results, the Allan table and its figure."""
    flicker = results.flicker  # as the key of the bench file
    said = [f"for [uncertainty] of the bench file: bias_instability_deg_h = {flicker[0]:.3g}"] if flicker else []
    if results.trend is not None and abs(results.trend.value) > results.trend.u95:
        said.append(
            "This record has a trend: at another time the mean differs by it, which u of the bias does not contain."
        )
    columns = heads("< | value:.6g | u:.2g | dof:.3g | U95:.2g | <unit")
    rows: list[Any] = [
        ("output, mean", results.bias_v, None, None, None, "V"),
        ("bias, mean", results.bias_deg_s, None, None, None, "deg/s"),
    ]
    stated = (("output, mean", results.output_v), ("bias, mean", results.bias), ("trend", results.trend))
    for place, (name, found) in enumerate(stated):
        if found is not None:
            value, u, u95 = printed(found)
            rows[place : place + 1] = [(name, value, u, found.dof, u95, found.unit)]
    lacks = incomplete(() if results.bias is None else results.bias.missing).removeprefix("; ")
    of_noise = incomplete(_BY_SCALE if results.noise and results.scale_factor_v_per_deg_s.u is None else ())
    return Report(
        [
            Text(_taken(settings, results) + of_noise.replace("; ", "\nnoise: ", 1)),
            noises.noise_table(results.noise),
            Table(columns, rows, lacks),
            *([] if results.output_v is None else [budget_table("the output's mean", results.output_v)]),
            noises.stability_table(results.stability_deg_h),
            noises.allan_table(results.allan_deg_h),
            Text("\n".join([*said, _WHAT_U_HOLDS])),
            noises.allan_figure(results.allan_deg_h, results.white_noise_seen),
        ]
    )


_WHAT_U_HOLDS = """\
The mean holds for horizon_h around the record; it contains the Earth's rate along the axis. Its u contains the noise
of this record with all correlations, flicker over the horizon, errors of the meter, temperature, warm-up and phases
as far as the bench file states them, and as a rate the u of the scale factor. The trend holds for this record only.
Not contained in any u: turn-on to turn-on and remounting, acceleration, vibration, magnetic fields, the supply,
changes after the run."""


def _taken(settings: ZeroSettings, results: ZeroResult) -> str:
    scale = results.scale_factor_v_per_deg_s
    lines = [rates_by(scale.value, scale.source)]
    if results.mode == "gapless":
        lost = f"{100.0 * results.dead_share:.2f} % of the time was lost between bursts"
        lines.append(f"readings without gaps, means over {results.interval_s:g} s; {lost}")
        if (found := results.noise_bandwidth_hz) is not None:
            band = f"{found.value:.2f} Hz, u {found.u:.2f}"
            keys = "noise_bandwidth_hz and u_noise_bandwidth_hz"
            lines.append(f"noise bandwidth of one reading {band}: {keys} of records with dead time")
    else:
        lines.append(
            f"one reading of {results.aperture_s:g} s every {results.interval_s:g} s: white noise appears "
            f"{results.white_noise_seen:.3g} times too large, {results.angle_random_walk_as_read:.3g} deg/sqrt(h) "
            "uncorrected"
        )
    if results.mode == "dead-time":
        lines.append("NOT corrected: N and the curve contain the noise that dead time aliases")
    elif results.mode == "corrected" and settings.passed_hz is None and results.white_noise_seen > 1.0:
        lines.append(
            "corrected with a noise bandwidth of 1 / (2 integration time), the smallest possible: a mode split widens "
            "it, so N has an upper bound only; set noise_bandwidth_hz"
            + ("" if settings.station.stream else ", or measure it with mode=gapless")
        )
    lines += results.remarks
    return "\n".join(lines)
