"""Capabilities of instruments, as the procedures need them: small protocols, SI floats, the unit in the name.

A procedure asks for capabilities by role (``{"multimeter": ReadsVoltage}``); a driver class has one when it has its
methods. The instruments of the paper's bench are compositions of them.

Every setter raises :class:`~vcfbench.errors.LimitError` or :class:`~vcfbench.errors.InstrumentError` rather than
clip, and returns only when the instrument's error queue has been read and was empty. Angles and rates
of the table are in deg and deg/s, which the field uses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from msgspec import Struct, field

from vcfbench.errors import PlanError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.clock import Deadline


class Identity(Struct, frozen=True):
    """Identity of an instrument: the four fields of ``*IDN?`` (empty where a dialect has none).

    >>> bench.multimeter.identify().model
    '34401A'
    """

    maker: str
    model: str
    serial: str
    firmware: str


class UnprovedCommand(Struct, frozen=True):
    """A command sent to an instrument without waiting for an answer, and the last read-back."""

    words: str
    """The command: ``to stop``, ``to switch off``; empty for one that drives nothing."""
    sent: bool
    """True where the wire took the words. That the instrument heard them is not known."""
    last_read: str | None = None
    """The last read-back in words, ``200 deg/s``; None: nothing was ever read back."""
    age_s: float | None = None
    """Age of that read-back, s of bench time; None where the bench's clock does not answer either."""

    def __str__(self) -> str:
        done = f"told {self.words}, not proved" if self.sent else f"could not be told {self.words}"
        if self.last_read is None:
            return f"{done}; its state was never read back"
        ago = "" if self.age_s is None else f" {self.age_s:.3g} s ago"
        return f"{done}; last read back: {self.last_read}{ago}"


class SafeReport(Struct, frozen=True):
    """Result of making an instrument safe, proved by read-back; `unproved` is there when it could not be proved.

    >>> report = bench.power.make_safe(vcfbench.Deadline.after(bench.clock, 10.0))
    >>> report.instrument, report.safe, report.detail
    ('power', True, 'outputs off, P6V +0 V, P25V +0 V, N25V +0 V at the terminals')
    """

    instrument: str
    resource: str
    safe: bool
    detail: str
    unproved: UnprovedCommand | None = None


class Regulation(Enum):
    """Regulation of a supply output.

    >>> bench.power.regulation("P25V") is vcfbench.Regulation.OFF
    True
    """

    OFF = "off"
    CONSTANT_VOLTAGE = "CV"
    CONSTANT_CURRENT = "CC"
    FAULT = "fault"


class Waveform(Struct, frozen=True):
    """A record of one oscilloscope channel: times (s, trigger at 0) and voltages (V), one-dimensional, equal length.

    >>> bench.oscilloscope.acquire(1)
    >>> wave = bench.oscilloscope.waveform(1, points=500)
    >>> wave.time_s.shape, wave.voltage_v.shape
    ((500,), (500,))
    """

    time_s: NDArray[np.float64]
    voltage_v: NDArray[np.float64]


class Request(Struct, frozen=True):
    """Manual task for a person, in words that follow "please".

    `takes_s` is how long that takes, about. `adjustments` are what comes to the same on a simulated bench: names and
    values as ``vcfbench sim ctl set`` takes them. `types` is what shall be typed: a unit, or the words that there are
    to choose from; empty where it need only be done. `wanted` tells whether somebody still waits for it.
    """

    words: str
    takes_s: float = 60.0
    adjustments: Mapping[str, float | str | bool | None] = field(default_factory=dict)
    types: str = ""
    wanted: Callable[[], bool] = lambda: True


Operator = Callable[[Request], str]
"""Does the request, or has it done, and returns when it is done; the answer is kept in the record."""


def nobody(request: Request) -> str:
    """Refuse: this run has no operator."""
    raise PlanError(
        f"a person has to {request.words}, but no operator can be asked",
        hint="at a terminal, or with an operator" + ("" if request.types else "; or say --yes if all is done as asked"),
    )


