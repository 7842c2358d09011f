"""The limits of a bench, and instruments that refuse a command beyond them before anything is sent.

Each instrument wraps a driver and is one itself; what is not limited goes straight through.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.errors import LimitError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.clock import Deadline
    from vcfbench.interfaces import (
        FunctionGenerator,
        Identity,
        Instrument,
        PowerSupply,
        RateTable,
        Regulation,
        SafeReport,
        TemperatureChamber,
        UnprovedCommand,
    )
    from vcfbench.station.description import BenchDescription
    from vcfbench.station.parts import Limits, RailWiring


class LimitChecks(Struct, frozen=True):
    """The limits of a bench as questions: each raises LimitError for a value that leaves one, or is not a number.

    The errors say nothing of where: whoever asks knows the instrument, or the step of a plan.
    """

    limits: Limits
    rails: RailWiring

    @classmethod
    def of(cls, description: BenchDescription) -> LimitChecks:
        """Return those of a bench file."""
        return cls(description.limits, description.wiring.rails)

    def rate(self, rate_deg_s: float) -> None:
        """Check a rate of the table, either way."""
        _at_most("rate", rate_deg_s, self.limits.of("max_rate_deg_s"), "deg/s")

    def acceleration(self, acceleration_deg_s2: float) -> None:
        """Check an acceleration of the table; a table whose acceleration is 0 could no longer be stopped (ACUTROL)."""
        _at_most("acceleration", acceleration_deg_s2, self.limits.of("max_acceleration_deg_s2"), "deg/s^2")
        if acceleration_deg_s2 <= 0.0:
            raise LimitError(f"acceleration {acceleration_deg_s2:g} deg/s^2 is not above 0 deg/s^2")

    def v_vc(self, peak_v: float, what: str = "voltage") -> None:
        """Check a voltage of the generator, either sign, into an open circuit."""
        _at_most(what, peak_v, self.limits.of("max_v_vc_v"), "V")

    def rail(self, output: str, voltage_v: float) -> None:
        """Check the level of a supply output: 0 V is always allowed, outputs that feed no rail only that."""
        if voltage_v == 0.0:
            return
        polarity = {self.rails.positive: 1.0, self.rails.negative: -1.0}
        if output not in polarity:
            raise LimitError(f"{output} {voltage_v:g} V: the output feeds no rail of the bench")
        low, high = self.limits.of("min_rail_v"), self.limits.of("max_rail_v")
        if not low <= voltage_v * polarity[output] <= high:
            ends = sorted((low * polarity[output], high * polarity[output]))
            raise LimitError(
                f"{output} {voltage_v:g} V is outside the bench's rail window of {ends[0]:g} to {ends[1]:g} V"
            )

    def temperature(self, temperature_c: float, ramp_k_min: float) -> None:
        """Check a temperature of the air, and how fast it may go there."""
        low, high = self.limits.of("min_temperature_c"), self.limits.of("max_temperature_c")
        if not low <= temperature_c <= high:
            raise LimitError(f"temperature {temperature_c:g} degC is outside the bench's {low:g} to {high:g} degC")
        _at_most("temperature ramp", ramp_k_min, self.limits.of("max_ramp_k_min"), "K/min")
        if ramp_k_min <= 0.0:
            raise LimitError(f"temperature ramp {ramp_k_min:g} K/min is not above 0 K/min")

    def rail_current(self, output: str, current_a: float) -> None:
        """Check the current limit of a supply output."""
        _at_most(f"{output} current limit", current_a, self.limits.of("max_rail_current_a"), "A")


def _at_most(what: str, value: float, limit: float, unit: str) -> None:
    if not abs(value) <= limit:
        raise LimitError(f"{what} {value:g} {unit} is beyond the bench's limit of {limit:g} {unit}")


def driver_of(instrument: Any) -> Any:
    """Return the driver behind an instrument of a bench: for callers that judge messages themselves."""
    return instrument.driver if isinstance(instrument, _Limited) else instrument


class _Limited:
    """Members that every wrapped instrument passes on."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument

    @property
    def driver(self) -> Instrument:
        """Driver behind the limits."""
        return self._instrument

    @property
    def name(self) -> str:
        """The role on this bench."""
        return self._instrument.name

    @property
    def resource(self) -> str:
        """The resource string it was opened with."""
        return self._instrument.resource

    def identify(self) -> Identity:
        """Ask for the identity."""
        return self._instrument.identify()

    def check_errors(self) -> None:
        """Read the error queue until it is empty."""
        self._instrument.check_errors()

    def command_safe(self) -> UnprovedCommand:
        """Send the stop or off words at once, without waiting for an answer."""
        return self._instrument.command_safe()

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Bring the instrument to its safe state."""
        return self._instrument.make_safe(deadline)

    def close(self) -> None:
        """Give the connection back."""
        self._instrument.close()

    @contextmanager
    def _nothing_sent(self) -> Iterator[None]:
        """Say at which instrument a limit would have been left."""
        try:
            yield
        except LimitError as error:
            error.instrument, error.resource, error.hint = self.name, self.resource, "nothing was sent"
            raise


class LimitedRateTable(_Limited):
    """A rate table within the bench's rate and acceleration."""

    def __init__(self, table: RateTable, checks: LimitChecks) -> None:
        super().__init__(table)
        self._table = table
        self._checks = checks

    def enable(self) -> None:
        """Zero the demand, then close the servo."""
        self._table.enable()

    def disable(self) -> None:
        """Open the servo."""
        self._table.disable()

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp to `rate_deg_s`; LimitError beyond the limits of rate and acceleration."""
        with self._nothing_sent():
            self._checks.rate(rate_deg_s)
            self._checks.acceleration(acceleration_deg_s2)
        self._table.set_rate(rate_deg_s, acceleration_deg_s2)

    def stop(self, acceleration_deg_s2: float) -> None:
        """Ramp to rest; LimitError beyond the limit of acceleration."""
        with self._nothing_sent():
            self._checks.acceleration(acceleration_deg_s2)
        self._table.stop(acceleration_deg_s2)

    def at_rate(self) -> bool:
        """Tell whether the demanded rate is reached."""
        return self._table.at_rate()

    def rate_deg_s(self) -> float:
        """Read back the rate."""
        return self._table.rate_deg_s()

    def angle_deg(self) -> float:
        """Read back the angle."""
        return self._table.angle_deg()

    def fault(self) -> str | None:
        """Return the latched fault in words, or None."""
        return self._table.fault()


class LimitedChamber(_Limited):
    """A chamber within the bench's temperatures and ramp."""

    def __init__(self, chamber: TemperatureChamber, checks: LimitChecks) -> None:
        super().__init__(chamber)
        self._chamber = chamber
        self._checks = checks

    def set_temperature(self, temperature_c: float, ramp_k_min: float) -> float:
        """Go to `temperature_c`; LimitError beyond the limits of temperature and ramp."""
        with self._nothing_sent():
            self._checks.temperature(temperature_c, ramp_k_min)
        return self._chamber.set_temperature(temperature_c, ramp_k_min)

    def set_settled(self, window_k: float, soak_s: float) -> None:
        """Say when it counts as at temperature."""
        self._chamber.set_settled(window_k, soak_s)

    def at_temperature(self) -> bool:
        """Tell whether the temperature is reached and has been held."""
        return self._chamber.at_temperature()

    def air_temperature_c(self) -> float:
        """Read the temperature of the air."""
        return self._chamber.air_temperature_c()

    def device_temperature_c(self) -> float | None:
        """Read the temperature at the device, None without a sensor."""
        return self._chamber.device_temperature_c()

    def enable_flow(self) -> None:
        """Let air flow."""
        self._chamber.enable_flow()

    def disable_flow(self) -> None:
        """Stop the air."""
        self._chamber.disable_flow()

    def flow_enabled(self) -> bool:
        """Tell whether air flows."""
        return self._chamber.flow_enabled()

    def fault(self) -> str | None:
        """Return the fault in words, or None."""
        return self._chamber.fault()


