"""The procedure `phase`: records at both signs of rate, V_Vc and difference, until every phase is known."""

from __future__ import annotations

import math
from statistics import fmean
from typing import TypeAlias

from msgspec import structs

from vcfbench import steps
from vcfbench.interfaces import FunctionGenerator, MeasuresWaveforms, PowersRails, ReadsVoltage, Rotates
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.phase.report import phase_report
from vcfbench.procedures.phase.results import CaptureSense, Phases, phase_results, phases_of
from vcfbench.procedures.phase.settings import LEAST_CYCLES, PhaseSettings
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.shared.kept_characteristics import Keeps
from vcfbench.procedures.shared.routines import go_to_rate, powered, v_vc_level_again, v_vc_on
from vcfbench.procedures.shared.tones import SCOPE_TIME_BASE
from vcfbench.records.devices import Characteristics, Measured
from vcfbench.station.parts import Node
from vcfbench.steps.drive_check import one_two_five
from vcfbench.steps.step import Routine, answer

_Amplitudes: TypeAlias = tuple[float, float, float]
_LARGEST_V = 10.0
"""Voltage that no node of the PCB exceeds: its rails."""
_SPACING_S = 0.5
"""Between two records: four time constants of the sense modes, whose noise swings at the mode split."""
_NEVER_REACHED = 1.5
"""A trigger level over the amplitude that is never reached, and still on a screen of eight divisions and a little."""
_ROTATION_POINTS = 10_000
_TURNS = 4.0
"""Least turns of the sense signal against the drive in a record."""


def plan(settings: PhaseSettings) -> steps.Plan:
    """Take records at both signs of rate, V_Vc and difference, until every phase is known well enough."""
    return (yield from powered(settings, _cycles(settings)))


def _cycles(settings: PhaseSettings) -> Routine[steps.Outcome]:
    yield from v_vc_on()
    shown_v = yield from _amplitudes_driven(settings)
    drive_hz = yield from _drive_hz(settings, shown_v[0])
    turning_v = yield from _amplitudes_turning(settings, drive_hz)
    states: list[tuple[CaptureSense, steps.SineRecords]] = []
    turned: list[steps.RotationRecord] = []
    for cycle in range(1, settings.most_cycles + 1):
        yield steps.Note(f"Cycle {cycle}")
        signs = (1.0, -1.0) if cycle % 2 else (-1.0, 1.0)
        states += yield from _static(settings, signs, shown_v)
        turned += yield from _rotations(settings, signs, turning_v, drive_hz)
        if cycle >= LEAST_CYCLES and phases_of(settings, states, turned).target_met:
            return steps.Outcome(f"every phase within {settings.target_deg:g} deg after {cycle} cycles")
    return steps.Outcome(f"not every phase within {settings.target_deg:g} deg after {settings.most_cycles} cycles")


def _fast(settings: PhaseSettings, drive_v: float = 0.0) -> steps.ConfigureScope:
    """Return the time base that shows some ten periods of the drive, with points enough for each.

    The trigger is beyond the drive's amplitude `drive_v`, where that is known: records that begin anywhere have other
    errors of rounding each, which average out and are in the scatter.
    """
    drive_hz = fmean(settings.drive.frequency_hz)
    channel = settings.station.channel_of("drive")
    return steps.ConfigureScope(one_two_five(1.0 / drive_hz), channel, _NEVER_REACHED * drive_v)


def _slow(settings: PhaseSettings) -> steps.ConfigureScope:
    """Return the time base that shows whole turns of the sense signal against the drive."""
    seconds_a_division = one_two_five(_TURNS / settings.difference_hz / 10.0)
    return steps.ConfigureScope(seconds_a_division, settings.station.channel_of("drive"))


def _amplitudes_driven(settings: PhaseSettings) -> Routine[_Amplitudes]:
    """Find the largest amplitudes of drive, carrier and sense signal: all states are seen at one scale."""
    yield steps.Note("The largest signals of all states, which set the scales")
    yield _fast(settings)
    shown_v, previous_deg_s = (0.0, 0.0, 0.0), 0.0
    for rate_deg_s, v_vc_v in _states(settings, (1.0, -1.0)):
        yield from _go(settings, rate_deg_s, v_vc_v, previous_deg_s)
        shown_v, previous_deg_s = (yield from _larger(_channels(settings, "carrier", "sense"), shown_v)), rate_deg_s
    yield from _go(settings, 0.0, 0.0, previous_deg_s)
    return shown_v


def _drive_hz(settings: PhaseSettings, drive_v: float) -> Routine[float]:
    """Measure the drive frequency: V_Vc shall have twice that and a little."""
    drive, channel = settings.drive, settings.station.channel_of("drive")
    expected = steps.SineRecord(fmean(drive.frequency_hz), (fmean(drive.amplitude_v),), (0.0,))
    found = answer((yield steps.CaptureSines((channel,), (drive_v,), settings.records, expected)), steps.SineRecords)
    return fmean(each.frequency_hz for each in found.records)


