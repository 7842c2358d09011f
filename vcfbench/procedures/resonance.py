"""Resonances by ring-down and by sweep: drive, split, both sense modes, with their quality factors.

The sense modes ring down when V_Vc is switched off, the drive when its loop stops as the rails fall: both are read from
records of the oscilloscope. The sweep is that of :mod:`vcfbench.procedures.bandwidth`. The drive has none: its loop
holds it at resonance.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from statistics import fmean
from typing import Annotated, ClassVar

from msgspec import Struct, structs

from vcfbench import steps
from vcfbench.analysis.decays import RingingMode, fit_decays, fit_release
from vcfbench.analysis.sine_fit import fit_sine
from vcfbench.belief.in_turn import SHARE, InTurn, Visit, require_alike
from vcfbench.errors import ClippedRecord, ConfigError, MeasurementError
from vcfbench.instructions import routines
from vcfbench.instructions.kept import Keeps
from vcfbench.instructions.procedure import Procedure, roles
from vcfbench.interfaces import FunctionGenerator, SamplesVoltage, Waveform
from vcfbench.procedures.bandwidth import Bandwidth, BandwidthSettings, characteristics, sweep
from vcfbench.procedures.bandwidth import results as band_of
from vcfbench.records.device_values import Characteristics
from vcfbench.reports.document import Report, Table, Text, heads
from vcfbench.station.bounds import ranged
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.drive_check import one_two_five
from vcfbench.steps.measured import Measured
from vcfbench.steps.scope import interval_of, scale_v_per_div
from vcfbench.steps.step import Context, Effect, Routine, Step, StepResult, answer, does
from vcfbench.uncertainty.measurand import as_kept, difference, measurand, printed, quality_of
from vcfbench.uncertainty.oscilloscope import (
    amplitudes,
    as_expected,
    frequency_of,
    points_over,
    points_that_show,
)
from vcfbench.values.value import Measurand

_DRIVE_RECORD = 0.02, 50_000
"""Time base (s/div) and points of the drive's record: a fifth of a second, in which the rails fall; five points in a
period of 50 kHz."""
_LENGTH = 4.0
"""Of a record of the sense modes, in time constants."""
_FIRST_S = 0.1
"""Time constant that a first record is meant for, before any is known."""
_BEATS, _LONGEST = 4.0, 8.0
"""Beats with the drive in a record, where that is no more than so many time constants."""
_SETTLED = 0.5
"""Share of the time that an output settles in: beyond it there is noise alone, and it rings as the modes do."""
_ROOM = 5.0
"""Times by which a record may be longer than it need be."""
_A_PERIOD = 6.0
_LOOKS = 8
"""Ring-downs by which length and scale of the records are found, at most."""
_PATIENCE, _SLOWEST = 3, 5.0
"""Ring-downs in which too few modes were seen, before a longer record is tried; and the longest, s/div."""

_WANDERS = 0.002
"""How far a quality factor walks by a kelvin; a split much less."""


class ResonanceSettings(BandwidthSettings, frozen=True, kw_only=True):
    """Keys of `resonance`: those of the sweep, and those of the ring-downs."""

    ring_down_v_vc_v: Annotated[
        float, ranged(0.01, 10.0, "V_Vc that is switched off for a ring-down of the sense modes")
    ] = 0.7
    sense_ring_downs: Annotated[int, ranged(3, 1000, "ring-downs of the sense modes")] = 8
    drive_ring_downs: Annotated[int, ranged(3, 1000, "ring-downs of the drive, rails off and on")] = 6


class SenseDecay(StepResult, Struct, frozen=True, omit_defaults=True):
    """The drive frequency in one record, and the modes that rang down in it, the strongest first.

    `trouble` says why none were seen, and `clipped` which channels were beyond their screens; empty otherwise.
    """

    drive_hz: float
    modes: tuple[RingingMode, ...]
    trouble: str = ""
    clipped: tuple[int, ...] = ()

    def describe(self) -> str:
        return self.trouble or ", ".join(f"{mode.frequency_hz:.2f} Hz with Q {mode.q:.4g}" for mode in self.modes)


@does(Effect.MEASURES, "waveforms", overhead_s=2.0)
class CaptureDecay(Step, Struct, frozen=True):
    """Take a record of drive and sense signal that begins at once, and fit the modes that ring down in it."""

    follows_at_once: ClassVar[bool] = True
    channels: tuple[int, int]
    amplitudes_v: tuple[float, float]
    points: int
    expected: SenseDecay

    def describe(self) -> str:
        return "oscilloscope: the sense modes ring down"

    def perform(self, context: Context) -> SenseDecay:
        """Capture, download and fit; a clipped record or one without a ring-down is an answer too."""
        scope = context.bench.oscilloscope
        for channel, amplitude_v in zip(self.channels, self.amplitudes_v, strict=True):
            scope.configure_channel(channel, scale_v_per_div(amplitude_v))
        scope.acquire(*self.channels)
        taken: list[Waveform] = []
        clipped: list[int] = []
        for channel in self.channels:
            try:
                taken.append(steps.downloaded(context, channel, self.points))
            except ClippedRecord:
                clipped.append(channel)
        if clipped:
            return SenseDecay(0.0, (), "more than the screen shows", tuple(clipped))
        drive, sense = taken
        interval_s = interval_of(drive, self.expected.drive_hz)
        drive_hz = fit_sine(drive.voltage_v, interval_s).frequency_hz
        try:
            return SenseDecay(drive_hz, fit_decays(sense.voltage_v, interval_s, drive_hz))
        except ConfigError as error:
            return SenseDecay(drive_hz, (), error.what)

    def predict(self, gyro: LinearGyro) -> SenseDecay:
        return self.expected


class DriveDecay(StepResult, Struct, frozen=True):
    """The drive as it rang down; `trouble` has the reason if it was not seen."""

    frequency_hz: float
    q: float
    trouble: str = ""

    def describe(self) -> str:
        return self.trouble or f"{self.frequency_hz:.3f} Hz with Q {self.q:.5g}"


@does(Effect.MEASURES, "drive signal", overhead_s=1.0)
class ReleaseDrive(Step, Struct, frozen=True):
    """Switch the supply off while the drive signal is recorded.

    Its loop stops below a voltage at which the board still shows the drive, which rings down until the board is dead.
    `drive_hz` is where it is, roughly.
    """

    channel: int
    amplitude_v: float
    points: int
    drive_hz: float

    def describe(self) -> str:
        return "supply outputs off; oscilloscope: the drive rings down"

    def perform(self, context: Context) -> DriveDecay:
        scope = context.bench.oscilloscope
        scope.configure_channel(self.channel, scale_v_per_div(self.amplitude_v))
        context.bench.power.disable_outputs()
        scope.acquire(self.channel)
        drive = scope.waveform(self.channel, self.points)
        try:
            found = fit_release(drive.voltage_v, float(drive.time_s[1] - drive.time_s[0]), self.drive_hz)
        except (ConfigError, MeasurementError) as error:
            return DriveDecay(0.0, 0.0, error.what)
        return DriveDecay(found.frequency_hz, found.q)

    def predict(self, gyro: LinearGyro) -> DriveDecay:
        return DriveDecay(self.drive_hz, 1000.0)


class Resonances(Struct, frozen=True):
    """Result of `resonance`, by ring-down and by sweep; a quantity that was not seen is null.

    `drive_hz` is that of the loop, locked; `drive_ring_down_hz` and `drive_q` those of the drive once it is let go;
    `why_no_drive` says why they are null. `sense_...` is the anti-phase mode. The splits are drive less sense
    frequency: of the sweep without its sign. `in_phase_...` is the other sense mode. `e_n_...` compares both ways;
    above 1 they disagree. `sweep` is what `bandwidth` finds.
    """

    drive_hz: Measurand
    drive_ring_down_hz: Measurand | None
    drive_q: Measurand | None
    why_no_drive: str
    sense_hz: Measurand
    sense_q_ring_down: Measurand
    sense_q_sweep: Measurand
    split_ring_down_hz: Measurand
    split_sweep_hz: Measurand
    in_phase_hz: Measurand | None
    in_phase_q: Measurand | None
    e_n_drive_hz: float | None
    e_n_sense_q: float
    e_n_split: float
    sweep: Bandwidth


NOT_HELD = (
    "The uncertainties of the ring-downs contain the scatter of the records and the oscilloscope's time base; those of "
    "the sweep are the uncertainties of `bandwidth`. They do not contain a change of temperature between the two "
    "methods or, for the drive, a change of its pick-off while the rails fall. The drive has no sweep: its loop holds "
    "it at resonance, and the generator cannot reach its force."
)


def _looked_at(settings: ResonanceSettings, work: steps.Plan) -> steps.Plan:
    yield from routines.look_at_drive(settings)
    yield from work


@routines.framed(routines.energised, _looked_at, routines.held_at_rest)
def plan(settings: ResonanceSettings) -> steps.Plan:
    """Sweep, then record ring-downs of the sense modes, then of the drive."""
    _, drive_hz = yield from sweep(settings)
    yield steps.Note("The sense modes ring down as V_Vc is switched off")
    yield from routines.v_vc_level_again()
    splits_hz = settings.split_guess_hz, settings.in_phase_split_hz
    expected = SenseDecay(drive_hz, tuple(RingingMode(drive_hz - each, 1000.0, 1.0) for each in splits_hz))
    v_vc_v, count = settings.ring_down_v_vc_v, settings.sense_ring_downs
    decays = yield from ring_downs(settings, v_vc_v, count, _LENGTH, expected, modes=1)
    if len(decays) < count:
        raise MeasurementError(
            f"the sense modes were seen to ring down {len(decays)} times of {count} as V_Vc was switched off",
            instrument="oscilloscope",
            hint="check the leads of V_Vc and of the sense signal; a larger ring_down_v_vc_v gives a larger signal",
        )
    drive_hz = fmean(each.drive_hz for each in decays)
    yield steps.Note("The drive rings down as the rails are switched off")
    channel = settings.station.channel_of("drive")
    seconds_a_division, points = _DRIVE_RECORD
    yield steps.DisableVvc()
    yield steps.ConfigureScope(one_two_five(1.0 / drive_hz), channel)
    (drive_v,) = yield from amplitudes(settings, channel)
    yield steps.MeasureDriveAgain(channel, drive_v, drive_hz)  # while there is a drive
    yield steps.ConfigureScope(seconds_a_division, channel)
    (drive_v,) = yield from amplitudes(settings, channel, points=points_that_show(10.0 * seconds_a_division, drive_hz))
    rails = routines.rails_of(settings)
    for number in range(settings.drive_ring_downs):
        if number:
            yield steps.EnableSupply()
            yield steps.Settle(settings.drive.start_up_s, "rails up, drive loop starts")
            yield steps.CheckRails(rails, settings.rail_tolerance_v)
        yield ReleaseDrive(channel, drive_v, points, drive_hz)


def ring_downs(
    settings: ProcedureSettings, v_vc_v: float, count: int, length: float, expected: SenseDecay, *, modes: int
) -> Routine[list[SenseDecay]]:
    """Switch V_Vc off until the records fit the ring-down, and then `count` times; return the last `count`.

    A record shall be `length` time constants of the mode that is nearest to the drive long, and show some beats of the
    two; a signal that is more than the screen shows is shown at twice the scale. `expected` has the drive frequency.
    Fewer records are returned where so many `modes` are not seen, however often it is tried.

    Raises:
        MeasurementError: the drive is not at the expected frequency.
    """
    channels = settings.station.channel_of("drive"), settings.station.channel_of("sense")
    s_per_div = one_two_five(length * _FIRST_S / 10.0)
    shown_v: tuple[float, ...] = ()
    yield steps.ConfigureScope(s_per_div, channels[0])
    found: list[SenseDecay] = []
    for tries in range(1, _LOOKS + 2 * count):
        yield from routines.set_v_vc(settings, v_vc_v)
        if not shown_v:
            points = points_that_show(10.0 * s_per_div, expected.drive_hz)
            shown_v = yield from amplitudes(settings, *channels, points=points)
        yield steps.SetVvc(0.0)
        points = points_over(10.0 * s_per_div, expected.drive_hz, _A_PERIOD)
        seen = answer((yield CaptureDecay(channels, (shown_v[0], shown_v[1]), points, expected)), SenseDecay)
        if seen.clipped:
            found = []
            shown_v = tuple(v * (1 + (each in seen.clipped)) for v, each in zip(shown_v, channels, strict=True))
            continue
        wanted = _s_per_div(seen, length, settings.settle_s)
        if not found and wanted and not wanted <= s_per_div <= _ROOM * wanted:
            s_per_div = wanted
            yield steps.ConfigureScope(s_per_div, channels[0])
        elif len(seen.modes) >= modes:
            as_expected(settings, seen.drive_hz)
            found.append(seen)
        elif not found and tries % _PATIENCE == 0 and s_per_div < min(_SLOWEST, _SETTLED * settings.settle_s / 10.0):
            s_per_div = one_two_five(_ROOM * s_per_div)
            yield steps.ConfigureScope(s_per_div, channels[0])
        if len(found) == count:
            break
    return found


def _s_per_div(seen: SenseDecay, length: float, settle_s: float) -> float | None:
    """Return the time base that fits what rang down, not longer than it takes to settle; None where nothing did."""
    if not seen.modes:
        return None
    near = min(seen.modes, key=lambda mode: abs(mode.frequency_hz - seen.drive_hz))
    lasts_s, beat_s = near.q / (math.pi * near.frequency_hz), 1.0 / abs(near.frequency_hz - seen.drive_hz)
    record_s = max(length * lasts_s, min(_BEATS * beat_s, _LONGEST * lasts_s))
    return min(_SLOWEST, one_two_five(min(record_s, _SETTLED * settle_s) / 10.0))


def rang_down(measured: Measured, count: int, modes: int) -> list[SenseDecay]:
    """Return the last `count` ring-downs of so many modes: those before were for length and scale of the records."""
    return [found for _, found in measured.found(SenseDecay) if len(found.modes) >= modes][-count:]


def _ring_downs(settings: ResonanceSettings, measured: Measured) -> tuple[list[SenseDecay], list[DriveDecay]]:
    decays = rang_down(measured, settings.sense_ring_downs, modes=1)
    return decays, [found for _, found in measured.found(DriveDecay)]


def results(settings: ResonanceSettings, measured: Measured) -> Resonances:
    """Combine the records of each way, and compare the ways."""
    decays, released = _ring_downs(settings, measured)
    found = combined(band_of(settings, measured), decays, released)
    require_alike(in_turn(decays, released))
    return found


def in_turn(decays: Sequence[SenseDecay], released: Sequence[DriveDecay]) -> Iterator[InTurn]:
    """Yield what the ring-downs showed in turn, of modes that were seen every time: splits and quality factors."""
    for place, name in enumerate(("anti-phase", "in-phase")):
        if all(len(each.modes) > place for each in decays):
            modes = [_near_first(each)[place] for each in decays]
            splits_hz = [each.drive_hz - mode.frequency_hz for each, mode in zip(decays, modes, strict=True)]
            for what, values in (("split", splits_hz), ("Q", [mode.q for mode in modes])):
                spoilt = partial(_other_mode, place, of_q=what == "Q")
                yield InTurn(f"the {what} of the {name} mode", SHARE, _WANDERS, _visits(values, decays), spoilt)
    if not any(each.trouble for each in released):
        yield InTurn(
            "the Q of the drive", SHARE, _WANDERS, _visits([each.q for each in released], released), _other_drive
        )


def _visits(values: Sequence[float], results: Sequence[StepResult]) -> tuple[Visit, ...]:
    return tuple(Visit(None, (value / values[0] - 1.0,), each) for value, each in zip(values, results, strict=True))


def _near_first(decay: SenseDecay) -> list[RingingMode]:
    return sorted(decay.modes, key=lambda mode: abs(mode.frequency_hz - decay.drive_hz))


def _other_mode(place: int, decay: SenseDecay, share: float, *, of_q: bool) -> SenseDecay:
    modes = _near_first(decay)
    split_hz = decay.drive_hz - modes[place].frequency_hz
    other = {"q": (1.0 + share) * modes[place].q} if of_q else {"frequency_hz": decay.drive_hz - (1 + share) * split_hz}
    modes[place] = structs.replace(modes[place], **other)
    return structs.replace(decay, modes=tuple(modes))


def _other_drive(decay: DriveDecay, share: float) -> DriveDecay:
    return structs.replace(decay, q=(1.0 + share) * decay.q)


def combined(swept: Bandwidth, decays: Sequence[SenseDecay], released: Sequence[DriveDecay]) -> Resonances:
    """Return the resonances by either way; a quantity that was not seen every time is not reported."""
    seen = [found for found in released if not found.trouble]
    drive_hz = frequency_of([found.drive_hz for found in decays])
    near_first = list(map(_near_first, decays))
    anti_phase = [modes[0] for modes in near_first]
    in_phase = [modes[1] for modes in near_first if len(modes) > 1]
    split = frequency_of([each.drive_hz - mode.frequency_hz for each, mode in zip(decays, anti_phase, strict=True)])
    quality = quality_of([mode.q for mode in anti_phase])
    whole, both = len(seen) == len(released), len(in_phase) == len(decays)
    drive_ring_down_hz = frequency_of([found.frequency_hz for found in seen]) if whole else None
    return Resonances(
        drive_hz=drive_hz,
        drive_ring_down_hz=drive_ring_down_hz,
        drive_q=quality_of([found.q for found in seen]) if whole else None,
        why_no_drive=next((found.trouble for found in released if found.trouble), ""),
        sense_hz=frequency_of([mode.frequency_hz for mode in anti_phase]),
        sense_q_ring_down=quality,
        sense_q_sweep=swept.q,
        split_ring_down_hz=split,
        split_sweep_hz=swept.split_hz,
        in_phase_hz=frequency_of([mode.frequency_hz for mode in in_phase]) if both else None,
        in_phase_q=quality_of([mode.q for mode in in_phase]) if both else None,
        e_n_drive_hz=None if drive_ring_down_hz is None else _e_n(drive_hz, drive_ring_down_hz),
        e_n_sense_q=_e_n(quality, swept.q),
        e_n_split=_e_n(split, swept.split_hz),
        sweep=swept,
    )


def _e_n(first: Measurand, second: Measurand) -> float:
    """Return the difference of two sizes over its expanded uncertainty; an instrument that both share cancels."""
    owners = {part.of for part in first.parts} & {part.of for part in second.parts}
    own = [part for part in (*first.parts, *second.parts) if part.of is None or part.of not in owners]
    difference = measurand(abs(first.value) - abs(second.value), first.unit, own)
    return abs(difference.value) / difference.u95 if difference.value else 0.0


def report(_settings: ResonanceSettings, _measured: Measured, found: Resonances) -> Report:
    """Report every quantity by either way, and the agreement of both."""
    named = (
        ("drive frequency", "loop, locked", found.drive_hz, None),
        ("drive frequency", "ring-down", found.drive_ring_down_hz, found.e_n_drive_hz),
        ("Q of the drive", "ring-down", found.drive_q, None),
        ("sense frequency, anti-phase", "ring-down", found.sense_hz, None),
        ("Q of the anti-phase mode", "ring-down", found.sense_q_ring_down, None),
        ("Q of the anti-phase mode", "sweep", found.sense_q_sweep, found.e_n_sense_q),
        ("mode split", "ring-down", found.split_ring_down_hz, None),
        ("mode split", "sweep", found.split_sweep_hz, found.e_n_split),
        ("sense frequency, in phase", "ring-down", found.in_phase_hz, None),
        ("Q of the in-phase mode", "ring-down", found.in_phase_q, None),
    )
    columns = heads("<quantity | <by | value:.8g | u:.2g | U95:.2g | <unit | E_n:.2f")
    rows = [(name, way, *printed(each), each.unit, e_n) for name, way, each, e_n in named if each]
    missing = [f"{name} by {way}: not seen" for name, way, each, _ in named if each is None]
    said = [*missing, *([found.why_no_drive] if found.why_no_drive else []), NOT_HELD]
    return Report([Table(columns, rows), Text("\n".join(said))])


def resonance_characteristics(_settings: ResonanceSettings, found: Resonances) -> Characteristics:
    """Return the characteristics that K_Vc depends on: the in-phase mode as well where it was seen to ring down."""
    apart = None
    if found.in_phase_hz is not None:
        apart = as_kept(difference(found.drive_hz, found.in_phase_hz))
    return structs.replace(
        characteristics(found.sweep),
        drive_hz=as_kept(found.drive_hz),
        split_hz=as_kept(found.split_ring_down_hz),
        split_size_hz=None,
        q_anti_phase=as_kept(found.sense_q_ring_down),
        in_phase_split_hz=apart,
        q_in_phase=None if found.in_phase_q is None else as_kept(found.in_phase_q),
    )


RESONANCE = Procedure(
    name="resonance",
    method=(
        "Frequency and quality factor of the drive mode and of both sense modes are measured by ring-down with the "
        "generator and the oscilloscope; split and quality factor of the sense mode also by sweep, and compared by "
        "E_n. The mode split is the difference of the frequencies."
    ),
    settings=ResonanceSettings,
    plan=plan,
    results=results,
    report=report,
    unforeseen=dict.fromkeys(
        ("drive_q", "sense_q_ring_down", "split_ring_down_hz", "in_phase_q"), "it is the scatter of a few ring-downs"
    ),
    entry=Keeps("resonance", resonance_characteristics),
    in_turn=lambda settings, measured: in_turn(*_ring_downs(settings, measured)),
    needs={**roles("power", rate_source=FunctionGenerator, multimeter=SamplesVoltage), **roles("oscilloscope")},
    uses=roles("rate_table"),
)
