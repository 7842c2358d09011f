"""The virtual vibration: a rate that vibrates, by the second generator, and the output's response.

The paper's bench has a second generator for a virtual vibration rate; here its sine is added to V_Vc, on which the
first generator stands at 0 V. What the output should make of it follows from its response to a direct V_Vc, taken in
the same run, and from the closed form of the modes; both are compared at each frequency.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
from msgspec import Struct

from vcfbench import steps
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import derivatives
from vcfbench.analysis.modulation import flicker_share
from vcfbench.analysis.rate_band import split_response
from vcfbench.analysis.tone import Tone
from vcfbench.belief.jumps import watched
from vcfbench.belief.walk import require_answer
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.v_vc import both_signs, generator_sheet, has_v_vc_meter
from vcfbench.interfaces import FunctionGenerator, SamplesVoltage
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import ranged, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import V_VC_RANGE_V, ProcedureSettings
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Routine
from vcfbench.uncertainty import tones
from vcfbench.uncertainty.measurand import made_of, measurand
from vcfbench.values.quantile import t_of_largest
from vcfbench.values.value import Measurand, UncertaintyPart, Value
from vcfbench.values.verdict import e_n

_STATIC = 1
"""The step of its points: V_Vc direct."""
_LEAST_TONES = 3
_LEAST_SPLIT_HZ = 1.0
_STEP = 1e-3
"""Part of a parameter by which it is changed for a derivative."""
_HIGHEST_HZ = 75.0
"""Two meters are read in turn, one pair every 6 ms: no tone up to it is folded."""

Hertz = Annotated[float, ranged(0.3, _HIGHEST_HZ)]


class VibrationSettings(ProcedureSettings, frozen=True, kw_only=True):
    """Settings of the vibration; split and Q as `bandwidth` finds them, with their standard uncertainties."""

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 1800.0
    vibration_hz: Annotated[tuple[Hertz, ...], several(1, 100, "frequencies of the virtual vibration")] = (
        *(0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 35.0),
    )
    vibration_amplitude_v: Annotated[
        float, ranged(1e-3, 10.0, "peak of the vibration on V_Vc; a rate by k_vc_guess_deg_s_per_v")
    ] = 0.04
    static_v_vc_v: Annotated[float, ranged(1e-3, 10.0, "DC V_Vc of both signs, for the response at rest")] = 0.05
    record_samples: Annotated[int, ranged(128, 512, "readings per frequency")] = 512
    split_hz: Annotated[float, ranged(-1000.0, 1000.0, "drive minus anti-phase sense frequency, of either sign")] = 24.8
    u_split_hz: Annotated[float, ranged(0.0, 100.0, "standard uncertainty of split_hz")] = 0.02
    q: Annotated[float, ranged(1.0, 1e6, "quality factor of the anti-phase sense mode")] = 1224.0
    u_q: Annotated[float, ranged(0.0, 1e5, "standard uncertainty of q")] = 10.0
    in_phase_split_hz: Annotated[float, ranged(10.0, 10_000.0, "drive minus in-phase sense frequency, roughly")] = 147.0
    in_phase_share: Annotated[float, ranged(-0.9, 0.9, "share of the in-phase mode in the response at rest")] = 0.147
    u_in_phase_share: Annotated[float, ranged(0.0, 0.5, "standard uncertainty of in_phase_share")] = 0.01
    low_pass_hz: Annotated[float, ranged(0.1, 1e5, "cut-off of the low-pass filter")] = 100.0
    low_pass_order: Annotated[int, ranged(1, 12, "order of the low-pass filter, Butterworth")] = 4

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if abs(self.split_hz) < _LEAST_SPLIT_HZ:
            yield InvalidValue("split_hz", f"at least {_LEAST_SPLIT_HZ:g} Hz either way", self.split_hz)

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        """The wanted frequencies that a record separates from the mains, rising."""
        mains_hz, samples = self.station.mains_hz, self.record_samples
        return tuple(sorted(each for each in self.vibration_hz if tones.stands_off_mains(each, mains_hz, samples)))


class VibrationResponse(Struct, frozen=True):
    """Response of the output to one vibration.

    `response` is that of the output to V_Vc over that at rest, as measured; `expected` that of the closed form.
    `virtual_rate_deg_s` is the amplitude by the K_Vc that the bench expects, for orientation.
    """

    frequency_hz: float
    v_vc_amplitude_v: float
    virtual_rate_deg_s: float
    output_amplitude_v: float
    response: Measurand
    expected: Measurand
    e_n: float
    """Difference of the two over its expanded uncertainty: above 1 they disagree."""


class VibrationResult(Struct, frozen=True):
    """The response at rest, V per V, and at each frequency.

    `largest_e_n` is over the U95 that the differences at all frequencies keep together: each of eight by itself would
    be above 1 in one of three healthy runs (Sidak, J. Am. Stat. Assoc. 62 (1967), 626).
    """

    static_v_per_v: Measurand
    responses: tuple[VibrationResponse, ...]
    largest_e_n: float
    v_vc_is_measured: bool

    def stated(self) -> Iterator[Value]:
        """Yield its values; a response of the table is none."""
        missing = dict.fromkeys(
            name for row in self.responses for name in (*row.response.missing, *row.expected.missing)
        )
        yield self.static_v_per_v.called("static_v_per_v", words="response at rest, V per V of V_Vc")
        yield Value("e_n", self.largest_e_n, kind="e_n", missing=tuple(missing))


NOT_HELD = (
    "The uncertainties contain the noise about each frequency, noise and flicker of the windows at rest, split, Q and "
    "share of the modes as set and, without a meter on V_Vc, the accuracy of both generators. They do not contain: the "
    "corner of the filter, curvature (20 ppm at 7 deg/s), a change of temperature during the run."
)


def _unshaken(_settings: VibrationSettings, work: steps.Plan) -> steps.Plan:
    yield steps.DisableVibration()
    yield from work


@routines.framed(_unshaken, routines.energised, routines.drive_seen, routines.held_at_rest)
def vibration(settings: VibrationSettings) -> steps.Plan:
    """Take the response at rest, then the vibrations."""
    yield from watched(settings, _static(settings))
    yield steps.Note("The virtual vibration")
    amplitude_v = settings.vibration_amplitude_v
    yield from _meters(settings, tones.NPLC)
    try:
        yield steps.SetVibration(settings.frequencies_hz[0], amplitude_v)
        yield steps.EnableVibration()
        for frequency_hz in settings.frequencies_hz:
            yield steps.SetVibration(frequency_hz, amplitude_v)
            yield steps.Settle(settings.settle_s, "gyro settles after the change of frequency")
            yield steps.SampleModulated(
                *(frequency_hz, amplitude_v, settings.record_samples, tones.sampled_every_s(frequency_hz)),
                of="both" if has_v_vc_meter(settings) else "output",
                table_deg_s=None,
                tolerance_deg_s=settings.rate_tolerance_deg_s,
            )
            yield from routines.check_rails(settings)
    finally:
        yield steps.DisableVibration()
    yield from _meters(settings, float(settings.nplc))


def _meters(settings: VibrationSettings, nplc: float) -> Routine[None]:
    """Set both meters up alike, so that the attenuation by averaging over a reading cancels."""
    yield steps.ConfigureMeter(float(settings.meter_range_v), nplc)
    if has_v_vc_meter(settings):
        yield steps.ConfigureVvcMeter(V_VC_RANGE_V, nplc)


def _static(settings: VibrationSettings) -> Routine[None]:
    yield steps.Note(f"V_Vc direct, {settings.static_v_vc_v:g} V both ways")
    yield from _meters(settings, float(settings.nplc))
    yield from routines.v_vc_on()
    require_answer(settings, (yield from both_signs(settings, _STATIC, settings.static_v_vc_v)))
    yield steps.SetVvc(0.0)


def results(settings: VibrationSettings, measured: Measured) -> VibrationResult:
    """Compare each response with the closed form."""
    # The response at rest, by both signs of V_Vc
    points = [point for point in measured if point.step == _STATIC]
    levels = [point.v_vc_v if point.v_vc_measured_v is None else point.v_vc_measured_v for point in points]
    signs = [math.copysign(1.0, point.v_vc_v) for point in points]
    swing_v = math.fsum(sign * level for sign, level in zip(signs, levels, strict=True))
    gain = math.fsum(sign * point.output_v for sign, point in zip(signs, points, strict=True)) / swing_v
    of_output = math.sqrt(math.fsum(point.std_v**2 / point.n for point in points)) / abs(swing_v)
    of_level = math.sqrt(math.fsum((point.v_vc_std_v or 0.0) ** 2 / point.n for point in points)) / abs(swing_v)
    dof, known = float(sum(point.n - 1 for point in points)), settings.station.sources
    begin_s = [float(window.t_s[0]) for window in measured.readings.windows[: len(signs)]]
    share = flicker_share(begin_s, settings.samples * settings.sample_interval_s, signs)
    b_v = (known.bias_instability_deg_h or 0.0) / 3600.0 / abs(settings.expected_gyro().k_vc)
    flicker = abs(gain) / abs(swing_v) * b_v * math.sqrt(share)
    parts = [
        UncertaintyPart("readings at rest", of_output, dof),
        UncertaintyPart("flicker at rest", flicker, known.bias_instability_dof),
        UncertaintyPart("readings of V_Vc at rest", abs(gain) * of_level, dof),
        *_believed(settings, "V_Vc direct", abs(gain)),
    ]
    static = measurand(gain, "V/V", parts)
    found = measured.found(steps.ModulatedRecord)
    records = [(step.frequency_hz, each) for step, each in found if isinstance(step, steps.SampleModulated)]
    mains_hz = float(settings.station.mains_hz)
    outputs = tones.fitted_tones([(hz, each, each.output_v) for hz, each in records], mains_hz)
    inputs = tones.fitted_tones([(hz, each, each.v_vc_v) for hz, each in records if each.v_vc_v], mains_hz)
    seen_hz = [each.frequency_hz for _, each in measured.found(steps.DriveReading) if not each.trouble]
    drive_hz = seen_hz[-1] if seen_hz else settings.drive.foreseen[0]
    noise_v = _noise_v(settings, outputs, drive_hz).tolist()
    responses = tuple(
        _response(settings, static, output, noise_v[place], inputs[place] if inputs else None, drive_hz=drive_hz)
        for place, output in enumerate(outputs)
    )

    def together(found: Measurand) -> float:  # U95 that all of them keep together (Sidak), so that 1 is its own limit
        return found.u * t_of_largest(len(responses), math.inf if found.dof is None else found.dof)

    pairs = [(each.response, each.expected) for each in responses]
    largest = max(e_n(one.value, together(one), other.value, together(other)) for one, other in pairs)
    return VibrationResult(static, responses, largest, has_v_vc_meter(settings))


def _believed(settings: VibrationSettings, what: str, size: float) -> list[UncertaintyPart]:
    """Return the contribution of a level that nobody measured: the generator's accuracy, rectangular."""
    if has_v_vc_meter(settings):
        return []
    return [UncertaintyPart(f"generator's accuracy, {what}", size * generator_sheet(settings).setting / math.sqrt(3.0))]


