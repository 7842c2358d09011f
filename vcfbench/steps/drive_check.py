"""The check of the drive signal: looks at it until the AGC has settled and everything lies in its window."""

import math
from itertools import cycle

from vcfbench.errors import MeasurementError
from vcfbench.station.parts import DriveWindow
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import ConfigureScope, DriveAmplitudes, DriveReading, FindDrive, MeasureDrive, ScopeReady, Settle
from vcfbench.steps.step import Routine, answer

_DRIVE_STEADY = 0.03
"""Largest relative difference of two looks at a steady drive amplitude: somewhat above the resolution of 8 bit."""
_LOOKS = 10.0
"""Looks in the time that the drive loop is given: every 0.5 s where that is 5 s, four time constants of such a loop."""
_FEWER_PERIODS = 4.0
"""Times by which the drive may be slower than a screen was meant for, and still show two periods."""


def check_drive(settings: ProcedureSettings) -> Routine[DriveReading]:
    """Wait for the AGC: look at the drive signal until it has settled and everything lies in its window.

    Settled: two looks in a row differ by less than 3 %. A wide window of frequencies is looked through from its fast
    end, so that no screen ever shows more periods than it has points for. The screen is left at some ten periods.

    Raises:
        MeasurementError: it does not come to that in time.
    """
    drive = settings.drive
    channels = settings.station.channel_of("drive"), settings.station.channel_of("carrier")
    screens = cycle(_screens(drive.frequency_hz))
    shown_s_per_div = next(screens)
    ready = answer((yield ConfigureScope(shown_s_per_div, channels[0])), ScopeReady)
    found = yield from _find_drive(drive, channels)
    while True:
        scales_v = (max(found.drive_v, drive.amplitude_v[0]), max(found.carrier_v, drive.amplitude_v[0]))
        reading = answer((yield MeasureDrive(*channels, *scales_v, drive.foreseen)), DriveReading)
        complaint = reading.trouble or _complaint(reading, drive, found.drive_v)
        wanted_s_per_div = next(screens) if reading.trouble else one_two_five(1.0 / reading.frequency_hz)
        if wanted_s_per_div != shown_s_per_div:
            shown_s_per_div = wanted_s_per_div
            yield ConfigureScope(shown_s_per_div, channels[0])
        if not complaint:
            return reading
        if reading.t_s - ready.t_s >= drive.start_up_s:
            raise MeasurementError(
                f"drive signal not as it should be after {drive.start_up_s:g} s: {complaint}; what is right for this "
                "gyroscope is set in [procedure.drive] of the bench file",
                instrument="oscilloscope",
                step="the check of the drive signal",
            )
        if reading.trouble:
            found = yield from _find_drive(drive, channels)
        else:
            found = DriveAmplitudes(reading.amplitude_v, found.carrier_v)
        yield Settle(drive.start_up_s / _LOOKS, "drive loop settles")


def _screens(frequency_hz: tuple[float, float]) -> list[float]:
    """Return time bases, s/div, that show two to ten periods and more of every frequency of a window; often one."""
    slowest_hz, fastest_hz = frequency_hz
    if fastest_hz <= _FEWER_PERIODS * slowest_hz:
        return [one_two_five(2.0 / (slowest_hz + fastest_hz))]
    steps = math.ceil(math.log(fastest_hz / slowest_hz, _FEWER_PERIODS))
    return [one_two_five(_FEWER_PERIODS**step / fastest_hz) for step in range(steps)]


def _find_drive(drive: DriveWindow, channels: tuple[int, int]) -> Routine[DriveAmplitudes]:
    step = FindDrive(*channels, drive.amplitude_v[1], drive.foreseen[1])
    return answer((yield step), DriveAmplitudes)


def _complaint(reading: DriveReading, drive: DriveWindow, previous_v: float) -> str:
    """Name the deviation of the drive signal from its window; empty when there is none."""
    middle_deg = sum(drive.phase_deg) / 2.0  # a window may hold 180 deg: a phase is told as the turn that is nearest
    for name, value, (low, high), unit in (
        ("frequency", reading.frequency_hz, drive.frequency_hz, "Hz"),
        ("amplitude", reading.amplitude_v, drive.amplitude_v, "V"),
        ("phase", middle_deg + math.remainder(reading.phase_deg - middle_deg, 360.0), drive.phase_deg, "deg"),
    ):
        if not low <= value <= high:
            return f"{name} {value:.6g} {unit}, expected {low:g}...{high:g} {unit}"
    if abs(reading.amplitude_v - previous_v) > _DRIVE_STEADY * reading.amplitude_v:
        return f"amplitude still moving, {previous_v:.4g} to {reading.amplitude_v:.4g} V"
    return ""


def one_two_five(least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is at least `least`."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= least * (1.0 - 1e-9))
