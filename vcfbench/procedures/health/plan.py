"""Characteristics that K_Vc depends on, by the oscilloscope without a table: modes, phases, feed-through, amplitudes.

The certificate's calibration and the self-calibration both do it, with the same steps, so that what an instrument is
off cancels in what has changed. V_Vc is switched off for ring-downs of the sense modes, rests at both signs for the
phase of what it does, and is a sine at twice the drive frequency and a little, which finds the demodulator's reference,
and at far from that, where no mode answers: what is left there comes through without motion.
"""

from __future__ import annotations

import cmath
import math
from statistics import fmean

from vcfbench import steps
from vcfbench.analysis.rotating import fit_rotation
from vcfbench.interfaces import AveragesWaveforms, Oscilloscope
from vcfbench.procedures.health.by_meter import split_by_meter
from vcfbench.procedures.health.modes import Modes, modes_of
from vcfbench.procedures.health.way import way_of
from vcfbench.procedures.phase.results import CaptureSense
from vcfbench.procedures.resonance import CaptureDecay, RingingMode, SenseDecay
from vcfbench.procedures.shared.known.v_vc import KnownVvcSettings
from vcfbench.procedures.shared.routines import rails_of, v_vc_level_again, v_vc_on
from vcfbench.records.devices import Characteristics
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.parts import Node
from vcfbench.steps.drive_check import one_two_five
from vcfbench.steps.step import Routine, answer

_LEVEL_V = 0.7
_LARGEST_V = 10.0
"""Voltage that no node of the PCB exceeds: its rails."""
_RING_DOWNS = 6
_RING_DOWN_RECORD = (0.02, 5_000)
"""Time base (s/div) and points: a fifth of a second, twice the time constant of a good mode."""
_MEANS, _PERIODS = 12, 3.0
"""Means of drive and carrier, and periods in their records: short ones come the faster."""
_HIGHEST = 0.8
"""Span of the starts of means, of the drive's amplitude, each side of zero. Each mean begins elsewhere, so that the
converter's steps, which no noise of a mean hides, differ in each; from one place they would all err by 20 ppm."""
_STATES = (1.0, -1.0, -1.0, 1.0)
_RECORDS = 4
_SPACING_S = 0.5
"""Between two records: four time constants of the sense modes, whose noise swings at the mode split."""
_NEAR_HZ, _OF_SPLIT = 8.0, 1.0 / 3.0
"""By which the sine is off twice the drive frequency: the smaller of this and of that share of the split."""
_OF_DRIVE = 0.43
"""The same over the drive frequency where no mode answers; no harmonic of the drive is there."""
_TURNS = 4.0
_SPLITS_HZ, _Q, _SHARE = (25.0, 150.0), 1200.0, 0.15
"""Values for a dry run: splits and Q of both modes of the paper's class, and the share of the in-phase one."""
_NEAR_RECORDS, _FAR_RECORDS = 2, 3
_A_PERIOD = 2.3
"""Points in a period of the drive, at least: two would be too few. Oscilloscopes give 1, 2 or 5 times 10^n of them."""
_FAR_POINTS, _FAR_S_PER_DIV = 10_000, 5e-3


class CaptureFar(steps.CaptureRotations, frozen=True):
    """Records under a sine so far from the modes that feed-through shows beside their response; the filter is shut.

    The last of `channels` is not looked at.
    """

    def _record(self, scope: Oscilloscope) -> steps.RotationRecord:
        first, second, _ = self.channels
        if isinstance(scope, AveragesWaveforms):  # a feed-through that matters is a ten-thousandth of the screen
            scope.acquire_fine(first, second)
        else:
            scope.acquire(first, second)
        drive, sense = (scope.waveform(channel, self.points) for channel in (first, second))
        interval_s = float(drive.time_s[1] - drive.time_s[0])
        found = fit_rotation(drive.voltage_v, sense.voltage_v, drive.voltage_v, interval_s, self.difference_hz)
        return steps.RotationRecord(found.drive_hz, found.difference_hz, 0.0, found.turning, 0.0)

    def predict(self, gyro: LinearGyro) -> steps.Rotations:
        """Predict the modes' response of a dry run there, without feed-through."""
        del gyro
        modes = _expected(self.drive_hz)
        turning_v = abs(modes.answer(_SHARE, self.difference_hz) / modes.answer(_SHARE, 0.0))
        record = steps.RotationRecord(self.drive_hz, self.difference_hz, 0.0, turning_v, 0.0)
        return steps.Rotations((record,) * self.count)


