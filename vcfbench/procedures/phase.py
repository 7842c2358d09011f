"""Phases: carrier, Coriolis, virtual Coriolis and demodulator against the drive, and their effect on K_Vc.

Drive, carrier and sense signal are sines of one frequency on the oscilloscope, fitted as IEEE 1057 has it. What a rate
or V_Vc does to the sense signal is the difference of its phasors at both signs: quadrature and feed-through, which are
there all the time, drop out. The demodulator's reference is no node of the bench; it is found by a V_Vc of twice the
drive frequency and a little: :mod:`vcfbench.analysis.rotating`.
"""

import cmath
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from statistics import fmean, stdev, variance
from typing import Annotated, Final

from msgspec import Struct, structs

from vcfbench import steps
from vcfbench.analysis.rotating import reference_phase
from vcfbench.belief.in_turn import DEG, SHARE, InTurn, Visit, require_alike
from vcfbench.errors import MeasurementError
from vcfbench.instructions.kept import Keeps, KeptSettings
from vcfbench.instructions.procedure import Procedure, roles
from vcfbench.instructions.routines import framed, go_to_rate, powered, set_sine, turning, v_vc_level_again, v_vc_on
from vcfbench.interfaces import FunctionGenerator
from vcfbench.records import device_values
from vcfbench.reports.document import Axis, Figure, Report, Series, Text
from vcfbench.station.bounds import ranged
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps import RotationRecord, Rotations, SineRecord, SineRecords
from vcfbench.steps.drive_check import one_two_five
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import LOOK_AT_SIGNALS, Routine, answer
from vcfbench.uncertainty import oscilloscope
from vcfbench.uncertainty.measurand import as_kept, measurand, quantity_table
from vcfbench.uncertainty.oscilloscope import CaptureSense, aimed, amplitudes, at_both_signs, channels_of, sense_phasor
from vcfbench.values.value import Measurand, UncertaintyPart

LEAST_CYCLES: Final = 3


class PhaseSettings(KeptSettings, frozen=True, kw_only=True):
    """Keys of `phase`."""

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 600.0
    rate_deg_s: Annotated[float, ranged(1.0, 1e4, "rate of the table, both signs")] = 100.0
    v_vc_v: Annotated[float, ranged(0.01, 10.0, "V_Vc, both signs")] = 0.7
    sine_amplitude_v: Annotated[
        float, ranged(0.01, 10.0, "peak of the sine that finds the demodulator's reference")
    ] = 1.4
    difference_hz: Annotated[
        float, ranged(0.5, 50.0, "offset of that sine from twice the drive frequency, both ways")
    ] = 8.0
    records: Annotated[int, ranged(2, 1000, "records of each state in a cycle")] = 5
    rotation_records: Annotated[int, ranged(1, 100, "records of each of both sines in a cycle")] = 2
    target_deg: Annotated[float, ranged(1e-3, 10.0, "cycles end at this expanded uncertainty of every phase")] = 0.05
    most_cycles: Annotated[int, ranged(LEAST_CYCLES, 1000, "largest number of cycles")] = 20

    @property
    def fastest_deg_s(self) -> float:
        return self.rate_deg_s

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from self.beyond_table("rate_deg_s", self.rate_deg_s)


_LARGEST_SCATTER_DEG = 5.0
"""Largest scatter of the demodulator's phase between records: mere noise scatters by 52 deg, a gyroscope by 0.01."""
_WANDERS_DEG, _WANDERS = 0.01, 0.003
"""How far a phase, deg, and the sense signal's size walk by a kelvin: Q by 0.2 %, a phase of 3 deg by as much."""


