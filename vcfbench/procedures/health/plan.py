"""What K_Vc depends on, measured without a table by the oscilloscope: modes, phases, feed-through, amplitudes.

The certificate's calibration and the self-calibration both do it, with the same steps, so that what an instrument is
off cancels in what has changed. V_Vc is switched off for ring-downs of the sense modes, rests at both signs for the
phase of what it does, and is a sine at twice the drive frequency and a little, which finds the demodulator's reference,
and at far from that, where no mode answers: what is left there comes through without motion.
"""

from __future__ import annotations

import cmath
import math
from statistics import fmean
from typing import TYPE_CHECKING

from vcfbench.plans.drive_check import one_two_five
from vcfbench.plans.step import answer
from vcfbench.plans.steps import (
    Amplitudes,
    CaptureMeanSines,
    CaptureRotations,
    CheckRails,
    ConfigureScope,
    DisableVvc,
    FindAmplitudes,
    NotChecked,
    Note,
    RotationRecord,
    Rotations,
    SetSine,
    Settle,
    SetVvc,
    SineRecord,
)
from vcfbench.procedures.health.modes import Modes, modes_of
from vcfbench.procedures.health.way import way_of
from vcfbench.procedures.phase.results import CaptureSense
from vcfbench.procedures.resonance import CaptureDecay, RingingMode, SenseDecay
from vcfbench.procedures.routines import rails_of, v_vc_level_again, v_vc_on

if TYPE_CHECKING:
    from vcfbench.bench.linear_gyro import LinearGyro
    from vcfbench.bench.parts import Node
    from vcfbench.interfaces import Oscilloscope
    from vcfbench.plans.step import Routine
    from vcfbench.procedures.known.v_vc import KnownVvcSettings

_LEVEL_V = 0.7
_LARGEST_V = 10.0
"""What no node of the PCB exceeds: its rails."""
_RING_DOWNS = 6
_RING_DOWN_RECORD = (0.02, 5_000)
"""Time base (s/div) and points: a fifth of a second, twice the time constant of a good mode."""
_MEANS, _PERIODS = 12, 3.0
"""Means of drive and carrier, and periods in their records: short ones come the faster."""
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
"""Of what a dry run answers with: both modes of the paper's class, and the part of the one in phase."""
_NEAR_RECORDS, _FAR_RECORDS = 2, 3
_NEAR_POINTS, _FAR_POINTS = 10_000, 20_000
_FAR_S_PER_DIV = 2e-3


class CaptureFar(CaptureRotations, frozen=True):
    """Records under a sine so far from the modes that feed-through shows beside what they answer; the filter is shut.

    The last of `channels` is not looked at.
    """

    def _record(self, scope: Oscilloscope) -> RotationRecord:
        from vcfbench.analysis.rotating import fit_rotation  # noqa: PLC0415  # NumPy, needed here alone

        first, second, _ = self.channels
        scope.acquire(first, second)
        drive, sense = (scope.waveform(channel, self.points) for channel in (first, second))
        interval_s = float(drive.time_s[1] - drive.time_s[0])
        found = fit_rotation(drive.voltage_v, sense.voltage_v, drive.voltage_v, interval_s, self.difference_hz)
        return RotationRecord(found.drive_hz, found.difference_hz, 0.0, found.turning, 0.0)

    def predict(self, gyro: LinearGyro) -> Rotations:
        """Predict what the modes of a dry run answer there, and nothing beside."""
        del gyro
        modes = _expected(self.drive_hz)
        turning_v = abs(modes.answer(_SHARE, self.difference_hz) / modes.answer(_SHARE, 0.0))
        record = RotationRecord(self.drive_hz, self.difference_hz, 0.0, turning_v, 0.0)
        return Rotations((record,) * self.count)


def level_v(settings: KnownVvcSettings) -> float:
    """Return the V_Vc of ring-downs and phases, V; the peak of its sines is twice that."""
    most_v = settings.station.limits.max_v_vc_v
    return _LEVEL_V if most_v is None else min(_LEVEL_V, 0.5 * most_v)


def examined(settings: KnownVvcSettings, *, looked_for: bool, why_not: str = "") -> Routine[None]:
    """Measure what K_Vc depends on, if that is `looked_for` and the bench can; V_Vc is off before and afterwards.

    `why_not` says why there would be no use; empty: there is.
    """
    if not looked_for:
        return
    way, lacks = way_of(settings)
    if why_not or way is None:
        yield NotChecked("what K_Vc depends on", why_not or lacks)
    else:
        yield from _by_oscilloscope(settings)


