"""Phases: carrier, Coriolis, virtual Coriolis and demodulator against the drive, and what they do to K_Vc.

Drive, carrier and sense signal are sines of one frequency on the oscilloscope, fitted as IEEE 1057 has it. What a rate
or V_Vc does to the sense signal is the difference of its phasors at both signs: quadrature and feed-through, which are
there all the time, drop out. The demodulator's reference is no node of the bench; it is found by a V_Vc of twice the
drive frequency and a little: :mod:`vcfbench.analysis.rotating`.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from statistics import fmean, stdev, variance
from typing import TYPE_CHECKING, Annotated, TypeAlias

from msgspec import Meta

from vcfbench.bench.invalid_value import InvalidValue
from vcfbench.bench.settings import ProcedureSettings, rate_words
from vcfbench.errors import MeasurementError
from vcfbench.interfaces import FunctionGenerator, MeasuresWaveforms, PowersRails, ReadsVoltage, Rotates
from vcfbench.plans.drive_check import one_two_five
from vcfbench.plans.step import answer
from vcfbench.plans.steps import (
    Amplitudes,
    CaptureRotations,
    CaptureSines,
    ConfigureScope,
    FindAmplitudes,
    Note,
    Outcome,
    Plan,
    RotationRecord,
    Rotations,
    SetSine,
    Settle,
    SetVvc,
    SineRecord,
    SineRecords,
)
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.measurand import Measurand, UncertaintyPart, measurand
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.routines import go_to_rate, powered, v_vc_level_again, v_vc_on
from vcfbench.report.document import Axis, Column, Figure, Report, Series, Table, Text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from vcfbench.bench.parts import Node
    from vcfbench.plans.measured import Measured
    from vcfbench.plans.step import Routine

_Amplitudes: TypeAlias = tuple[float, float, float]

__all__ = ["PHASE", "CaptureSense", "PhaseSettings", "Phases", "phases_of"]

_SKEW_S = 1e-10
"""DSO7104B: delay of a channel, either way (unverified), rectangular."""
_LARGEST_V = 10.0
"""What no node of the PCB exceeds: its rails."""
_SPACING_S = 0.5
"""Between two records: four time constants of the sense modes, whose noise swings at the mode split."""
_NEVER_REACHED = 1.5
"""A trigger level over the amplitude that is never reached, and still on a screen of eight divisions and a little."""
_LEAST_CYCLES = 3
_ROTATION_POINTS = 10_000
_TURNS = 4.0
"""Of the sense signal against the drive in a record, at least."""


class PhaseSettings(ProcedureSettings, frozen=True, kw_only=True):
    """Keys of `phase`."""

    warm_up_s: Annotated[float, Meta(ge=0.0, le=86_400.0, description="wait after power-on")] = 600.0
    rate_deg_s: Annotated[float, Meta(ge=1.0, le=1e4, description="of the table, both signs")] = 100.0
    v_vc_v: Annotated[float, Meta(ge=0.01, le=10.0, description="V_Vc, both signs")] = 0.7
    sine_amplitude_v: Annotated[
        float, Meta(ge=0.01, le=10.0, description="peak of the sine that finds the demodulator's reference")
    ] = 1.4
    difference_hz: Annotated[
        float, Meta(ge=0.5, le=50.0, description="by which that sine is off twice the drive frequency, both ways")
    ] = 8.0
    records: Annotated[int, Meta(ge=2, le=1000, description="records of each state in a cycle")] = 5
    rotation_records: Annotated[int, Meta(ge=1, le=100, description="records of each of both sines in a cycle")] = 2
    target_deg: Annotated[
        float, Meta(ge=1e-3, le=10.0, description="expanded uncertainty at which cycles end, of every phase")
    ] = 0.05
    most_cycles: Annotated[int, Meta(ge=_LEAST_CYCLES, le=1000, description="and after so many they end anyway")] = 20

    @property
    def fastest_deg_s(self) -> float:
        """The fastest that the table is asked to turn, deg/s, either way."""
        return self.rate_deg_s

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield what the ranges cannot say; every node that is looked at needs a channel."""
        yield from super().contradictions()
        most_deg_s = self.station.limits.max_rate_deg_s
        if most_deg_s is not None and self.rate_deg_s > most_deg_s:
            yield InvalidValue("rate_deg_s", rate_words(most_deg_s), self.rate_deg_s)
        if self.station.oscilloscope is not None:
            for node in ("sense", "output"):
                if self.station.oscilloscope.channel_of(node) is None:
                    yield InvalidValue(
                        "station.oscilloscope", f"a channel that sees {node!r} (bench file, wiring)", None
                    )


