"""Everything about temperature: a chamber or a stream of air, or one that a person sets."""

from msgspec import Struct

from vcfbench.bench.bench import Bench
from vcfbench.clock import sleep
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.operator import AskOperator
from vcfbench.steps.step import Context, Effect, Step, StepResult, does, problem

_POLL_S = 2.0


class TemperatureReading(StepResult, Struct, frozen=True):
    """The temperatures when it was reached: of the air and, where a sensor is wired, at the device; bench time, s."""

    air_c: float
    device_c: float | None
    t_s: float

    def describe(self) -> str:
        device = "" if self.device_c is None else f", device {self.device_c:.1f} degC"
        return f"air {self.air_c:.1f} degC{device}"


@does(Effect.SETS, "temperature", overhead_s=0.5)
class SetTemperature(Step, Struct, frozen=True):
    """Go to a temperature with at most `ramp_k_min`, air on; reached is `soak_s` within `window_k` of it."""

    temperature_c: float
    ramp_k_min: float
    window_k: float
    soak_s: float

    def describe(self) -> str:
        return f"temperature {self.temperature_c:+.1f} degC at {self.ramp_k_min:g} K/min, air on"

    def within(self, limits: LimitChecks) -> None:
        limits.temperature(self.temperature_c, self.ramp_k_min)

    def command(self, bench: Bench) -> None:
        chamber = bench.chamber
        chamber.set_temperature(self.temperature_c, self.ramp_k_min)
        chamber.set_settled(self.window_k, self.soak_s)
        if not chamber.flow_enabled():
            chamber.enable_flow()


@does(Effect.WAITS)
class AwaitTemperature(Step, Struct, frozen=True):
    """Wait until the temperature is reached and has been held.

    `ramp_s` is what the way takes, `soak_s` how long it is held: what a plan knows of the time. `deadline_s` is the
    longest wait.
    """

    temperature_c: float
    ramp_s: float
    soak_s: float
    deadline_s: float

    def describe(self) -> str:
        return f"wait until {self.temperature_c:+.1f} degC is reached and held for {self.soak_s:g} s"

    @property
    def physical_s(self) -> float:
        return self.ramp_s + self.soak_s

    def perform(self, context: Context) -> TemperatureReading:
        """Ask every few seconds; MeasurementError: it is not reached in time, or the chamber has a fault."""
        clock, chamber = context.bench.clock, context.bench.chamber
        start_s = clock.now()
        while not chamber.at_temperature():
            if fault := chamber.fault():
                raise problem(chamber, f"{fault}, on the way to {self.temperature_c:g} degC")
            if clock.now() - start_s >= self.deadline_s:
                air_c = chamber.air_temperature_c()
                raise problem(
                    chamber,
                    f"not at {self.temperature_c:g} degC after {self.deadline_s:g} s, its air has {air_c:.1f} degC",
                )
            sleep(clock, _POLL_S)
        return TemperatureReading(chamber.air_temperature_c(), chamber.device_temperature_c(), clock.now())

    def predict(self, gyro: LinearGyro) -> TemperatureReading:
        return TemperatureReading(self.temperature_c, None, 0.0)


@does(Effect.SETS, "temperature", "air off", overhead_s=0.2)
class StopFlow(Step, Struct, frozen=True):
    """Stop the air; the device comes to the room's temperature by itself."""

    def command(self, bench: Bench) -> None:
        bench.chamber.disable_flow()


def set_air_by_hand(temperature_c: float, takes_s: float = 900.0) -> AskOperator:
    """Return the step that has a chamber without an interface set to a temperature, and held there, by a person."""
    words = f"set the chamber to {temperature_c:+.1f} degC and wait until it is there"
    return AskOperator(words, takes_s, (("ambient_c", temperature_c),))
