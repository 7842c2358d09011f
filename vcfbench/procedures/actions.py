"""How each step is done with the instruments of an open bench."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeVar

from vcfbench.clock import Deadline, sleep
from vcfbench.errors import FramingError, InterlockError, MeasurementError
from vcfbench.interfaces import Regulation
from vcfbench.procedures import steps
from vcfbench.procedures.scatter import NoiseSeen
from vcfbench.procedures.steps import (
    Acquire,
    AwaitDrive,
    AwaitRate,
    CheckRails,
    ConfigureGenerator,
    ConfigureMeter,
    ConfigureRail,
    Done,
    DriveReading,
    RailReading,
    RailsReading,
    RateReading,
    Reading,
    SetRate,
    Settle,
    SetVvc,
    Step,
    StepResult,
    VvcSetting,
    Window,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import Clock
    from vcfbench.interfaces import FunctionGenerator, Instrument, Multimeter, Oscilloscope, PowerSupply, RateTable

__all__ = ["BenchActor", "OpenBench"]

_T = TypeVar("_T")

_POLL_S = 0.05
"""How often the table is asked whether it is at its rate, s."""

_DIVISIONS = 3.0
"""Divisions of the oscilloscope's screen (eight high) that an amplitude shall fill."""


class OpenBench(Protocol):
    """What a procedure needs of a bench: five instruments and its clock."""

    @property
    def clock(self) -> Clock:
        """Bench time."""
        ...

    @property
    def power(self) -> PowerSupply:
        """The supply of the PCB's rails."""
        ...

    @property
    def rate_source(self) -> FunctionGenerator:
        """The generator of V_Vc."""
        ...

    @property
    def multimeter(self) -> Multimeter:
        """The voltmeter of the output."""
        ...

    @property
    def oscilloscope(self) -> Oscilloscope:
        """The oscilloscope on drive and carrier."""
        ...

    @property
    def rate_table(self) -> RateTable:
        """The table."""
        ...