class CaptureSense(CaptureSines, frozen=True):
    """Sines of drive, carrier and sense signal while the table has a rate (deg/s) and V_Vc a level (V)."""

    rate_deg_s: float = 0.0
    v_vc_v: float = 0.0


@dataclass(frozen=True, slots=True)
class Phases:
    """Phases against the drive signal, deg, of one frequency all; and what they do to K_Vc.

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


NOT_HELD = (
    "The uncertainties hold the scatter of the records and, against the drive signal, the skew of the oscilloscope's "
    "channels. They do not hold: probes and the resistance of the nodes, the non-linearity of the converter, the "
    "phase of the drive's own pick-off, the curvature of the filter's lag, a change of temperature. Not seen: signs, "
    "since combs, pick-offs and output stage may have either (angles are known apart from half turns); the force "
    "itself, which is no node: a delay between carrier and force is in the virtual phase, together with what unequal "
    "combs do; and the in-phase and the anti-phase mode apart."
)


def plan(settings: PhaseSettings) -> Plan:
    """Take records at both signs of rate, V_Vc and difference, until every phase is known well enough."""
    return (yield from powered(settings, _cycles(settings)))


def _cycles(settings: PhaseSettings) -> Routine[Outcome]:
    yield from v_vc_on()
    shown_v = yield from _amplitudes_driven(settings)
    drive_hz = yield from _drive_hz(settings, shown_v[0])
    turning_v = yield from _amplitudes_turning(settings, drive_hz)
    states: list[tuple[CaptureSense, SineRecords]] = []
    turned: list[RotationRecord] = []
    for cycle in range(1, settings.most_cycles + 1):
        yield Note(f"Cycle {cycle}")
        signs = (1.0, -1.0) if cycle % 2 else (-1.0, 1.0)
        states += yield from _static(settings, signs, shown_v)
        turned += yield from _rotations(settings, signs, turning_v, drive_hz)
        if cycle >= _LEAST_CYCLES and phases_of(settings, states, turned).target_met:
            return Outcome(f"every phase within {settings.target_deg:g} deg after {cycle} cycles")
    return Outcome(f"not every phase within {settings.target_deg:g} deg after {settings.most_cycles} cycles")


def _fast(settings: PhaseSettings, drive_v: float = 0.0) -> ConfigureScope:
    """Return the time base that shows some ten periods of the drive, with points enough for each.

    The trigger is beyond the drive's amplitude `drive_v`, where that is known: records that begin anywhere have other
    errors of rounding each, which average out and are in the scatter.
    """
    drive_hz = fmean(settings.drive.frequency_hz)
    channel = settings.station.channel_of("drive")
    return ConfigureScope(one_two_five(1.0 / drive_hz), channel, _NEVER_REACHED * drive_v)


def _slow(settings: PhaseSettings) -> ConfigureScope:
    """Return the time base that shows whole turns of the sense signal against the drive."""
    seconds_a_division = one_two_five(_TURNS / settings.difference_hz / 10.0)
    return ConfigureScope(seconds_a_division, settings.station.channel_of("drive"))


def _amplitudes_driven(settings: PhaseSettings) -> Routine[_Amplitudes]:
    """Find the largest amplitudes of drive, carrier and sense signal: all states are seen at one scale."""
    yield Note("The largest signals of all states, which set the scales")
    yield _fast(settings)
    shown_v, previous_deg_s = (0.0, 0.0, 0.0), 0.0
    for rate_deg_s, v_vc_v in _states(settings, (1.0, -1.0)):
        yield from _go(settings, rate_deg_s, v_vc_v, previous_deg_s)
        shown_v, previous_deg_s = (yield from _larger(_channels(settings, "carrier", "sense"), shown_v)), rate_deg_s
    yield from _go(settings, 0.0, 0.0, previous_deg_s)
    return shown_v


def _drive_hz(settings: PhaseSettings, drive_v: float) -> Routine[float]:
    """Measure the drive frequency: twice that and a little is what V_Vc shall have."""
    drive, channel = settings.drive, settings.station.channel_of("drive")
    expected = SineRecord(fmean(drive.frequency_hz), (fmean(drive.amplitude_v),), (0.0,))
    found = answer((yield CaptureSines((channel,), (drive_v,), settings.records, expected)), SineRecords)
    return fmean(each.frequency_hz for each in found.records)


def _amplitudes_turning(settings: PhaseSettings, drive_hz: float) -> Routine[_Amplitudes]:
    """Find the largest amplitudes of drive, sense signal and output under both sines."""
    yield Note("The largest signals under the sines beside twice the drive frequency")
    yield _slow(settings)
    shown_v = (0.0, 0.0, 0.0)
    for sign in (1.0, -1.0):
        yield from _turn(settings, sign, drive_hz)
        shown_v = yield from _larger(_channels(settings, "sense", "output"), shown_v)
    yield from v_vc_level_again()
    return shown_v


def _larger(channels: tuple[int, int, int], before_v: _Amplitudes) -> Routine[_Amplitudes]:
    """Look how large three channels are, and return the larger of that and of what was seen before."""
    found = answer((yield FindAmplitudes(channels, _LARGEST_V, 1.0)), Amplitudes)
    first, second, third = map(max, before_v, found.amplitudes_v)
    return first, second, third


def _channels(settings: PhaseSettings, second: Node, third: Node) -> tuple[int, int, int]:
    of = settings.station.channel_of
    return of("drive"), of(second), of(third)


def _turn(settings: PhaseSettings, sign: float, drive_hz: float) -> Routine[None]:
    """Have V_Vc turn the sense signal against the drive; how fast it does, the records tell."""
    yield SetSine(2.0 * drive_hz + sign * settings.difference_hz, settings.sine_amplitude_v)
    yield Settle(settings.settle_s, "gyro settles after the change of frequency")


def _states(settings: PhaseSettings, signs: tuple[float, float]) -> list[tuple[float, float]]:
    """Return rate (deg/s) and V_Vc (V) of the states of a cycle."""
    rates = [(sign * settings.rate_deg_s, 0.0) for sign in signs]
    return [*rates, *((0.0, sign * settings.v_vc_v) for sign in signs)]


def _go(settings: PhaseSettings, rate_deg_s: float, v_vc_v: float, previous_deg_s: float) -> Routine[None]:
    yield SetVvc(v_vc_v)
    yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)


def _static(
    settings: PhaseSettings, signs: tuple[float, float], shown_v: _Amplitudes
) -> Routine[list[tuple[CaptureSense, SineRecords]]]:
    """Take the records of a cycle's states, table and V_Vc at rest afterwards."""
    yield _fast(settings, shown_v[0])
    channels, drive = _channels(settings, "carrier", "sense"), settings.drive
    levels_v = (fmean(drive.amplitude_v),) * 2
    taken, previous_deg_s = [], 0.0
    for rate_deg_s, v_vc_v in _states(settings, signs):
        yield from _go(settings, rate_deg_s, v_vc_v, previous_deg_s)
        sense_deg = math.copysign(90.0, rate_deg_s + v_vc_v)
        expected = SineRecord(fmean(drive.frequency_hz), (*levels_v, 1.0), (0.0, -90.0, sense_deg))
        step = CaptureSense(channels, shown_v, settings.records, expected, _SPACING_S, rate_deg_s, v_vc_v)
        taken.append((step, answer((yield step), SineRecords)))
        previous_deg_s = rate_deg_s
    yield from _go(settings, 0.0, 0.0, previous_deg_s)
    return taken


