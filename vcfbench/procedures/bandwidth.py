"""The rate response: a sine on V_Vc at many frequencies, table still; split and Q by the closed form through the gains.

The meter samples the output by itself at 0.2 power-line cycles, since one cycle or more would average the split away.
All frequencies have one amplitude and one range, so that what generator and meter are off cancels in the response. Its
phase is measured where the oscilloscope sees both V_Vc and the output, whose channels are sampled at the same instants.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from statistics import fmean, stdev
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from vcfbench import steps
from vcfbench.analysis import rate_band
from vcfbench.analysis.tone import Tone
from vcfbench.belief.one_gain import require_one_gain
from vcfbench.errors import MeasurementError
from vcfbench.instructions.kept import Keeps, KeptSettings
from vcfbench.instructions.procedure import Procedure, roles
from vcfbench.instructions.routines import (
    check_rails,
    drive_seen,
    energised,
    framed,
    held_at_rest,
    set_sine,
    v_vc_on,
)
from vcfbench.interfaces import FunctionGenerator, SamplesVoltage
from vcfbench.records import device_values
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import ranged, said, several
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.measured import Foreseen, Measured
from vcfbench.steps.step import Routine, answer
from vcfbench.uncertainty import oscilloscope
from vcfbench.uncertainty import tones as sampling
from vcfbench.uncertainty.measurand import as_kept, measurand, printed, quantity_table
from vcfbench.values.value import Measurand, UncertaintyPart

RECORDS = 4
_PERIODS = 4.0
"""A record, at least."""
_DIVISIONS_WIDE = 10.0
_ROOM = 1.1
_SCATTER = 3.0
"""Times by which the gains may be farther from the closed form than their u explains."""
_CLOSE = 1e-5
"""As close as gains without noise need to be to it."""


class PhasePoint(Struct, frozen=True):
    """Phase of the output against V_Vc at one frequency, deg, that at rest (0 or half a turn) taken off.

    The low-pass filter is in it. Phases go on from one frequency to the next, beyond half a turn above the split.
    """

    frequency_hz: float
    phase_deg: Measurand


def phase_channels(settings: ProcedureSettings) -> tuple[int, int] | None:
    """Return the oscilloscope's channels that see V_Vc and the output; None where it does not see both."""
    wiring = settings.station.oscilloscope
    if wiring is None:
        return None
    v_vc, output = wiring.channel_of("v_vc"), wiring.channel_of("output")
    return None if v_vc is None or output is None else (v_vc, output)


def phases_of(
    settings: ProcedureSettings, amplitude_v: float, found: Sequence[tuple[float, steps.SineResponse]]
) -> Routine[None]:
    """Capture V_Vc and output at each frequency; the meter's samples `found` give the size of the output."""
    channels = phase_channels(settings)
    if channels is None:
        return
    yield steps.Note("V_Vc and output on the oscilloscope: the phase between them")
    for frequency_hz, response in sorted(found, key=lambda each: each[0]):
        largest_v = _ROOM * max(*map(abs, response.voltages_v), settings.meter_resolution_v)
        lasts_s = _PERIODS / frequency_hz
        yield from set_sine(settings, frequency_hz, amplitude_v)
        yield steps.ConfigureScope(lasts_s / _DIVISIONS_WIDE, channels[0])
        expected = steps.SineRecord(frequency_hz, (amplitude_v, largest_v), (0.0, 0.0))
        yield steps.CaptureSines(channels, (_ROOM * amplitude_v, largest_v), RECORDS, expected, lasts_s)


