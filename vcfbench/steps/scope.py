"""Everything about the oscilloscope: it looks at the drive signal before anything is measured."""

import math
from collections.abc import Callable, Sequence
from statistics import fmean
from typing import TYPE_CHECKING

from msgspec import Struct

from vcfbench.errors import ClippedRecord, ConfigError, MeasurementError
from vcfbench.interfaces import AveragesWaveforms, Oscilloscope, Waveform
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Step, StepResult, does

if TYPE_CHECKING:
    from vcfbench.analysis.sine_fit import Sine

_DIVISIONS = 3.0
"""Divisions of the oscilloscope's screen (eight high) that an amplitude shall fill."""
_LEAST_V = 0.01
"""A smaller amplitude is shown at this scale: no oscilloscope has much less than 2 mV a division."""


def scale_v_per_div(amplitude_v: float) -> float:
    """Return the vertical scale, V/div, that shows an amplitude with a third to spare."""
    return max(amplitude_v, _LEAST_V) / _DIVISIONS


def downloaded(context: Context, channel: int, points: int = 1000) -> Waveform:
    """Download the stopped record of `channel`, which can be read twice."""
    return context.believable(lambda: context.bench.oscilloscope.waveform(channel, points))


_DIGIT = 8.0 / 256.0
"""Last bit of a screen of eight divisions, in divisions. A smaller amplitude may show as nothing, and is not."""
_FREQUENCY_POINTS = 10_000
"""Of a record that tells the drive's frequency to some ppm, a tenth of a kelvin; 1000 tell it to 10 ppm."""
_NEAR, _LEAST_OF_DRIVE = 0.01, 0.3
"""Share by which the fitted frequency may be off the oscilloscope's own, and of the amplitude that there must be."""
_MOST_V = 15.0
"""No node exceeds the rails, which are 15 V at most: a third more, and every probe shows it."""
_A_PERIOD = 2.1
"""Points in a period of the fastest sine, at least: with two it may be any other."""


class Screen:
    """Channels of an oscilloscope, each at a scale that shows its amplitude."""

    def __init__(self, context: Context, channels: Sequence[int], amplitudes_v: Sequence[float]) -> None:
        self._context = context
        self._shown_v = dict(zip(channels, amplitudes_v, strict=True))
        for channel in channels:
            self._show(channel)

    def _show(self, channel: int) -> None:
        self._context.bench.oscilloscope.configure_channel(channel, scale_v_per_div(self._shown_v[channel]))

    def record(self, acquire: Callable[[], None], points: int = 1000) -> list[Waveform]:
        """Acquire and download all channels; a channel that comes clipped is shown at twice the scale, and all again.

        Raises:
            ClippedRecord: at the scale of the largest voltage that there is.
        """
        while True:
            acquire()
            found: list[Waveform] = []
            for channel, shown_v in self._shown_v.items():
                try:
                    found.append(downloaded(self._context, channel, points))
                except ClippedRecord:
                    if shown_v >= _MOST_V:
                        raise
                    self._shown_v[channel] = min(2.0 * max(shown_v, _LEAST_V), _MOST_V)
                    self._show(channel)
                    break
            else:
                return found


def interval_of(record: Waveform, highest_hz: float) -> float:
    """Return the spacing of a record's points, s.

    Raises:
        MeasurementError: they are too far apart for a sine of `highest_hz`, and would show another one.
    """
    interval_s = float(record.time_s[1] - record.time_s[0])
    if _A_PERIOD * highest_hz * interval_s > 1.0:
        raise MeasurementError(
            f"points every {interval_s:.3g} s are too few for a sine of {highest_hz:.6g} Hz",
            instrument="oscilloscope",
            hint="check the memory of the oscilloscope: its depth, segments, other channels",
        )
    return interval_s


class ScopeReady(StepResult, Struct, frozen=True):
    """Time base and trigger are set; bench time, s."""

    t_s: float


class DriveAmplitudes(StepResult, Struct, frozen=True):
    """Amplitudes of drive and carrier at a coarse scale, V; 0 where there is no signal yet."""

    drive_v: float
    carrier_v: float

    def describe(self) -> str:
        return f"drive {self.drive_v:.3g} V, carrier {self.carrier_v:.3g} V"