class Phases(Struct, frozen=True):
    """Phases against the drive signal, deg, of one frequency all; and their effect on K_Vc.

    `coriolis_deg` and `virtual_deg` are those of the sense signal that a positive rate and a positive V_Vc make.
    Of `demodulator_deg` half turns are not seen. The `..._from_...` are folded into -90 to 90: `velocity` leads the
    drive signal by a quarter turn. `k_vc_error_ppm` is by how much K_Vc, found by equal outputs, is larger than the
    quotient of both forces' sense signals. `k_vc_ppm_per_carrier_deg` and `k_vc_ppm_per_demodulator_deg` say by how
    much it changes with a degree of either; `scale_factor_ppm_per_demodulator_deg` and
    `bias_deg_s_per_demodulator_deg` by how much scale factor and bias do: the latter is what quadrature and
    feed-through let in. `filter_delay_ms` is that of the filter behind the demodulator.
    """

    carrier_deg: Measurand
    coriolis_deg: Measurand
    virtual_deg: Measurand
    demodulator_deg: Measurand
    carrier_from_velocity_deg: Measurand
    coriolis_from_velocity_deg: Measurand
    virtual_from_coriolis_deg: Measurand
    demodulator_from_coriolis_deg: Measurand
    k_vc_error_ppm: Measurand
    k_vc_ppm_per_carrier_deg: float
    k_vc_ppm_per_demodulator_deg: float
    scale_factor_ppm_per_demodulator_deg: float
    bias_deg_s_per_demodulator_deg: float
    filter_delay_ms: Measurand
    drive_hz: float
    records: int
    target_deg: float
    target_met: bool


class _Angle(Struct, frozen=True):
    """A phase against the drive signal, deg, with the uncertainty that its records leave."""

    deg: float
    u_deg: float
    dof: float

    def part(self, source: str, weight: float = 1.0) -> UncertaintyPart:
        """Return it as a part of an uncertainty, `weight` that of a degree."""
        return UncertaintyPart(source, abs(weight) * self.u_deg, self.dof)


def phases_of(
    settings: PhaseSettings, states: Sequence[tuple[CaptureSense, SineRecords]], turned: Sequence[RotationRecord]
) -> Phases:
    """Return the phases from records of the sense signal at both signs of rate and V_Vc, and of both sines.

    Raises:
        MeasurementError: a rate or V_Vc does not move the sense signal, or the output does not follow that.
    """
    records = [each for _, found in states for each in found.records]
    first_deg = records[0].phases_deg[1]  # the mean of angles that lie close together, also across 180 deg
    beside = [math.remainder(each.phases_deg[1] - first_deg, 360.0) for each in records]
    u_deg = stdev(beside) / math.sqrt(len(beside))
    carrier = _Angle(math.remainder(first_deg + fmean(beside), 360.0), u_deg, len(beside) - 1)
    coriolis = _response(states, lambda step: step.rate_deg_s, f"a rate of {settings.rate_deg_s:g} deg/s")
    virtual = _response(states, lambda step: step.v_vc_v, f"V_Vc of {settings.v_vc_v:g} V")
    reference = reference_phase(aimed(turned, settings.difference_hz))
    if reference.scatter_deg > _LARGEST_SCATTER_DEG:
        raise MeasurementError(
            "the output does not respond to the sense signal: the demodulator's phase scatters by "
            f"{reference.scatter_deg:.0f} deg from record to record, as that of mere noise does",
            instrument="oscilloscope",
            hint=LOOK_AT_SIGNALS,
        )
    demodulator = _Angle(reference.phase_deg, reference.u_phase_deg, reference.dof)
    phases = {"carrier": carrier, "Coriolis": coriolis, "virtual": virtual, "demodulator": demodulator}
    drive_hz = fmean(each.frequency_hz for each in records)
    skew = oscilloscope.skew(drive_hz)
    against_drive = {
        f"{name.lower()}_deg": measurand(each.deg, "deg", [each.part("records"), skew]) for name, each in phases.items()
    }

    def apart(name: str, of: str) -> Measurand:  # from half turns
        own = [phases[each].part(each) for each in (name, of)]
        return measurand(_folded(phases[name].deg - phases[of].deg), "deg", own)

    error, by_carrier, by_demodulator = _of_k_vc(coriolis, virtual, demodulator)
    # At rest there is the mean of both signs of a rate; the demodulator lets in what is a quarter turn from it
    plus, minus = (sum(each) / len(each) for each in at_both_signs(states, lambda step: step.rate_deg_s))
    seen = cmath.rect(1.0, -math.radians(demodulator.deg))
    per_deg_s = ((plus - minus) / (2.0 * settings.rate_deg_s) * seen).real
    return Phases(
        **against_drive,
        carrier_from_velocity_deg=measurand(_folded(carrier.deg - 90.0), "deg", [carrier.part("carrier"), skew]),
        coriolis_from_velocity_deg=measurand(_folded(coriolis.deg - 90.0), "deg", [coriolis.part("Coriolis"), skew]),
        virtual_from_coriolis_deg=apart("virtual", "Coriolis"),
        demodulator_from_coriolis_deg=apart("demodulator", "Coriolis"),
        k_vc_error_ppm=error,
        k_vc_ppm_per_carrier_deg=by_carrier,
        k_vc_ppm_per_demodulator_deg=by_demodulator,
        scale_factor_ppm_per_demodulator_deg=1e6 * math.radians(math.tan(math.radians(coriolis.deg - demodulator.deg))),
        bias_deg_s_per_demodulator_deg=math.radians(((plus + minus) / 2.0 * seen).imag / per_deg_s),
        filter_delay_ms=measurand(
            1e3 * reference.delay_s, "ms", [UncertaintyPart("records", 1e3 * reference.u_delay_s, reference.dof)]
        ),
        drive_hz=drive_hz,
        records=len(records) + len(turned),
        target_deg=settings.target_deg,
        target_met=all(each.u95 <= settings.target_deg for each in against_drive.values()),
    )


