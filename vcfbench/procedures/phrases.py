"""Sentences that every work instruction uses: power up, check the drive, go to a rate, take a point, shut down."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any, TypeVar

from vcfbench.procedures.steps import (
    Acquire,
    AwaitDrive,
    AwaitRate,
    CheckRails,
    ConfigureGenerator,
    ConfigureMeter,
    ConfigureRail,
    DisableSupply,
    DisableTable,
    DisableVvc,
    EnableSupply,
    EnableTable,
    EnableVvc,
    Note,
    SetRate,
    Settle,
    SetVvc,
    Step,
    StepResult,
    VerifyZero,
    VvcSetting,
    Window,
)

if TYPE_CHECKING:
    from vcfbench.procedures.settings import CalibrationSettings
    from vcfbench.record.schema import Point

__all__ = [
    "Phrase",
    "go_to_rate",
    "powered",
    "ramp_to",
    "set_v_vc",
    "start_up",
    "take",
    "take_zero_again",
    "v_vc_on",
]

T = TypeVar("T")
Phrase = Generator[Step, StepResult, T]


def start_up(settings: CalibrationSettings) -> Phrase[None]:
    """Bring the gyro from cold to a settled drive loop, generator off."""
    yield Note("Start-up")
    yield from power_up(settings)
    yield from check_drive(settings)


def power_up(settings: CalibrationSettings) -> Phrase[None]:
    """Set levels and limits, then switch on, wait, and read the rails back; V_Vc is off before the PCB gets power."""
    yield ConfigureMeter(settings.meter_range_v, settings.nplc)
    yield DisableVvc()
    yield ConfigureGenerator(0.0)
    rails = rails_of(settings)
    for rail in rails:  # noqa: UP028  # a tuple cannot be sent results
        yield rail
    yield EnableSupply()
    yield Settle(settings.start_up_s, "rails up, drive loop starts")
    yield CheckRails(rails, settings.rail_tolerance_v)


def rails_of(settings: CalibrationSettings) -> tuple[ConfigureRail, ...]:
    """Return what each rail is set to."""
    return tuple(ConfigureRail(rail.rail, rail.output, rail.voltage_v, rail.current_limit_a) for rail in settings.rails)


def check_drive(settings: CalibrationSettings) -> Phrase[None]:
    """Wait for the AGC and check frequency, amplitude and phase of the drive signal on the oscilloscope."""
    drive = settings.drive
    yield AwaitDrive(
        drive.drive_channel,
        drive.carrier_channel,
        drive.frequency_hz,
        drive.amplitude_v,
        drive.phase_deg,
        drive.amplitude_tolerance,
        drive.interval_s,
        drive.deadline_s,
    )


def ramp_to(settings: CalibrationSettings, rate_deg_s: float, *, previous_deg_s: float) -> Phrase[None]:
    """Ramp the table and wait until it is at its rate."""
    ramp = SetRate(rate_deg_s, settings.acceleration_deg_s2, previous_deg_s)
    yield ramp
    deadline_s = 2.0 * ramp.ramp_s + settings.rate_deadline_s
    yield AwaitRate(rate_deg_s, ramp.ramp_s, settings.rate_tolerance_deg_s, deadline_s)


def go_to_rate(settings: CalibrationSettings, rate_deg_s: float, *, previous_deg_s: float) -> Phrase[None]:
    """Ramp the table, wait until it is at its rate, then let the gyro settle."""
    yield from ramp_to(settings, rate_deg_s, previous_deg_s=previous_deg_s)
    yield Settle(settings.settle_s, "gyro settles after the rate step")


def v_vc_on() -> Phrase[None]:
    """Set 0 V and only then close the generator's relay."""
    yield SetVvc(0.0)
    yield EnableVvc()


def set_v_vc(settings: CalibrationSettings, v_vc_v: float) -> Phrase[float]:
    """Set V_Vc and let the gyro settle; return the level read back, V."""
    setting = answer((yield SetVvc(v_vc_v)), VvcSetting)
    yield Settle(settings.settle_s, "gyro settles after the V_Vc step")
    return setting.v_vc_v


def take(
    settings: CalibrationSettings, step: int, *, rate_deg_s: float, v_vc_v: float, table_deg_s: float
) -> Phrase[Point]:
    """Average one window and return its point."""
    acquire = Acquire(step, rate_deg_s, v_vc_v, table_deg_s, **_window_of(settings))
    return acquire.point(answer((yield acquire), Window))


def take_zero_again(settings: CalibrationSettings, step: int) -> Phrase[Point]:
    """Average one window more at zero and return what it gives; it is for comparison and no point of the run."""
    verify = VerifyZero(step, 0.0, 0.0, 0.0, **_window_of(settings))
    return verify.point(answer((yield verify), Window))


def _window_of(settings: CalibrationSettings) -> dict[str, Any]:
    """Return what all windows of a run have in common."""
    return {
        "tolerance_deg_s": settings.rate_tolerance_deg_s,
        "rails": rails_of(settings),
        "rail_tolerance_v": settings.rail_tolerance_v,
        "samples": settings.samples,
        "interval_s": settings.sample_interval_s,
        "resolution_v": settings.meter_resolution_v,
        "noise_v": settings.expected.reading_noise_v,
    }


def powered(settings: CalibrationSettings, work: Phrase[T]) -> Phrase[T]:
    """Do `work` with the bench started up; whatever happens, table to rest, then outputs off, then supply off.

    The bench's own safety stack does all this once more, and proves it, whatever becomes of these steps.
    """
    try:
        yield from start_up(settings)
        return (yield from under_servo(settings, work))
    finally:
        yield from power_down()


def under_servo(settings: CalibrationSettings, work: Phrase[T]) -> Phrase[T]:
    """Do `work` with the table under servo; whatever happens, bring it to rest and open the servo."""
    yield EnableTable()
    try:
        return (yield from work)
    finally:
        yield Note("Shut down")
        yield from table_to_rest(settings)
        yield DisableTable()


def table_to_rest(settings: CalibrationSettings) -> Phrase[None]:
    """Demand zero from whatever rate the table has, and see it come to rest."""
    fastest_deg_s = max(abs(rate) for rate in (*settings.rates_deg_s, settings.match_rate_deg_s))
    yield SetRate(0.0, settings.acceleration_deg_s2, 0.0)
    deadline_s = 2.0 * fastest_deg_s / settings.acceleration_deg_s2 + settings.rate_deadline_s
    yield AwaitRate(0.0, 0.0, settings.rate_tolerance_deg_s, deadline_s)


def power_down() -> Phrase[None]:
    """Switch off the stimulus, then the power."""
    try:
        yield DisableVvc()
    finally:
        yield DisableSupply()


def answer(result: StepResult, kind: type[T]) -> T:
    """Return `result`, which the executor promises to be of `kind`."""
    if not isinstance(result, kind):
        raise TypeError(f"the step was answered with {type(result).__name__}, not {kind.__name__}")
    return result