class DriveFrequency(StepResult, Struct, frozen=True):
    """Frequency of the drive by a sine through one record, Hz.

    Its u is by the residuals and the last digit. That of the time base is not in it. `trouble` says why there is none,
    which ends no run.
    """

    frequency_hz: float
    u_hz: float
    trouble: str = ""

    def describe(self) -> str:
        return self.trouble or f"{self.frequency_hz:.3f} Hz"


class DriveReading(StepResult, Struct, frozen=True):
    """The drive signal on the oscilloscope: frequency (Hz), amplitude (V), phase of the drive to the carrier (deg).

    `t_s` is the bench time, s. `trouble` says why the record could not be measured; empty when it could. `fitted` is
    the frequency of a sine through the record, which resolves what the oscilloscope's own does not; None: of none.
    """

    frequency_hz: float
    amplitude_v: float
    phase_deg: float
    t_s: float
    trouble: str = ""
    fitted: DriveFrequency | None = None

    def describe(self) -> str:
        if self.trouble:
            return self.trouble
        frequency = f"{self.frequency_hz:.2f} Hz" if self.fitted is None else self.fitted.describe()
        return f"{frequency}, {self.amplitude_v:.4g} V, {self.phase_deg:+.2f} deg"


@does(Effect.SETS, "oscilloscope", overhead_s=0.1)
class ConfigureScope(Step, Struct, frozen=True):
    """Set time base and trigger for the drive signal; beyond its amplitude records begin anywhere in its period."""

    timebase_s_per_div: float
    trigger_channel: int
    level_v: float = 0.0

    def describe(self) -> str:
        level = f" at {self.level_v:.3g} V" if self.level_v else ""
        return f"oscilloscope: {self.timebase_s_per_div:g} s/div, trigger on channel {self.trigger_channel}{level}"

    def perform(self, context: Context) -> ScopeReady:
        ready = ScopeReady(context.bench.clock.now())
        scope = context.bench.oscilloscope
        scope.configure_timebase(self.timebase_s_per_div)
        scope.configure_trigger(self.trigger_channel, self.level_v)
        return ready

    def predict(self, gyro: LinearGyro) -> ScopeReady:
        return ScopeReady(0.0)


@does(Effect.CHECKS, "drive signal", overhead_s=0.4)
class FindDrive(Step, Struct, frozen=True):
    """Show drive and carrier at the scale of the largest amplitude allowed, V, and measure their rough sizes.

    `expected_v` is what a dry run answers.
    """

    drive_channel: int
    carrier_channel: int
    largest_v: float
    expected_v: float

    def describe(self) -> str:
        return f"oscilloscope: find drive and carrier, up to {self.largest_v:g} V"

    def perform(self, context: Context) -> DriveAmplitudes:
        scope = context.bench.oscilloscope
        channels = (self.drive_channel, self.carrier_channel)
        for channel in channels:
            scope.configure_channel(channel, self.largest_v / _DIVISIONS)
        scope.acquire(*channels)
        return DriveAmplitudes(*(_amplitude_or_none(context, channel) for channel in channels))

    def predict(self, gyro: LinearGyro) -> DriveAmplitudes:
        return DriveAmplitudes(self.expected_v, self.expected_v)


def _amplitude_or_none(context: Context, channel: int) -> float:
    """Measure an amplitude where there may be no signal yet, V; 0 when there is none."""
    try:
        return context.believable(lambda: context.bench.oscilloscope.measure_amplitude_v(channel))
    except MeasurementError:
        return 0.0