def _noise_v(settings: VibrationSettings, outputs: Sequence[Tone], drive_hz: float) -> Floats:
    """Return the standard uncertainty of each tone's amplitude by noise, V.

    It was read from the spectrum on both sides, over some hertz, where near the peak the modes pass more than at the
    tone itself. So the noise of the close records is taken apart into what is flat and what passed the modes.
    """
    close = [tone for tone in outputs if tone.frequency_hz >= tones.SLOW_BELOW_HZ]
    u_v = np.array([tone.u_amplitude for tone in outputs])
    if len(close) < _LEAST_TONES:
        return u_v

    def passed(frequency_hz: float) -> float:
        parameters = np.array([settings.split_hz, settings.q, settings.in_phase_share])
        return _closed_form(settings, drive_hz, frequency_hz, parameters) ** 2

    def beside_hz(tone: Tone) -> list[float]:  # lines of the spectrum from which the noise about it was read
        width_hz = 1.0 / (settings.record_samples * tone.spacing_s)
        return [abs(tone.frequency_hz + sign * step * width_hz) for step in range(2, 9) for sign in (-1.0, 1.0)]

    at_tone = np.array([passed(tone.frequency_hz) for tone in close])
    beside = np.array([np.mean([passed(hz) for hz in beside_hz(tone)]) for tone in close])
    variance = np.array([tone.u_amplitude**2 for tone in close])
    found, *_ = np.linalg.lstsq(np.column_stack([1.0 / variance, beside / variance]), np.ones(len(close)), rcond=None)
    flat, by_modes = (0.0, 1.0) if found[0] < 0.0 else (1.0, 0.0) if found[1] < 0.0 else found
    own = np.sqrt(variance * (flat + by_modes * at_tone) / (flat + by_modes * beside))
    u_v[[tone in close for tone in outputs]] = own
    return u_v


