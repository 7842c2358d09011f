"""The limits of a bench, and instruments that refuse a command beyond them before anything is sent.

Each instrument wraps a driver and has the members of its protocol; those that no limit is about go straight through.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from typing import Any

from msgspec import Struct

from vcfbench.arguments import require, require_number
from vcfbench.drivers.rate_table.dialect import MIDDLE, TableDialect, TableSettings, spoken
from vcfbench.drivers.registry import find_driver
from vcfbench.errors import LimitError
from vcfbench.interfaces import FunctionGenerator, PowerSupply, RateTable, TemperatureChamber
from vcfbench.station.description import BenchDescription
from vcfbench.station.parts import Limits, RailWiring


class LimitChecks(Struct, frozen=True):
    """The limits of a bench as questions: each raises LimitError for a value that leaves one, or is not a number.

    The errors say nothing of where: whoever asks knows the instrument, or the step of a plan.

    >>> vcfbench.LimitChecks.of(vcfbench.load_bench("lab.toml")).rate(9000.0)
    Traceback (most recent call last):
    vcfbench.errors.LimitError: rate 9000 deg/s is beyond the bench's limit of 300 deg/s
    """

    limits: Limits
    rails: RailWiring
    table: TableDialect | None = None
    """The language of the table, which has bounds of its own, None where it is not known."""
    sines: tuple[float, float] = (0.0, math.inf)
    """The generator's least amplitude, V peak, and its largest frequency, Hz."""

    @classmethod
    def of(cls, description: BenchDescription) -> "LimitChecks":
        """Return those of a bench file, with those of the instruments' drivers."""
        table, source, by_hand = description.rate_table, description.rate_source, description.by_hand
        spoken_to = source is not None and "rate_source" not in by_hand
        generator = find_driver(source.model, source.like).driver_class if source and spoken_to else None
        return cls(
            description.limits,
            description.wiring.rails,
            None
            if table is None or "rate_table" in by_hand
            else spoken(table.dialect, TableSettings(axis=table.axis, steps_per_deg=table.steps_per_deg))[0],
            (getattr(generator, "least_vpp", 0.0) / 2.0, getattr(generator, "sine_hz", math.inf)),
        )

    def motion(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Check a ramp of the table to a rate, also by the bounds of its language."""
        self.rate(rate_deg_s)
        self.acceleration(acceleration_deg_s2)
        if self.table is not None and (why := self.table.refusal(rate_deg_s, acceleration_deg_s2)):
            raise LimitError(why)

    def sine(self, frequency_hz: float, peak_v: float) -> None:
        """Check a sine of the generator about 0 V, into an open circuit."""
        require_number("frequency", frequency_hz)
        self.v_vc(peak_v, "peak voltage")
        least_v, most_hz = self.sines
        if not peak_v >= least_v:
            raise LimitError(f"peak voltage {peak_v:g} V is below the generator's least of {least_v:g} V")
        if not frequency_hz <= most_hz:
            raise LimitError(f"frequency {frequency_hz:g} Hz is beyond the generator's {most_hz:g} Hz")

    def rate(self, rate_deg_s: float) -> None:
        """Check a rate of the table, either way."""
        _at_most("rate", rate_deg_s, self.limits.of("max_rate_deg_s"), "deg/s")

    def acceleration(self, acceleration_deg_s2: float) -> None:
        """Check an acceleration of the table; with 0 the table could no longer be stopped (ACUTROL)."""
        _at_most("acceleration", acceleration_deg_s2, self.limits.of("max_acceleration_deg_s2"), "deg/s^2")
        if acceleration_deg_s2 <= 0.0:
            raise LimitError(f"acceleration {acceleration_deg_s2:g} deg/s^2 is not above 0 deg/s^2")

    def turn(self, angle_deg: float) -> None:
        """Check how far the table turns from where it begins, either way, by the travel of its language."""
        if self.table is None or self.table.travel_deg is None:
            return
        low_deg, high_deg = self.table.travel_deg
        if not abs(angle_deg) <= (left_deg := (1.0 - MIDDLE) * (high_deg - low_deg) / 2.0):
            raise LimitError(f"the table turns {angle_deg:+.0f} deg from its middle, its travel has {left_deg:.0f} deg")

    def v_vc(self, peak_v: float, what: str = "voltage") -> None:
        """Check a voltage of the generator, either sign, into an open circuit."""
        _at_most(what, peak_v, self.limits.of("max_v_vc_v"), "V")

    def rail(self, output: str, voltage_v: float) -> None:
        """Check the level of a supply output: 0 V is always allowed, outputs that feed no rail only that."""
        require("output", output, str)
        require_number("voltage", voltage_v)
        if voltage_v == 0.0:
            return
        polarity = {self.rails.positive: 1.0, self.rails.negative: -1.0}  # "none" is no output
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
        require_number("temperature", temperature_c)
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
    require_number(what, value)
    if not abs(value) <= limit:
        raise LimitError(f"{what} {value:g} {unit} is beyond the bench's limit of {limit:g} {unit}")


def driver_of(instrument: Any) -> Any:
    """Return the driver behind an instrument of a bench: for callers that judge messages themselves."""
    return instrument.driver if isinstance(instrument, _Limited) else instrument


class _Limited:
    """An instrument within limits: passes on the members of its `protocol`, but for those that a subclass defines.

    A driver's member beyond its protocol is not there: nothing is passed on that nobody has compared with a limit.
    """

    def __init__(self, driver: Any, checks: LimitChecks) -> None:
        self.driver = driver
        self._checks = checks

    def __init_subclass__(cls, protocol: type) -> None:
        """Pass on the arguments."""
        for name in {each for base in protocol.__mro__ for each in vars(base) if not each.startswith("_")}:
            if name not in vars(cls):
                setattr(cls, name, property(attrgetter(f"driver.{name}")))

    @contextmanager
    def _nothing_sent(self) -> Iterator[None]:
        """Say at which instrument a limit would have been left."""
        try:
            yield
        except LimitError as error:
            error.instrument, error.resource = self.driver.name, self.driver.resource
            error.hint = "nothing was sent"
            raise


class LimitedRateTable(_Limited, protocol=RateTable):
    """A rate table within the bench's rate and acceleration."""

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp to `rate_deg_s`; LimitError beyond the limits of rate and acceleration."""
        with self._nothing_sent():
            self._checks.rate(rate_deg_s)
            self._checks.acceleration(acceleration_deg_s2)
        self.driver.set_rate(rate_deg_s, acceleration_deg_s2)

    def stop(self, acceleration_deg_s2: float) -> None:
        """Ramp to rest; LimitError beyond the limit of acceleration."""
        with self._nothing_sent():
            self._checks.acceleration(acceleration_deg_s2)
        self.driver.stop(acceleration_deg_s2)


class LimitedChamber(_Limited, protocol=TemperatureChamber):
    """A chamber within the bench's temperatures and ramp."""

    def set_temperature(self, temperature_c: float, ramp_k_min: float) -> float:
        """Go to `temperature_c`; LimitError beyond the limits of temperature and ramp."""
        with self._nothing_sent():
            self._checks.temperature(temperature_c, ramp_k_min)
        return self.driver.set_temperature(temperature_c, ramp_k_min)  # type: ignore[no-any-return]


class LimitedGenerator(_Limited, protocol=FunctionGenerator):
    """A function generator whose voltage stays within the bench's V_Vc, peak, into an open circuit."""

    def configure_dc(self, voltage_v: float) -> float:
        """Select DC at `voltage_v`; LimitError beyond the limit."""
        with self._nothing_sent():
            self._checks.v_vc(voltage_v)
        return self.driver.configure_dc(voltage_v)  # type: ignore[no-any-return]

    def set_dc(self, voltage_v: float) -> float:
        """Change the DC level; LimitError beyond the limit."""
        with self._nothing_sent():
            self._checks.v_vc(voltage_v)
        return self.driver.set_dc(voltage_v)  # type: ignore[no-any-return]

    def configure_sine(self, frequency_hz: float, amplitude_vpp: float, offset_v: float = 0.0) -> None:
        """Select a sine; LimitError when its peak, offset included, is beyond the limit."""
        with self._nothing_sent():
            require_number("amplitude", amplitude_vpp)
            require_number("offset", offset_v)
            self._checks.v_vc(abs(amplitude_vpp) / 2.0 + abs(offset_v), "peak voltage")
        self.driver.configure_sine(frequency_hz, amplitude_vpp, offset_v)


class LimitedSupply(_Limited, protocol=PowerSupply):
    """A supply whose rail outputs stay within the window of the rails and the limit of their current.

    Outputs that feed no rail may only be set to 0 V.
    """

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        """Set level and current limit of `output`; LimitError outside the limits, 0 V is always allowed."""
        with self._nothing_sent():
            self._checks.rail(output, voltage_v)
            self._checks.rail_current(output, current_limit_a)
        self.driver.configure_output(output, voltage_v, current_limit_a)