def _of_k_vc(coriolis: _Angle, virtual: _Angle, demodulator: _Angle) -> tuple[Measurand, float, float]:
    """Return the effect of the phases on K_Vc, ppm, and ppm a degree of carrier and demodulator.

    The demodulator sees both sense signals with the cosine of their angle to its reference.
    """
    seen, by_rate = (math.radians(_folded(each.deg - demodulator.deg)) for each in (virtual, coriolis))
    ratio = math.cos(seen) / math.cos(by_rate)
    ppm_a_degree = 1e6 * ratio * math.radians(1.0)
    by_virtual, by_coriolis = -ppm_a_degree * math.tan(seen), ppm_a_degree * math.tan(by_rate)
    by_demodulator = -by_virtual - by_coriolis
    parts = [
        virtual.part("virtual", by_virtual),
        coriolis.part("Coriolis", by_coriolis),
        demodulator.part("demodulator", by_demodulator),
    ]
    return measurand(1e6 * (ratio - 1.0), "ppm", parts), by_virtual, by_demodulator


def _folded(angle_deg: float) -> float:
    """Return an angle apart from half turns, -90 to 90 deg."""
    return math.remainder(angle_deg, 180.0)


def _response(
    states: Sequence[tuple[CaptureSense, SineRecords]], level: Callable[[CaptureSense], float], what: str
) -> _Angle:
    """Return the phase of the difference of the sense signal's phasors between the two signs of a level."""
    plus, minus = at_both_signs(states, level)
    moved = sum(plus) / len(plus) - sum(minus) / len(minus)
    if abs(moved) < 1e-3 * max(map(abs, plus)):
        raise MeasurementError(f"{what} of either sign does not move the sense signal", instrument="oscilloscope")
    along = moved / abs(moved)
    variances = [variance((each / along).imag for each in state) / len(state) for state in (plus, minus)]
    dof = len(plus) + len(minus) - 2
    return _Angle(math.degrees(cmath.phase(moved)), math.degrees(math.sqrt(sum(variances)) / abs(moved)), dof)