def level_v(settings: KnownVvcSettings) -> float:
    """Return the V_Vc of ring-downs and phases, V; the peak of its sines is twice that."""
    most_v = settings.station.limits.max_v_vc_v
    return _LEVEL_V if most_v is None else min(_LEVEL_V, 0.5 * most_v)


def examined(
    settings: KnownVvcSettings, then: Characteristics | None, *, looked_for: bool, source: str = ""
) -> Routine[None]:
    """Measure the characteristics, if that is `looked_for` and the bench can; V_Vc is off before and afterwards.

    `then` is what `source` has of it; a certificate's own calibration has none (None), and needs none.
    """
    if not looked_for:
        return
    way, lacks = way_of(settings)
    if way == "oscilloscope" and (not source or (then is not None and then.sense_phase_deg is not None)):
        yield from _by_oscilloscope(settings)
        return
    split_and_q = then is not None and source and then.split_hz is not None and then.q_anti_phase is not None
    if way == "multimeter" and then is not None and split_and_q:
        yield steps.NotChecked("phases, feed-through and amplitudes", lacks)
        yield from split_by_meter(settings, then)
    else:
        yield steps.NotChecked("what K_Vc depends on", lacks if way != "oscilloscope" else f"{source} does not have it")


def _by_oscilloscope(settings: KnownVvcSettings) -> Routine[None]:
    yield steps.Note("Health: what K_Vc depends on, by the oscilloscope")
    yield from v_vc_on()
    split_hz, drive_hz = yield from _ring_downs(settings)
    yield from _at_both_signs(settings)
    near_hz = min(_NEAR_HZ, _OF_SPLIT * split_hz)
    near_s_per_div = one_two_five(_TURNS / near_hz / 10.0)
    points = round(one_two_five(_A_PERIOD * drive_hz * 10.0 * near_s_per_div))
    yield steps.ConfigureScope(near_s_per_div, settings.station.channel_of("drive"))
    for sign in (1.0, -1.0):
        channels = _channels(settings, "sense", "output")
        shown_v = yield from _turned(settings, drive_hz, sign * near_hz, channels)
        yield steps.CaptureRotations(channels, shown_v, _NEAR_RECORDS, points, sign * near_hz, drive_hz)
    yield steps.ConfigureScope(_FAR_S_PER_DIV, settings.station.channel_of("drive"))
    for sign in (1.0, -1.0):
        channels, far_hz = _channels(settings, "sense", "carrier"), sign * _OF_DRIVE * drive_hz
        shown_v = yield from _turned(settings, drive_hz, far_hz, channels)
        yield CaptureFar(channels, shown_v, _FAR_RECORDS, _FAR_POINTS, far_hz, drive_hz)
    yield from v_vc_level_again()
    yield steps.DisableVvc()
    yield steps.CheckRails(rails_of(settings), settings.rail_tolerance_v)