def measured_phases(
    settings: ProcedureSettings, measured: Measured, expected_deg: Callable[[float], float]
) -> tuple[PhasePoint, ...]:
    """Return the phases that were measured, in the order of their frequencies; none where none were.

    `expected_deg` tells about where the first one is, since output and V_Vc are in phase or opposed at rest, as the
    signs of scale factor and K_Vc have it.
    """
    channels = phase_channels(settings)
    points: list[PhasePoint] = []
    at_rest_deg = 0.0
    for step, taken in measured.found(steps.SineRecords):
        if channels is None or taken.channels != channels or not isinstance(step, steps.CaptureSines):
            continue
        frequency_hz, seen = step.expected.frequency_hz, [each.phases_deg[1] for each in taken.records]
        if points:
            near_deg = points[-1].phase_deg.value
        else:
            near_deg = expected_deg(frequency_hz)
            at_rest_deg = 180.0 * round(math.remainder(seen[0] - near_deg, 360.0) / 180.0)
        turned = [near_deg + math.remainder(each - at_rest_deg - near_deg, 360.0) for each in seen]
        u_deg = stdev(turned) / math.sqrt(len(turned))
        parts = [UncertaintyPart("scatter of the records", u_deg, len(turned) - 1.0)]
        points.append(PhasePoint(frequency_hz, measurand(fmean(turned), "deg", parts)))
    return tuple(points)


def phase_parts(points: Sequence[PhasePoint]) -> list[Table | Figure]:
    """Lay out the phases, and draw them."""
    if not points:
        return []
    columns = heads("frequency [Hz]:.4g | phase [deg] | u [deg] | U95 [deg]")
    rows = [(each.frequency_hz, *printed(each.phase_deg)) for each in points]
    at_hz, phases = [each.frequency_hz for each in points], [each.phase_deg for each in points]
    series = Series("measured", at_hz, [each.value for each in phases], [each.u for each in phases])
    title = "Phase of the output against V_Vc, the low-pass filter in it"
    return [Table(columns, rows, title), Figure(title, Axis("frequency", "Hz", "log"), Axis("phase", "deg"), [series])]


_TIME_BASE = 20e-6
"""33220A: frequency within 20 ppm a year (data sheet, unverified), rectangular."""
_PAPER_Q = 1224.0
"""Quality factor of the sense modes of the paper's gyroscope: assumed in a dry run."""
_PAPER_LAG_RAD = math.radians(0.5)
"""The same of its demodulator."""

Hertz = Annotated[float, ranged(0.05, sampling.HIGHEST_HZ)]
Ratio = Annotated[float, ranged(0.05, 3.0)]


class BandwidthSettings(KeptSettings, frozen=True, kw_only=True):
    """Keys of `bandwidth`; the gyroscope is warm first, since its split moves by 3.5 mHz/K."""

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 1800.0
    sine_amplitude_v: Annotated[float, ranged(0.01, 10.0, "peak of the sine on V_Vc, at all frequencies")] = 0.1
    record_samples: Annotated[int, ranged(128, 512, "readings per frequency")] = 512
    frequencies_hz: Annotated[
        tuple[Hertz, ...], several(4, 200, "frequencies of the first sweep, which finds the split")
    ] = (
        *(0.3, 1.0, 2.0, 4.5, 6.5, 9.0, 12.0),
        *(16.0, 20.0, 25.0, 31.0, 38.0, 48.0, 60.0),
    )
    around_split: Annotated[
        tuple[Ratio, ...], Meta(max_length=200, description="further frequencies, as ratios to the split found")
    ] = (
        *(0.5, 0.54, 0.6, 0.7, 0.8, 0.88, 0.93, 0.96, 0.98, 0.99, 1.0, 1.01, 1.02, 1.04, 1.07, 1.12, 1.2, 1.35),
        *(1.5, 1.55, 1.65),
    )
    split_guess_hz: Annotated[Hertz, said("mode split that a dry run assumes")] = 24.8
    in_phase_split_hz: Annotated[float, ranged(10.0, 10_000.0, "drive minus in-phase sense frequency, roughly")] = 147.0
    low_pass_hz: Annotated[float, ranged(0.1, 1e5, "cut-off of the low-pass filter")] = 100.0
    low_pass_order: Annotated[int, ranged(1, 12, "order of the low-pass filter, Butterworth")] = 4
    closed_form_ppm: Annotated[
        float, ranged(0.0, 1e5, "added u of each gain for deviations from the closed form, such as a Q that drifts")
    ] = 0.0


