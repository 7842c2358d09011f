"""Characteristics that K_Vc depends on, by the oscilloscope without a table: modes, phases, feed-through, amplitudes.

The certificate's calibration and the self-calibration both do it, with the same steps, so that what an instrument is
off cancels in what has changed. V_Vc is switched off for ring-downs of the sense modes, rests at both signs for the
phase of what it does, and is a sine at twice the drive frequency and a little, which finds the demodulator's reference,
and at far from that, where no mode answers: what is left there comes through without motion.
"""

import cmath
import math
from collections.abc import Sequence
from statistics import fmean
from typing import Final

from msgspec import Struct, structs

from vcfbench import steps
from vcfbench.analysis.decays import RingingMode
from vcfbench.analysis.rotating import fit_rotation
from vcfbench.errors import MeasurementError
from vcfbench.instructions.routines import check_rails, set_sine, set_v_vc, turning, v_vc_level_again, v_vc_on
from vcfbench.instructions.v_vc import KnownVvcSettings
from vcfbench.interfaces import AveragesWaveforms, Oscilloscope, SetsSine, lacking
from vcfbench.models import driver_of, find_model
from vcfbench.procedures.resonance import SenseDecay, ring_downs
from vcfbench.records.device_values import Characteristics
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.parts import Node
from vcfbench.station.settings import V_VC_RANGE_V
from vcfbench.steps.drive_check import one_two_five
from vcfbench.steps.scope import Screen
from vcfbench.steps.step import Routine
from vcfbench.uncertainty.oscilloscope import (
    CaptureSense,
    amplitudes,
    capture_drive,
    channels_of,
    points_over,
    points_that_show,
)

HEALTH: Final = "also measure the quantities that K_Vc depends on, if the bench can"
EXCHANGE: Final = "a person exchanges the probes of drive and carrier, so that their gains cancel"
NODES: Final[tuple[Node, ...]] = ("drive", "carrier", "sense", "output")
"""Nodes that the oscilloscope must see."""


def why_not(settings: KnownVvcSettings) -> str:
    """Return the reason why the bench cannot measure it; empty: it can."""
    placed = settings.station.instruments.get("rate_source")
    row = None if placed is None else find_model(placed.model)
    driver = None if row is None else driver_of(row)
    if driver is None or lacking(getattr(driver, "driver_class", driver), SetsSine):
        return "the generator makes no sines"
    wiring = settings.station.oscilloscope
    if wiring is None:
        return "the bench has no oscilloscope"
    unseen = [node for node in NODES if wiring.channel_of(node) is None]
    return f"no channel of the oscilloscope sees {' and '.join(unseen)} (wiring.oscilloscope)" if unseen else ""


class Modes(Struct, frozen=True):
    """Drive frequency and both modes, with the amplitudes as their record begins."""

    drive_hz: float
    anti_phase: RingingMode
    in_phase: RingingMode

    def answers(self, offset_hz: float) -> tuple[complex, complex]:
        """Return motion over force of both modes so far from the drive frequency; in one unit, not that of forces."""
        at_hz = self.drive_hz + offset_hz
        first, second = (
            1.0 / complex(mode.frequency_hz**2 - at_hz**2, mode.frequency_hz * at_hz / mode.q)
            for mode in (self.anti_phase, self.in_phase)
        )
        return first, second

    def answer(self, share: float, offset_hz: float) -> complex:
        """Return the response of both to V_Vc, `share` being that of the in-phase mode at the drive's own frequency."""
        stiff = [(1.0 / each).real for each in self.answers(0.0)]
        anti_phase, in_phase = self.answers(offset_hz)
        moved = (1.0 - share) * stiff[0] * anti_phase + share * stiff[1] * in_phase
        return math.copysign(1.0, stiff[0]) * moved


def modes_of(decay: SenseDecay) -> Modes:
    """Return both modes, the one nearer to the drive as that in anti-phase; MeasurementError: only one rang down."""
    if len(decay.modes) < 2:
        raise MeasurementError(
            f"expected a ring-down of two modes, got {decay.modes[0].frequency_hz:.1f} Hz", instrument="oscilloscope"
        )
    near, far = sorted(decay.modes, key=lambda mode: abs(mode.frequency_hz - decay.drive_hz))
    return Modes(decay.drive_hz, near, far)


def middle_of(found: Sequence[Modes]) -> Modes:
    """Return the mean of several ring-downs."""

    def mode(of: Sequence[RingingMode]) -> RingingMode:
        return RingingMode(*(fmean(each) for each in zip(*map(structs.astuple, of), strict=True)))

    drive_hz = fmean(each.drive_hz for each in found)
    return Modes(drive_hz, mode([each.anti_phase for each in found]), mode([each.in_phase for each in found]))