@does(Effect.CHECKS, "drive signal", overhead_s=0.5)
class MeasureDrive(Step, Struct, frozen=True):
    """Take one record of drive and carrier at fitting scales and measure frequency, amplitude and phase.

    `drive_v` and `carrier_v` are the amplitudes that fill the screen. `expected` is what a dry run answers: Hz, V, deg.
    """

    drive_channel: int
    carrier_channel: int
    drive_v: float
    carrier_v: float
    expected: tuple[float, float, float]

    def describe(self) -> str:
        return "oscilloscope: frequency, amplitude and phase of the drive signal"

    def perform(self, context: Context) -> DriveReading:
        """Measure; a record that cannot be measured is an answer too, since the drive may still be starting."""
        scope, clock = context.bench.oscilloscope, context.bench.clock
        scope.configure_channel(self.drive_channel, self.drive_v / _DIVISIONS)
        scope.configure_channel(self.carrier_channel, self.carrier_v / _DIVISIONS)
        scope.acquire(self.drive_channel, self.carrier_channel)
        try:
            measured = (
                context.believable(lambda: scope.measure_frequency_hz(self.drive_channel)),
                context.believable(lambda: scope.measure_amplitude_v(self.drive_channel)),
                context.believable(lambda: scope.measure_phase_deg(self.drive_channel, self.carrier_channel)),
            )
        except MeasurementError as error:
            return DriveReading(0.0, 0.0, 0.0, clock.now(), error.what)
        fitted = drive_frequency(context, self.drive_channel, self.drive_v, measured[0])
        return DriveReading(*measured, clock.now(), fitted=None if fitted.trouble else fitted)

    def predict(self, gyro: LinearGyro) -> DriveReading:
        """Predict that the drive is as expected."""
        return DriveReading(*self.expected, 0.0)


def drive_frequency(context: Context, channel: int, amplitude_v: float, near_hz: float) -> DriveFrequency:
    """Return the frequency of a drive at about `near_hz` in the present record, on a screen for `amplitude_v`."""
    from vcfbench.analysis.sine_fit import fit_sine  # noqa: PLC0415  # NumPy, needed here alone

    try:
        taken = downloaded(context, channel, _FREQUENCY_POINTS)
        interval_s = interval_of(taken, near_hz)
        found = fit_sine(taken.voltage_v, interval_s)
        if abs(found.frequency_hz - near_hz) > _NEAR * near_hz or found.amplitude < _LEAST_OF_DRIVE * amplitude_v:
            seen = f"a sine of {found.frequency_hz:.6g} Hz and {found.amplitude:.3g} V is not the drive's"
            return DriveFrequency(0.0, 0.0, seen)
        return DriveFrequency(found.frequency_hz, _u_of_frequency(taken, interval_s, found, amplitude_v))
    except (ConfigError, MeasurementError) as error:
        return DriveFrequency(0.0, 0.0, error.what)


def _u_of_frequency(taken: Waveform, interval_s: float, found: "Sine", amplitude_v: float) -> float:
    """Return the standard uncertainty of the frequency of a record on a screen for `amplitude_v`, Hz.

    Of a sine that fills the digits without noise their errors go with it: a thousand of them count at most.
    """
    from vcfbench.analysis.sine_fit import u_of_frequency  # noqa: PLC0415  # NumPy, needed here alone

    by_digit = math.sqrt(6.0 / 1000.0 / 12.0) * _DIGIT * scale_v_per_div(amplitude_v)
    by_digit /= math.pi * len(taken.voltage_v) * interval_s * found.amplitude
    return math.hypot(u_of_frequency(taken.voltage_v, interval_s, found), by_digit)


class SineRecord(Struct, frozen=True):
    """A sine fitted to one record of some channels, one frequency for all.

    Amplitudes are in V, phases in deg against the first channel, whose own is 0. `u_frequency_hz` is by what the fit
    leaves of the first, its digits among it.
    """

    frequency_hz: float
    amplitudes_v: tuple[float, ...]
    phases_deg: tuple[float, ...]
    u_frequency_hz: float = 0.0


class SineRecords(StepResult, Struct, frozen=True):
    """Sines fitted to records of the same channels, taken one after the other."""

    channels: tuple[int, ...]
    records: tuple[SineRecord, ...]

    def describe(self) -> str:
        first = self.records[0]
        seen = zip(self.channels, first.amplitudes_v, first.phases_deg, strict=True)
        parts = [f"{channel}: {level:.4g} V {phase:+.2f} deg" for channel, level, phase in seen]
        return f"{fmean(each.frequency_hz for each in self.records):.3f} Hz; {', '.join(parts)}"