def _ring_downs(settings: KnownVvcSettings) -> Routine[tuple[float, float]]:
    """Switch V_Vc off again and again; return split and drive frequency, Hz."""
    channels = settings.station.channel_of("drive"), settings.station.channel_of("sense")
    seconds_a_division, points = _RING_DOWN_RECORD
    yield steps.ConfigureScope(seconds_a_division, channels[0])
    shown_v: tuple[float, float] | None = None
    modes = _expected(fmean(settings.drive.frequency_hz))
    expected = SenseDecay(modes.drive_hz, (modes.anti_phase, modes.in_phase))
    for _ in range(_RING_DOWNS):
        yield steps.SetVvc(level_v(settings))
        yield steps.Settle(settings.settle_s, "gyro settles after the V_Vc step")
        if shown_v is None:
            found = answer((yield steps.FindAmplitudes(channels, _LARGEST_V, 1.0)), steps.Amplitudes)
            shown_v = found.amplitudes_v[0], found.amplitudes_v[1]
        yield steps.SetVvc(0.0)
        modes = modes_of(answer((yield CaptureDecay(channels, shown_v, points, expected)), SenseDecay))
    return abs(modes.drive_hz - modes.anti_phase.frequency_hz), modes.drive_hz


def _expected(drive_hz: float) -> Modes:
    """Return the modes that a dry run answers with."""
    near, far = drive_hz - _SPLITS_HZ[0], drive_hz - _SPLITS_HZ[1]
    return Modes(drive_hz, RingingMode(near, _Q, 1.0 - _SHARE), RingingMode(far, _Q, _SHARE))


def _at_both_signs(settings: KnownVvcSettings) -> Routine[None]:
    """Take drive, carrier and sense signal at both signs of V_Vc; means of many records of the first two."""
    drive = settings.drive
    drive_hz, channels = fmean(drive.frequency_hz), _channels(settings, "carrier", "sense")
    yield steps.ConfigureScope(one_two_five(1.0 / drive_hz), channels[0])
    shown_v = (0.0, 0.0, 0.0)
    for sign in (1.0, -1.0):
        yield steps.SetVvc(sign * level_v(settings))
        yield steps.Settle(settings.settle_s, "gyro settles after the V_Vc step")
        found = answer((yield steps.FindAmplitudes(channels, _LARGEST_V, 1.0)), steps.Amplitudes)
        shown_v = max(shown_v, found.amplitudes_v[:3], key=lambda seen: seen[2])  # type: ignore[assignment]
    amplitude_v, turned = fmean(drive.amplitude_v), 1j * _expected(drive_hz).answer(_SHARE, 0.0)
    expected = steps.SineRecord(drive_hz, (amplitude_v, amplitude_v), (0.0, -90.0))
    for place in range(_MEANS):
        level = _HIGHEST * amplitude_v * (2.0 * place / (_MEANS - 1) - 1.0)
        yield steps.ConfigureScope(one_two_five(_PERIODS / drive_hz / 10.0), channels[0], level)
        yield steps.CaptureMeanSines(channels[:2], shown_v[:2], 1, expected)
    yield steps.ConfigureScope(one_two_five(1.0 / drive_hz), channels[0])
    for sign in _STATES:
        yield steps.SetVvc(sign * level_v(settings))
        yield steps.Settle(settings.settle_s, "gyro settles after the V_Vc step")
        seen = steps.SineRecord(
            drive_hz, (amplitude_v, amplitude_v, 1.0), (0.0, -90.0, math.degrees(cmath.phase(sign * turned)))
        )
        yield CaptureSense(channels, shown_v, _RECORDS, seen, _SPACING_S, 0.0, sign * level_v(settings))
    yield steps.SetVvc(0.0)


def _turned(
    settings: KnownVvcSettings, drive_hz: float, off_hz: float, channels: tuple[int, int, int]
) -> Routine[tuple[float, float, float]]:
    """Have V_Vc turn the sense signal against the drive; return the amplitudes of the channels, V."""
    yield steps.SetSine(2.0 * drive_hz + off_hz, 2.0 * level_v(settings))
    yield steps.Settle(settings.settle_s, "gyro settles after the change of frequency")
    first_v, second_v, third_v = answer(
        (yield steps.FindAmplitudes(channels, _LARGEST_V, 1.0)), steps.Amplitudes
    ).amplitudes_v
    return first_v, second_v, third_v


def _channels(settings: KnownVvcSettings, second: Node, third: Node) -> tuple[int, int, int]:
    of = settings.station.channel_of
    return of("drive"), of(second), of(third)