def _rotations(
    settings: PhaseSettings, signs: tuple[float, float], shown_v: _Amplitudes, drive_hz: float
) -> Routine[list[RotationRecord]]:
    """Take the records of a cycle's sines."""
    yield _slow(settings)
    channels = _channels(settings, "sense", "output")
    taken: list[RotationRecord] = []
    for sign in signs:
        yield from _turn(settings, sign, drive_hz)
        offset_hz, count = sign * settings.difference_hz, settings.rotation_records
        step = CaptureRotations(channels, shown_v, count, _ROTATION_POINTS, offset_hz, drive_hz)
        taken += answer((yield step), Rotations).records
    yield from v_vc_level_again()
    return taken


@dataclass(frozen=True, slots=True)
class _Angle:
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
        MeasurementError: a rate or V_Vc does not move the sense signal.
    """
    from vcfbench.analysis.rotating import Rotation, reference_phase  # noqa: PLC0415  # NumPy, needed here alone

    records = [each for _, found in states for each in found.records]
    carrier = _mean_angle([each.phases_deg[1] for each in records])
    coriolis = _response(states, lambda step: step.rate_deg_s, f"a rate of {settings.rate_deg_s:g} deg/s")
    virtual = _response(states, lambda step: step.v_vc_v, f"V_Vc of {settings.v_vc_v:g} V")
    reference = reference_phase(
        [Rotation(r.drive_hz, r.difference_hz, r.reference_deg, r.turning_v, r.output_v) for r in turned]
    )
    demodulator = _Angle(reference.phase_deg, reference.u_phase_deg, reference.dof)
    phases = carrier, coriolis, virtual, demodulator
    drive_hz = fmean(each.frequency_hz for each in records)
    skew = UncertaintyPart("skew of two channels", math.sqrt(2.0 / 3.0) * 360.0 * drive_hz * _SKEW_S)
    against_drive = [measurand(each.deg, "deg", [each.part("records"), skew]) for each in phases]
    error, by_carrier, by_demodulator = _of_k_vc(coriolis, virtual, demodulator)
    return Phases(
        carrier_deg=against_drive[0],
        coriolis_deg=against_drive[1],
        virtual_deg=against_drive[2],
        demodulator_deg=against_drive[3],
        carrier_from_velocity_deg=measurand(_folded(carrier.deg - 90.0), "deg", [carrier.part("carrier"), skew]),
        coriolis_from_velocity_deg=measurand(_folded(coriolis.deg - 90.0), "deg", [coriolis.part("Coriolis"), skew]),
        virtual_from_coriolis_deg=measurand(
            _folded(virtual.deg - coriolis.deg), "deg", [virtual.part("virtual"), coriolis.part("Coriolis")]
        ),
        demodulator_from_coriolis_deg=measurand(
            _folded(demodulator.deg - coriolis.deg),
            "deg",
            [demodulator.part("demodulator"), coriolis.part("Coriolis")],
        ),
        k_vc_error_ppm=error,
        k_vc_ppm_per_carrier_deg=by_carrier,
        k_vc_ppm_per_demodulator_deg=by_demodulator,
        scale_factor_ppm_per_demodulator_deg=1e6 * math.radians(math.tan(math.radians(coriolis.deg - demodulator.deg))),
        bias_deg_s_per_demodulator_deg=_bias_per_deg(settings, states, demodulator.deg),
        filter_delay_ms=measurand(
            1e3 * reference.delay_s, "ms", [UncertaintyPart("records", 1e3 * reference.u_delay_s, reference.dof)]
        ),
        drive_hz=drive_hz,
        records=len(records) + len(turned),
        target_deg=settings.target_deg,
        target_met=all(each.expanded_u <= settings.target_deg for each in against_drive),
    )


def _bias_per_deg(
    settings: PhaseSettings, states: Sequence[tuple[CaptureSense, SineRecords]], demodulator_deg: float
) -> float:
    """Return by how much the bias changes with a degree of the demodulator's phase, deg/s.

    What is there at rest is the mean of both signs of a rate; the demodulator lets in what is a quarter turn from it.
    """
    plus, minus = (
        [_phasor(each) for step, found in states if sign * step.rate_deg_s > 0.0 for each in found.records]
        for sign in (1.0, -1.0)
    )
    first, second = sum(plus) / len(plus), sum(minus) / len(minus)
    seen = cmath.rect(1.0, -math.radians(demodulator_deg))
    per_deg_s = ((first - second) / (2.0 * settings.rate_deg_s) * seen).real
    return math.radians(((first + second) / 2.0 * seen).imag / per_deg_s)


def _of_k_vc(coriolis: _Angle, virtual: _Angle, demodulator: _Angle) -> tuple[Measurand, float, float]:
    """Return what the phases make of K_Vc, ppm, and ppm a degree of carrier and demodulator.

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