def phase_results(settings: PhaseSettings, measured: Measured) -> Phases:
    """Return the phases from all that was captured."""
    turned = [each for _, found in measured.found(Rotations) for each in found.records]
    phases = phases_of(settings, _captured(measured), turned)
    require_alike(in_turn(settings, measured))
    return phases


def _captured(measured: Measured) -> list[tuple[CaptureSense, SineRecords]]:
    return [(step, found) for step, found in measured.found(SineRecords) if isinstance(step, CaptureSense)]


def in_turn(settings: PhaseSettings, measured: Measured) -> Iterator[InTurn]:
    """Yield what the records showed in turn: phases of carrier and sense signal, the latter's size, the reference."""
    states = _captured(measured)
    first: dict[tuple[float, float], SineRecord] = {}
    for step, found in states:
        first.setdefault((step.rate_deg_s, step.v_vc_v), found.records[0])

    def visits(moved: Callable[[SineRecord, SineRecord], float]) -> tuple[Visit, ...]:
        levels = [(step.rate_deg_s, step.v_vc_v) for step, _ in states]
        return tuple(
            Visit(level, tuple(moved(each, first[level]) for each in found.records), found)
            for level, (_, found) in zip(levels, states, strict=True)
        )

    for channel, what in ((1, "carrier"), (2, "sense signal")):
        phases = visits(
            lambda each, of, at=channel: math.remainder(each.phases_deg[at] - of.phases_deg[at], 360.0)  # type: ignore[misc]
        )
        yield InTurn(f"the phase of the {what}", DEG, _WANDERS_DEG, phases, partial(_spoilt, channel))
    sizes = visits(lambda each, of: each.amplitudes_v[2] / of.amplitudes_v[2] - 1.0)
    yield InTurn("the size of the sense signal", SHARE, _WANDERS, sizes, partial(_spoilt, 2, of_amplitude=True))
    turned = [found for _, found in measured.found(Rotations)]
    used = aimed([each for found in turned for each in found.records], settings.difference_hz)
    turned = [
        found for found in turned if all((each.difference_hz, each.reference_deg) in used for each in found.records)
    ]
    line = reference_phase(used)

    def off_line_deg(each: RotationRecord) -> float:
        return math.remainder(each.reference_deg - line.phase_deg - 360.0 * line.delay_s * each.difference_hz, 180.0)

    references = tuple(
        Visit(found.records[0].difference_hz > 0.0, tuple(map(off_line_deg, found.records)), found) for found in turned
    )
    yield InTurn("the phase of the demodulator", DEG, _WANDERS_DEG, references, _turned)


def _spoilt(channel: int, result: SineRecords, size: float, *, of_amplitude: bool = False) -> SineRecords:
    """Return records with a channel's phase off by deg, or its amplitude by a share."""

    def off(each: SineRecord) -> SineRecord:
        field = "amplitudes_v" if of_amplitude else "phases_deg"
        values = list(getattr(each, field))
        values[channel] = (1.0 + size) * values[channel] if of_amplitude else values[channel] + size
        return structs.replace(each, **{field: tuple(values)})

    return structs.replace(result, records=tuple(map(off, result.records)))


def _turned(result: Rotations, size_deg: float) -> Rotations:
    records = (structs.replace(each, reference_deg=each.reference_deg + size_deg) for each in result.records)
    return structs.replace(result, records=tuple(records))


NOT_HELD = (
    "The uncertainties contain the scatter of the records and, against the drive signal, the skew of the "
    "oscilloscope's channels. They do not contain: probes and the resistance of the nodes, the non-linearity of the "
    "converter, the phase of the drive pick-off, the curvature of the filter's lag, a change of temperature. Not "
    "detected: signs, since combs, pick-offs and output stage may invert (angles are known modulo half a turn); the "
    "force itself, which has no node: a delay between carrier and force appears in the virtual phase, as does the "
    "effect of unequal combs; and the in-phase and the anti-phase mode separately."
)