def _response(
    settings: VibrationSettings, static: Measurand, output: Tone, noise_v: float, v_vc: Tone | None, *, drive_hz: float
) -> VibrationResponse:
    amplitude_v = settings.vibration_amplitude_v if v_vc is None else v_vc.amplitude
    size = abs(static.value)
    value = output.amplitude / amplitude_v / size
    parts = [UncertaintyPart("noise of the output", value * noise_v / output.amplitude, output.noise_dof)]
    if v_vc is not None:
        parts.append(UncertaintyPart("noise of V_Vc", value * v_vc.u_amplitude / amplitude_v, v_vc.noise_dof))
    parts += [
        *_believed(settings, "the vibration", value),
        *(UncertaintyPart(part.source, value * part.u / size, part.dof) for part in static.parts),
    ]
    # The closed form with the uncertainties of its parameters
    inputs = {
        "mode split": (settings.split_hz, settings.u_split_hz),
        "Q": (settings.q, settings.u_q),
        "share of the in-phase mode": (settings.in_phase_share, settings.u_in_phase_share),
    }
    at, u_at = np.array([*inputs.values()]).T

    def closed_form(parameters: Floats) -> float:
        return _closed_form(settings, drive_hz, output.frequency_hz, parameters)

    slopes = derivatives(closed_form, at, _STEP * np.maximum(np.abs(at), 0.01))
    by_parameters = [UncertaintyPart(*each) for each in zip(inputs, (np.abs(slopes) * u_at).tolist(), strict=True)]
    expected = measurand(closed_form(at), "", by_parameters)
    response = measurand(value, "", parts)
    return VibrationResponse(
        *(output.frequency_hz, amplitude_v, abs(settings.expected_gyro().k_vc) * amplitude_v, output.amplitude),
        *(response, expected, e_n(response.value, response.u95, expected.value, expected.u95)),
    )