class Bandwidth(Struct, frozen=True):
    """Result of `bandwidth`; frequencies of the response without the low-pass filter, which is divided out.

    `split_hz` is the size of the split, whose sign no response shows. `q` is that of the anti-phase sense mode;
    `peak_gain` is over the static gain. `static_gain_v_per_v` rests on the generator's setting and has no uncertainty.
    `chi_square` over `dof` tells how well the closed form fits; what it lacks is in the uncertainty as far as
    `closed_form_ppm` says. `gain_v_per_v` and `u_gain_v_per_v` are what was measured, `residual` what the fit leaves.
    """

    split_hz: Measurand
    q: Measurand
    plus_3_db_hz: Measurand
    peak_hz: Measurand
    peak_gain: Measurand
    minus_3_db_hz: Measurand
    drive_hz: float
    u_drive_hz: float
    static_gain_v_per_v: float
    in_phase_share: float
    u_in_phase_share: float
    chi_square: float
    dof: int
    frequency_hz: tuple[float, ...]
    gain_v_per_v: tuple[float, ...]
    u_gain_v_per_v: tuple[float, ...]
    residual: tuple[float, ...]
    phase: tuple[PhasePoint, ...] = ()
    """Phase of the output against V_Vc, where the oscilloscope sees both; else empty."""


NOT_HELD = (
    "The uncertainties contain the noise about each frequency, the generator's time base and, for Q, the drive "
    "frequency. They do not contain: the corner of the low-pass filter, the meter's aperture, a change of temperature "
    "during the run, a different share of V_Vc and of a rate in the two sense modes. "
)
NO_PHASE = (
    "The phase of the response is not measured: it needs one channel of the oscilloscope on V_Vc and another on the "
    "output (wiring.oscilloscope), as the meter's samples have no common start with the generator."
)
PHASE_HOLDS = (
    "The uncertainties of the phases contain the scatter of the records, not a difference between the delays of "
    "the oscilloscope's channels. The phases include the low-pass filter, the gains do not."
)


@framed(energised, drive_seen, held_at_rest)
def plan(settings: BandwidthSettings) -> steps.Plan:
    """Sweep the sine over all frequencies, find the split, and go closely about it."""
    found, _ = yield from sweep(settings)
    yield from phases_of(settings, settings.sine_amplitude_v, found)


Responses = list[tuple[float, steps.SineResponse]]
"""Frequency (Hz) and what was sampled there."""


def sweep(settings: BandwidthSettings) -> Routine[tuple[Responses, float]]:
    """Measure the drive frequency, to which Q is in proportion, then the responses; V_Vc is left a sine.

    Both are returned, the frequency as the bench file foresees it where there is no oscilloscope.
    """
    drive_hz = settings.drive.foreseen[0]
    if settings.station.oscilloscope is not None:
        drive_hz = (yield from oscilloscope.capture_drive(settings)).frequency_hz
    yield steps.ConfigureMeter(float(settings.meter_range_v), sampling.NPLC)
    yield from v_vc_on()
    yield steps.Note("The sine at frequencies far apart")
    found = yield from _respond(settings, settings.frequencies_hz)
    tones = tones_of(settings, found)
    split_hz = rate_band.split_guess_hz(
        [tone.frequency_hz for tone in tones],
        [tone.amplitude for tone in tones],
        (settings.low_pass_hz, settings.low_pass_order),
    )
    yield steps.Note(f"The sine about the split, near {split_hz:.4g} Hz")
    found += yield from _respond(settings, [float(f"{split_hz * ratio:.4g}") for ratio in settings.around_split])
    yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
    return found, drive_hz


def _respond(settings: BandwidthSettings, frequencies_hz: Iterable[float]) -> Routine[Responses]:
    """Take the response at those frequencies, rising, that a record tells from the mains, whose pick-up is a tone."""
    amplitude_v, samples, found = settings.sine_amplitude_v, settings.record_samples, []
    for hz in sorted(frequencies_hz):
        if hz > sampling.HIGHEST_HZ or not sampling.stands_off_mains(hz, settings.station.mains_hz, samples):
            continue
        yield from set_sine(settings, hz, amplitude_v)
        sample = steps.SampleSine(hz, amplitude_v, samples, sampling.sampled_every_s(hz), settings.split_guess_hz)
        found.append((hz, answer((yield sample), steps.SineResponse)))
        yield from check_rails(settings)
    return found


