"""The scale factor of every window of a modulation, that of the whole run, and the disturbance of the true rate.

All comes from the phasors of the output over those of V_Vc. A curved chain (modulator, output stage) makes three times
as much of the fundamental as of the third harmonic, and moves the mean by as much as the second: both are read off
the record and taken out, so that of the curve of K_Vc its slope at 0 V is all that is needed.
"""

import cmath
import math
from collections.abc import Sequence
from statistics import median

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.allan import allan_deviation, averaging_factors
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.modulation import FLICKER_FLOOR, Demodulated, demodulated, flicker_share, static_response
from vcfbench.devices.certificate import (
    Drift,
    Here,
    curve_parts,
    drift_of,
    drift_parts,
    lists_of_omissions,
)
from vcfbench.devices.k_vc_since import k_vc_since, with_temperature
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions import v_vc
from vcfbench.instructions.v_vc import v_vc_tolerance_v
from vcfbench.procedures.health.check import by_phases, gaps_of, missing_of, unmeasured
from vcfbench.procedures.online.settings import OnlineSettings
from vcfbench.records.stated import BEYOND_SHEETS
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.steps import ModulatedRecord, SampleModulated
from vcfbench.steps.measured import Measured
from vcfbench.uncertainty.measurand import budget_table, made_of, measurand, said_of
from vcfbench.values.sources import METER_GAIN, V_VC_GAIN, V_VC_NOISE
from vcfbench.values.value import Measurand, UncertaintyPart

_U_SHARE = 0.05
"""Standard uncertainty of the share share of the in-phase mode in the response at rest."""
_SCATTER = 3.0
"""Times by which a burst may scatter more than the others."""
_SWING = 0.05
"""Part by which its sine may be another than theirs: the scale factor of a gyroscope that is warm moves by far less."""
_SURE = math.cos(math.radians(60.0))
"""Least cosine of the phase between output and V_Vc that tells the sign of the scale factor."""

UNKNOWN_SIGN = "its sign (from expected.scale_factor_v_per_deg_s, a certificate or a meter on V_Vc)"
_HOLDS_NOT = (
    BEYOND_SHEETS,
    "changes of K_Vc itself: see the changes that only a rate table shows",
    "a true rate at the frequency of the modulation: it cannot be separated from the modulation",
    "curvature of fifth order and higher; harmonics of the generator if V_Vc is not measured",
)


class WindowFactor(Struct, frozen=True):
    """The scale factor of one window, whose middle is `t_s` after the modulation began to be sampled.

    `u_readings` is what its own readings leave; `u` holds what is common to all windows as well.
    """

    t_s: float
    scale_factor_v_per_deg_s: float
    u_readings: float
    u: float


class AllanOfScaleFactor(Struct, frozen=True):
    """Allan deviation of the windows' scale factors over their mean, ppm, with its bounds (68 %).

    `noise_ppm` is what the noise of the readings alone would make of it.
    """

    tau_s: float
    deviation_ppm: float
    low_ppm: float
    high_ppm: float
    noise_ppm: float


class OnlineResult(Struct, frozen=True, kw_only=True):
    """Result of a calibration while measuring."""

    scale_factor: Measurand
    """Scale factor of small signals about the true rate, mean over the modulation, V/(deg/s)."""
    disturbance: Measurand
    """True rate as read under the modulation, which is taken out, less that read with V_Vc at rest, deg/s."""
    disturbed_by_less_than_deg_s: float
    """Size of the disturbance and its expanded uncertainty."""
    windows: tuple[WindowFactor, ...]
    allan: tuple[AllanOfScaleFactor, ...]
    chi_square: float
    """Chi-square of the windows about their mean, by `u_readings`."""
    dof: int
    rate_t_s: tuple[float, ...]
    """Middles of the bursts, as the windows' times."""
    rate_change_deg_s: tuple[float, ...]
    """True rate of each burst less the mean at rest, deg/s."""
    noise_at_rest_deg_s: float
    noise_modulated_deg_s: float
    """Standard deviation of single readings, the fitted sine taken out."""
    virtual_rate_deg_s: float
    """Amplitude of the virtual rate."""
    v_vc_amplitude_v: float
    rectified_deg_s: float
    """Mean that curvature makes of the sine at rate zero; it is taken out."""
    compression_ppm: float
    """Loss of the fundamental by curvature; it is given back."""
    response_ppm: float
    """By how much the response at the frequency exceeds that at rest; it is divided out."""
    lost_share: float
    """Share of the time between first and last reading in which nothing was read."""
    k_vc_from: str
    v_vc_by: str
    since: tuple[str, ...]
    """Assumed changes of K_Vc since its certificate."""
    unseen: tuple[str, ...]
    holds_not: tuple[str, ...]
    drift: Drift | None
    """Since the certificate of the device; None where nothing earlier is known."""