@does(Effect.MEASURES, "waveforms")
class CaptureSines(Step, Struct, frozen=True):
    """Download `count` records of some channels and fit a sine of one frequency to each (IEEE 1057, four parameters).

    `amplitudes_v` are what fills the screen; `expected` is what a dry run answers. Records begin `spacing_s` apart at
    least: of noise that is slower than a record, those close together have the same.
    """

    channels: tuple[int, ...]
    amplitudes_v: tuple[float, ...]
    count: int
    expected: SineRecord
    spacing_s: float = 0.0

    def describe(self) -> str:
        return f"oscilloscope: {self.count} records of channels {', '.join(map(str, self.channels))}, sines fitted"

    @property
    def duration_s(self) -> float:
        return max(0.2 * len(self.channels), self.spacing_s) * self.count

    def perform(self, context: Context) -> SineRecords:
        """Take, download and fit them.

        Raises:
            MeasurementError: a record is clipped at the largest scale.
            ConfigError: there is no sine in one.
        """
        screen = Screen(context, self.channels, self.amplitudes_v)
        return SineRecords(self.channels, tuple(self._record(context, screen) for _ in range(self.count)))

    def _record(self, context: Context, screen: Screen) -> SineRecord:
        from vcfbench.analysis.sine_fit import fit_sine, phase_difference  # noqa: PLC0415  # NumPy, needed here alone

        clock = context.bench.clock
        next_s = clock.now() + self.spacing_s
        taken = screen.record(lambda: self.acquire(context.bench.oscilloscope))
        interval_s = float(taken[0].time_s[1] - taken[0].time_s[0])
        first = fit_sine(taken[0].voltage_v, interval_s)
        others = [
            phase_difference(taken[0].voltage_v, each.voltage_v, interval_s, first.frequency_hz) for each in taken[1:]
        ]
        clock.sleep_until(next_s)
        return SineRecord(
            first.frequency_hz,
            (first.amplitude, *(each.gain * first.amplitude for each in others)),
            (0.0, *(each.phase_deg for each in others)),
            _u_of_frequency(taken[0], interval_s, first, self.amplitudes_v[0]),
        )

    def acquire(self, scope: Oscilloscope) -> None:
        """Take one record."""
        scope.acquire(*self.channels)

    def predict(self, gyro: LinearGyro) -> SineRecords:
        return SineRecords(self.channels, (self.expected,) * self.count)


class CaptureMeanSines(CaptureSines, frozen=True):
    """The same of means of `averages` records, which the oscilloscope takes by itself where it can."""

    averages: int = 4096

    def acquire(self, scope: Oscilloscope) -> None:
        """Take one mean."""
        if isinstance(scope, AveragesWaveforms):
            scope.acquire_mean(self.averages, *self.channels)
        else:
            CaptureSines.acquire(self, scope)


class Amplitudes(StepResult, Struct, frozen=True):
    """The largest voltages that channels showed, of either sign, V."""

    channels: tuple[int, ...]
    amplitudes_v: tuple[float, ...]

    def describe(self) -> str:
        seen = zip(self.channels, self.amplitudes_v, strict=True)
        return ", ".join(f"{channel}: {level:.4g} V" for channel, level in seen)