class Instrument(Protocol):
    """Capabilities of every instrument of the bench.

    >>> for instrument in bench.instruments.values():
    ...     print(instrument.name, instrument.resource)
    power GPIB0::5::INSTR
    rate_source USB0::0x0957::0x0407::MY44021876::INSTR
    multimeter GPIB0::22::INSTR
    oscilloscope USB0::0x0957::0x175D::MY49520121::INSTR
    rate_table sim://ideal
    """

    @property
    def name(self) -> str:
        """The role on this bench, for messages: ``multimeter``."""

    @property
    def resource(self) -> str:
        """The resource string it was opened with."""

    def identify(self) -> Identity:
        """Ask for the identity."""

    def check_errors(self) -> None:
        """Read the error queue until it is empty; raise InstrumentError with the first entry if there was any."""

    def command_safe(self) -> UnprovedCommand:
        """Send the stop or off commands at once, without waiting for an answer, and return the last read-back.

        They go out whatever state the session is in and whoever is in the middle of an exchange; a connection that is
        closed is made anew, if that is quick. Never raises; takes at most a few tenths of a second of wall time.
        """

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Bring the instrument to its safe state and prove it by read-back; never raises for a refused step.

        Speaks before it listens: the words of `command_safe` go out first, and once more where the proof fails.
        """

    def close(self) -> None:
        """Give the connection back."""


@runtime_checkable
class PowersRails(Protocol):
    """Feeds the rails: named outputs, each regulated and read back, that share one output switch.

    >>> bench.power.configure_output("P25V", 10.0, current_limit_a=0.1)
    >>> bench.power.enable_outputs()
    >>> f"{bench.power.measure_voltage_v('P25V'):.2f} V"
    '10.00 V'
    """

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        """Set level and current limit of `output`; `voltage_v` carries the sign of the terminal."""

    def enable_outputs(self) -> None:
        """Switch all outputs on."""

    def disable_outputs(self) -> None:
        """Switch all outputs off."""

    def outputs_enabled(self) -> bool:
        """Return True if the outputs are on."""

    def measure_voltage_v(self, output: str) -> float:
        """Read back the voltage at the terminals, V."""

    def measure_current_a(self, output: str) -> float:
        """Read back the current, A."""

    def regulation(self, output: str) -> Regulation:
        """Return the regulation of `output`."""


@runtime_checkable
class SwitchesOutput(Protocol):
    """An output with a relay that can be switched off.

    >>> bench.rate_source.disable_output()
    >>> bench.rate_source.output_enabled()
    False
    """

    def enable_output(self) -> None:
        """Close the output relay."""

    def disable_output(self) -> None:
        """Open the output relay."""

    def output_enabled(self) -> bool:
        """Return True if the output relay is closed."""


@runtime_checkable
class SetsVoltage(SwitchesOutput, Protocol):
    """Puts out a DC voltage, into a high impedance.

    >>> bench.rate_source.configure_dc(0.5)
    0.5
    """

    def configure_dc(self, voltage_v: float) -> float:
        """Select DC at `voltage_v` into an open circuit, output switch unchanged; return the setting read back, V."""

    def set_dc(self, voltage_v: float) -> float:
        """Change the DC level; return the setting read back, V."""


@runtime_checkable
class SetsSine(SwitchesOutput, Protocol):
    """Puts out a sine, into a high impedance.

    >>> bench.rate_source.configure_sine(20.0, amplitude_vpp=0.1)
    >>> bench.rate_source.enable_output()
    """

    def configure_sine(self, frequency_hz: float, amplitude_vpp: float, offset_v: float = 0.0) -> None:
        """Select a sine into an open circuit, output switch unchanged."""


@runtime_checkable
class ReadsVoltage(Protocol):
    """Reads a DC voltage on one node, on request.

    >>> bench.multimeter.configure_dc_voltage(range_v=10.0, nplc=10.0)
    >>> f"{bench.multimeter.read_voltage_v():.2f} V"
    '0.00 V'
    """

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Select DC voltage on a fixed range with an integration time of `nplc` power-line cycles, autozero on."""

    def read_voltage_v(self) -> float:
        """Trigger one reading and return it, V; raises MeasurementError on overload."""