def _amplitudes_turning(settings: PhaseSettings, drive_hz: float) -> Routine[_Amplitudes]:
    """Find the largest amplitudes of drive, sense signal and output under both sines."""
    yield steps.Note("The largest signals under the sines beside twice the drive frequency")
    yield _slow(settings)
    shown_v = (0.0, 0.0, 0.0)
    for sign in (1.0, -1.0):
        yield from _turn(settings, sign, drive_hz)
        shown_v = yield from _larger(_channels(settings, "sense", "output"), shown_v)
    yield from v_vc_level_again()
    return shown_v


def _larger(channels: tuple[int, int, int], before_v: _Amplitudes) -> Routine[_Amplitudes]:
    """Look how large three channels are, and return the larger of that and of the amplitudes before."""
    found = answer((yield steps.FindAmplitudes(channels, _LARGEST_V, 1.0)), steps.Amplitudes)
    first, second, third = map(max, before_v, found.amplitudes_v)
    return first, second, third


def _channels(settings: PhaseSettings, second: Node, third: Node) -> tuple[int, int, int]:
    of = settings.station.channel_of
    return of("drive"), of(second), of(third)


def _turn(settings: PhaseSettings, sign: float, drive_hz: float) -> Routine[None]:
    """Have V_Vc turn the sense signal against the drive; how fast it does, the records tell."""
    yield steps.SetSine(2.0 * drive_hz + sign * settings.difference_hz, settings.sine_amplitude_v)
    yield steps.Settle(settings.settle_s, "gyro settles after the change of frequency")


def _states(settings: PhaseSettings, signs: tuple[float, float]) -> list[tuple[float, float]]:
    """Return rate (deg/s) and V_Vc (V) of the states of a cycle."""
    rates = [(sign * settings.rate_deg_s, 0.0) for sign in signs]
    return [*rates, *((0.0, sign * settings.v_vc_v) for sign in signs)]


def _go(settings: PhaseSettings, rate_deg_s: float, v_vc_v: float, previous_deg_s: float) -> Routine[None]:
    yield steps.SetVvc(v_vc_v)
    yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)


def _static(
    settings: PhaseSettings, signs: tuple[float, float], shown_v: _Amplitudes
) -> Routine[list[tuple[CaptureSense, steps.SineRecords]]]:
    """Take the records of a cycle's states, table and V_Vc at rest afterwards."""
    yield _fast(settings, shown_v[0])
    channels, drive = _channels(settings, "carrier", "sense"), settings.drive
    levels_v = (fmean(drive.amplitude_v),) * 2
    taken, previous_deg_s = [], 0.0
    for rate_deg_s, v_vc_v in _states(settings, signs):
        yield from _go(settings, rate_deg_s, v_vc_v, previous_deg_s)
        sense_deg = math.copysign(90.0, rate_deg_s + v_vc_v)
        expected = steps.SineRecord(fmean(drive.frequency_hz), (*levels_v, 1.0), (0.0, -90.0, sense_deg))
        step = CaptureSense(channels, shown_v, settings.records, expected, _SPACING_S, rate_deg_s, v_vc_v)
        taken.append((step, answer((yield step), steps.SineRecords)))
        previous_deg_s = rate_deg_s
    yield from _go(settings, 0.0, 0.0, previous_deg_s)
    return taken


def _rotations(
    settings: PhaseSettings, signs: tuple[float, float], shown_v: _Amplitudes, drive_hz: float
) -> Routine[list[steps.RotationRecord]]:
    """Take the records of a cycle's sines."""
    yield _slow(settings)
    channels = _channels(settings, "sense", "output")
    taken: list[steps.RotationRecord] = []
    for sign in signs:
        yield from _turn(settings, sign, drive_hz)
        offset_hz, count = sign * settings.difference_hz, settings.rotation_records
        step = steps.CaptureRotations(channels, shown_v, count, _ROTATION_POINTS, offset_hz, drive_hz)
        taken += answer((yield step), steps.Rotations).records
    yield from v_vc_level_again()
    return taken


def phase_characteristics(_settings: PhaseSettings, found: Phases) -> Characteristics:
    """Return the characteristics that K_Vc depends on: phases against the drive's velocity."""
    demodulator = found.demodulator_deg.kept()
    return Characteristics(
        drive_hz=Measured(value=found.drive_hz, u=found.drive_hz * SCOPE_TIME_BASE / math.sqrt(3.0)),
        carrier_phase_deg=found.carrier_from_velocity_deg.kept(),
        demodulator_phase_deg=structs.replace(demodulator, value=math.remainder(demodulator.value - 90.0, 180.0)),
    )


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
    results=phase_results,
    report=phase_report,
    unforeseen=dict.fromkeys(
        Phases.__struct_fields__, "it is the scatter of the records, which go on until target_deg"
    ),
    entry=Keeps("phase", phase_characteristics),
    needs={
        "power": PowersRails,
        "rate_source": FunctionGenerator,
        "multimeter": ReadsVoltage,
        "oscilloscope": MeasuresWaveforms,
        "rate_table": Rotates,
    },
)
"""The phases of carrier, Coriolis and virtual signal and demodulator."""