class _Run(Struct, frozen=True):
    """The records of a run, output and V_Vc of each burst fitted, and the sign of the scale factor."""

    modulated: Sequence[ModulatedRecord]
    output: Sequence[Demodulated]
    v_vc: Sequence[Demodulated]
    """One a burst; the same for all, where V_Vc was measured by hand; none where it is believed."""
    rest: Sequence[ModulatedRecord]
    rest_v_vc_v: float
    sign: float


def _fitted(settings: OnlineSettings, measured: Measured) -> _Run:
    found = measured.found(ModulatedRecord)
    sampled = [(step, record) for step, record in found if isinstance(step, SampleModulated)]
    modulated = [record for step, record in sampled if step.amplitude_v and step.of != "v_vc"]
    rest = [record for step, record in sampled if not step.amplitude_v and step.of != "v_vc"]
    frequency_hz, windows = settings.modulation_hz, settings.windows_a_burst
    output = []
    for number, each in enumerate(modulated, 1):
        try:
            output.append(demodulated(each.output_v, each.aperture_s, frequency_hz, windows))
        except (ConfigError, MeasurementError) as error:  # the sine is not in it: a lead may be off
            said = f"burst {number} of {len(modulated)}: {error.what}"
            raise MeasurementError(said, instrument="multimeter", hint=error.hint) from error
    _require_alike(output, rest, settings.meter_resolution_v)
    by_hand = [record for step, record in sampled if step.of == "v_vc" and step.amplitude_v]
    sines = [each for each in modulated if each.v_vc_v] or by_hand
    v_vc = [demodulated(each.v_vc_v, each.aperture_s, frequency_hz, 1) for each in sines]
    within_v = v_vc_tolerance_v(settings, settings.amplitude_v)
    for number, sine in enumerate(v_vc, 1):
        amplitude_v = sine.phasors[0].real
        if max(abs(amplitude_v - settings.amplitude_v), abs(sine.mean)) > within_v:
            raise MeasurementError(
                f"in burst {number} of {len(v_vc)} V_Vc reads {amplitude_v:.6g} V about {sine.mean:+.2g} V, set to "
                f"{settings.amplitude_v:.6g} V about 0, within {within_v:.2g} V",
                instrument=settings.v_vc_role,
                hint="check that its leads are on the V_Vc input and that it reads volts",
            )
    at_rest = [each.v_vc_v for step, each in sampled if not step.amplitude_v and each.v_vc_v]
    means = [math.fsum(each) / len(each) for each in at_rest]
    rest_v_vc_v = math.fsum(means) / len(means) if means else 0.0
    sign = _sign(settings, modulated, output, v_vc if not by_hand else [])
    return _Run(modulated, output, v_vc * len(output) if by_hand else v_vc, rest, rest_v_vc_v, sign)


def _require_alike(output: Sequence[Demodulated], rest: Sequence[ModulatedRecord], resolution_v: float) -> None:
    """See that no burst scatters, or swings, unlike the others, and no record at rest: a lead that came off.

    Nor all of them unlike the records at rest: an output at its limit is no sine.
    """
    rest_v = median(float(np.std(each.output_v)) for each in rest)
    scatter_v, swing_v = median(each.residual_rms for each in output), median(each.phasors[0].real for each in output)
    for number, each in enumerate(output, 1):
        if each.residual_rms > _SCATTER * max(scatter_v, resolution_v):
            said = f"scatters by {each.residual_rms:.2g} V about its sine, the others by {scatter_v:.2g} V"
        elif abs(each.phasors[0].real - swing_v) > _SWING * swing_v:
            said = f"swings by {each.phasors[0].real:.4g} V, the others by {swing_v:.4g} V"
        else:
            continue
        raise MeasurementError(f"burst {number} of {len(output)} {said}", instrument="multimeter")
    if scatter_v > _SCATTER * max(rest_v, resolution_v):
        said = f"the output scatters by {scatter_v:.2g} V about its sine, at rest by {rest_v:.2g} V: it is no sine"
        hint = "check it on the oscilloscope: it may be limited (virtual_rate_deg_s), or stand still at times"
        raise MeasurementError(said, instrument="multimeter", hint=hint)
    for number, record in enumerate(rest, 1):
        rms_v = float(np.std(record.output_v))
        if rms_v > _SCATTER * max(scatter_v, resolution_v):
            said = f"scatters by {rms_v:.2g} V, those with the sine by {scatter_v:.2g} V about it"
            raise MeasurementError(f"record {number} of {len(rest)} at rest {said}", instrument="multimeter")