def _closed_form(settings: VibrationSettings, drive_hz: float, frequency_hz: float, parameters: Floats) -> float:
    """Return the response over that at rest, for split, Q and share: both side bands of both modes, and the filter."""
    split_hz, q, in_phase_share = parameters.tolist()
    own, far = (1.0 / ((drive_hz - each) ** 2 - drive_hz**2) for each in (split_hz, settings.in_phase_split_hz))
    pick_off = in_phase_share / (1.0 - in_phase_share) * own / far
    shape = np.array([split_hz, q, pick_off, settings.in_phase_split_hz, 0.0])
    filtered = 1.0 / math.sqrt(1.0 + (frequency_hz / settings.low_pass_hz) ** (2 * settings.low_pass_order))
    return filtered * float(split_response(frequency_hz, drive_hz, shape)[0])


def report(_settings: VibrationSettings, _measured: Measured, found: VibrationResult) -> Report:
    """Report the responses and the closed form."""
    columns = heads(
        "frequency [Hz]:g | virtual rate [deg/s]:.4g | output [V]:.5g | response:.5f | U95:.1g | "
        "expected:.5f | U95:.1g | difference [%]:+.3f | E_n:.2f | <contributions to u"
    )
    rows = [
        (
            *(each.frequency_hz, each.virtual_rate_deg_s, each.output_amplitude_v),
            *(each.response.value, each.response.u95, each.expected.value, each.expected.u95),
            *(100.0 * (each.response.value / each.expected.value - 1.0), each.e_n, made_of(each.response, ".1g")),
        )
        for each in found.responses
    ]
    static = found.static_v_per_v
    by = "measured by its meter" if found.v_vc_is_measured else "as set"
    words = f"response at rest {static.value:.6g} V/V, u {static.u:.1g}; V_Vc {by}; "
    words += f"largest E_n, of all together, {found.largest_e_n:.2f}"
    at_hz = [each.frequency_hz for each in found.responses]
    responses = [each.response for each in found.responses]
    measured = Series("measured", at_hz, [each.value for each in responses], [each.u for each in responses])
    expected = Series("closed form", at_hz, [each.expected.value for each in found.responses], kind="line")
    axes = Axis("frequency", "Hz", "log"), Axis("response over response at rest", scale="log")
    return Report(
        [
            Table(columns, rows),
            Text(f"{words}\n{NOT_HELD}"),
            Figure("Response to the virtual vibration", *axes, [measured, expected]),
        ]
    )


VIBRATION = Procedure(
    name="vibration",
    method=(
        "A second generator adds a sine to V_Vc, which the gyroscope feels as a vibrating rate. The response in the "
        "output is compared with the closed form."
    ),
    settings=VibrationSettings,
    watched=Watched(frozenset({_STATIC})),
    plan=vibration,
    results=results,
    report=report,
    needs=roles("rate_source", vibration_source=FunctionGenerator, multimeter=SamplesVoltage),
    uses={**roles("power", "oscilloscope", v_vc_meter=SamplesVoltage), **roles("rate_table")},
)