def tones_of(settings: ProcedureSettings, found: Sequence[tuple[float, steps.SineResponse]]) -> list[Tone]:
    """Fit the sine in every record."""
    return sampling.fitted_tones([(hz, each, each.voltages_v) for hz, each in found], float(settings.station.mains_hz))


def results(settings: BandwidthSettings, measured: Measured) -> Bandwidth:
    """Fit the response to all that was sampled."""
    sampled = [(step, each) for step, each in measured.found(steps.SineResponse) if isinstance(step, steps.SampleSine)]
    low_hz, high_hz = settings.drive.frequency_hz
    drive_hz, u_drive_hz = 0.5 * (low_hz + high_hz), (high_hz - low_hz) / math.sqrt(12.0)
    if of_drive := [found for _, found in measured.found(steps.SineRecords) if len(found.channels) == 1]:
        seen = oscilloscope.DriveRecords.of(of_drive[-1].records)
        drive_hz = seen.frequency_hz
        u_drive_hz = math.hypot(seen.u_hz, oscilloscope.TIME_BASE / math.sqrt(3.0) * drive_hz)
    known = rate_band.Known(
        drive_hz,
        settings.in_phase_split_hz,
        low_pass_hz=settings.low_pass_hz,
        low_pass_order=settings.low_pass_order,
        off_form=1e-6 * settings.closed_form_ppm,
    )
    if isinstance(measured, Foreseen):
        # What the paper's gyroscope will show, with the noise that its modes pass and that is folded
        gyro = settings.expected_gyro()
        static_v = abs(gyro.scale_factor * gyro.k_vc) * settings.sine_amplitude_v
        shown = (settings.split_guess_hz, _PAPER_Q, 1.0, settings.in_phase_split_hz, _PAPER_LAG_RAD)
        reading_s = sampling.NPLC / settings.station.mains_hz
        whole = static_v, measured.white_v_sqrt_s
        tones = [
            rate_band.foreseen_tone(step.frequency_hz, (step.samples, step.interval_s, reading_s), whole, known, shown)
            for step, _ in sampled
        ]
    else:
        tones = tones_of(settings, [(step.frequency_hz, each) for step, each in sampled])
    band = rate_band.fit_rate_band(tones, settings.sine_amplitude_v, known)
    off = band.residual / np.hypot(band.u_gain / band.gain, _CLOSE)
    if (times := math.sqrt(off @ off / band.dof)) > _SCATTER:  # what is read off the form would be untrue
        worst = int(np.argmax(np.abs(off)))
        raise MeasurementError(
            f"the gains are {times:.2g} times as far from the closed form as their u explains, the gain at "
            f"{band.frequency_hz[worst]:.4g} Hz by {100.0 * band.residual[worst]:+.2g} %",
            instrument="multimeter",
            hint="check whether the output is limited (sine_amplitude_v) or its gain changed in the sweep; "
            "closed_form_ppm adds a deviation from the closed form to u",
        )
    in_time = [step.frequency_hz for step, _ in sampled]
    require_one_gain(band, drive_hz, np.array(list(map(in_time.index, band.frequency_hz))), _CLOSE)
    shape = band.parameters[[0, 1, 3, 4, 5]]
    phase = measured_phases(settings, measured, lambda at_hz: rate_band.response_phase_deg(at_hz, known, shape))
    return _bandwidth(band, drive_hz, u_drive_hz, phase, lacking=settings.closed_form_ppm > 0.0)


_QUANTITIES = ("split_hz", "q", "plus_3_db_hz", "peak_hz", "peak_gain", "minus_3_db_hz")