@dataclass(slots=True)
class BenchActor:
    """Performs steps on `bench`; `hear` is called with every reading as it comes.

    `readings` holds those of the window under way, so that a window that fails leaves them behind. `asked_again` says
    what was answered, in the step under way, that could not be believed, so that it was asked once more.
    """

    bench: OpenBench
    hear: Callable[[Reading], None]
    readings: list[Reading] = field(default_factory=list)
    asked_again: list[str] = field(default_factory=list)
    _noise: NoiseSeen | None = None

    def perform(self, step: Step) -> StepResult:  # noqa: C901, PLR0911, PLR0912  # one case a kind of step: this *is* the table
        """Do one step and return what came of it.

        Raises:
            BenchError: the instrument, the wire or the bench did not let it be done.
        """
        self.readings.clear()
        self.asked_again.clear()
        match step:
            case steps.Note():
                return Done()
            case Settle():
                return self._settle(step)
            case Acquire():
                return self._acquire(step)
            case SetRate():
                return self._set_rate(step)
            case AwaitRate():
                return self._await_rate(step)
            case SetVvc():
                return VvcSetting(self._believable(lambda: self.bench.rate_source.set_dc(step.v_vc_v)))
            case steps.EnableVvc():
                return self._enable_v_vc()
            case steps.DisableVvc():
                return self._disable_v_vc()
            case ConfigureGenerator():
                return VvcSetting(self._believable(lambda: self.bench.rate_source.configure_dc(step.v_vc_v)))
            case ConfigureMeter():
                self.bench.multimeter.configure_dc_voltage(step.range_v, step.nplc)
            case ConfigureRail():
                self.bench.power.configure_output(step.output, step.voltage_v, step.current_limit_a)
            case steps.EnableSupply():
                self.bench.power.enable_outputs()
            case steps.DisableSupply():
                self.bench.power.disable_outputs()
            case CheckRails():
                return self._check_rails(step)
            case AwaitDrive():
                return _DriveCheck(self.bench, step).settled()
            case steps.EnableTable():
                self.bench.rate_table.enable()
            case steps.DisableTable():
                self.bench.rate_table.disable()
            case _:
                raise TypeError(f"{type(step).__name__} is no step that a bench can perform")
        return Done()

    def _believable(self, ask: Callable[[], _T], doubt: Callable[[_T], str] = lambda _: "") -> _T:
        """Ask, and once more where the answer is none or `doubt` says something against it; that is written down.

        Asking again moves nothing: `ask` reads, or sets what is set already. The second answer is as it is: whoever
        asked says what is wrong with it.
        """
        try:
            answer = ask()
        except FramingError as error:
            self.asked_again.append(str(error))
            return ask()
        if said := doubt(answer):
            self.asked_again.append(said)
            return ask()
        return answer

    def _settle(self, step: Settle) -> Done:
        sleep(self.bench.clock, step.seconds)
        return Done()

    def _enable_v_vc(self) -> Done:
        source = self.bench.rate_source
        source.enable_output()
        if not source.output_enabled():
            raise _problem(source, "the output was switched on but reads back off")
        return Done()

    def _disable_v_vc(self) -> Done:
        source = self.bench.rate_source
        source.disable_output()
        if source.output_enabled():
            raise _problem(source, "the output was switched off but reads back on")
        return Done()

    def _check_rails(self, step: CheckRails) -> RailsReading:
        return RailsReading(tuple(self._rail_within(rail, step.tolerance_v) for rail in step.rails))

    def _rail_within(self, rail: ConfigureRail, tolerance_v: float) -> RailReading:
        """Read one rail back; it must be regulated and within `tolerance_v` of its level."""

        def off(reading: RailReading) -> str:
            if abs(reading.voltage_v - rail.voltage_v) <= tolerance_v:
                return ""
            return (
                f"{rail.output} reads {reading.voltage_v:+.4g} V, "
                f"expected {rail.voltage_v:+g} V within {tolerance_v:g} V"
            )

        reading = self._believable(lambda: self._read_rail(rail.output), off)
        self._demand_regulated(reading)
        if said := off(reading):
            raise _problem(self.bench.power, said)
        return reading

    def _read_rail(self, output: str) -> RailReading:
        power = self.bench.power
        return RailReading(
            output, power.measure_voltage_v(output), power.measure_current_a(output), power.regulation(output)
        )

    def _demand_regulated(self, reading: RailReading) -> None:
        if reading.regulation is Regulation.CONSTANT_VOLTAGE:
            return
        if reading.regulation is Regulation.CONSTANT_CURRENT:
            what = f"{reading.rail} is in current limit: {reading.current_a:.3g} A at {reading.voltage_v:+.4g} V"
        else:
            what = f"{reading.rail} is not regulated: {reading.regulation.value}, {reading.voltage_v:+.4g} V"
        raise _problem(self.bench.power, what)

    def _set_rate(self, step: SetRate) -> Done:
        self.bench.rate_table.set_rate(step.rate_deg_s, step.acceleration_deg_s2)
        return Done()

    def _await_rate(self, step: AwaitRate) -> RateReading:
        clock, table = self.bench.clock, self.bench.rate_table
        deadline = Deadline.after(clock, step.deadline_s)
        sleep(clock, step.ramp_s)
        while True:
            self._demand_no_fault()
            at_rate, reading = table.at_rate(), table.rate_deg_s()
            if at_rate and abs(reading - step.rate_deg_s) <= step.tolerance_deg_s:
                return RateReading(reading, clock.now())
            if deadline.expired():
                raise _problem(
                    table,
                    f"not at {step.rate_deg_s:+g} deg/s within {step.deadline_s:.3g} s: reads {reading:+.5g} deg/s, "
                    f"at-rate flag {'set' if at_rate else 'not set'}",
                )
            sleep(clock, _POLL_S)

    def _demand_no_fault(self) -> None:
        fault = self.bench.rate_table.fault()
        if fault is not None:
            table = self.bench.rate_table
            raise InterlockError(f"fault: {fault}", instrument=table.name, resource=table.resource)

    def _acquire(self, step: Acquire) -> Window:
        """Read on the grid, hold the window to its full length, and read back table and rails before it ends."""
        clock = self.bench.clock
        start_s = clock.now()
        for number in range(step.samples):
            self._read_at(start_s + number * step.interval_s, number, step)
        window = self._window(step)
        clock.sleep_until(start_s + step.samples * step.interval_s)
        return window

    def _read_at(self, instant_s: float, number: int, step: Acquire) -> None:
        clock, meter = self.bench.clock, self.bench.multimeter
        clock.sleep_until(instant_s)
        t_s = clock.now()
        if t_s - instant_s > 0.5 * step.interval_s:
            raise _problem(
                meter,
                f"reading {number + 1} of {step.samples} began {t_s - instant_s:.2g} s late: "
                f"the meter cannot follow one reading every {step.interval_s:g} s",
            )
        reading = Reading(t_s, self._believable(meter.read_voltage_v))
        self.readings.append(reading)
        self.hear(reading)

    def _window(self, step: Acquire) -> Window:
        table = self.bench.rate_table
        rails = tuple(self._rail_within(rail, step.rail_tolerance_v) for rail in step.rails)
        self._demand_no_fault()

        def left(reading: float) -> str:
            if abs(reading - step.table_deg_s) <= step.tolerance_deg_s:
                return ""
            return f"left {step.table_deg_s:+g} deg/s during the window: reads {reading:+.5g} deg/s"

        reading = self._believable(table.rate_deg_s, left)
        if said := left(reading):
            raise _problem(table, said)
        window = Window(tuple(self.readings), reading, rails)
        self._demand_plausible(window, step)
        return window

    def _demand_plausible(self, window: Window, step: Acquire) -> None:
        """See that the readings scatter as expected, and as those of the run do."""
        if step.noise_v is not None and not step.noise_v[0] <= window.std_v <= step.noise_v[1]:
            low_v, high_v = step.noise_v
            raise _problem(
                self.bench.multimeter,
                f"the readings scatter by {window.std_v:.2g} V, the bench file expects {low_v:g} to {high_v:g} V "
                "(expected.reading_noise_v)",
            )
        if self._noise is None:
            self._noise = NoiseSeen(step.resolution_v)
        if said := self._noise.doubt([reading.voltage_v for reading in window.readings]):
            raise _problem(self.bench.multimeter, f"{said}; a mean of them is no measurement")