def _sign(
    settings: OnlineSettings,
    records: Sequence[ModulatedRecord],
    output: Sequence[Demodulated],
    v_vc: Sequence[Demodulated],
) -> float:
    """Return the sign of the output per V of V_Vc: by the phase, or as known where V_Vc was not sampled beside."""
    slope, known = settings.known.k_vc.coefficients[1], settings.known_scale_factor
    if not v_vc:
        stated = settings.expected_gyro().scale_factor if known is None else known
        return math.copysign(1.0, stated * slope)
    speed = 2.0 * math.pi * settings.modulation_hz
    turned = [
        cmath.exp(1j * (out.phase_rad - into.phase_rad - speed * (record.output_t_s - record.v_vc_t_s)))
        for record, out, into in zip(records, output, v_vc, strict=True)
    ]
    sign = math.copysign(1.0, turned[0].real)
    for number, each in enumerate(turned, 1):
        if sign * each.real < _SURE:
            own_deg, first_deg = (math.degrees(cmath.phase(angle)) for angle in (each, turned[0]))
            angles = f"{own_deg:.0f} degrees, in the first {first_deg:.0f}"
            raise MeasurementError(
                f"burst {number} of {len(turned)}: output and V_Vc differ by {angles}, expected 0 or 180",
                instrument="multimeter",
            )
    return sign


class _Gain(Struct, frozen=True):
    """The gain of small signals without its sign: output per V_Vc, the response taken out, and its uncertainties."""

    windows: Floats
    """V/V."""
    u_readings: float
    """Standard uncertainty of one window."""
    value: float
    u_mean_readings: float
    u_third: float
    """Contribution of the noise of the third harmonic."""
    u_v_vc: float
    response: float
    amplitude_v: float
    offset_v: float
    """Mean V_Vc."""
    compression: float
    dof: float


def _gain(settings: OnlineSettings, run: _Run) -> _Gain:
    response = _static_response(settings, 1)
    amplitude_v = np.array([each.phasors[0].real for each in run.v_vc] or [settings.amplitude_v] * len(run.output))
    windows_v = np.array([each.in_phase for each in run.output]) / response
    slope = float(np.mean(windows_v.mean(axis=1) / amplitude_v))
    third = _harmonic_v(settings, run, 3, slope)
    offset_v = np.array([into.mean for into in run.v_vc] or [0.0] * len(run.output))
    bent_v = 4.0 * _harmonic_v(settings, run, 2, run.sign * slope) * offset_v / amplitude_v
    gains = (windows_v - 3.0 * third - run.sign * bent_v[:, None]) / amplitude_v[:, None]
    count, readings = len(run.output), settings.burst_readings
    middle_v = float(amplitude_v.mean())
    variance = math.fsum(each.variance(1, settings.window_readings) for each in run.output) / count
    variance_third = math.fsum(each.variance(3, readings) for each in run.output) / count
    own = {id(each): each for each in run.v_vc}.values()
    of_v_vc = math.sqrt(math.fsum(each.variance(1, readings) for each in own)) / len(own) if own else 0.0
    return _Gain(
        windows=gains.ravel(),
        u_readings=math.sqrt(variance) / middle_v,
        value=float(gains.mean()),
        u_mean_readings=math.sqrt(variance / gains.size) / middle_v,
        u_third=3.0 * math.sqrt(variance_third / count) / middle_v,
        u_v_vc=float(gains.mean()) * of_v_vc / middle_v,
        response=response,
        amplitude_v=middle_v,
        offset_v=float(offset_v.mean()),
        compression=3.0 * third / middle_v / float(gains.mean()),
        dof=2.0 * sum(each.lines[0] for each in run.output),
    )


