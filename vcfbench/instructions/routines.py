"""Common parts of work instructions: power up, check the drive, go to a rate, take a point, shut down."""

import math
from collections.abc import Callable, Iterable
from functools import wraps
from statistics import fmean
from typing import Any, TypeAlias, TypeVar

from vcfbench import steps
from vcfbench.errors import MeasurementError
from vcfbench.instructions.scale_factor import (
    LOOKED,
    AtRestSettings,
    ScaleFactor,
    far,
    require_as_used,
    scale_factor_used,
    tells_scale_factor,
    unlike_used,
)
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.drive_check import check_drive, one_two_five
from vcfbench.steps.measured import Measured
from vcfbench.steps.scope import AIMED
from vcfbench.steps.step import LOOK_AT_SIGNALS, Plan, Routine, answer

S = TypeVar("S", bound=ProcedureSettings)
T = TypeVar("T")

SMALL_V = 1.0
_LOOKS = 5
"""V_Vc and readings of a window by which an output at rest is asked whether it answers."""
_NONE = 1e-6
"""Scatter in the meter's last digits that no meter shows."""
_ANSWERS = 10.0
"""Standard uncertainties by which it must move: a thousandth of what 10 deg/s make of the paper's gyroscope."""


def framed(*frames: Callable[[Any, Plan], Plan]) -> Callable[[Callable[[S], Plan]], Callable[[S], Plan]]:
    """Put a plan inside of `frames`, the outermost first: ``@framed(powered, watched)``."""

    def of(plan: Callable[[S], Plan]) -> Callable[[S], Plan]:
        @wraps(plan)
        def inside(settings: S) -> Plan:
            work = plan(settings)
            for frame in reversed(frames):
                work = frame(settings, work)
            return work

        return inside

    return of


def power_up(settings: ProcedureSettings) -> Routine[None]:
    """Set up meter and generator, then switch the rails on; V_Vc is off before the PCB gets power."""
    yield from meter_set(settings)
    yield from source_off(settings)
    yield from rails_on(settings, settings.start_up_s)


def meter_set(settings: ProcedureSettings) -> Routine[None]:
    """Set range and integration time of the multimeter; a stream has its own."""
    if not settings.station.stream:
        yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))


Look: TypeAlias = Callable[[ProcedureSettings], Routine[None]]


def look_early(settings: ProcedureSettings, *, held: bool = False) -> Routine[None]:
    """See that the output answers as was told, before a long wait or record by it; the table is at rest afterwards.

    `held` tells that it is under servo already. Nothing is done where nothing was told, or nothing can move the output.
    MeasurementError: it answers otherwise.
    """
    yield from _look_at_k_vc(settings)
    by = next((role for role in settings.early_look if _on_bench(settings, role)), None)
    if by is None:
        return
    moving = _turned_and_back(settings) if by == "rate_table" else _moved_and_settled(settings)
    if by == "rate_table" and not held:
        moving = under_servo(settings, moving, "The table to rest")
    slope, within = yield from moving
    settings.require_known_answer(slope, within, by_v_vc=by != "rate_table")


def _turned_and_back(settings: ProcedureSettings) -> Routine[tuple[float, float]]:
    """Look at the output at a slow rate, as `_moved` does, and turn back to rest."""
    found = yield from _moved(settings, by_table=True)
    yield from go_to_rate(settings, 0.0, previous_deg_s=settings.station.limits.slow_deg_s)
    return found


def _moved_and_settled(settings: ProcedureSettings) -> Routine[tuple[float, float]]:
    """Look at the output by V_Vc, as `_moved` does, and wait until it has gone back."""
    found = yield from _moved(settings, by_table=False)
    yield steps.Settle(settings.settle_s, "gyro settles, generator off")
    return found


def _look_at_k_vc(settings: ProcedureSettings) -> Routine[None]:
    """See that V_Vc moves the output as the table does by the K_Vc that was told, where the bench has both."""
    given = settings.k_vc_looked_at
    if given is None or not all(_on_bench(settings, role) for role in ("rate_table", "rate_source")):
        return
    by_v_vc, within = yield from _moved_and_settled(settings)
    by_table, more = yield from under_servo(settings, _turned_and_back(settings), "The table to rest")
    k_vc = settings.k_vc_guess_deg_s_per_v * by_v_vc / by_table
    part = abs(within / by_v_vc) + abs(more / by_table)
    if not min(far((given, given), part)) <= k_vc <= max(far((given, given), part)):
        raise MeasurementError(
            f"by the table K_Vc is some {k_vc:.3g} (deg/s)/V, told is {given:g}",
            instrument="multimeter",
            hint="correct K_Vc (vcfbench run kvc measures it), or look at the leads: vcfbench run polarity",
        )