@does(Effect.MEASURES, "waveforms", overhead_s=1.0)
class FindAmplitudes(Step, Struct, frozen=True, omit_defaults=True):
    """Find the sizes of channels: at the scale of `largest_v`, then at one that fits. `expected_v`: of a dry run."""

    channels: tuple[int, ...]
    largest_v: float
    expected_v: float
    points: int = 1000

    def describe(self) -> str:
        return f"oscilloscope: find channels {', '.join(map(str, self.channels))}, up to {self.largest_v:g} V"

    def perform(self, context: Context) -> Amplitudes:
        """Look twice, so that an offset error of the first scale does not count.

        Raises:
            MeasurementError: a channel is clipped at the largest scale.
        """
        scope = context.bench.oscilloscope
        levels_v = [self.largest_v] * len(self.channels)
        for _ in range(2):
            scales = [scale_v_per_div(level_v) for level_v in levels_v]
            taken = Screen(context, self.channels, levels_v).record(lambda: scope.acquire(*self.channels), self.points)
            seen_v = [float(abs(each.voltage_v).max()) for each in taken]
            levels_v = [max(level_v, _DIGIT * scale) for level_v, scale in zip(seen_v, scales, strict=True)]
        return Amplitudes(self.channels, tuple(levels_v))

    def predict(self, gyro: LinearGyro) -> Amplitudes:
        return Amplitudes(self.channels, (self.expected_v,) * len(self.channels))


AIMED = 1e-3
"""Of a difference to the drive: sines so close to it both ways lose what the lag of a narrow filter is curved by."""


class RotationRecord(Struct, frozen=True):
    """One record of a sense signal that turns against the drive: see :class:`vcfbench.analysis.rotating.Rotation`."""

    drive_hz: float
    difference_hz: float
    reference_deg: float
    turning_v: float
    output_v: float


class Rotations(StepResult, Struct, frozen=True):
    """Rotations in records taken one after the other."""

    records: tuple[RotationRecord, ...]

    def describe(self) -> str:
        first = self.records[0]
        return f"{first.difference_hz:+.3f} Hz to the drive, output at {first.reference_deg:+.2f} deg"


@does(Effect.MEASURES, "waveforms")
class CaptureRotations(Step, Struct, frozen=True):
    """Download `count` records of drive, sense and output while V_Vc moves the sense signal off the drive's frequency.

    `difference_hz` is by how much, roughly. `amplitudes_v` are what fills the screen, in the order of `channels`.
    `drive_hz` is what a dry run answers with.
    """

    channels: tuple[int, ...]
    amplitudes_v: tuple[float, ...]
    count: int
    points: int
    difference_hz: float
    drive_hz: float

    def describe(self) -> str:
        return f"oscilloscope: {self.count} records of drive, sense, output, {self.difference_hz:+g} Hz to the drive"

    @property
    def duration_s(self) -> float:
        """Estimate of the time the step takes, s: four turns a record, and its download."""
        return self.count * (4.0 / abs(self.difference_hz) + 1.0)

    def perform(self, context: Context) -> Rotations:
        """Take, download and fit them.

        Raises:
            MeasurementError: a record is clipped at the largest scale, or its points are too far apart.
            ConfigError: nothing in it turns.
        """
        screen = Screen(context, self.seen, self.amplitudes_v[: len(self.seen)])
        return Rotations(tuple(self._record(context.bench.oscilloscope, screen) for _ in range(self.count)))

    @property
    def seen(self) -> tuple[int, ...]:
        """The channels that are looked at."""
        return self.channels

    def taken(self, scope: Oscilloscope, screen: Screen) -> tuple[list[Waveform], float]:
        """Take one record; return the samples of each channel, and the spacing of the points, s."""
        taken = screen.record(lambda: self.acquire(scope), self.points)
        return taken, interval_of(taken[0], self.drive_hz + max(0.0, self.difference_hz))

    def acquire(self, scope: Oscilloscope) -> None:
        """Take one record."""
        scope.acquire(*self.seen)

    def _record(self, scope: Oscilloscope, screen: Screen) -> RotationRecord:
        from vcfbench.analysis.rotating import fit_rotation  # noqa: PLC0415  # NumPy, needed here alone

        (drive, sense, output), interval_s = self.taken(scope, screen)
        found = fit_rotation(drive.voltage_v, sense.voltage_v, output.voltage_v, interval_s, self.difference_hz)
        return RotationRecord(found.drive_hz, found.difference_hz, found.reference_deg, found.turning, found.output)

    def predict(self, gyro: LinearGyro) -> Rotations:
        """Predict a reference a quarter turn from the drive, and no delay."""
        return Rotations((RotationRecord(self.drive_hz, self.difference_hz, 90.0, 1.0, 1.0),) * self.count)