def _harmonic_v(settings: OnlineSettings, run: _Run, order: int, gain: float) -> float:
    """Return the harmonic that curvature makes, V, mean of the bursts; by as much as the second it moves the mean.

    The slope of the same curvature at a mean V_Vc of v is 4 v / amplitude^2 times the second.
    """
    response = _static_response(settings, order)
    of_v_vc = [gain * into.phasors[order - 1].real for into in run.v_vc] or [0.0] * len(run.output)
    each_v = [out.phasors[order - 1].real / response - v for out, v in zip(run.output, of_v_vc, strict=True)]
    return float(np.mean(each_v))


def _static_response(settings: OnlineSettings, order: int) -> float:
    modes = settings.split_hz, settings.in_phase_split_hz, settings.in_phase_share
    return static_response(order * settings.modulation_hz, *modes)


def online_results(settings: OnlineSettings, measured: Measured) -> OnlineResult:
    """Return the scale factor of the windows and of the run, and the disturbance of the true rate."""
    run = _fitted(settings, measured)
    gain = _gain(settings, run)
    factor, since, said = k_vc_since(settings)
    k_vc = settings.known.k_vc.coefficients[1] * factor
    own, common = _parts(settings, gain, k_vc)
    begin_s = [each.output_t_s - run.modulated[0].output_t_s for each in run.modulated]
    window_s, burst_s = (each * settings.aperture_s for each in (settings.window_readings, settings.burst_readings))
    warmth = with_temperature(v_vc.of_warmth(settings, begin_s[-1] + burst_s), since)
    common += [replace(part, u=abs(gain.value / k_vc) * part.u) for part in (*warmth, *unmeasured(settings))]
    missing = missing_of(settings)
    if settings.v_vc_role != "v_vc_meter" and settings.known_scale_factor is None:
        missing = (*missing, UNKNOWN_SIGN)
    settings.require_known(gain.value * run.sign / k_vc)
    scale_factor = measurand(gain.value * run.sign / k_vc, "V/(deg/s)", [*own, *common], missing, "scale_factor_small")
    u_readings, u_common = gain.u_readings / abs(k_vc), math.sqrt(math.fsum(each.u**2 for each in (own[1], *common)))
    factors = gain.windows * run.sign / k_vc
    times_s = [at_s + (place + 0.5) * window_s for at_s in begin_s for place in range(settings.windows_a_burst)]
    left = (factors - factors.mean()) / u_readings
    disturbance, rectified, changes = _disturbance(settings, run, gain, scale_factor.value)
    mean = abs(float(factors.mean()))
    enough = factors.size >= 3
    curve = allan_deviation(1e6 * factors / mean, window_s, averaging_factors(factors.size, 2)) if enough else ()
    allan = tuple(
        AllanOfScaleFactor(
            each.tau_s, each.deviation, each.low, each.high, 1e6 * u_readings / mean * math.sqrt(window_s / each.tau_s)
        )
        for each in curve
    )
    size = abs(scale_factor.value)
    at_rest_v2 = math.fsum(float(np.var(each.output_v)) for each in run.rest) / len(run.rest)
    return OnlineResult(
        scale_factor=scale_factor,
        disturbance=disturbance,
        disturbed_by_less_than_deg_s=abs(disturbance.value) + disturbance.u95,
        windows=tuple(
            WindowFactor(t_s, float(each), u_readings, math.hypot(u_readings, u_common))
            for t_s, each in zip(times_s, factors, strict=True)
        ),
        allan=allan,
        chi_square=float(left @ left),
        dof=factors.size - 1,
        rate_t_s=tuple(at_s + 0.5 * burst_s for at_s in begin_s),
        rate_change_deg_s=tuple(changes.tolist()),
        noise_at_rest_deg_s=math.sqrt(at_rest_v2) / size,
        noise_modulated_deg_s=math.sqrt(math.fsum(each.residual_rms**2 for each in run.output) / len(run.output))
        / size,
        virtual_rate_deg_s=abs(k_vc) * gain.amplitude_v,
        v_vc_amplitude_v=gain.amplitude_v,
        rectified_deg_s=rectified,
        compression_ppm=1e6 * gain.compression,
        response_ppm=1e6 * (gain.response - 1.0),
        lost_share=1.0 - len(begin_s) * burst_s / (begin_s[-1] + burst_s),
        k_vc_from=settings.known.source,
        v_vc_by=v_vc.v_vc_error(settings).name,
        since=said,
        unseen=settings.known.unseen,
        holds_not=(*settings.known.holds_not, *_HOLDS_NOT, *gaps_of(settings)),
        drift=drift_of(scale_factor, settings.known, settings.acceptance, Here.of(settings)),
    )