def rails_on(settings: ProcedureSettings, wait_s: float, look: Look | None = look_early) -> Routine[None]:
    """Set levels and limits, then switch on, wait, and read the rails back; say so where the device feeds itself."""
    rails = rails_of(settings)
    if not rails:
        yield steps.NotChecked("power and when it came on", "the bench has no supply: the device has its own")
        yield from under_power(settings, wait_s, "the time since power-on of the device is unknown", look)
        return
    for rail in rails:  # noqa: UP028  # a tuple cannot be sent results
        yield rail
    yield steps.EnableSupply()
    yield from under_power(settings, wait_s, "rails up, drive loop starts", look)


def under_power(
    settings: ProcedureSettings, wait_s: float, reason: str, look: Look | None = look_early
) -> Routine[None]:
    """Wait, then read the rails back; before a long wait also look at rails, drive and output, lest it be in vain."""
    soon_s = settings.drive.start_up_s
    if wait_s > soon_s:
        yield steps.Settle(soon_s, reason)
        yield from check_rails(settings)
        if settings.station.oscilloscope is not None:
            yield from check_drive(settings)
        if look is not None:
            yield from look(settings)
        wait_s, reason, look = wait_s - soon_s, "warm-up", None
    yield steps.Settle(wait_s, reason)
    yield from check_rails(settings)
    if look is not None and isinstance(settings, AtRestSettings):
        yield from look(settings)


def check_rails(settings: ProcedureSettings) -> Routine[None]:
    """Read the rails back, where the bench has a supply."""
    if settings.rails:
        yield steps.CheckRails(rails_of(settings), settings.rail_tolerance_v)


def rails_of(settings: ProcedureSettings) -> tuple[steps.ConfigureRail, ...]:
    """Return the setting of each rail."""
    return tuple(
        steps.ConfigureRail(rail.rail, rail.output, rail.voltage_v, rail.current_limit_a) for rail in settings.rails
    )


def look_at_drive(settings: ProcedureSettings) -> Routine[steps.DriveReading | None]:
    """Check the drive signal if the bench has an oscilloscope; otherwise wait, and record "not checked"."""
    if settings.station.oscilloscope is None:
        yield steps.NotChecked("the drive signal", "the bench has no oscilloscope")
        yield steps.Settle(settings.drive.start_up_s, "drive loop starts, unseen")
        return None
    return (yield from check_drive(settings))


def look_again(settings: ProcedureSettings, seen: steps.DriveReading | None) -> Routine[None]:
    """Measure the frequency of the drive once more, if it was `seen`."""
    if seen is not None:
        channel = settings.station.channel_of("drive")
        amplitude_v, frequency_hz = float(f"{seen.amplitude_v:.2g}"), float(f"{seen.frequency_hz:.4g}")
        yield steps.MeasureDriveAgain(channel, amplitude_v, frequency_hz, one_two_five(1.0 / seen.frequency_hz))


def ramp_to(settings: ProcedureSettings, rate_deg_s: float, *, previous_deg_s: float) -> Routine[None]:
    """Ramp the table and wait until it is at its rate.

    >>> [step.describe() for step in vcfbench.ramp_to(settings, 50.0, previous_deg_s=0.0)]
    ['table to +50 deg/s at 100 deg/s^2', 'table at +50 deg/s, read-back within 0.05 deg/s']
    """
    ramp = steps.SetRate(rate_deg_s, settings.acceleration_deg_s2, previous_deg_s)
    yield ramp
    deadline_s = 2.0 * ramp.ramp_s + settings.rate_deadline_s
    yield steps.AwaitRate(rate_deg_s, ramp.ramp_s, settings.rate_tolerance_deg_s, deadline_s)


def go_to_rate(settings: ProcedureSettings, rate_deg_s: float, *, previous_deg_s: float) -> Routine[None]:
    """Ramp the table, wait until it is at its rate, then let the gyro settle.

    >>> list(vcfbench.go_to_rate(settings, 50.0, previous_deg_s=0.0))[-1].describe()
    'wait 2 s: gyro settles after the rate step'
    """
    yield from ramp_to(settings, rate_deg_s, previous_deg_s=previous_deg_s)
    yield steps.Settle(settings.settle_s, "gyro settles after the rate step")


