"""Common ways of looking at the gyroscope's signals by the oscilloscope: amplitudes, drive frequency, phasors."""

import cmath
import math
from collections.abc import Callable, Iterable, Sequence
from statistics import fmean, stdev
from typing import NamedTuple, Self

from vcfbench import steps
from vcfbench.errors import MeasurementError
from vcfbench.station.parts import Node
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.drive_check import one_two_five
from vcfbench.steps.scope import AIMED
from vcfbench.steps.step import Routine, answer
from vcfbench.uncertainty.measurand import mean_of_records
from vcfbench.values.value import Measurand, UncertaintyPart

TIME_BASE = 25e-6
"""DSO7104B: 15 ppm and 2 ppm a year, five years old (service guide p. 45), rectangular."""
_SKEW_S = 1e-10
"""DSO7104B: delay of a channel, either way (unverified), rectangular."""
_DRIVE_RECORDS = 8
_SCREEN_POINTS = 1000
"""Of the screen itself, which is read soonest."""
_LEAST_A_PERIOD, _MANY_POINTS = 2.5, 100_000
"""Points in a period at least, where more would be more than so many: they take their time to come."""
_ROUNDS = 8.0
"""Times that the phases which a slow screen shows must go round in a record, at least."""
_LEAST_EITHER_WAY = 2
"""Records that a line over differences of either sign needs."""


def points_over(span_s: float, highest_hz: float, a_period: float) -> int:
    """Return the number of points that show a sine with so many in a period: 1, 2 or 5 times 10^n of them."""
    periods = span_s * highest_hz
    return round(one_two_five(max(_LEAST_A_PERIOD * periods, min(a_period * periods, _MANY_POINTS))))


class CaptureSense(steps.CaptureSines, frozen=True):
    """Sines of drive, carrier and sense signal while the table has a rate (deg/s) and V_Vc a level (V)."""

    rate_deg_s: float = 0.0
    v_vc_v: float = 0.0


def channels_of(settings: ProcedureSettings, second: Node, third: Node) -> tuple[int, ...]:
    """Return the channels of the drive signal and two other nodes."""
    of = settings.station.channel_of
    return of("drive"), of(second), of(third)


def amplitudes(settings: ProcedureSettings, *channels: int, points: int = _SCREEN_POINTS) -> Routine[tuple[float, ...]]:
    """Look how large the signals on some channels are, V, at first on a screen for the rails, which no node exceeds."""
    largest_v = max(map(abs, settings.rails_v or (settings.positive_rail_v, settings.negative_rail_v)))
    return answer((yield steps.FindAmplitudes(channels, largest_v, 1.0, points)), steps.Amplitudes).amplitudes_v


def points_that_show(span_s: float, drive_hz: float) -> int:
    """Return the number of points that over a slow screen show how large a sine of the drive's frequency is.

    Those of the screen may be too few to show the sine itself. They do show its size, unless they meet the same few of
    its phases again and again: where four periods of the sine are close to a whole number of points.
    """
    points, quarters = _SCREEN_POINTS, 4.0 * drive_hz * span_s
    while points < 2.0 * quarters and abs(math.remainder(quarters / points, 1.0)) * points < _ROUNDS:
        points = round(one_two_five(1.1 * points))
    return points


def capture_drive(
    settings: ProcedureSettings, drive_v: float | None = None, records: int = _DRIVE_RECORDS
) -> Routine[steps.SineRecord]:
    """Measure frequency and amplitude of the drive, on a screen for `drive_v`: else for the largest that is expected.

    The time base is that of the drive's check.

    Raises:
        MeasurementError: the frequency is not the expected one.
    """
    drive, channel = settings.drive, settings.station.channel_of("drive")
    frequency_hz, amplitude_v, _ = drive.foreseen
    expected = steps.SineRecord(frequency_hz, (amplitude_v,), (0.0,))
    shown_v = drive.amplitude_v[1] if drive_v is None else drive_v
    found = answer((yield steps.CaptureSines((channel,), (shown_v,), records, expected)), steps.SineRecords)
    drive_hz = as_expected(settings, fmean(each.frequency_hz for each in found.records))
    return steps.SineRecord(drive_hz, (fmean(each.amplitudes_v[0] for each in found.records),), (0.0,))


def as_expected(settings: ProcedureSettings, drive_hz: float) -> float:
    """Return a drive frequency that was found, Hz; MeasurementError: the bench file expects another."""
    low_hz, high_hz = settings.drive.frequency_hz
    if not low_hz <= drive_hz <= high_hz:
        raise MeasurementError(
            f"the drive was found at {drive_hz:.6g} Hz, expected {low_hz:g} to {high_hz:g} Hz (drive.frequency_hz)",
            instrument="oscilloscope",
            hint="check whether this is another gyroscope, or its loop does not hold the drive at resonance",
        )
    return drive_hz


def frequency_of(values_hz: Sequence[float], owner: str = "oscilloscope") -> Measurand:
    """Return the mean frequency of records by the time base of `owner`."""
    u_hz = TIME_BASE / math.sqrt(3.0) * abs(fmean(values_hz))
    return mean_of_records(values_hz, "Hz", UncertaintyPart("time base", u_hz, of=owner))


class DriveRecords(NamedTuple):
    """The frequency of the drive by some records, Hz, without the error of the time base.

    Noise makes records differ, and their mean better: `u_noise_hz`. What each fit leaves beyond that, and what digits
    without noise add, is `u_digits_hz`: they err alike wherever the drive has that frequency.
    """

    frequency_hz: float
    u_noise_hz: float
    u_digits_hz: float

    @classmethod
    def of(cls, records: Sequence[steps.SineRecord]) -> Self:
        """Return it of records of the drive alone."""
        found_hz = [each.frequency_hz for each in records]
        scatter_hz = stdev(found_hz)
        digits = max(fmean(each.u_frequency_hz**2 for each in records) - 2.0 * scatter_hz**2, 0.0)
        return cls(fmean(found_hz), scatter_hz / math.sqrt(len(found_hz)), math.sqrt(digits))

    @property
    def u_hz(self) -> float:
        """Standard uncertainty, Hz."""
        return math.hypot(self.u_noise_hz, self.u_digits_hz)


def skew(drive_hz: float, owner: str | None = None) -> UncertaintyPart:
    """Return the uncertainty of a phase by different delays of two channels, deg."""
    return UncertaintyPart("skew of two channels", math.sqrt(2.0 / 3.0) * 360.0 * drive_hz * _SKEW_S, of=owner)


def aimed(records: Sequence[steps.RotationRecord], difference_hz: float) -> list[tuple[float, float]]:
    """Return difference (Hz) and reference (deg) of records that turned as they were to; of all, if too few did."""
    found = [(each.difference_hz, each.reference_deg) for each in records]
    close = [each for each in found if abs(abs(each[0]) - difference_hz) <= AIMED * difference_hz]
    above = sum(each_hz > 0.0 for each_hz, _ in close)
    return close if min(above, len(close) - above) >= _LEAST_EITHER_WAY else found


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