def _parts(settings: OnlineSettings, gain: _Gain, k_vc: float) -> tuple[list[UncertaintyPart], list[UncertaintyPart]]:
    """Return the contributions of the readings to the scale factor's uncertainty, and those common to all windows."""
    size = abs(gain.value / k_vc)
    meter, error = v_vc.meter_error(settings, "multimeter"), v_vc.v_vc_error(settings)
    of_modes = math.hypot(2.0 * settings.u_split_hz / settings.split_hz, _U_SHARE / (1.0 - settings.in_phase_share))
    own = [
        UncertaintyPart(v_vc.READINGS, gain.u_mean_readings / abs(k_vc), gain.dof),
        UncertaintyPart("readings: the third harmonic", gain.u_third / abs(k_vc), gain.dof),
    ]
    common = [
        UncertaintyPart(METER_GAIN, size * meter.u_gain, None, meter.owner),
        UncertaintyPart("response at the frequency of the modulation", size * ((gain.response - 1.0) * of_modes)),
        *(replace(part, u=size * part.u) for part in by_phases(settings)),
    ]
    if gain.u_v_vc:
        common.append(UncertaintyPart(V_VC_NOISE, gain.u_v_vc / abs(k_vc)))
    of_curve, same_meter = curve_parts(settings)
    for name, covariance, dof, of in of_curve:
        u = size * math.sqrt(max(0.0, float(covariance[1, 1]))) / abs(k_vc)  # a share of none may round below 0
        common.append(UncertaintyPart(name, u, dof, of))
    if not same_meter:
        common.append(UncertaintyPart(V_VC_GAIN, size * error.u_gain, None, error.owner))
    return own, common


def _disturbance(
    settings: OnlineSettings, run: _Run, gain: _Gain, scale_factor: float
) -> tuple[Measurand, float, Floats]:
    """Return the disturbance, the part taken out as rectified (deg/s), and the change of the rate in each burst."""
    signed = gain.value * run.sign
    rectified_v = _harmonic_v(settings, run, 2, signed)
    shift_v = signed * (gain.offset_v - run.rest_v_vc_v)
    means_v = np.array([each.mean for each in run.output]) - rectified_v - shift_v
    rest = len(run.rest)
    rest_v = math.fsum(math.fsum(each.output_v) / len(each.output_v) for each in run.rest) / rest
    size, count = abs(scale_factor), len(run.output)
    changes = (means_v - rest_v) / scale_factor
    variance_mean = 0.5 * math.fsum(each.variance(1, settings.burst_readings) for each in run.output) / count
    white = variance_mean * (1.0 / count + 1.0 / rest)
    # Flicker by the differences of successive bursts, and not less than is known of the gyroscope, or assumed
    allan = 0.5 * float(np.mean(np.diff(means_v) ** 2))
    b_squared = max(0.0, allan - variance_mean) / FLICKER_FLOOR / size**2
    b_squared = max(b_squared, ((settings.station.sources.bias_instability_deg_h or 0.0) / 3600.0) ** 2)
    begin_s, burst_s = (
        [each.output_t_s for each in (*run.rest, *run.modulated)],
        settings.burst_readings * settings.aperture_s,
    )
    share = flicker_share(begin_s, burst_s, [-1.0 / rest] * rest + [1.0 / count] * count)
    of_second = math.fsum(each.variance(2, settings.burst_readings) for each in run.output) / count**2
    parts = [
        UncertaintyPart("noise of the means", math.sqrt(white) / size, gain.dof),
        UncertaintyPart("flicker between modulation and rest", math.sqrt(b_squared * share), float(count - 1)),
        UncertaintyPart("noise of the second harmonic", math.sqrt(of_second) / size, gain.dof),
    ]
    if not run.v_vc:
        offset_v = math.sqrt(2.0) * v_vc.v_vc_error(settings).u_offset_v
        parts.append(
            UncertaintyPart("offset of the generator, sine against direct voltage", gain.value * offset_v / size)
        )
    return measurand(float(changes.mean()), "deg/s", parts), rectified_v / scale_factor, changes