def v_vc_on(settle_s: float | None = None) -> Routine[None]:
    """Set 0 V, then close the generator's relay; wait `settle_s` if given.

    >>> [step.describe() for step in vcfbench.v_vc_on()]
    ['V_Vc = +0 V', 'generator output on']
    """
    yield steps.SetVvc(0.0)
    yield steps.EnableVvc()
    if settle_s is not None:
        yield steps.Settle(settle_s, "gyro settles after the generator came on")


def v_vc_level_again() -> Routine[None]:
    """Set V_Vc back from a sine to a level of 0 V."""
    yield steps.DisableVvc()
    yield steps.ConfigureGenerator(0.0)
    yield from v_vc_on()


def set_sine(settings: ProcedureSettings, frequency_hz: float, amplitude_v: float) -> Routine[None]:
    """Set V_Vc to a sine, and let the gyro settle."""
    yield steps.SetSine(frequency_hz, amplitude_v)
    yield steps.Settle(settings.settle_s, "gyro settles after the change of frequency")


def turning(
    settings: ProcedureSettings, step: steps.CaptureRotations, amplitude_v: float, off_hz: float
) -> Routine[tuple[list[steps.RotationRecord], float]]:
    """Record the sense signal while V_Vc is a sine beside twice the drive's frequency.

    Once more, with another sine, where it turns otherwise than it was to: of a drive at 30 kHz the time bases of
    generator and oscilloscope differ by 3 Hz. `off_hz` is what the sine was set lower by for that; what the next one
    shall be is returned beside the records.
    """
    taken = answer((yield step), steps.Rotations).records
    missed_hz = fmean(each.difference_hz for each in taken) - step.difference_hz
    off_hz += missed_hz
    if abs(missed_hz) > AIMED * abs(step.difference_hz):
        yield from set_sine(settings, 2.0 * step.drive_hz + step.difference_hz - off_hz, amplitude_v)
        taken += answer((yield step), steps.Rotations).records
    return list(taken), off_hz


def set_v_vc(settings: ProcedureSettings, v_vc_v: float) -> Routine[float]:
    """Set V_Vc and let the gyro settle; return the level read back, V.

    >>> def half_a_volt(settings):
    ...     level_v = yield from vcfbench.set_v_vc(settings, 0.5)
    >>> next(half_a_volt(settings)).describe()
    'V_Vc = +0.5 V'
    """
    setting = answer((yield steps.SetVvc(v_vc_v)), steps.VvcSetting)
    yield steps.Settle(settings.settle_s, "gyro settles after the V_Vc step")
    return setting.v_vc_v


def take(
    settings: ProcedureSettings, step: int, *, rate_deg_s: float, v_vc_v: float, table_deg_s: float | None = None
) -> Routine[Point]:
    """Average one window and return its point; `table_deg_s` is the table's due readback, None asks no table.

    >>> def zero(settings):
    ...     point = yield from vcfbench.take(settings, 1, rate_deg_s=0.0, v_vc_v=0.0)
    >>> next(zero(settings)).describe()
    'average 10 readings, one every 1 s: +0 deg/s, V_Vc +0 V'
    """
    acquire = steps.Acquire(step, rate_deg_s, v_vc_v, table_deg_s, **window_of(settings))
    return answer((yield acquire), steps.Window).point


def at_rates(
    settings: ProcedureSettings,
    step: int,
    rates_deg_s: Iterable[float],
    look: Callable[[list[Point]], None] | None = None,
) -> Routine[list[Point]]:
    """Average one window at each rate of the table in turn, the first from rest; `look` at the points after each."""
    points: list[Point] = []
    previous_deg_s = 0.0
    for rate_deg_s in rates_deg_s:
        if rate_deg_s != previous_deg_s:
            yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
        points.append((yield from take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s)))
        if look:
            look(points)
        previous_deg_s = rate_deg_s
    return points


def take_reference(settings: ProcedureSettings, step: int, v_vc_v: float = 0.0) -> Routine[Point]:
    """Average one window at rest with the present V_Vc; return its mean, which is no point of the run."""
    verify = steps.VerifyZero(step, 0.0, v_vc_v, 0.0, **window_of(settings))
    return answer((yield verify), steps.Window).point


def require_alive(settings: ProcedureSettings, point: Point) -> None:
    """See that a record at rest is that of a gyroscope: its noise is more than a tenth of the meter's last digit.

    `expected.reading_noise_v` of the bench file takes the place of this. MeasurementError: its readings scatter by
    less.
    """
    # None at all, or what a lag leaves: nobody measured, or a bench without noise
    if _NONE < point.std_v / settings.meter_resolution_v < 0.1 and settings.expected.reading_noise_v is None:
        raise MeasurementError(
            f"the output does not respond: it is {point.output_v:+.6g} V and scatters by {point.std_v:.1g} V, "
            f"less than a tenth of the meter's last digit of {settings.meter_resolution_v:g} V",
            instrument="multimeter",
            step=str(point.step),
            hint=f"{LOOK_AT_SIGNALS}; for a gyroscope with so little noise set expected.reading_noise_v",
        )


