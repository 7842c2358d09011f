"""Everything about the supply of the rails."""

from contextlib import suppress

from msgspec import Struct

from vcfbench.bench.bench import Bench
from vcfbench.errors import BenchError, ConfigError, MeasurementError
from vcfbench.interfaces import PowerSupply, Regulation
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import LOOK_AT_SIGNALS, Context, Effect, Step, StepResult, does, problem


class RailReading(Struct, frozen=True):
    """Reading of one rail at the supply: voltage at the terminals (V), current (A) and regulation."""

    rail: str
    voltage_v: float
    current_a: float
    regulation: Regulation


class RailsReading(StepResult, Struct, frozen=True):
    """Readings of all rails at the supply."""

    rails: tuple[RailReading, ...]

    def describe(self) -> str:
        return ", ".join(f"{rail.rail} {rail.voltage_v:+.3f} V {rail.current_a:.4f} A" for rail in self.rails)


@does(Effect.SETS, "rail", overhead_s=0.05)
class ConfigureRail(Step, Struct, frozen=True):
    """Set level and current limit of one supply output, outputs off."""

    rail: str
    output: str
    voltage_v: float
    current_limit_a: float

    @property
    def sets(self) -> tuple[str, ...]:
        return (f"{self.subject} {self.output}",)

    def describe(self) -> str:
        return f"supply {self.output} ({self.rail} rail): {self.voltage_v:+g} V, limit {self.current_limit_a:g} A"

    def within(self, limits: LimitChecks) -> None:
        limits.rail(self.output, self.voltage_v)
        limits.rail_current(self.output, self.current_limit_a)

    def command(self, bench: Bench) -> None:
        bench.power.configure_output(self.output, self.voltage_v, self.current_limit_a)


@does(Effect.SETS, "supply outputs", "supply outputs on", overhead_s=0.05)
class EnableSupply(Step, Struct, frozen=True):
    """Switch the supply outputs on."""

    def command(self, bench: Bench) -> None:
        bench.power.enable_outputs()


@does(Effect.SETS, "supply outputs", "supply outputs off", overhead_s=0.05)
class DisableSupply(Step, Struct, frozen=True):
    """Switch the supply outputs off."""

    def command(self, bench: Bench) -> None:
        bench.power.disable_outputs()


@does(Effect.CHECKS, "rails", overhead_s=0.2)
class CheckRails(Step, Struct, frozen=True):
    """Read back rails and currents; each must be regulated in voltage and within `tolerance_v` of its level."""

    rails: tuple[ConfigureRail, ...]
    tolerance_v: float

    def describe(self) -> str:
        levels = ", ".join(f"{rail.voltage_v:+g} V" for rail in self.rails)
        return f"read back the rails: {levels} within {self.tolerance_v:g} V, constant voltage"

    def perform(self, context: Context) -> RailsReading:
        """Read all rails back; MeasurementError when one is not as it should be."""
        context.outputs = tuple(rail.output for rail in self.rails)
        return RailsReading(tuple(read_rail(context, rail, self.tolerance_v) for rail in self.rails))

    def predict(self, gyro: LinearGyro) -> RailsReading:
        return RailsReading(tuple(map(predicted_rail, self.rails)))


def predicted_rail(rail: ConfigureRail) -> RailReading:
    """Return the reading of a rail in order."""
    return RailReading(rail.output, rail.voltage_v, 0.0, Regulation.CONSTANT_VOLTAGE)


def read_rail(context: Context, rail: ConfigureRail, tolerance_v: float) -> RailReading:
    """Read one rail back; it must be regulated and within `tolerance_v` of its level; MeasurementError: it is not."""
    power = context.bench.power

    def off(reading: RailReading) -> str:
        if abs(reading.voltage_v - rail.voltage_v) <= tolerance_v:
            return ""
        return (
            f"{rail.output} reads {reading.voltage_v:+.7g} V, expected {rail.voltage_v:+g} V within {tolerance_v:g} V"
        )

    reading = context.believable(lambda: _read(power, rail.output), off)
    if reading.regulation is Regulation.CONSTANT_CURRENT:
        raise problem(power, _limited(reading))
    if reading.regulation is not Regulation.CONSTANT_VOLTAGE:
        state = f"{reading.regulation.value}, {reading.voltage_v:+.4g} V"
        raise problem(power, f"{reading.rail} is not regulated: {state}")
    if said := off(reading):
        raise problem(power, said)
    return reading


def cause_behind(error: BenchError, context: Context) -> BenchError:
    """Return the cause behind the error of a measurement: a supply that is in current limit, else the error itself.

    The symptoms of a gyroscope without its rails (no sine, a scatter, nothing that decays) show at another instrument.
    An analysis' failure to find a signal is that of a bench that does not answer.
    """
    if isinstance(error, MeasurementError | ConfigError) and error.instrument != "power":
        with suppress(BenchError):  # a supply that does not answer either is for the safety stack to name
            power = context.bench.power
            for output in context.outputs:
                reading = _read(power, output)
                if reading.regulation is Regulation.CONSTANT_CURRENT:
                    return problem(power, f"{_limited(reading)}; it was found because of: {error}")
    if not isinstance(error, ConfigError):
        return error
    failed = MeasurementError(f"no response: {error.what}", step=error.step, hint=error.hint or LOOK_AT_SIGNALS)
    failed.__cause__ = error.__cause__
    return failed


def _limited(reading: RailReading) -> str:
    return f"{reading.rail} is in current limit: {reading.current_a:.3g} A at {reading.voltage_v:+.4g} V"


def _read(power: PowerSupply, output: str) -> RailReading:
    return RailReading(
        output, power.measure_voltage_v(output), power.measure_current_a(output), power.regulation(output)
    )