def _by_oscilloscope(settings: KnownVvcSettings) -> Routine[None]:
    yield Note("Health: what K_Vc depends on, by the oscilloscope")
    yield from v_vc_on()
    split_hz, drive_hz = yield from _ring_downs(settings)
    yield from _at_both_signs(settings)
    near_hz = min(_NEAR_HZ, _OF_SPLIT * split_hz)
    yield ConfigureScope(one_two_five(_TURNS / near_hz / 10.0), settings.station.channel_of("drive"))
    for sign in (1.0, -1.0):
        channels = _channels(settings, "sense", "output")
        shown_v = yield from _turned(settings, drive_hz, sign * near_hz, channels)
        yield CaptureRotations(channels, shown_v, _NEAR_RECORDS, _NEAR_POINTS, sign * near_hz, drive_hz)
    yield ConfigureScope(_FAR_S_PER_DIV, settings.station.channel_of("drive"))
    for sign in (1.0, -1.0):
        channels, far_hz = _channels(settings, "sense", "carrier"), sign * _OF_DRIVE * drive_hz
        shown_v = yield from _turned(settings, drive_hz, far_hz, channels)
        yield CaptureFar(channels, shown_v, _FAR_RECORDS, _FAR_POINTS, far_hz, drive_hz)
    yield from v_vc_level_again()
    yield DisableVvc()
    yield CheckRails(rails_of(settings), settings.rail_tolerance_v)


def _ring_downs(settings: KnownVvcSettings) -> Routine[tuple[float, float]]:
    """Switch V_Vc off again and again; return split and drive frequency, Hz."""
    channels = settings.station.channel_of("drive"), settings.station.channel_of("sense")
    seconds_a_division, points = _RING_DOWN_RECORD
    yield ConfigureScope(seconds_a_division, channels[0])
    shown_v: tuple[float, float] | None = None
    modes = _expected(fmean(settings.drive.frequency_hz))
    expected = SenseDecay(modes.drive_hz, (modes.anti_phase, modes.in_phase))
    for _ in range(_RING_DOWNS):
        yield SetVvc(level_v(settings))
        yield Settle(settings.settle_s, "gyro settles after the V_Vc step")
        if shown_v is None:
            found = answer((yield FindAmplitudes(channels, _LARGEST_V, 1.0)), Amplitudes)
            shown_v = found.amplitudes_v[0], found.amplitudes_v[1]
        yield SetVvc(0.0)
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
    yield ConfigureScope(one_two_five(1.0 / drive_hz), channels[0])
    shown_v = (0.0, 0.0, 0.0)
    for sign in (1.0, -1.0):
        yield SetVvc(sign * level_v(settings))
        yield Settle(settings.settle_s, "gyro settles after the V_Vc step")
        found = answer((yield FindAmplitudes(channels, _LARGEST_V, 1.0)), Amplitudes)
        shown_v = max(shown_v, found.amplitudes_v[:3], key=lambda seen: seen[2])  # type: ignore[assignment]
    amplitude_v, turned = fmean(drive.amplitude_v), 1j * _expected(drive_hz).answer(_SHARE, 0.0)
    expected = SineRecord(drive_hz, (amplitude_v, amplitude_v), (0.0, -90.0))
    yield ConfigureScope(one_two_five(_PERIODS / drive_hz / 10.0), channels[0])
    yield CaptureMeanSines(channels[:2], shown_v[:2], _MEANS, expected)
    yield ConfigureScope(one_two_five(1.0 / drive_hz), channels[0])
    for sign in _STATES:
        yield SetVvc(sign * level_v(settings))
        yield Settle(settings.settle_s, "gyro settles after the V_Vc step")
        seen = SineRecord(
            drive_hz, (amplitude_v, amplitude_v, 1.0), (0.0, -90.0, math.degrees(cmath.phase(sign * turned)))
        )
        yield CaptureSense(channels, shown_v, _RECORDS, seen, _SPACING_S, 0.0, sign * level_v(settings))
    yield SetVvc(0.0)


def _turned(
    settings: KnownVvcSettings, drive_hz: float, off_hz: float, channels: tuple[int, int, int]
) -> Routine[tuple[float, float, float]]:
    """Have V_Vc turn the sense signal against the drive; return the amplitudes of the channels, V."""
    yield SetSine(2.0 * drive_hz + off_hz, 2.0 * level_v(settings))
    yield Settle(settings.settle_s, "gyro settles after the change of frequency")
    first_v, second_v, third_v = answer((yield FindAmplitudes(channels, _LARGEST_V, 1.0)), Amplitudes).amplitudes_v
    return first_v, second_v, third_v


def _channels(settings: KnownVvcSettings, second: Node, third: Node) -> tuple[int, int, int]:
    of = settings.station.channel_of
    return of("drive"), of(second), of(third)