_OF_RANGE = 0.525
"""V_Vc of ring-downs and phases, as a rate over the largest of `rates_deg_s`: 0.7 V of the paper's gyroscope."""
RING_DOWNS: Final = 6
_LENGTH = 1.5
"""Of their records, in time constants of the mode that measures."""
_MEANS, _PERIODS = 12, 3.0
"""Means of drive and carrier, and periods in their records: short ones come the faster."""
_HIGHEST = 0.8
"""Span of the starts of means, of the drive's amplitude, each side of zero. Each mean begins elsewhere, so that the
converter's steps, which no noise of a mean hides, differ in each; from one place they would all err by 20 ppm."""
_STATES = (1.0, -1.0, -1.0, 1.0)
_RECORDS = 4
_APART = 4.0
"""Between two records: so many time constants of the sense modes, whose noise swings at the mode split."""
_NEAR_HZ, _OF_SPLIT = 8.0, 1.0 / 3.0
"""By which the sine is off twice the drive frequency: the smaller of this and of that share of the split."""
_OF_DRIVE = 0.43, 0.23
"""The same over the drive frequency: that which is farther from both modes. No harmonic of the drive is there."""
_TURNS = 4.0
_SPLITS_HZ, _Q, _SHARE = (25.0, 150.0), 1200.0, 0.15
"""Values for a dry run: splits and Q of both modes of the paper's class, and the share of the in-phase one."""
_NEAR_RECORDS, _FAR_RECORDS = 2, 3
_A_PERIOD = 2.3
"""Points in a period of the drive, at least: two would be too few."""
_FAR_PERIODS, _FAR_A_PERIOD = 100.0, 30.0
"""The same of the sine far from the modes, and the periods of the drive in its records."""


class CaptureFar(steps.CaptureRotations, frozen=True):
    """Records under a sine far from the modes, where feed-through is visible; the filter is shut.

    The last of `channels` is not looked at.
    """

    @property
    def seen(self) -> tuple[int, ...]:
        return self.channels[:2]

    def acquire(self, scope: Oscilloscope) -> None:
        if isinstance(scope, AveragesWaveforms):  # a feed-through that matters is a ten-thousandth of the screen
            scope.acquire_fine(*self.seen)
        else:
            scope.acquire(*self.seen)

    def _record(self, scope: Oscilloscope, screen: Screen) -> steps.RotationRecord:
        (drive, sense), interval_s = self.taken(scope, screen)
        found = fit_rotation(drive.voltage_v, sense.voltage_v, drive.voltage_v, interval_s, self.difference_hz)
        return steps.RotationRecord(found.drive_hz, found.difference_hz, 0.0, found.turning, 0.0)

    def predict(self, gyro: LinearGyro) -> steps.Rotations:
        modes = _expected(self.drive_hz)
        turning_v = abs(modes.answer(_SHARE, self.difference_hz) / modes.answer(_SHARE, 0.0))
        record = steps.RotationRecord(self.drive_hz, self.difference_hz, 0.0, turning_v, 0.0)
        return steps.Rotations((record,) * self.count)


def level_v(settings: KnownVvcSettings) -> float:
    """Return the V_Vc of ring-downs and phases, V; the peak of its sines is twice that."""
    level_v = _OF_RANGE * max(map(abs, settings.rates_deg_s)) / abs(settings.k_vc_guess_deg_s_per_v)
    return min(level_v, 0.5 * (settings.station.limits.max_v_vc_v or V_VC_RANGE_V))


def examined(
    settings: KnownVvcSettings, then: Characteristics | None, *, looked_for: bool, exchange: bool, source: str = ""
) -> Routine[None]:
    """Measure the characteristics, if that is `looked_for` and the bench can; V_Vc is off before and afterwards.

    `exchange`: a person puts the probes of drive and carrier in each other's place for it. `then` is what `source` has
    of it; a certificate's own calibration has none (None), and needs none.
    """
    if not looked_for:
        return
    lacks = why_not(settings)
    if not lacks and source and (then is None or then.sense_phase_deg is None):
        lacks = f"{source} does not have it"
    if lacks:
        yield steps.NotChecked("what K_Vc depends on", lacks)
        return
    yield steps.Note("Health: what K_Vc depends on, by the oscilloscope")
    yield from v_vc_on()
    (drive_v,) = yield from amplitudes(settings, settings.station.channel_of("drive"))
    seen = yield from capture_drive(settings, drive_v)
    expected = _expected(seen.frequency_hz)
    foreseen = SenseDecay(expected.drive_hz, (expected.anti_phase, expected.in_phase))
    decays = yield from ring_downs(settings, level_v(settings), RING_DOWNS, _LENGTH, foreseen, modes=2)
    if len(decays) < RING_DOWNS:
        seen_v = f"both sense modes were seen to ring down {len(decays)} times of {RING_DOWNS}"
        yield steps.NotChecked("what K_Vc depends on", f"{seen_v}: the in-phase mode may be too weak")
        yield from _off_again(settings)
        return
    modes = modes_of(decays[-1])
    split_hz, drive_hz = abs(modes.drive_hz - modes.anti_phase.frequency_hz), modes.drive_hz
    lasts_s = modes.anti_phase.q / (math.pi * modes.anti_phase.frequency_hz)
    spacing_s = one_two_five(_APART * lasts_s)
    yield from _at_both_signs(settings, drive_hz, seen.amplitudes_v[0], spacing_s, exchange=exchange)
    near_hz = min(_NEAR_HZ, _OF_SPLIT * split_hz)
    near_s_per_div = one_two_five(_TURNS / near_hz / 10.0)
    far_s_per_div = one_two_five(_FAR_PERIODS / drive_hz / 10.0)
    near_points = points_over(10.0 * near_s_per_div, drive_hz + near_hz, _A_PERIOD)
    own_hz = [abs(drive_hz - mode.frequency_hz) for mode in (modes.anti_phase, modes.in_phase)]
    far_hz = max((of * drive_hz for of in _OF_DRIVE), key=lambda off: min(abs(off - each) for each in own_hz))
    far_points = points_over(10.0 * far_s_per_div, drive_hz + far_hz, _FAR_A_PERIOD)
    near, far = channels_of(settings, "sense", "output"), channels_of(settings, "sense", "carrier")
    apart_hz = 0.0
    for kind, channels, s_per_div, count, points, off_hz in (
        (steps.CaptureRotations, near, near_s_per_div, _NEAR_RECORDS, near_points, near_hz),
        (CaptureFar, far, far_s_per_div, _FAR_RECORDS, far_points, far_hz),
    ):
        yield steps.ConfigureScope(s_per_div, channels[0])
        for sign in (1.0, -1.0):  # V_Vc turns the sense signal against the drive
            yield from set_sine(settings, 2.0 * drive_hz + sign * off_hz - apart_hz, 2.0 * level_v(settings))
            shown_v = yield from amplitudes(settings, *channels, points=points_that_show(10.0 * s_per_div, drive_hz))
            step = kind(channels, shown_v, count, points, sign * off_hz, drive_hz)
            _, apart_hz = yield from turning(settings, step, 2.0 * level_v(settings), apart_hz)
    yield from v_vc_level_again()
    yield from _off_again(settings)


