"""The check of the drive signal: looks at it until the AGC has settled and everything lies in its window."""

import math

from vcfbench.errors import MeasurementError
from vcfbench.station.settings import DriveWindow, ProcedureSettings
from vcfbench.steps import ConfigureScope, DriveAmplitudes, DriveReading, FindDrive, MeasureDrive, ScopeReady, Settle
from vcfbench.steps.step import Routine, answer

_DRIVE_STEADY = 0.03
"""Largest relative difference of two looks at a steady drive amplitude: somewhat above the resolution of 8 bit."""
_DRIVE_INTERVAL_S = 0.5
"""Between two looks: four time constants of the drive loop (0.13 s, gyro-metrology 1.3)."""


def check_drive(settings: ProcedureSettings) -> Routine[DriveReading]:
    """Wait for the AGC: look at the drive signal until it has settled and everything lies in its window.

    Settled: two looks in a row differ by less than 3 %.

    Raises:
        MeasurementError: it does not come to that in time.
    """
    drive = settings.drive
    channels = settings.station.channel_of("drive"), settings.station.channel_of("carrier")
    ready = answer((yield ConfigureScope(one_two_five(2.0 / sum(drive.frequency_hz)), channels[0])), ScopeReady)
    expected = (_middle(drive.frequency_hz), _middle(drive.amplitude_v), _middle(drive.phase_deg))
    found = yield from _find_drive(drive, channels)
    while True:
        scales_v = (max(found.drive_v, drive.amplitude_v[0]), max(found.carrier_v, drive.amplitude_v[0]))
        reading = answer((yield MeasureDrive(*channels, *scales_v, expected)), DriveReading)
        complaint = reading.trouble or _complaint(reading, drive, found.drive_v)
        if not complaint:
            return reading
        if reading.t_s - ready.t_s >= drive.start_up_s:
            raise MeasurementError(
                f"drive signal not as it should be after {drive.start_up_s:g} s: {complaint}",
                instrument="oscilloscope",
                step="the check of the drive signal",
            )
        if reading.trouble:
            found = yield from _find_drive(drive, channels)
        else:
            found = DriveAmplitudes(reading.amplitude_v, found.carrier_v)
        yield Settle(_DRIVE_INTERVAL_S, "drive loop settles")


def _find_drive(drive: DriveWindow, channels: tuple[int, int]) -> Routine[DriveAmplitudes]:
    step = FindDrive(*channels, drive.amplitude_v[1], _middle(drive.amplitude_v))
    return answer((yield step), DriveAmplitudes)


def _complaint(reading: DriveReading, drive: DriveWindow, previous_v: float) -> str:
    """Name the deviation of the drive signal from its window; empty when there is none."""
    low_deg = drive.phase_deg[0]
    for name, value, (low, high), unit in (
        ("frequency", reading.frequency_hz, drive.frequency_hz, "Hz"),
        ("amplitude", reading.amplitude_v, drive.amplitude_v, "V"),
        ("phase", low_deg + (reading.phase_deg - low_deg) % 360.0, drive.phase_deg, "deg"),  # a window may hold 180
    ):
        if not low <= value <= high:
            return f"{name} {value:.6g} {unit}, expected {low:g}...{high:g} {unit}"
    if abs(reading.amplitude_v - previous_v) > _DRIVE_STEADY * reading.amplitude_v:
        return f"amplitude still moving, {previous_v:.4g} to {reading.amplitude_v:.4g} V"
    return ""


def _middle(window: tuple[float, float]) -> float:
    return 0.5 * (window[0] + window[1])


def one_two_five(least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is at least `least`."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= least * (1.0 - 1e-9))
