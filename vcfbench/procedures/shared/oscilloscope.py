"""Common ways of looking at the gyroscope's signals by the oscilloscope: amplitudes, drive frequency, phasors."""

import cmath
import math
from collections.abc import Callable, Iterable, Sequence
from statistics import fmean

from vcfbench import steps
from vcfbench.procedures.shared.measurand import Measurand, UncertaintyPart, mean_of_records
from vcfbench.station.parts import Node
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.step import Routine, answer

TIME_BASE = 25e-6
"""DSO7104B: 15 ppm and 2 ppm a year, five years old (service guide p. 45), rectangular."""
_SKEW_S = 1e-10
"""DSO7104B: delay of a channel, either way (unverified), rectangular."""
_LARGEST_V = 10.0
"""Voltage that no node of the PCB exceeds: its rails."""
_DRIVE_RECORDS = 8


class CaptureSense(steps.CaptureSines, frozen=True):
    """Sines of drive, carrier and sense signal while the table has a rate (deg/s) and V_Vc a level (V)."""

    rate_deg_s: float = 0.0
    v_vc_v: float = 0.0


def channels_of(settings: ProcedureSettings, second: Node, third: Node) -> tuple[int, ...]:
    """Return the channels of the drive signal and two other nodes."""
    of = settings.station.channel_of
    return of("drive"), of(second), of(third)


def amplitudes(*channels: int) -> Routine[tuple[float, ...]]:
    """Look how large the signals on some channels are, V."""
    return answer((yield steps.FindAmplitudes(channels, _LARGEST_V, 1.0)), steps.Amplitudes).amplitudes_v


def capture_drive(
    settings: ProcedureSettings, drive_v: float | None = None, records: int = _DRIVE_RECORDS
) -> Routine[float]:
    """Measure the drive frequency, Hz, on a screen for `drive_v`: else for the largest amplitude that is expected."""
    drive, channel = settings.drive, settings.station.channel_of("drive")
    expected = steps.SineRecord(fmean(drive.frequency_hz), (fmean(drive.amplitude_v),), (0.0,))
    shown_v = drive.amplitude_v[1] if drive_v is None else drive_v
    found = answer((yield steps.CaptureSines((channel,), (shown_v,), records, expected)), steps.SineRecords)
    return fmean(each.frequency_hz for each in found.records)


def frequency_of(values_hz: Sequence[float], owner: str = "oscilloscope") -> Measurand:
    """Return the mean frequency of records by the time base of `owner`."""
    u_hz = TIME_BASE / math.sqrt(3.0) * abs(fmean(values_hz))
    return mean_of_records(values_hz, "Hz", UncertaintyPart("time base", u_hz, of=owner))


def skew(drive_hz: float, owner: str | None = None) -> UncertaintyPart:
    """Return the uncertainty of a phase by different delays of two channels, deg."""
    return UncertaintyPart("skew of two channels", math.sqrt(2.0 / 3.0) * 360.0 * drive_hz * _SKEW_S, of=owner)


def sense_phasor(record: steps.SineRecord) -> complex:
    """Return the sense signal against the drive signal, V."""
    return cmath.rect(record.amplitudes_v[2], math.radians(record.phases_deg[2]))


def at_both_signs(
    states: Iterable[tuple[CaptureSense, steps.SineRecords]], level: Callable[[CaptureSense], float]
) -> tuple[list[complex], list[complex]]:
    """Return the sense signal's phasors where a level is positive, and where it is negative."""
    seen: tuple[list[complex], list[complex]] = [], []
    for step, found in states:
        if level(step):
            seen[level(step) < 0.0].extend(map(sense_phasor, found.records))
    return seen