@runtime_checkable
class ReadsResistance(Protocol):
    """Reads the resistance of a part without a voltage of its own, on request.

    >>> bench.multimeter.configure_resistance(1e6, nplc=10.0, wires=2)
    >>> resistance_ohm = bench.multimeter.read_resistance_ohm()
    """

    def configure_resistance(self, range_ohm: float, nplc: float, wires: int = 2) -> None:
        """Select resistance by two or four wires on a fixed range with an integration time of `nplc` cycles."""

    def read_resistance_ohm(self) -> float:
        """Trigger one reading and return it, ohm; inf where it is beyond the range."""


@runtime_checkable
class BeginsReadings(ReadsVoltage, Protocol):
    """Reads while another instrument is queried: a reading is begun, and fetched when it is over.

    >>> bench.multimeter.configure_dc_voltage(10.0, 10.0)
    >>> bench.multimeter.begin_reading()
    >>> rate_deg_s = bench.rate_table.rate_deg_s()  # meanwhile
    >>> f"{bench.multimeter.begun_reading_v():.2f} V"
    '0.00 V'
    """

    def begin_reading(self) -> None:
        """Trigger one reading; return at once."""

    def begun_reading_v(self) -> float:
        """Wait for the reading that was begun last and return it, V; asked again, it gives the same reading again."""


@runtime_checkable
class SamplesVoltage(ReadsVoltage, Protocol):
    """Takes readings by itself, at its own interval, and keeps them until they are read out.

    >>> bench.multimeter.configure_dc_voltage(10.0, 1.0)
    >>> took_s = bench.multimeter.start_sampling(50, interval_s=0.1)
    >>> len(bench.multimeter.sampled_voltages_v())
    50
    """

    @property
    def aperture_s(self) -> float:
        """Return the integration time of one reading as configured, s."""

    def start_sampling(self, samples: int, interval_s: float) -> float:
        """Begin to take `samples` readings, one every `interval_s`; return their duration, s.

        Range and integration time are those configured; a zero is taken once, before the first. An interval of one
        integration time leaves no gap between the readings. Send it no message until they are taken.
        """

    def sampled_voltages_v(self) -> tuple[float, ...]:
        """Return the readings of the sampling that was begun last, V; raises MeasurementError on overload."""


@runtime_checkable
class CapturesWaveforms(Protocol):
    """Takes records of channels that see nodes of the PCB.

    >>> bench.oscilloscope.configure_channel(1, scale_v_per_div=0.5)
    >>> bench.oscilloscope.configure_timebase(1e-4)
    >>> bench.oscilloscope.acquire(1)
    >>> len(bench.oscilloscope.waveform(1, points=500).voltage_v)
    500
    """

    def configure_channel(self, channel: int, scale_v_per_div: float, offset_v: float = 0.0) -> None:
        """Show `channel`, DC coupled, 1 Mohm, at the given scale and offset."""

    def configure_timebase(self, scale_s_per_div: float) -> None:
        """Set the main time base."""

    def configure_trigger(self, channel: int, level_v: float = 0.0) -> None:
        """Select the rising-edge trigger on `channel`, automatic sweep."""

    def acquire(self, *channels: int) -> None:
        """Take one record of `channels` and stop."""

    def waveform(self, channel: int, points: int = 1000) -> Waveform:
        """Download the record of `channel`."""


@runtime_checkable
class AveragesWaveforms(Protocol):
    """Takes means of many records, or of the samples of one, which have more bits than a sample."""

    def acquire_mean(self, count: int, *channels: int) -> None:
        """Take the mean of `count` records of `channels`, each from its own trigger, and stop."""

    def acquire_fine(self, *channels: int) -> None:
        """Take one record of `channels` whose points are means of all samples about them, and stop."""