OTHER_SCALE_FACTOR = "values in deg/s, which are not those of this gyroscope"
"""Of a run that was told no scale factor, and whose output answers otherwise than the usual one has it."""


def can_answer(settings: ProcedureSettings) -> bool:
    """Return True if the bench has a table or a generator, by which the output may show its scale factor."""
    return any(_on_bench(settings, role) for role in ("rate_table", "rate_source"))


def require_answer(settings: AtRestSettings, *, turns: bool = True) -> Routine[None]:
    """See that the output answers as told: to a slow rate, or to a small V_Vc where no table `turns` it.

    A record at rest has nothing else that tells a gyroscope from a lead that is off, or from a dead demodulator; and
    nothing else that tells its scale factor from another. MeasurementError: it stands where it stood at rest, or moves
    otherwise than its scale factor has it.
    """
    turns = turns and _on_bench(settings, "rate_table")
    if not (turns or _on_bench(settings, "rate_source")):
        yield steps.NotChecked(
            "whether the output responds, and as was told", "the bench has neither table nor generator"
        )
        return
    slope, within = yield from _moved(settings, by_table=turns)
    if tells_scale_factor(settings):
        require_as_used(settings, slope, within, by_v_vc=not turns)
    elif settings.looks_on_table and turns:
        return
    elif words := unlike_used(settings, slope, within, by_v_vc=not turns):  # nobody has said that it were so
        yield steps.NotChecked(OTHER_SCALE_FACTOR, words)


def scale_factor_seen(settings: AtRestSettings, measured: Measured) -> ScaleFactor:
    """Return the scale factor that turns volts into rates: where nobody gives it, that of the look on the table."""
    looks = measured.found(steps.OutputSeen)[-2:] if settings.looks_on_table else []
    if len(looks) < 2:
        return scale_factor_used(settings)
    (_, at_rest), (turning, moved) = looks
    rate_deg_s = turning.rate_deg_s if isinstance(turning, steps.LookAtOutput) else 0.0
    if not rate_deg_s:
        return scale_factor_used(settings)
    slope = (moved.mean_v - at_rest.mean_v) / rate_deg_s
    of_rate = (settings.station.sources.table_rate or 0.0) / math.sqrt(3.0)
    return ScaleFactor(slope, math.hypot(_u_of_looks(settings, at_rest, moved) / rate_deg_s, of_rate * slope), LOOKED)


def _u_of_looks(settings: ProcedureSettings, at_rest: steps.OutputSeen, moved: steps.OutputSeen) -> float:
    """Return the standard uncertainty of the difference of two looks, V."""
    return math.sqrt((at_rest.variance_v2 + moved.variance_v2 + settings.meter_resolution_v**2) / _LOOKS)


def _moved(settings: ProcedureSettings, *, by_table: bool) -> Routine[tuple[float, float]]:
    """Move the output by a slow rate, or by V_Vc of both signs, lest its square count; return its slope and its limits.

    The slope is in V/(deg/s), of V_Vc by the guess of K_Vc. MeasurementError: the output stands where it stood.
    """
    yield steps.Note("Does the output answer?")
    yield from meter_set(settings)
    if by_table:
        change_deg_s = settings.station.limits.slow_deg_s
        before = answer((yield steps.LookAtOutput(_LOOKS)), steps.OutputSeen)
        yield from go_to_rate(settings, change_deg_s, previous_deg_s=0.0)
        look = steps.LookAtOutput(_LOOKS, change_deg_s, settings.rate_tolerance_deg_s)
        what, aside = f"a rate of {change_deg_s:g} deg/s", ""
    else:
        v_vc_v, look = min(SMALL_V, settings.station.limits.max_v_vc_v or SMALL_V), steps.LookAtOutput(_LOOKS)
        change_deg_s = 2.0 * v_vc_v * settings.k_vc_guess_deg_s_per_v
        yield from v_vc_on()
        yield from set_v_vc(settings, -v_vc_v)
        before = answer((yield look), steps.OutputSeen)
        yield from set_v_vc(settings, v_vc_v)
        what, aside = f"V_Vc of {v_vc_v:g} V, either sign", "the generator's lead to V_Vc, the carrier, "
    after = answer((yield look), steps.OutputSeen)
    if not by_table:
        yield steps.DisableVvc()
    u_v = _u_of_looks(settings, before, after)
    if abs(after.mean_v - before.mean_v) < _ANSWERS * u_v:
        raise MeasurementError(
            f"the output does not respond to {what}: it stands at {after.mean_v:+.6g} V, before it was at "
            f"{before.mean_v:+.6g} V, and a mean is known to {u_v:.1g} V",
            instrument="multimeter",
            step="the look whether the output answers",
            hint=f"check the lead of the output, {aside}the PCB's supply, and the drive signal",
        )
    return (after.mean_v - before.mean_v) / change_deg_s, abs(_ANSWERS * u_v / change_deg_s)