def phase_report(_settings: PhaseSettings, measured: Measured, found: Phases) -> Report:
    """Report the phases, their effect on K_Vc, and the omissions of the uncertainties."""
    against_drive = {
        "carrier": found.carrier_deg,
        "sense signal of a positive rate (Coriolis)": found.coriolis_deg,
        "sense signal of a positive V_Vc (virtual)": found.virtual_deg,
        "demodulator's reference, modulo half a turn": found.demodulator_deg,
    }
    errors = {
        "carrier against the drive's velocity": found.carrier_from_velocity_deg,
        "Coriolis against the drive's velocity": found.coriolis_from_velocity_deg,
        "virtual against Coriolis": found.virtual_from_coriolis_deg,
        "demodulator against Coriolis": found.demodulator_from_coriolis_deg,
        "error of K_Vc by equal outputs": found.k_vc_error_ppm,
        "delay of the filter": found.filter_delay_ms,
    }
    error = found.k_vc_error_ppm
    sensitivities = {
        "k_vc_ppm_carrier_deg": found.k_vc_ppm_per_carrier_deg,
        "k_vc_ppm_demodulator_deg": found.k_vc_ppm_per_demodulator_deg,
        "scale_factor_ppm_demodulator_deg": found.scale_factor_ppm_per_demodulator_deg,
        "bias_deg_s_demodulator_deg": found.bias_deg_s_per_demodulator_deg,
    }
    known = ", ".join(f"{key} = {value:.4g}" for key, value in sensitivities.items())
    said = (
        f"drive {found.drive_hz:.3f} Hz; {found.records} records; U95 of {found.target_deg:g} deg for every phase: "
        f"{'met' if found.target_met else 'NOT met'}\nK_Vc by equal outputs: {abs(error.value):.0f} ppm too "
        f"{'small' if error.value < 0.0 else 'large'}, U95 {error.u95:.2g} ppm; it changes by "
        f"{found.k_vc_ppm_per_carrier_deg:+.0f} ppm per degree of the carrier, "
        f"{found.k_vc_ppm_per_demodulator_deg:+.1f} ppm per degree of the demodulator\n"
        f"for [uncertainty] of the bench file: {known}\n{NOT_HELD}"
    )
    # The sense signal of each record as a phasor
    seen: dict[str, list[complex]] = {"rate +": [], "rate -": [], "V_Vc +": [], "V_Vc -": []}
    for step, taken in measured.found(SineRecords):
        if isinstance(step, CaptureSense) and (step.rate_deg_s or step.v_vc_v):
            what, level = ("rate", step.rate_deg_s) if step.rate_deg_s else ("V_Vc", step.v_vc_v)
            seen[f"{what} {'+' if level > 0.0 else '-'}"] += [1e3 * sense_phasor(each) for each in taken.records]
    series = [Series(name, [p.real for p in each], [p.imag for p in each]) for name, each in seen.items() if each]
    axes = Axis("in phase with the drive signal", "mV"), Axis("a quarter period ahead", "mV")
    words = "One point per record; the vector from minus to plus has the phase of the force."
    return Report(
        [
            quantity_table(against_drive, "phases against the drive signal"),
            quantity_table(errors, "phase errors (modulo half a turn) and error of K_Vc"),
            Text(said),
            *([Figure("Sense signal against the drive signal", *axes, series, words)] if series else []),
        ]
    )


_SPACINGS = 4.0
"""Spacings of two records in what the gyroscope takes to settle: some four time constants of the sense modes, whose
noise swings at the mode split."""
_NEVER_REACHED = 1.5
"""A trigger level over the amplitude that is never reached, and still on a screen of eight divisions and a little."""
_A_PERIOD = 5.0
"""Points in a period of the drive while the sense signal turns."""
_TURNS = 4.0
"""Least turns of the sense signal against the drive in a record."""