@runtime_checkable
class MeasuresWaveforms(CapturesWaveforms, Protocol):
    """Measures its records by itself.

    >>> try:
    ...     print(bench.oscilloscope.measure_frequency_hz(1))
    ... except vcfbench.MeasurementError:
    ...     print("no signal on channel 1")
    no signal on channel 1
    """

    def measure_frequency_hz(self, channel: int) -> float:
        """Measure the frequency of the record; raises MeasurementError without a signal."""

    def measure_amplitude_v(self, channel: int) -> float:
        """Measure half the peak-to-peak voltage of the record, V."""

    def measure_phase_deg(self, channel: int, reference: int) -> float:
        """Measure the phase of `channel` against `reference`, deg in -180...180."""


@runtime_checkable
class Rotates(Protocol):
    """Turns the device on it about one axis.

    >>> bench.rate_table.enable()
    >>> bench.rate_table.set_rate(10.0, acceleration_deg_s2=50.0)
    >>> vcfbench.sleep(bench.clock, 1.0)
    >>> f"{bench.rate_table.rate_deg_s():.2f} deg/s"
    '10.00 deg/s'
    """

    def enable(self) -> None:
        """Zero the demand, then close the servo; raises InterlockError when a fault forbids it."""

    def disable(self) -> None:
        """Open the servo; refuses (InterlockError) while the table turns."""

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp to `rate_deg_s` with at most `acceleration_deg_s2`; returns at once."""

    def at_rate(self) -> bool:
        """Return True if the table says that the demanded rate is reached."""

    def rate_deg_s(self) -> float:
        """Read back the rate."""

    def angle_deg(self) -> float:
        """Read back the angle."""

    def stop(self, acceleration_deg_s2: float) -> None:
        """Ramp to rest, servo kept."""

    def fault(self) -> str | None:
        """Return the latched fault or interlock in words, or None."""


@runtime_checkable
class ForcesTemperature(Protocol):
    """Brings the air around the device to a temperature."""

    def set_temperature(self, temperature_c: float, ramp_k_min: float) -> float:
        """Go to `temperature_c` with at most `ramp_k_min` once air flows; return the setting read back, degC."""

    def set_settled(self, window_k: float, soak_s: float) -> None:
        """Say when it counts as at temperature: for `soak_s` within `window_k` of the setting."""

    def at_temperature(self) -> bool:
        """Return True if the temperature is reached and has been held."""

    def air_temperature_c(self) -> float:
        """Read the temperature of the air, degC."""

    def device_temperature_c(self) -> float | None:
        """Read the temperature at the device, degC; None where no sensor is wired."""

    def enable_flow(self) -> None:
        """Switch the air on; InterlockError at a fault or an open head."""

    def disable_flow(self) -> None:
        """Stop the air."""

    def flow_enabled(self) -> bool:
        """Return True if air flows."""

    def fault(self) -> str | None:
        """Return the fault in words, or None."""


class PowerSupply(Instrument, PowersRails, Protocol):
    """A supply of the rails.

    >>> bench.power.identify().model
    'E3631A'
    """


class FunctionGenerator(Instrument, SetsVoltage, SetsSine, Protocol):
    """A generator whose load is a high impedance.

    >>> bench.rate_source.identify().model
    '33220A'
    """


class Multimeter(Instrument, ReadsVoltage, Protocol):
    """A voltmeter.

    >>> bench.multimeter.identify().model, isinstance(bench.multimeter, vcfbench.SamplesVoltage)
    ('34401A', True)
    """


class Oscilloscope(Instrument, MeasuresWaveforms, Protocol):
    """An oscilloscope.

    >>> bench.oscilloscope.identify().model
    'DSO7104B'
    """


class TemperatureChamber(Instrument, ForcesTemperature, Protocol):
    """A chamber, or a stream of air on the device."""


class RateTable(Instrument, Rotates, Protocol):
    """A single-axis rate table.

    >>> bench.rate_table.identify().model, bench.rate_table.fault()
    ('Acutrol3000', None)
    """


def lacking(kind: type, capability: type) -> tuple[str, ...]:
    """Return the methods of the protocol `capability` that the class `kind` does not have."""
    asked = {name for base in capability.__mro__ for name in vars(base) if not name.startswith("_")}
    return tuple(sorted(name for name in asked if not hasattr(kind, name)))