def _mean_angle(angles_deg: Sequence[float]) -> _Angle:
    """Return the mean of angles that lie close together, also across 180 deg."""
    first = angles_deg[0]
    beside = [math.remainder(each - first, 360.0) for each in angles_deg]
    u_deg = stdev(beside) / math.sqrt(len(beside))
    return _Angle(math.remainder(first + fmean(beside), 360.0), u_deg, len(beside) - 1)


def _response(
    states: Sequence[tuple[CaptureSense, SineRecords]], level: Callable[[CaptureSense], float], what: str
) -> _Angle:
    """Return the phase of the difference of the sense signal's phasors between the two signs of a level."""
    plus, minus = (
        [_phasor(each) for step, found in states if sign * level(step) > 0.0 for each in found.records]
        for sign in (1.0, -1.0)
    )
    moved = sum(plus) / len(plus) - sum(minus) / len(minus)
    if abs(moved) < 1e-3 * max(map(abs, plus)):
        raise MeasurementError(f"{what} of either sign does not move the sense signal", instrument="oscilloscope")
    along = moved / abs(moved)
    variances = [variance((each / along).imag for each in state) / len(state) for state in (plus, minus)]
    dof = len(plus) + len(minus) - 2
    return _Angle(math.degrees(cmath.phase(moved)), math.degrees(math.sqrt(sum(variances)) / abs(moved)), dof)