@framed(powered)
def plan(settings: PhaseSettings) -> steps.Plan:
    """Take records at both signs of rate, V_Vc and difference, until every phase is known well enough."""
    yield from v_vc_on()
    drive, shown_v, turning_v = yield from _scales(settings)
    states: list[tuple[CaptureSense, SineRecords]] = []
    turned: list[RotationRecord] = []
    off_hz = 0.0
    for cycle in range(1, settings.most_cycles + 1):
        yield steps.Note(f"Cycle {cycle}")
        signs = (1.0, -1.0) if cycle % 2 else (-1.0, 1.0)
        states += yield from _static(settings, signs, shown_v, drive)
        taken, off_hz = yield from _rotations(settings, signs, turning_v, drive.frequency_hz, off_hz)
        turned += taken
        if cycle >= LEAST_CYCLES and phases_of(settings, states, turned).target_met:
            return


def _scales(settings: PhaseSettings) -> Routine[tuple[SineRecord, tuple[float, ...], tuple[float, ...]]]:
    """Measure the drive, then find the largest amplitudes of all states (drive, carrier, sense; drive, sense, output).

    All states are seen at one scale; V_Vc shall have twice the drive frequency and a little.
    """
    yield steps.Note("The largest signals of all states, which set the scales")
    (drive_v,) = yield from amplitudes(settings, settings.station.channel_of("drive"))
    drive = yield from oscilloscope.capture_drive(settings, drive_v, settings.records)
    yield _fast(settings, drive.frequency_hz)
    shown_v: tuple[float, ...] = (0.0, 0.0, 0.0)
    turning_v, previous_deg_s = shown_v, 0.0
    channels = channels_of(settings, "carrier", "sense")
    for rate_deg_s, v_vc_v in _states(settings, (1.0, -1.0)):
        yield from _go(settings, rate_deg_s, v_vc_v, previous_deg_s)
        shown_v, previous_deg_s = tuple(map(max, shown_v, (yield from amplitudes(settings, *channels)))), rate_deg_s
    yield from _go(settings, 0.0, 0.0, previous_deg_s)
    yield steps.Note("The largest signals under the sines beside twice the drive frequency")
    slow = _slow(settings)
    yield slow
    channels = channels_of(settings, "sense", "output")
    points = oscilloscope.points_that_show(10.0 * slow.timebase_s_per_div, drive.frequency_hz)
    for sign in (1.0, -1.0):
        turning_hz = 2.0 * drive.frequency_hz + sign * settings.difference_hz
        yield from set_sine(settings, turning_hz, settings.sine_amplitude_v)
        turning_v = tuple(map(max, turning_v, (yield from amplitudes(settings, *channels, points=points))))
    yield from v_vc_level_again()
    return drive, shown_v, turning_v


def _fast(settings: PhaseSettings, drive_hz: float, drive_v: float = 0.0) -> steps.ConfigureScope:
    """Return the time base that shows some ten periods of the drive, with points enough for each.

    The trigger is beyond the drive's amplitude `drive_v`, where that is known: records that begin anywhere have other
    errors of rounding each, which average out and are in the scatter.
    """
    channel = settings.station.channel_of("drive")
    return steps.ConfigureScope(one_two_five(1.0 / drive_hz), channel, _NEVER_REACHED * drive_v)


def _slow(settings: PhaseSettings) -> steps.ConfigureScope:
    """Return the time base that shows whole turns of the sense signal against the drive."""
    seconds_a_division = one_two_five(_TURNS / settings.difference_hz / 10.0)
    return steps.ConfigureScope(seconds_a_division, settings.station.channel_of("drive"))


def _states(settings: PhaseSettings, signs: tuple[float, float]) -> list[tuple[float, float]]:
    """Return rate (deg/s) and V_Vc (V) of the states of a cycle."""
    rates = [(sign * settings.rate_deg_s, 0.0) for sign in signs]
    return [*rates, *((0.0, sign * settings.v_vc_v) for sign in signs)]