def _off_again(settings: KnownVvcSettings) -> Routine[None]:
    yield steps.DisableVvc()
    yield from check_rails(settings)


def _expected(drive_hz: float) -> Modes:
    """Return the modes that a dry run answers with."""
    near, far = drive_hz - _SPLITS_HZ[0], drive_hz - _SPLITS_HZ[1]
    return Modes(drive_hz, RingingMode(near, _Q, 1.0 - _SHARE), RingingMode(far, _Q, _SHARE))


def exchanged_probes(on_drive: int, on_carrier: int) -> steps.AskOperator:
    """Return the step that has the probe of one channel put on the drive, and that of another on the carrier."""
    words = f"put the probe of channel {on_drive} on the drive and that of channel {on_carrier} on the carrier"
    inputs = ((on_drive, "drive"), (on_carrier, "carrier"))
    return steps.AskOperator(words, adjustments=tuple((f"oscilloscope.channel_{n}.node", node) for n, node in inputs))


def _at_both_signs(
    settings: KnownVvcSettings, drive_hz: float, amplitude_v: float, spacing_s: float, *, exchange: bool
) -> Routine[None]:
    """Take drive, carrier and sense signal at both signs of V_Vc; means of many records of the first two.

    `drive_hz` and `amplitude_v` are the drive's. With `exchange` the means are of the probes as they are, exchanged
    twice as many, and as they are (A B B A).
    """
    channels = channels_of(settings, "carrier", "sense")
    yield steps.ConfigureScope(one_two_five(1.0 / drive_hz), channels[0])
    shown_v: tuple[float, ...] = (0.0, 0.0, 0.0)
    for sign in (1.0, -1.0):
        yield from set_v_vc(settings, sign * level_v(settings))
        shown_v = max(shown_v, (yield from amplitudes(settings, *channels)), key=lambda seen: seen[2])
    turned = 1j * _expected(drive_hz).answer(_SHARE, 0.0)
    expected = steps.SineRecord(drive_hz, (amplitude_v, amplitude_v), (0.0, -90.0))
    every, pair, common_v = range(_MEANS), channels[:2], (max(shown_v[:2]),) * 2
    turns = [(pair, every[::2]), (pair[::-1], every), (pair, every[1::2])] if exchange else [(pair, every)]
    for turn, ((on_drive, on_carrier), places) in enumerate(turns):
        if turn:
            yield exchanged_probes(on_drive, on_carrier)
        for place in places:
            level = _HIGHEST * amplitude_v * (2.0 * place / (_MEANS - 1) - 1.0)
            yield steps.ConfigureScope(one_two_five(_PERIODS / drive_hz / 10.0), on_drive, level)
            # at one scale: another one has an error of its own
            yield steps.CaptureMeanSines((on_drive, on_carrier), common_v, 1, expected)
    yield steps.ConfigureScope(one_two_five(1.0 / drive_hz), channels[0])
    for sign in _STATES:
        yield from set_v_vc(settings, sign * level_v(settings))
        seen = steps.SineRecord(
            drive_hz, (amplitude_v, amplitude_v, 1.0), (0.0, -90.0, math.degrees(cmath.phase(sign * turned)))
        )
        yield CaptureSense(channels, shown_v, _RECORDS, seen, spacing_s, 0.0, sign * level_v(settings))
    yield steps.SetVvc(0.0)