def window_of(settings: ProcedureSettings) -> dict[str, Any]:
    """Return the common settings of all windows of a run."""
    return {
        "tolerance_deg_s": settings.rate_tolerance_deg_s,
        "rails": rails_of(settings),
        "rail_tolerance_v": settings.rail_tolerance_v,
        "samples": settings.samples,
        "interval_s": settings.sample_interval_s,
        "resolution_v": settings.meter_resolution_v,
        "noise_v": settings.expected.reading_noise_v,
    }


def powered(settings: ProcedureSettings, work: Routine[T]) -> Routine[T]:
    """Do `work` with the bench started up; whatever happens, table to rest, then outputs off, then supply off.

    >>> def plan(settings):
    ...     yield from vcfbench.powered(settings, vcfbench.go_to_rate(settings, 50.0, previous_deg_s=0.0))
    """
    return (yield from energised(settings, drive_seen(settings, under_servo(settings, work))))


def energised(settings: ProcedureSettings, work: Routine[T]) -> Routine[T]:
    """Do `work` with meter, generator and rails up, V_Vc off; whatever happens, outputs off, then supply off.

    It asks for no table and no oscilloscope. The bench's own safety stack does what switches off once more, and proves
    it, whatever becomes of these steps.

    >>> def plan(settings):
    ...     yield from vcfbench.energised(settings, vcfbench.take(settings, 1, rate_deg_s=0.0, v_vc_v=0.0))
    """
    try:
        yield steps.Note("Start-up")
        yield from power_up(settings)
        found = yield from work
        if settings.station.stream:
            yield steps.LookAtStream()
        return found
    finally:
        yield from power_down(settings)


def under_servo(settings: ProcedureSettings, work: Routine[T], afterwards: str = "Shut down") -> Routine[T]:
    """Do `work` with the table under servo; whatever happens, bring it to rest and open the servo."""
    yield steps.EnableTable()
    try:
        return (yield from work)
    finally:
        yield steps.Note(afterwards)
        yield steps.SetRate(0.0, settings.acceleration_deg_s2, 0.0)  # from whatever rate it has
        deadline_s = 2.0 * settings.fastest_deg_s / settings.acceleration_deg_s2 + settings.rate_deadline_s
        yield steps.AwaitRate(0.0, 0.0, settings.rate_tolerance_deg_s, deadline_s)
        yield steps.DisableTable()


def power_down(settings: ProcedureSettings) -> Routine[None]:
    """Switch V_Vc off, where the bench has a generator, then the power, where it has a supply."""
    try:
        if _on_bench(settings, "rate_source"):
            yield steps.DisableVvc()
    finally:
        if settings.rails:
            yield steps.DisableSupply()


def source_off(settings: ProcedureSettings) -> Routine[None]:
    """Switch V_Vc off and set it to 0 V, where the bench has a generator."""
    if _on_bench(settings, "rate_source"):
        yield steps.DisableVvc()
        yield steps.ConfigureGenerator(0.0)


def _on_bench(settings: ProcedureSettings, role: str) -> bool:
    if role == "rate_table":
        return settings.station.limits.max_rate_deg_s is not None
    return role in settings.station.instruments


def held_at_rest(settings: ProcedureSettings, work: steps.Plan) -> steps.Plan:
    """Do `work` with the table held at rest under servo, where the bench has one."""
    held = settings.station.limits.max_rate_deg_s is not None
    yield from under_servo(settings, work) if held else work


def drive_seen(settings: ProcedureSettings, work: Routine[T]) -> Routine[T]:
    """Look at the drive, do `work`, and measure the drive's frequency once more."""
    seen = yield from look_at_drive(settings)
    done = yield from work
    yield from look_again(settings, seen)
    return done


def off_afterwards(settings: ProcedureSettings, work: steps.Plan) -> steps.Plan:
    """Do `work`; whatever happens, generator (if there is one) and supply are off afterwards."""
    try:
        yield from work
    finally:
        yield from power_down(settings)