def _phasor(record: SineRecord) -> complex:
    """Return the sense signal against the drive signal, V."""
    return cmath.rect(record.amplitudes_v[2], math.radians(record.phases_deg[2]))


def results(settings: PhaseSettings, measured: Measured) -> Phases:
    """Return the phases from all that was captured."""
    states = [(step, found) for step, found in measured.found(SineRecords) if isinstance(step, CaptureSense)]
    turned = [each for _, found in measured.found(Rotations) for each in found.records]
    return phases_of(settings, states, turned)


def report(_settings: PhaseSettings, measured: Measured, found: Phases) -> Report:
    """Report the phases, what they do to K_Vc, and what is not in the uncertainties."""
    against_drive = {
        "carrier": found.carrier_deg,
        "sense signal of a positive rate (Coriolis)": found.coriolis_deg,
        "sense signal of a positive V_Vc (virtual)": found.virtual_deg,
        "demodulator's reference, apart from half a turn": found.demodulator_deg,
    }
    errors = {
        "carrier from the drive's velocity": found.carrier_from_velocity_deg,
        "Coriolis from the drive's velocity": found.coriolis_from_velocity_deg,
        "virtual from Coriolis": found.virtual_from_coriolis_deg,
        "demodulator from Coriolis": found.demodulator_from_coriolis_deg,
        "error of K_Vc by equal outputs": found.k_vc_error_ppm,
        "delay of the filter": found.filter_delay_ms,
    }
    met = "met" if found.target_met else "NOT met"
    drive = f"drive {found.drive_hz:.3f} Hz; {found.records} records"
    target = f"U95 of {found.target_deg:g} deg for every phase: {met}"
    by_carrier = f"{found.k_vc_ppm_per_carrier_deg:+.0f} ppm a degree of the carrier"
    by_demodulator = f"{found.k_vc_ppm_per_demodulator_deg:+.1f} ppm a degree of the demodulator"
    error = found.k_vc_error_ppm
    wrong = (
        f"{abs(error.value):.0f} ppm too {'small' if error.value < 0.0 else 'large'}, U95 {error.expanded_u:.2g} ppm"
    )
    known = ", ".join(f"{key} = {value:.4g}" for key, value in _knowledge(found).items())
    said = (
        f"{drive}; {target}\nK_Vc by equal outputs: {wrong}; it changes by {by_carrier}, {by_demodulator}\n"
        f"for [uncertainty] of the bench file: {known}\n{NOT_HELD}"
    )
    return Report(
        [
            _table("phases against the drive signal", against_drive),
            _table("what they come to, apart from half turns", errors),
            Text(said),
            *_figures(measured),
        ]
    )


