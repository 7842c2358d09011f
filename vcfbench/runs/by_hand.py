"""The whole bench by typed commands, performed by the steps of procedures.

So the PCB is powered in the right order, every level and rate is held against the limits of the bench, and every answer
comes as a run would get it. What follows the name of a role goes to that instrument as it is: a question, or, where raw
commands are recorded, anything.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from msgspec import Struct, structs

from vcfbench import steps
from vcfbench.bench.bench import Bench
from vcfbench.bench.console import Console, ConsoleReply
from vcfbench.clock import sleep
from vcfbench.drivers.plain import plain
from vcfbench.errors import Aborted, BenchError, ConfigError, InterlockError, LimitError
from vcfbench.instructions.routines import look_at_drive, meter_set, rails_of, ramp_to
from vcfbench.records.raw import RawRecord
from vcfbench.safety.signals import StopSignals
from vcfbench.station.limits import LimitChecks, driver_of
from vcfbench.station.settings import Station
from vcfbench.steps.step import Context, Routine, Step

ALIASES: Final = {
    "table": "rate_table",
    "scope": "oscilloscope",
    "meter": "multimeter",
    "v_vc": "rate_source",
    "vibration": "vibration_source",
}
"""Short names of roles."""

_LONGEST_WAIT_S = 86_400.0


class StepWord(Struct, frozen=True):
    """A word: its role (None: the bench), its arguments, its effect, and the limits that it is held against."""

    name: str
    role: str | None
    takes: tuple[str, ...]
    means: str
    limits: str = ""


WORDS: Final = (
    StepWord(
        "power.on", "power", (), "V_Vc off, rails set and on, read back", "min_rail_v, max_rail_v, max_rail_current_a"
    ),
    StepWord("power.read", "power", (), "voltage and current of each rail"),
    StepWord("power.off", "power", (), "V_Vc off, then the rails"),
    StepWord("multimeter.read", "multimeter", (), "one reading of the output"),
    StepWord("v_vc.set", "rate_source", ("VOLTS",), "V_Vc to a level, output on", "max_v_vc_v"),
    StepWord("v_vc.sine", "rate_source", ("HZ", "VOLTS"), "V_Vc a sine, peak VOLTS, output on", "max_v_vc_v"),
    StepWord("v_vc.off", "rate_source", (), "output off"),
    StepWord("v_vc.read", "v_vc_meter", (), "one reading of V_Vc, V"),
    StepWord("vibration.sine", "vibration_source", ("HZ", "VOLTS"), "second generator a sine, output on", "max_v_vc_v"),
    StepWord("vibration.off", "vibration_source", (), "its output off"),
    StepWord("scope.drive", "oscilloscope", (), "frequency, amplitude and phase of the drive signal"),
    StepWord(
        *("table.rate", "rate_table", ("DEG_S",), "ramp to a rate and wait for it"),
        "max_rate_deg_s, max_acceleration_deg_s2",
    ),
    StepWord("table.read", "rate_table", (), "rate and angle read back"),
    StepWord("table.stop", "rate_table", (), "ramp to rest, servo kept"),
    StepWord("table.off", "rate_table", (), "to rest, servo open"),
    StepWord("chamber.set", "chamber", ("DEG_C",), "air on, to a temperature", "min_temperature_c, max_temperature_c"),
    StepWord("chamber.read", "chamber", (), "temperature of the air, and of the device"),
    StepWord("chamber.off", "chamber", (), "air off"),
    StepWord("status", None, (), "what is on, what turns"),
    StepWord("wait", None, ("SECONDS",), "let bench time pass"),
    StepWord("safe", None, (), "table to rest, outputs off, and go on"),
)
"""Every word of the bench but those of the prompt itself."""

_SECOND_METER_RANGE_V = 10.0


class ByHand:
    """An open bench, spoken to in words.

    Args:
        bench: the bench.
        signals: what stops it.
        raw: record of raw commands to single instruments; None lets questions pass alone.
        timeout_s: what an exchange of such a line may take; None is the bench file's.
        tell: is told what is done, step by step.
    """

    def __init__(
        self,
        bench: Bench,
        signals: StopSignals,
        tell: Callable[[str], None],
        *,
        raw: RawRecord | None = None,
        timeout_s: float | None = None,
    ) -> None:
        description = bench.description
        self.bench = bench
        self._tell = tell
        self._checks = LimitChecks.of(description)
        scope = None if description.oscilloscope is None else description.wiring.oscilloscope
        wiring, limits, gyro = description.wiring, description.limits, description.gyro
        station = Station(rails=wiring.rails, oscilloscope=scope, limits=limits, gyro=gyro)
        self._context = Context(bench, lambda _: None)
        self._settings = structs.replace(description.procedure, station=station)
        self._ready: set[str] = set()
        self.consoles: dict[str, Console] = {}
        for role, instrument in bench.instruments.items():
            driver = driver_of(instrument)
            try:
                plain(driver, 1.0)
            except ConfigError:  # frames of bytes cannot be typed
                continue
            within_s = getattr(description, role).timeout_s if timeout_s is None else timeout_s
            self.consoles[role] = Console(driver, raw=raw, signals=signals, timeout_s=within_s)
        self.words = {word.name: word for word in WORDS if word.role is None or word.role in bench.instruments}

    def names(self) -> list[str]:
        """Return all that a line can begin with: words, roles and their short names."""
        short = [alias for alias, role in ALIASES.items() if role in self.consoles]
        return sorted({*self.words, *self.consoles, *short})

    def raw(self, name: str, message: str) -> ConsoleReply:
        """Send `message` unchanged to the instrument called `name`."""
        role = ALIASES.get(name, name)
        self._ready.discard(role)  # what it is set to is not known any more
        return self.consoles[role].say(message)

    def perform(self, name: str, values: list[str]) -> str:
        """Perform a command and return its output; empty without one.

        Raises:
            ConfigError: it takes other values.
            LimitError: they leave a limit of the bench, which is named; nothing was sent.
            BenchError: an instrument did not do it.
        """
        word = self.words[name]
        usage = " ".join((word.name, *word.takes))
        if len(values) != len(word.takes):
            raise ConfigError(f"expected {usage!r}, got {' '.join((word.name, *values))!r}")
        numbers = [_number(f"{usage}: {what}", value) for what, value in zip(word.takes, values, strict=True)]
        act: Callable[..., str | None] = getattr(self, f"_{name.replace('.', '_')}")
        try:
            return act(*numbers) or ""
        except LimitError as error:
            if word.limits:
                error.hint = f"limits.{word.limits.replace(', ', ', limits.')} of bench {self.bench.description.name}"
            error.instrument = error.instrument or word.role
            raise

    def _carry_out(self, routine: Routine[Any]) -> None:
        """Perform steps as a run does, telling each with its result."""
        advance: Callable[[], Step] = partial(next, routine)
        while True:
            try:
                step = advance()
            except StopIteration:
                return
            try:
                step.within(self._checks)
                self._context.begin()
                result = step.perform(self._context)
            except BenchError as error:
                advance = partial(routine.throw, error)
                continue
            said = result.describe()
            self._tell(f"{step.describe()}{f': {said}' if said else ''}")
            advance = partial(routine.send, result)

    # Power

    def _power_on(self) -> str:
        def routine() -> Routine[None]:
            if "rate_source" in self.bench.instruments:
                yield from self._v_vc_off_steps()
            settings = self._settings
            rails = rails_of(settings)
            for rail in rails:  # noqa: UP028  # a tuple cannot be sent results
                yield rail
            yield steps.EnableSupply()
            sleep(self.bench.clock, settings.settle_s)
            yield steps.CheckRails(rails, settings.rail_tolerance_v)

        self._carry_out(routine())
        return self._power_read()

    def _power_read(self) -> str:
        power = self.bench.power
        return ", ".join(
            f"{rail.output} {power.measure_voltage_v(rail.output):+.4f} V {power.measure_current_a(rail.output):.4f} A"
            for rail in self._settings.rails
        )

    def _power_off(self) -> None:
        def routine() -> Routine[None]:
            try:
                if "rate_source" in self.bench.instruments:
                    yield from self._v_vc_off_steps()
            finally:
                yield steps.DisableSupply()

        self._carry_out(routine())

    def _require_power(self) -> None:
        """Refuse to drive the input of a PCB that has no power: its protection would carry the current."""
        if "power" in self.bench.instruments and not self.bench.power.outputs_enabled():
            raise InterlockError("the PCB has no power, nothing was sent", hint="type power.on first")

    # Generators

    def _v_vc_off_steps(self) -> Routine[None]:
        self._ready.discard("rate_source")
        yield steps.DisableVvc()

    def _v_vc_set(self, volts: float) -> None:
        self._checks.v_vc(volts)
        self._require_power()
        first: list[Step] = []
        if "rate_source" not in self._ready:
            first = [steps.DisableVvc(), steps.ConfigureGenerator(0.0), steps.EnableVvc()]
        self._carry_out(_each(*first))
        self._ready.add("rate_source")
        self._carry_out(_each(steps.SetVvc(volts)))

    def _v_vc_sine(self, frequency_hz: float, peak_v: float) -> None:
        self._checks.v_vc(peak_v, "peak voltage")
        self._require_power()
        self._ready.discard("rate_source")
        self._carry_out(_each(steps.SetSine(frequency_hz, peak_v), steps.EnableVvc()))

    def _v_vc_off(self) -> None:
        self._carry_out(self._v_vc_off_steps())

    def _vibration_sine(self, frequency_hz: float, peak_v: float) -> None:
        self._checks.v_vc(peak_v, "peak voltage")
        self._require_power()
        source = self.bench.vibration_source
        source.configure_sine(frequency_hz, 2.0 * peak_v)
        source.enable_output()

    def _vibration_off(self) -> None:
        self.bench.vibration_source.disable_output()

    # Meters and oscilloscope

    def _multimeter_read(self) -> str:
        if "multimeter" not in self._ready:
            self._carry_out(meter_set(self._settings))
            self._ready.add("multimeter")
        return f"{self.bench.multimeter.read_voltage_v():+.8g} {self._settings.station.output_unit}"

    def _v_vc_read(self) -> str:
        meter = self.bench.v_vc_meter
        if "v_vc_meter" not in self._ready:
            meter.configure_dc_voltage(_SECOND_METER_RANGE_V, float(self._settings.nplc))
            self._ready.add("v_vc_meter")
        return f"{meter.read_voltage_v():+.8g} V"

    def _scope_drive(self) -> None:
        self._carry_out(look_at_drive(self._settings))

    # Table

    def _table_rate(self, rate_deg_s: float) -> str:
        table = self.bench.rate_table
        self._checks.rate(rate_deg_s)
        if "rate_table" not in self._ready:
            self._carry_out(_each(steps.EnableTable()))
            self._ready.add("rate_table")
        self._carry_out(ramp_to(self._settings, rate_deg_s, previous_deg_s=table.rate_deg_s()))
        return f"{table.rate_deg_s():+.4f} deg/s"

    def _table_read(self) -> str:
        table = self.bench.rate_table
        fault = table.fault()
        return f"{table.rate_deg_s():+.4f} deg/s, {table.angle_deg():.4f} deg{f', fault: {fault}' if fault else ''}"

    def _table_stop(self) -> None:
        table, settings = self.bench.rate_table, self._settings
        rate_deg_s = table.rate_deg_s()
        table.stop(settings.acceleration_deg_s2)
        ramp_s = abs(rate_deg_s) / settings.acceleration_deg_s2
        deadline_s = 2.0 * ramp_s + settings.rate_deadline_s
        self._carry_out(_each(steps.AwaitRate(0.0, ramp_s, settings.rate_tolerance_deg_s, deadline_s)))

    def _table_off(self) -> None:
        self._table_stop()
        self._ready.discard("rate_table")
        self._carry_out(_each(steps.DisableTable()))

    # Chamber

    def _chamber_set(self, temperature_c: float) -> str:
        chamber, ramp_k_min = self.bench.chamber, self._checks.limits.of("max_ramp_k_min")
        set_c = chamber.set_temperature(temperature_c, ramp_k_min)
        if not chamber.flow_enabled():
            chamber.enable_flow()
        return f"set to {set_c:+.1f} degC, at most {ramp_k_min:g} K/min"

    def _chamber_read(self) -> str:
        chamber = self.bench.chamber
        device_c = chamber.device_temperature_c()
        device = "" if device_c is None else f", device {device_c:+.1f} degC"
        return f"air {chamber.air_temperature_c():+.1f} degC{device}"

    def _chamber_off(self) -> None:
        self.bench.chamber.disable_flow()

    # The bench

    def _status(self) -> str:
        states: dict[str, Callable[[Any], str]] = {
            "power": lambda it: f"on, {self._power_read()}" if it.outputs_enabled() else "off",
            "rate_source": _switched,
            "vibration_source": _switched,
            "chamber": lambda it: f"{'air on' if it.flow_enabled() else 'air off'}, {self.perform('chamber.read', [])}",
            "rate_table": lambda _: self.perform("table.read", []),
        }
        lines = [f"bench time {self.bench.clock.now():.1f} s"]
        for role, instrument in self.bench.instruments.items():
            identity = self.bench.identities[role]
            lines.append(f"{role}: {states[role](instrument) if role in states else identity.model}")
        return "\n".join(lines)

    def _wait(self, seconds: float) -> None:
        if not 0.0 <= seconds <= _LONGEST_WAIT_S:
            raise ConfigError(f"wait {seconds:g}: expected seconds, from 0 to {_LONGEST_WAIT_S:g}")
        sleep(self.bench.clock, seconds)

    def _safe(self) -> str:
        failed: list[str] = []
        for name in ("table.off", "vibration.off", "v_vc.off", "chamber.off", "power.off"):
            if name in self.words:
                try:
                    self.perform(name, [])
                except Aborted:
                    raise
                except BenchError as error:  # the next must be switched off whatever this one does
                    failed.append(f"{name}: {error}")
        if failed:
            hint = "what is not named is off; leaving makes everything safe"
            raise BenchError(f"not all is safe: {'; '.join(failed)}", hint=hint)
        return "table at rest, outputs off"


def _each(*given: Step) -> Routine[None]:
    for step in given:  # noqa: UP028  # a tuple cannot be sent results
        yield step


def _switched(source: Any) -> str:
    return "on" if source.output_enabled() else "off"


def _number(what: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"{what}: expected a number, got {value!r}")
    return number