class LimitedGenerator(_Limited):
    """A function generator whose voltage stays within the bench's V_Vc, peak, into an open circuit."""

    def __init__(self, generator: FunctionGenerator, checks: LimitChecks) -> None:
        super().__init__(generator)
        self._generator = generator
        self._checks = checks

    def configure_dc(self, voltage_v: float) -> float:
        """Select DC at `voltage_v`; LimitError beyond the limit."""
        with self._nothing_sent():
            self._checks.v_vc(voltage_v)
        return self._generator.configure_dc(voltage_v)

    def set_dc(self, voltage_v: float) -> float:
        """Change the DC level; LimitError beyond the limit."""
        with self._nothing_sent():
            self._checks.v_vc(voltage_v)
        return self._generator.set_dc(voltage_v)

    def configure_sine(self, frequency_hz: float, amplitude_vpp: float, offset_v: float = 0.0) -> None:
        """Select a sine; LimitError when its peak, offset included, is beyond the limit."""
        with self._nothing_sent():
            self._checks.v_vc(abs(amplitude_vpp) / 2.0 + abs(offset_v), "peak voltage")
        self._generator.configure_sine(frequency_hz, amplitude_vpp, offset_v)

    def enable_output(self) -> None:
        """Close the output relay."""
        self._generator.enable_output()

    def disable_output(self) -> None:
        """Open the output relay."""
        self._generator.disable_output()

    def output_enabled(self) -> bool:
        """Tell whether the output relay is closed."""
        return self._generator.output_enabled()


class LimitedSupply(_Limited):
    """A supply whose rail outputs stay within the window of the rails and the limit of their current.

    Outputs that feed no rail may only be set to 0 V.
    """

    def __init__(self, supply: PowerSupply, checks: LimitChecks) -> None:
        super().__init__(supply)
        self._supply = supply
        self._checks = checks

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        """Set level and current limit of `output`; LimitError outside the limits, 0 V is always allowed."""
        with self._nothing_sent():
            self._checks.rail(output, voltage_v)
            self._checks.rail_current(output, current_limit_a)
        self._supply.configure_output(output, voltage_v, current_limit_a)

    def enable_outputs(self) -> None:
        """Switch all outputs on."""
        self._supply.enable_outputs()

    def disable_outputs(self) -> None:
        """Switch all outputs off."""
        self._supply.disable_outputs()

    def outputs_enabled(self) -> bool:
        """Tell whether the outputs are on."""
        return self._supply.outputs_enabled()

    def measure_voltage_v(self, output: str) -> float:
        """Read back the voltage at the terminals, V."""
        return self._supply.measure_voltage_v(output)

    def measure_current_a(self, output: str) -> float:
        """Read back the current, A."""
        return self._supply.measure_current_a(output)

    def regulation(self, output: str) -> Regulation:
        """Tell how `output` is regulated now."""
        return self._supply.regulation(output)