def _knowledge(found: Phases) -> dict[str, float]:
    """Return what budgets may know of it, by the keys of ``[uncertainty]``."""
    return {
        "k_vc_ppm_carrier_deg": found.k_vc_ppm_per_carrier_deg,
        "k_vc_ppm_demodulator_deg": found.k_vc_ppm_per_demodulator_deg,
        "scale_factor_ppm_demodulator_deg": found.scale_factor_ppm_per_demodulator_deg,
        "bias_deg_s_demodulator_deg": found.bias_deg_s_per_demodulator_deg,
    }


def _figures(measured: Measured) -> list[Figure]:
    """Draw the sense signal of each record as a phasor: the way from minus to plus has the phase of the force."""
    seen: dict[str, list[complex]] = {"rate +": [], "rate -": [], "V_Vc +": [], "V_Vc -": []}
    for step, found in measured.found(SineRecords):
        if isinstance(step, CaptureSense) and (step.rate_deg_s or step.v_vc_v):
            what, level = ("rate", step.rate_deg_s) if step.rate_deg_s else ("V_Vc", step.v_vc_v)
            seen[f"{what} {'+' if level > 0.0 else '-'}"] += [1e3 * _phasor(each) for each in found.records]
    series = [Series(name, [p.real for p in found], [p.imag for p in found]) for name, found in seen.items() if found]
    axes = Axis("in phase with the drive signal", "mV"), Axis("a quarter turn ahead", "mV")
    words = "A point a record; the way from minus to plus has the phase of the force."
    return [Figure("Sense signal against the drive signal", *axes, series, words)] if series else []


def _table(title: str, quantities: dict[str, Measurand]) -> Table:
    columns = (
        Column("quantity", align="left"),
        *(Column("value", format=".7g"), Column("u", format=".2g"), Column("U95", format=".2g")),
        *(Column("unit", align="left"), Column("u is made of", align="left")),
    )
    rows = [(name, *each.printed(), each.unit, _made_of(each)) for name, each in quantities.items()]
    return Table(columns, rows, title)


def _made_of(quantity: Measurand) -> str:
    return ", ".join(f"{each.source} {each.u:.2g}" for each in quantity.parts)


PHASE = Procedure(
    name="phase",
    title=BUILT_IN["phase"][1],
    method=(
        "Waveforms of drive, carrier, sense signal and output are captured by the oscilloscope, the table turning and "
        "V_Vc standing for a rate in turn. Sines fitted to them give the phases of carrier, Coriolis and virtual "
        "signal and of the demodulator, and what their errors do to K_Vc."
    ),
    settings=PhaseSettings,
    plan=plan,
    results=results,
    report=report,
    needs={
        "power": PowersRails,
        "rate_source": FunctionGenerator,
        "multimeter": ReadsVoltage,
        "oscilloscope": MeasuresWaveforms,
        "rate_table": Rotates,
    },
)
"""The phases of carrier, Coriolis and virtual signal and demodulator."""
