"""Instruments that refuse what the station's limits forbid, before anything is sent.

Each wraps a driver and is one itself; what is not limited goes straight through.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.errors import LimitError

if TYPE_CHECKING:
    from vcfbench.bench.description import Limits, RailWiring
    from vcfbench.clock import Deadline
    from vcfbench.interfaces import (
        FunctionGenerator,
        Identity,
        Instrument,
        PowerSupply,
        RateTable,
        Regulation,
        SafeReport,
        Told,
    )

__all__ = ["LimitedGenerator", "LimitedRateTable", "LimitedSupply"]


class _Limited:
    """What every wrapped instrument passes on."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument

    @property
    def name(self) -> str:
        """The role on this bench."""
        return self._instrument.name

    @property
    def resource(self) -> str:
        """The resource string it was opened with."""
        return self._instrument.resource

    def identify(self) -> Identity:
        """Ask who answers."""
        return self._instrument.identify()

    def check_errors(self) -> None:
        """Read the error queue until it is empty."""
        self._instrument.check_errors()

    def command_safe(self) -> Told:
        """Send the stop or off words at once, without waiting for an answer."""
        return self._instrument.command_safe()

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Bring the instrument to its safe state."""
        return self._instrument.make_safe(deadline)

    def close(self) -> None:
        """Give the connection back."""
        self._instrument.close()

    def _at_most(self, what: str, value: float, limit: float, unit: str) -> None:
        """Refuse a magnitude above `limit`, and anything that is not a number."""
        if not abs(value) <= limit:
            self._refuse(f"{what} {value:g} {unit} is beyond the bench's limit of {limit:g} {unit}")

    def _refuse(self, what: str) -> None:
        raise LimitError(what, instrument=self.name, resource=self.resource, hint="nothing was sent")


class LimitedRateTable(_Limited):
    """A rate table within the bench's rate and acceleration."""

    def __init__(self, table: RateTable, limits: Limits) -> None:
        super().__init__(table)
        self._table = table
        self._limits = limits

    def enable(self) -> None:
        """Zero the demand, then close the servo."""
        self._table.enable()

    def disable(self) -> None:
        """Open the servo."""
        self._table.disable()

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp to `rate_deg_s`; LimitError beyond the limits of rate and acceleration."""
        self._at_most("rate", rate_deg_s, self._limits.max_rate_deg_s, "deg/s")
        self._acceleration(acceleration_deg_s2)
        self._table.set_rate(rate_deg_s, acceleration_deg_s2)

    def stop(self, acceleration_deg_s2: float) -> None:
        """Ramp to rest; LimitError beyond the limit of acceleration."""
        self._acceleration(acceleration_deg_s2)
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

    def _acceleration(self, acceleration_deg_s2: float) -> None:
        self._at_most("acceleration", acceleration_deg_s2, self._limits.max_acceleration_deg_s2, "deg/s^2")
        if acceleration_deg_s2 <= 0.0:  # a table whose acceleration is 0 can no longer be stopped (ACUTROL manual)
            self._refuse(f"acceleration {acceleration_deg_s2:g} deg/s^2 is not above 0 deg/s^2")


class LimitedGenerator(_Limited):
    """A function generator whose voltage stays within the bench's V_Vc, peak, into an open circuit."""

    def __init__(self, generator: FunctionGenerator, limits: Limits) -> None:
        super().__init__(generator)
        self._generator = generator
        self._max_v = limits.max_v_vc_v

    def configure_dc(self, voltage_v: float) -> float:
        """Select DC at `voltage_v`; LimitError beyond the limit."""
        self._at_most("voltage", voltage_v, self._max_v, "V")
        return self._generator.configure_dc(voltage_v)

    def set_dc(self, voltage_v: float) -> float:
        """Change the DC level; LimitError beyond the limit."""
        self._at_most("voltage", voltage_v, self._max_v, "V")
        return self._generator.set_dc(voltage_v)

    def configure_sine(self, frequency_hz: float, amplitude_vpp: float, offset_v: float = 0.0) -> None:
        """Select a sine; LimitError when its peak, offset included, is beyond the limit."""
        self._at_most("peak voltage", abs(amplitude_vpp) / 2.0 + abs(offset_v), self._max_v, "V")
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

    def __init__(self, supply: PowerSupply, limits: Limits, rails: RailWiring) -> None:
        super().__init__(supply)
        self._supply = supply
        self._limits = limits
        self._polarity: dict[str, float] = {rails.positive: 1.0, rails.negative: -1.0}

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        """Set level and current limit of `output`; LimitError outside the limits, 0 V is always allowed."""
        if voltage_v != 0.0:
            self._rail(output, voltage_v)
        self._at_most(f"{output} current limit", current_limit_a, self._limits.max_rail_current_a, "A")
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

    def _rail(self, output: str, voltage_v: float) -> None:
        if output not in self._polarity:
            self._refuse(f"{output} {voltage_v:g} V: the output feeds no rail of the bench")
        low, high = self._limits.min_rail_v, self._limits.max_rail_v
        if not low <= voltage_v * self._polarity[output] <= high:
            ends = sorted((low * self._polarity[output], high * self._polarity[output]))
            self._refuse(f"{output} {voltage_v:g} V is outside the bench's rail window of {ends[0]:g} to {ends[1]:g} V")