def online_report(settings: OnlineSettings, _measured: Measured, results: OnlineResult) -> Report:
    """Report scale factor, disturbance, the windows, and their Allan deviation."""
    disturbance = results.disturbance
    scatter = f"chi-square {results.chi_square:.1f} for {results.dof} degrees of freedom"
    sine = f"virtual rate {results.virtual_rate_deg_s:.4g} deg/s, V_Vc {results.v_vc_amplitude_v:.6g} V"
    less = f"disturbance below {results.disturbed_by_less_than_deg_s:.2g} deg/s (95 %)"
    scattered = f"{results.noise_at_rest_deg_s:.2g} deg/s at rest, {results.noise_modulated_deg_s:.2g} modulated"
    curvature = f"{results.compression_ppm:+.0f} ppm of curvature, {results.response_ppm:+.0f} ppm of response"
    words = [
        said_of("scale factor of small signals", results.scale_factor),
        f"{len(results.windows)} windows scatter with {scatter}; {sine}",
        f"true rate with modulation minus at rest: {disturbance.value:+.2g} deg/s, u {disturbance.u:.1g}: {less}",
        f"  contributions to u: {made_of(disturbance, '.1g')} deg/s",
        f"noise of a reading: {scattered}; {100.0 * results.lost_share:.2g} % of the time is lost between bursts",
        f"corrected: {results.rectified_deg_s:+.3g} deg/s of rectification, {curvature}",
        f"K_Vc from {results.k_vc_from}; V_Vc is taken from the {results.v_vc_by}",
        *results.since,
        *v_vc.known_words(settings),
    ]
    columns = heads("t [s]:.1f | scale factor [V/(deg/s)]:.8f | u of the readings [ppm]:.1f | u [ppm]:.1f")
    rows = [
        (each.t_s, each.scale_factor_v_per_deg_s, _ppm(each.u_readings, each), _ppm(each.u, each))
        for each in results.windows
    ]
    mean = results.scale_factor.value
    times = [each.t_s for each in results.windows]
    ppm = [1e6 * (each.scale_factor_v_per_deg_s / mean - 1.0) for each in results.windows]
    factors = Series("window", times, ppm, [_ppm(each.u_readings, each) for each in results.windows])
    rate = Series("burst", results.rate_t_s, results.rate_change_deg_s)
    figures = [
        Figure("Scale factor over time", Axis("time", "s"), Axis("scale factor minus its mean", "ppm"), [factors]),
        Figure(
            "True rate, corrected for the modulation",
            Axis("time", "s"),
            Axis("rate minus rate at rest", "deg/s"),
            [rate],
        ),
    ]
    if shown := [each for each in results.allan if each.deviation_ppm > 0.0]:
        tau, deviations = [each.tau_s for each in shown], [each.deviation_ppm for each in shown]
        low, high = [each.low_ppm for each in shown], [each.high_ppm for each in shown]
        curve = Series("windows", tau, deviations, low=low, high=high)
        noise = Series("noise of the readings alone", tau, [each.noise_ppm for each in shown], kind="line")
        axes = Axis("averaging time", "s", "log"), Axis("Allan deviation", "ppm", "log")
        band = "The band contains the true value with 95 % probability."
        figures.append(Figure("Allan deviation of the scale factor", *axes, [curve, noise], band))
    parts = [
        Text("\n".join(words)),
        Table(columns, rows, "scale factor, window by window"),
        budget_table("the scale factor", results.scale_factor),
        *([] if results.drift is None else drift_parts(results.drift)),
        *figures,
        *lists_of_omissions(results.holds_not, results.unseen),
    ]
    return Report(parts)


def _ppm(u: float, window: WindowFactor) -> float:
    return 1e6 * u / abs(window.scale_factor_v_per_deg_s)