def _bandwidth(
    band: rate_band.RateBand, drive_hz: float, u_drive_hz: float, phase: tuple[PhasePoint, ...], *, lacking: bool
) -> Bandwidth:
    def quantity(name: str) -> Measurand:
        """Combine independent parts; only that of the noise has finite degrees of freedom."""
        value, u_noise = getattr(band, name)
        parts = [UncertaintyPart("noise, and closed_form_ppm" if lacking else "noise", u_noise, band.noise_dof)]
        if name != "peak_gain":
            parts.append(UncertaintyPart("time base", _TIME_BASE / math.sqrt(3.0) * value))
        if name == "q":
            parts.append(UncertaintyPart("drive frequency", value * u_drive_hz / drive_hz))
        return measurand(value, "Hz" if name.endswith("_hz") else "", parts)

    return Bandwidth(
        **{name: quantity(name) for name in _QUANTITIES},
        drive_hz=drive_hz,
        u_drive_hz=u_drive_hz,
        static_gain_v_per_v=band.static_gain,
        in_phase_share=band.in_phase_share[0],
        u_in_phase_share=band.in_phase_share[1],
        chi_square=band.chi_square,
        dof=band.dof,
        frequency_hz=tuple(band.frequency_hz.tolist()),
        gain_v_per_v=tuple(band.gain.tolist()),
        u_gain_v_per_v=tuple(band.u_gain.tolist()),
        residual=tuple(band.residual.tolist()),
        phase=phase,
    )


def report(_settings: BandwidthSettings, _measured: Measured, found: Bandwidth) -> Report:
    """Report the figures, the response with its fit, and the residuals."""
    named = {
        "mode split, without sign": found.split_hz,
        "Q of the sense mode": found.q,
        "+3 dB": found.plus_3_db_hz,
        "peak": found.peak_hz,
        "gain at the peak, over the static gain": found.peak_gain,
        "-3 dB": found.minus_3_db_hz,
    }
    static = found.static_gain_v_per_v
    gains, u_gains = ([each / static for each in of] for of in (found.gain_v_per_v, found.u_gain_v_per_v))
    measured = Series("measured", found.frequency_hz, gains, u_gains)
    fitted = [gain / (1.0 + left) for gain, left in zip(gains, found.residual, strict=True)]
    ppm = [1e6 * each for each in found.residual]
    u_ppm = [1e6 * u / gain for u, gain in zip(found.u_gain_v_per_v, found.gain_v_per_v, strict=True)]
    rest = Series("measured less fitted", found.frequency_hz, ppm, u_ppm)
    frequency = Axis("frequency", "Hz", "log")
    share = f"in-phase mode: {100 * found.in_phase_share:.1f}({100 * found.u_in_phase_share:.1f}) % of the static gain"
    fit = f"closed form: chi-square {found.chi_square:.1f} for {found.dof} degrees of freedom; {share}"
    return Report(
        [
            quantity_table(named),
            Text(f"drive {found.drive_hz:.3f}({found.u_drive_hz:.3f}) Hz; {fit}\n{NOT_HELD}"),
            *phase_parts(found.phase),
            Text(PHASE_HOLDS if found.phase else NO_PHASE),
            Figure(
                "Response to a sine on V_Vc, over the static gain",
                frequency,
                Axis("gain", scale="log"),
                [measured, Series("closed form", found.frequency_hz, fitted, kind="line")],
            ),
            Figure("Deviation from the closed form", frequency, Axis("gain", "ppm"), [rest]),
        ]
    )


def characteristics(found: Bandwidth) -> device_values.Characteristics:
    """Return the characteristics that K_Vc depends on, as a sweep found them.

    It knows one Q of both modes, and the size of the split: a response has both side bands of a mode, below the drive
    or above.
    """
    return device_values.Characteristics(
        drive_hz=device_values.Measured(value=found.drive_hz, u=found.u_drive_hz),
        split_size_hz=as_kept(found.split_hz),
        q_anti_phase=as_kept(found.q),
        in_phase_share=device_values.Measured(value=found.in_phase_share, u=found.u_in_phase_share),
    )


BANDWIDTH = Procedure(
    name="bandwidth",
    method=(
        "A sine on V_Vc makes a virtual rate of known frequency and amplitude; the response in the output, over the "
        "static gain, is fitted by the closed form of the two sense modes and the demodulator."
    ),
    settings=BandwidthSettings,
    plan=plan,
    results=results,
    report=report,
    entry=Keeps("bandwidth", lambda _, found: characteristics(found)),
    needs=roles(rate_source=FunctionGenerator, multimeter=SamplesVoltage),
    uses=roles("power", "oscilloscope", "rate_table"),
)