@dataclass(slots=True)
class _DriveCheck:
    """Looks at the drive signal until it is settled and in its windows, or the deadline has passed."""

    bench: OpenBench
    step: AwaitDrive

    def settled(self) -> DriveReading:
        scope, clock, step = self.bench.oscilloscope, self.bench.clock, self.step
        deadline = Deadline.after(clock, step.deadline_s)
        scope.configure_timebase(_one_two_five(2.0 / sum(step.frequency_hz)))
        scope.configure_trigger(step.drive_channel)
        previous_v, carrier_v, looks = self._coarse_look()
        while True:
            reading, complaint = self._look(previous_v, carrier_v, looks := looks + 1)
            if reading is not None and not complaint:
                return reading
            if deadline.expired():
                raise _problem(scope, f"drive signal not as it should be after {step.deadline_s:g} s: {complaint}")
            if reading is not None:
                previous_v = reading.amplitude_v
            else:
                previous_v, carrier_v, _ = self._coarse_look()
            sleep(clock, step.interval_s)

    def _coarse_look(self) -> tuple[float, float, int]:
        """Show both channels at the scale of the largest amplitude allowed; return amplitudes (V) and looks taken."""
        scope, step = self.bench.oscilloscope, self.step
        channels = (step.drive_channel, step.carrier_channel)
        for channel in channels:
            scope.configure_channel(channel, step.amplitude_v[1] / _DIVISIONS)
        scope.acquire(*channels)
        drive_v, carrier_v = (self._amplitude_or_none(channel) for channel in channels)
        return drive_v, carrier_v, 1

    def _amplitude_or_none(self, channel: int) -> float:
        """Measure an amplitude where there may be no signal yet, V; 0 when there is none."""
        try:
            return self.bench.oscilloscope.measure_amplitude_v(channel)
        except MeasurementError:
            return 0.0

    def _look(self, drive_v: float, carrier_v: float, looks: int) -> tuple[DriveReading | None, str]:
        """Take one record at a fitting scale; return what it shows and what is wrong with it, empty when nothing is."""
        scope, step = self.bench.oscilloscope, self.step
        for channel, amplitude_v in ((step.drive_channel, drive_v), (step.carrier_channel, carrier_v)):
            scope.configure_channel(channel, max(amplitude_v, step.amplitude_v[0]) / _DIVISIONS)
        scope.acquire(step.drive_channel, step.carrier_channel)
        try:
            reading = DriveReading(
                scope.measure_frequency_hz(step.drive_channel),
                scope.measure_amplitude_v(step.drive_channel),
                scope.measure_phase_deg(step.drive_channel, step.carrier_channel),
                looks,
            )
        except MeasurementError as error:
            return None, error.what
        return reading, _complaint(reading, step, drive_v)


def _complaint(reading: DriveReading, step: AwaitDrive, previous_v: float) -> str:
    """Say what is wrong with the drive signal; empty when nothing is."""
    low_deg = step.phase_deg[0]
    for name, value, (low, high), unit in (
        ("frequency", reading.frequency_hz, step.frequency_hz, "Hz"),
        ("amplitude", reading.amplitude_v, step.amplitude_v, "V"),
        ("phase", low_deg + (reading.phase_deg - low_deg) % 360.0, step.phase_deg, "deg"),  # a window may hold 180
    ):
        if not low <= value <= high:
            return f"{name} {value:.6g} {unit}, expected {low:g}...{high:g} {unit}"
    if abs(reading.amplitude_v - previous_v) > step.amplitude_tolerance * reading.amplitude_v:
        return f"amplitude still moving, {previous_v:.4g} to {reading.amplitude_v:.4g} V"
    return ""


def _one_two_five(least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is at least `least`."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= least * (1.0 - 1e-9))


def _problem(instrument: Instrument, what: str) -> MeasurementError:
    return MeasurementError(what, instrument=instrument.name, resource=instrument.resource)