def _go(settings: PhaseSettings, rate_deg_s: float, v_vc_v: float, previous_deg_s: float) -> Routine[None]:
    yield steps.SetVvc(v_vc_v)
    yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)


def _static(
    settings: PhaseSettings, signs: tuple[float, float], shown_v: tuple[float, ...], drive: SineRecord
) -> Routine[list[tuple[CaptureSense, SineRecords]]]:
    """Take the records of a cycle's states, table and V_Vc at rest afterwards."""
    yield _fast(settings, drive.frequency_hz, shown_v[0])
    channels, levels_v = channels_of(settings, "carrier", "sense"), drive.amplitudes_v * 2
    taken, previous_deg_s, spacing_s = [], 0.0, settings.settle_s / _SPACINGS
    for rate_deg_s, v_vc_v in _states(settings, signs):
        yield from _go(settings, rate_deg_s, v_vc_v, previous_deg_s)
        sense_deg = math.copysign(90.0, rate_deg_s + v_vc_v)
        expected = SineRecord(drive.frequency_hz, (*levels_v, 1.0), (0.0, -90.0, sense_deg))
        step = CaptureSense(channels, shown_v, settings.records, expected, spacing_s, rate_deg_s, v_vc_v)
        taken.append((step, answer((yield step), SineRecords)))
        previous_deg_s = rate_deg_s
    yield from _go(settings, 0.0, 0.0, previous_deg_s)
    return taken


def _rotations(
    settings: PhaseSettings, signs: tuple[float, float], shown_v: tuple[float, ...], drive_hz: float, off_hz: float
) -> Routine[tuple[list[RotationRecord], float]]:
    """Take the records of a cycle's sines, set `off_hz` lower; return what the next are to be, too."""
    slow = _slow(settings)
    yield slow
    channels = channels_of(settings, "sense", "output")
    highest_hz = drive_hz + settings.difference_hz
    points = oscilloscope.points_over(10.0 * slow.timebase_s_per_div, highest_hz, _A_PERIOD)
    taken: list[RotationRecord] = []
    for sign in signs:
        offset_hz, count = sign * settings.difference_hz, settings.rotation_records
        yield from set_sine(settings, 2.0 * drive_hz + offset_hz - off_hz, settings.sine_amplitude_v)
        step = steps.CaptureRotations(channels, shown_v, count, points, offset_hz, drive_hz)
        records, off_hz = yield from turning(settings, step, settings.sine_amplitude_v, off_hz)
        taken += records
    yield from v_vc_level_again()
    return taken, off_hz


def phase_characteristics(_settings: PhaseSettings, found: Phases) -> device_values.Characteristics:
    """Return the characteristics that K_Vc depends on: phases against the drive's velocity."""
    demodulator = as_kept(found.demodulator_deg)
    return device_values.Characteristics(
        drive_hz=device_values.Measured(
            value=found.drive_hz, u=found.drive_hz * oscilloscope.TIME_BASE / math.sqrt(3.0)
        ),
        carrier_phase_deg=as_kept(found.carrier_from_velocity_deg),
        demodulator_phase_deg=structs.replace(demodulator, value=math.remainder(demodulator.value - 90.0, 180.0)),
    )


PHASE = Procedure(
    name="phase",
    method=(
        "Waveforms of drive, carrier, sense signal and output are captured by the oscilloscope, the table turning and "
        "V_Vc standing for a rate in turn. Sines fitted to them give the phases of carrier, Coriolis and virtual "
        "signal and of the demodulator, and what their errors do to K_Vc."
    ),
    settings=PhaseSettings,
    plan=plan,
    results=phase_results,
    report=phase_report,
    unforeseen=dict.fromkeys(
        Phases.__struct_fields__, "it is the scatter of the records, which go on until target_deg"
    ),
    entry=Keeps("phase", phase_characteristics),
    in_turn=in_turn,
    needs={**roles(rate_source=FunctionGenerator), **roles("multimeter", "oscilloscope", "rate_table")},
    uses=roles("power"),
)
