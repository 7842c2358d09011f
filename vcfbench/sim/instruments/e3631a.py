"""Simulated E3631A triple supply: its command set, and its outputs on the rails of the World.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 84-108 commands, 113-122 status, 139-146 errors,
186-188 specifications). What the guide leaves open is marked *unverified*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from vcfbench.sim.scpi import (
    COMMON_COMMANDS,
    GPIB,
    RS232,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Limits,
    Number,
    Register,
    ScpiEngine,
    ScpiError,
    ScpiInstrument,
    Status,
    Text,
    Word,
    bare_integer,
    boolean,
    enable,
    event,
    next_error,
    quoted,
    real,
)
from vcfbench.sim.sources import Ripple

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np

    from vcfbench.sim.world import World

__all__ = ["E3631A", "OutputErrors", "SupplyErrors"]

_PROGRAMMING_S = 0.05
"""From a programming command to the change at the output: the guide gives it as less than this (p. 187)."""
_READBACK_S = 0.1
"""MEASure?: the guide gives it as less than this (p. 187)."""
_SELF_TEST_S = 1.0
"""*TST?; unverified."""
_RAMP_STEPS = 8
_LIMITED_LOOK_S = 0.01
"""How often an output in constant current looks at its load, which may let go by itself: a PCB that has started."""
_LIMITED_PATIENCE_S = 2.0
"""For how long it does so after its voltage last moved."""
_SETTLED = math.log(100.0)
"""Settling times of the guide are to 1 % of the excursion."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """What an output is by design.

    Args:
        name: as in the commands. number: as in INSTrument:NSELect. sign: of its voltage.
        volts, amps: ranges (p. 91). volt_step, amp_step: programming and read-back resolution (p. 186).
        rise_s, fall_s: settling at no load and at full load, s (p. 187).
        rated_a: its rated current (p. 186).
    """

    name: str
    number: int
    sign: int
    volts: Limits
    amps: Limits
    volt_step: float
    amp_step: float
    rise_s: tuple[float, float]
    fall_s: tuple[float, float]
    rated_a: float

    @property
    def volt_parameter(self) -> Number:
        """A voltage for this output."""
        return Number(unit="V", limits=self.volts)

    @property
    def amp_parameter(self) -> Number:
        """A current limit for this output."""
        return Number(unit="A", limits=self.amps)


_P6V = _Kind(
    "P6V", 1, 1, Limits(0.0, 6.18, 0.0), Limits(0.0, 5.15, 5.0), 0.5e-3, 0.5e-3, (0.010, 0.011), (0.2, 0.013), 5.0
)
_P25V = _Kind(
    "P25V", 2, 1, Limits(0.0, 25.75, 0.0), Limits(0.0, 1.03, 1.0), 1.5e-3, 0.1e-3, (0.02, 0.05), (0.4, 0.045), 1.0
)
_N25V = replace(_P25V, name="N25V", number=3, sign=-1, volts=Limits(0.0, -25.75, 0.0))
_KINDS = (_P6V, _P25V, _N25V)


@dataclass(frozen=True, slots=True)
class OutputErrors:
    """Imperfections of one output of a specimen; gains are relative errors."""

    programming_gain: float = 0.0
    """Voltage programming, V/V (p. 186)."""
    programming_offset_v: float = 0.0
    """Voltage programming, V (p. 186)."""
    current_programming_gain: float = 0.0
    """Current limit, A/A (p. 186)."""
    current_programming_offset_a: float = 0.0
    """Current limit, A (p. 186)."""
    readback_gain: float = 0.0
    """Voltage read-back, V/V (p. 186)."""
    readback_offset_v: float = 0.0
    """Voltage read-back, V (p. 186)."""
    current_readback_gain: float = 0.0
    """Current read-back, A/A (p. 186)."""
    current_readback_offset_a: float = 0.0
    """Current read-back, A (p. 186)."""
    resistance_ohm: float = 0.0
    """Output resistance: the fixed 2 mV of the load regulation per rated current, ohm (p. 186)."""
    sag: float = 0.0
    """Relative fall of the voltage at rated current, V/V: the 0.01 % of the load regulation (p. 186)."""
    line_gain: float = 0.0
    """Relative change of the voltage by the mains being off nominal, V/V (line regulation 0.01 %, p. 186)."""
    ripple_v: float = 0.0
    """Ripple on the output while it is on, Vrms (below 0.35 mV, p. 186)."""
    ripple_hz: float = 100.0
    """Frequency of the ripple, Hz: twice the mains (the guide names a band, 20 Hz to 20 MHz; unverified)."""
    ripple_phase_rad: float = 0.0
    """Phase of the ripple at bench time 0, rad."""


@dataclass(frozen=True, slots=True)
class _Accuracy:
    """Published 12-month accuracy at 25 +- 5 C (p. 186): relative part and fixed part."""

    programming: tuple[float, float]
    current: tuple[float, float]
    readback: tuple[float, float]


_ACCURACY = {
    "P6V": _Accuracy((1e-3, 5e-3), (2e-3, 10e-3), (1e-3, 5e-3)),
    "P25V": _Accuracy((0.5e-3, 20e-3), (1.5e-3, 4e-3), (0.5e-3, 10e-3)),
    "N25V": _Accuracy((0.5e-3, 20e-3), (1.5e-3, 4e-3), (0.5e-3, 10e-3)),
}


@dataclass(frozen=True, slots=True)
class SupplyErrors:
    """Imperfections of a specimen; each can be set by itself."""

    p6v: OutputErrors = field(default_factory=OutputErrors)
    """The +6 V output."""
    p25v: OutputErrors = field(default_factory=OutputErrors)
    """The +25 V output."""
    n25v: OutputErrors = field(default_factory=OutputErrors)
    """The -25 V output."""
    tracking_gain: float = 0.0
    """Relative error of the -25 V output added while it tracks, V/V (0.2 %, p. 186)."""
    tracking_offset_v: float = 0.0
    """Error of the -25 V output added while it tracks, V (20 mV, p. 186)."""
    quantised: bool = False
    """Whether outputs and readings come in the steps of the converters (p. 186)."""

    @classmethod
    def none(cls) -> SupplyErrors:
        """Return an ideal specimen."""
        return cls()

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> SupplyErrors:
        """Return a specimen drawn from the published accuracy taken as four standard deviations.

        That is how the maker sets the limits of the 34401A (its User's Guide p. 227); for the supply it is inferred.
        """
        drawn = cls(
            p6v=_drawn_output(rng, _P6V, _ACCURACY["P6V"]),
            p25v=_drawn_output(rng, _P25V, _ACCURACY["P25V"]),
            n25v=_drawn_output(rng, _N25V, _ACCURACY["N25V"]),
            tracking_gain=_draw(rng, 2e-3),
            tracking_offset_v=_draw(rng, 20e-3),
            quantised=True,
        )
        p6v, p25v, n25v = (_disturbed(rng, each) for each in (drawn.p6v, drawn.p25v, drawn.n25v))
        return replace(drawn, p6v=p6v, p25v=p25v, n25v=n25v)

    def of(self, name: str) -> OutputErrors:
        """Return the errors of output `name`."""
        return {"P6V": self.p6v, "P25V": self.p25v, "N25V": self.n25v}[name]


def _draw(rng: np.random.Generator, limit: float) -> float:
    return float(rng.normal(0.0, limit / 4.0))


def _drawn_output(rng: np.random.Generator, kind: _Kind, accuracy: _Accuracy) -> OutputErrors:
    limits = (*accuracy.programming, *accuracy.current, *accuracy.readback, *accuracy.current)
    names = [item.name for item in fields(OutputErrors)][: len(limits)]
    drawn = {name: _draw(rng, limit) for name, limit in zip(names, limits, strict=True)}
    return OutputErrors(**drawn, resistance_ohm=2e-3 / kind.rated_a, sag=1e-4)


def _disturbed(rng: np.random.Generator, errors: OutputErrors) -> OutputErrors:
    """Return the errors with what the mains leave on the output: ripple below its limit at any phase, line."""
    return replace(
        errors,
        line_gain=_draw(rng, 1e-4),
        ripple_v=float(rng.uniform(0.1e-3, 0.35e-3)),
        ripple_phase_rad=float(rng.uniform(-math.pi, math.pi)),
    )


@dataclass(slots=True)
class _Ramp:
    """An exponential approach, handed to the World in steps."""

    start_s: float
    from_v: float
    to_v: float
    tau_s: float
    step: int = 1

    def instant_s(self) -> float:
        """Return when the next step is due."""
        left = 1.0 - self.step / _RAMP_STEPS
        return self.start_s + self.tau_s * (-math.log(left) if left > 0 else _SETTLED)

    def level_v(self) -> float:
        """Return the level of the next step."""
        return self.from_v + (self.to_v - self.from_v) * self.step / _RAMP_STEPS


class _Output:
    """One output: its settings, and the voltage and current really there."""

    __slots__ = (
        "_world",
        "amps",
        "current_a",
        "errors",
        "kind",
        "level_v",
        "limited",
        "quantised",
        "rail",
        "ramp",
        "register",
        "rippling",
        "triggered_amps",
        "triggered_volts",
        "voltage_v",
        "volts",
    )

    def __init__(self, kind: _Kind, world: World, rail: str | None, register: Register, errors: SupplyErrors) -> None:
        self.kind = kind
        self.rail = rail
        self.register = register
        self.errors = errors.of(kind.name)
        self.quantised = errors.quantised
        self._world = world
        self.level_v = 0.0
        self.voltage_v = 0.0
        self.current_a = 0.0
        self.limited = False
        self.rippling = False
        self.ramp: _Ramp | None = None
        self.volts = 0.0
        self.amps = 0.0
        self.triggered_volts: float | None = None
        self.triggered_amps: float | None = None

    def forget_triggered(self) -> None:
        """Forget the pending levels."""
        self.triggered_volts = None
        self.triggered_amps = None

    def head_for(self, level_v: float) -> None:
        """Start towards the open-circuit level `level_v` from now on."""
        if level_v == (self.level_v if self.ramp is None else self.ramp.to_v):
            return
        rising = abs(level_v) > abs(self.level_v)
        idle, full = self.kind.rise_s if rising else self.kind.fall_s
        share = min(1.0, self.current_a / self.kind.amps.maximum)
        tau = (idle + (full - idle) * share) / _SETTLED
        self.ramp = _Ramp(self._world.clock.now(), self.level_v, level_v, tau)

    def advance(self, now_s: float) -> None:
        """Take the steps of the ramp that are due; regulation is found afterwards."""
        while self.ramp is not None and self.ramp.instant_s() <= now_s:
            self.level_v = self.ramp.level_v()
            self.ramp.step += 1
            if self.ramp.step > _RAMP_STEPS:
                self.level_v, self.ramp = self.ramp.to_v, None

    def limit_a(self) -> float:
        """Return the current at which the output really goes to constant current."""
        errors = self.errors
        amps = _stepped(self.amps, self.kind.amp_step) if self.quantised else self.amps
        return max(0.0, amps * (1.0 + errors.current_programming_gain) + errors.current_programming_offset_a)

    def regulate(self) -> None:
        """Find voltage and current with the present load, constant voltage or constant current."""
        limit = self.limit_a()
        voltage, current = self.level_v, self._load_a(self.level_v)
        self.limited = current > limit
        if self.limited:
            voltage, current = self._at_limit(limit)
        voltage -= self._sagged(voltage, current)
        self._ripple(on=bool(voltage))
        if self.rail is not None and voltage != self.voltage_v:
            self._world.set_rail(self.rail, voltage)
        self.voltage_v, self.current_a = voltage, current

    def _sagged(self, voltage_v: float, current_a: float) -> float:
        """Return what the current takes off the voltage."""
        share = current_a / self.kind.rated_a
        return self.kind.sign * current_a * self.errors.resistance_ohm + voltage_v * self.errors.sag * share

    def _ripple(self, *, on: bool) -> None:
        """Put the ripple on the rail as the output gets or loses its voltage."""
        errors = self.errors
        if self.rail is None or not errors.ripple_v or on == self.rippling:
            return
        self.rippling = on
        ripple = Ripple(errors.ripple_v, errors.ripple_hz, errors.ripple_phase_rad)
        self._world.set_ripple(self.rail, ripple if on else None)

    def show(self, *, on: bool) -> None:
        """Show the regulation in the condition register: 2 constant voltage, 1 constant current, 0 off (p. 118)."""
        self.regulate()
        self.register.set_condition((1 if self.limited else 2) if on else 0)

    def _load_a(self, voltage_v: float) -> float:
        return 0.0 if self.rail is None else self._world.rail_current_a(self.rail, voltage_v)

    def _at_limit(self, limit: float) -> tuple[float, float]:
        """Return the voltage at which the load draws the limit, by bisection, and that current."""
        low, high = 0.0, self.level_v
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if self._load_a(middle) > limit else (middle, high)
        return low, min(limit, self._load_a(low))

    def voltage_reading(self) -> float:
        """Return what the voltmeter of the output shows."""
        reading = self.voltage_v * (1.0 + self.errors.readback_gain) + self.errors.readback_offset_v
        return _stepped(reading, self.kind.volt_step) if self.quantised else reading

    def current_reading(self) -> float:
        """Return what the ammeter of the output shows; positive for every output (unverified for N25V)."""
        reading = self.current_a * (1.0 + self.errors.current_readback_gain) + self.errors.current_readback_offset_a
        return _stepped(reading, self.kind.amp_step) if self.quantised else reading


def _stepped(value: float, step: float) -> float:
    return round(value / step) * step


@dataclass(frozen=True, slots=True)
class _Settings:
    """What *SAV stores (p. 96)."""

    selected: str
    levels: tuple[tuple[float, float], ...]
    output_on: bool
    tracking: bool
    source: str
    delay_s: float


_DEFAULT_SETTINGS = _Settings(
    selected="P6V",
    levels=tuple((kind.volts[2] or 0.0, kind.amps[2] or 0.0) for kind in _KINDS),
    output_on=False,
    tracking=False,
    source="BUS",
    delay_s=0.0,
)
_RAILS: Mapping[str, str] = MappingProxyType({"P25V": "positive", "N25V": "negative"})


class E3631A(ScpiInstrument):
    """The supply.

    Args:
        world: where its outputs lead.
        rails: output to power pin of the PCB; outputs that are not in it have no load.
        errors: imperfections of this specimen.
        interface: "gpib" or "rs232", one of which is selected on the front panel.
    """

    def __init__(
        self, world: World, *, rails: Mapping[str, str] = _RAILS, errors: SupplyErrors, interface: str = "gpib"
    ) -> None:
        self.world = world
        self.errors = errors
        self.questionable = Register()
        self.instrument_summary = Register(self.questionable, 13)
        registers = [Register(self.instrument_summary, kind.number) for kind in _KINDS]
        self.outputs = {
            kind.name: _Output(kind, world, rails.get(kind.name), register, errors)
            for kind, register in zip(_KINDS, registers, strict=True)
        }
        status = Status({3: self.questionable}, (*registers, self.instrument_summary))
        self.engine = ScpiEngine(
            self, TABLE, world.clock, dialect=_DIALECT, interface=_INTERFACES[interface], status=status
        )
        self.stored: dict[int, _Settings] = {}
        self.local = True
        self.initiated = False
        self.transfer_at_s: float | None = None
        self._next_s: float | None = None
        self._looks_until_s = -math.inf
        self.calibration = _Calibration()
        self.display_on = True
        self.display_text = ""
        self.coupled: tuple[str, ...] = ()
        self.restore(_DEFAULT_SETTINGS)
        world.on_load(self.regulate)

    # --- what the engine asks -----------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the identity; the firmware numbers are typical, unverified."""
        return "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0"

    def reset(self) -> None:
        """*RST (p. 97)."""
        self.coupled = ()
        self.display_on = True
        self.display_text = ""
        for output in self.outputs.values():
            output.forget_triggered()
        self.restore(_DEFAULT_SETTINGS)

    def service(self) -> None:
        """Advance ramps and the trigger delay."""
        if self._next_s is not None and self._next_s <= self.world.clock.now():
            self._advance()
        if self.instrument_summary.enable:
            self.observe()

    def next_event_s(self) -> float | None:
        """Return the next step of a ramp, or the end of the trigger delay."""
        return self._next_s

    def _advance(self) -> None:
        now = self.world.clock.now()
        if self.transfer_at_s is not None and self.transfer_at_s <= now:
            self.transfer_at_s = None
            self.transfer()
        for output in self.outputs.values():
            output.advance(now)
        self.regulate()

    def plan(self) -> None:
        """Work out when something next happens by itself."""
        instants = [output.ramp.instant_s() for output in self.outputs.values() if output.ramp is not None]
        if any(output.limited for output in self.outputs.values()) and self.world.clock.now() < self._looks_until_s:
            instants.append(self.world.clock.now() + _LIMITED_LOOK_S)
        if self.transfer_at_s is not None:
            instants.append(self.transfer_at_s)
        self._next_s = min(instants, default=None)

    def abort(self) -> None:
        """Device clear: the trigger system goes idle."""
        self.initiated = False
        self.transfer_at_s = None
        self.plan()

    def operations_end_s(self) -> float:
        """Return when the triggered change is through: an INITiate waits for its trigger."""
        if self.initiated:
            return math.inf
        return -math.inf if self.transfer_at_s is None else self.transfer_at_s

    # --- outputs ------------------------------------------------------------------------------------------

    @property
    def output(self) -> _Output:
        """The selected output."""
        return self.outputs[self.selected]

    def observe(self) -> None:
        """Bring regulation and condition registers up to now."""
        for output in self.outputs.values():
            output.show(on=self.output_on)

    def regulate(self) -> None:
        """Find the working point of every output: the load of one rail may depend on the other."""
        before = self._working_points()
        self.observe()
        if self._working_points() != before:
            self._looks_until_s = self.world.clock.now() + _LIMITED_PATIENCE_S
        self.plan()

    def _working_points(self) -> list[float]:
        return [output.voltage_v for output in self.outputs.values()]

    def drive(self) -> None:
        """Send every output towards its setting."""
        for name, output in self.outputs.items():
            output.head_for(self.open_circuit_v(name) if self.output_on else 0.0)
        self.regulate()

    def open_circuit_v(self, name: str) -> float:
        """Return what output `name` gives without load when it is on."""
        output = self.outputs[name]
        volts = _stepped(output.volts, output.kind.volt_step) if self.errors.quantised else output.volts
        gain, offset = output.errors.programming_gain, output.errors.programming_offset_v
        if name == "N25V" and self.tracking:
            gain, offset = gain + self.errors.tracking_gain, offset + self.errors.tracking_offset_v
        gain += output.errors.line_gain
        return volts * (1.0 + gain) + output.kind.sign * offset

    def program(self, name: str, *, volts: float | None = None, amps: float | None = None) -> None:
        """Take levels for output `name`; while tracking a voltage goes to its twin too."""
        output = self.outputs[name]
        if amps is not None:
            output.amps = amps
        if volts is not None:
            output.volts = volts
            if self.tracking and name != "P6V":
                self.outputs["N25V" if name == "P25V" else "P25V"].volts = -volts
        self.drive()

    def transfer(self) -> None:
        """The trigger: pending levels of the coupled outputs (of the selected one if none is) become immediate."""
        for name in self.coupled or (self.selected,):
            output = self.outputs[name]
            self.program(name, volts=output.triggered_volts, amps=output.triggered_amps)
            output.forget_triggered()

    # --- stored states ------------------------------------------------------------------------------------

    def settings(self) -> _Settings:
        """Return what *SAV stores."""
        levels = tuple((output.volts, output.amps) for output in self.outputs.values())
        return _Settings(
            self.selected, levels, self.output_on, self.tracking, self.trigger_source, self.trigger_delay_s
        )

    def restore(self, settings: _Settings) -> None:
        """Take what *RCL recalls."""
        self.selected = settings.selected
        self.output_on = settings.output_on
        self.tracking = settings.tracking
        self.trigger_source = settings.source
        self.trigger_delay_s = settings.delay_s
        self.initiated = False
        self.transfer_at_s = None
        for output, (volts, amps) in zip(self.outputs.values(), settings.levels, strict=True):
            output.volts, output.amps = volts, amps
        self.drive()


class _Calibration:
    """The calibration memory: guarded by a code (p. 104); adjusting changes nothing here."""

    def __init__(self) -> None:
        self.secured = True
        self.code = "HP003631"
        self.count = 1
        self.text = ""

    def require_unsecured(self) -> None:
        """Raise 702 while secured."""
        if self.secured:
            raise ScpiError(702)


# --- handlers: outputs ------------------------------------------------------------------------------------


def _remote(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Refuse with 550 while an RS-232 unit is in local; that all setting commands do so is unverified."""

    @wraps(handler)
    def guarded(supply: E3631A, *arguments: Any) -> Any:
        if supply.local and supply.engine.interface is RS232:
            raise ScpiError(550)
        return handler(supply, *arguments)

    return guarded


def _volt_limits(supply: E3631A) -> Limits:
    return supply.output.kind.volts


def _amp_limits(supply: E3631A) -> Limits:
    return supply.output.kind.amps


@_remote
def _set_volts(supply: E3631A, volts: float) -> None:
    supply.program(supply.selected, volts=volts)


def _volts(supply: E3631A) -> float:
    return supply.output.volts


@_remote
def _set_amps(supply: E3631A, amps: float) -> None:
    supply.program(supply.selected, amps=amps)


def _amps(supply: E3631A) -> float:
    return supply.output.amps


@_remote
def _set_triggered_volts(supply: E3631A, volts: float) -> None:
    supply.output.triggered_volts = volts


def _triggered_volts(supply: E3631A) -> float:
    pending = supply.output.triggered_volts
    return supply.output.volts if pending is None else pending


@_remote
def _set_triggered_amps(supply: E3631A, amps: float) -> None:
    supply.output.triggered_amps = amps


def _triggered_amps(supply: E3631A) -> float:
    pending = supply.output.triggered_amps
    return supply.output.amps if pending is None else pending


@_remote
def _apply(supply: E3631A, name: str, volts: Any, amps: Any) -> None:
    kind = supply.outputs[name].kind
    volts = None if volts is None else kind.volt_parameter.settle(volts, supply)
    amps = None if amps is None else kind.amp_parameter.settle(amps, supply)
    supply.selected = name
    supply.program(name, volts=volts, amps=amps)


def _applied(supply: E3631A, name: str | None) -> str:
    output = supply.outputs[name or supply.selected]
    return f"{output.volts:.6f},{output.amps:.6f}"


@_remote
def _select(supply: E3631A, name: str) -> None:
    supply.selected = name


def _selected(supply: E3631A) -> str:
    return supply.selected


@_remote
def _select_number(supply: E3631A, number: int) -> None:
    supply.selected = _KINDS[number - 1].name


def _selected_number(supply: E3631A) -> int:
    return supply.output.kind.number


@_remote
def _couple(supply: E3631A, *names: str) -> None:
    if ("ALL" in names or "NONE" in names) and len(names) > 1:
        raise ScpiError(-108)
    wanted = tuple(kind.name for kind in _KINDS if kind.name in names or "ALL" in names)
    if supply.tracking and {"P25V", "N25V"} <= set(wanted):
        raise ScpiError(800)
    supply.coupled = wanted


def _coupling(supply: E3631A) -> str:
    if len(supply.coupled) == len(_KINDS):
        return "ALL"
    return ",".join(supply.coupled) or "NONE"


def _measure_volts(supply: E3631A, name: str | None) -> float:
    supply.observe()
    return supply.outputs[name or supply.selected].voltage_reading()


def _measure_amps(supply: E3631A, name: str | None) -> float:
    supply.observe()
    return supply.outputs[name or supply.selected].current_reading()


@_remote
def _switch(supply: E3631A, state: object) -> None:
    supply.output_on = bool(state)
    supply.drive()


def _switched(supply: E3631A) -> bool:
    return supply.output_on


@_remote
def _track(supply: E3631A, state: object) -> None:
    if state and {"P25V", "N25V"} <= set(supply.coupled):
        raise ScpiError(801)
    supply.tracking = bool(state)
    if state:
        supply.program("P25V", volts=supply.outputs["P25V"].volts)
    supply.drive()


def _tracking(supply: E3631A) -> bool:
    return supply.tracking


# --- handlers: trigger, display, system -------------------------------------------------------------------


@_remote
def _initiate(supply: E3631A) -> None:
    if supply.initiated or supply.transfer_at_s is not None:
        raise ScpiError(-213)
    if supply.trigger_source == "IMM":
        supply.transfer()
    else:
        supply.initiated = True


def _trigger(supply: E3631A) -> None:
    if not supply.initiated:
        raise ScpiError(-211)
    supply.initiated = False
    supply.transfer_at_s = supply.world.clock.now() + supply.trigger_delay_s
    supply.plan()
    supply.service()


@_remote
def _set_delay(supply: E3631A, seconds: float) -> None:
    supply.trigger_delay_s = seconds


def _delay(supply: E3631A) -> float:
    return supply.trigger_delay_s


@_remote
def _set_source(supply: E3631A, source: str) -> None:
    supply.trigger_source = source


def _source(supply: E3631A) -> str:
    return supply.trigger_source


def _set_display(supply: E3631A, state: object) -> None:
    supply.display_on = bool(state)


def _display(supply: E3631A) -> bool:
    return supply.display_on


def _set_display_text(supply: E3631A, text: str) -> None:
    supply.display_text = text[:12]


def _display_text(supply: E3631A) -> str:
    return supply.display_text


def _clear_display_text(supply: E3631A) -> None:
    supply.display_text = ""


def _beep(supply: E3631A) -> None:
    del supply


def _version(supply: E3631A) -> str:
    del supply
    return "1995.0"


def _go_local(supply: E3631A) -> None:
    _require_rs232(supply)
    supply.local = True


def _go_remote(supply: E3631A) -> None:
    _require_rs232(supply)
    supply.local = False


def _require_rs232(supply: E3631A) -> None:
    if supply.engine.interface is not RS232:
        raise ScpiError(514)


def _self_test(supply: E3631A) -> str:
    del supply
    return "0"


@_remote
def _save(supply: E3631A, slot: int) -> None:
    supply.stored[slot] = supply.settings()


@_remote
def _recall(supply: E3631A, slot: int) -> None:
    supply.restore(supply.stored.get(slot, _DEFAULT_SETTINGS))


def _summary_condition(supply: E3631A, number: int) -> int:
    supply.observe()
    return _summary(supply, number).condition


def _summary(supply: E3631A, number: int) -> Register:
    return supply.outputs[_KINDS[number - 1].name].register


def _summary_event(supply: E3631A, number: int) -> int:
    supply.observe()
    return _summary(supply, number).read_event()


def _set_summary_enable(supply: E3631A, number: int, mask: int) -> None:
    _summary(supply, number).enable = mask


def _summary_enable(supply: E3631A, number: int) -> int:
    return _summary(supply, number).enable


# --- handlers: calibration --------------------------------------------------------------------------------


def _calibration_count(supply: E3631A) -> int:
    return supply.calibration.count


def _set_code(supply: E3631A, code: str) -> None:
    supply.calibration.require_unsecured()
    supply.calibration.code = code


def _set_secured(supply: E3631A, state: object, code: str) -> None:
    if code != supply.calibration.code:
        raise ScpiError(703)
    supply.calibration.secured = bool(state)


def _secured(supply: E3631A) -> bool:
    return supply.calibration.secured


def _set_calibration_text(supply: E3631A, text: str) -> None:
    supply.calibration.require_unsecured()
    supply.calibration.text = text


def _calibration_text(supply: E3631A) -> str:
    return supply.calibration.text


def _adjust(supply: E3631A, value: object) -> None:
    del value
    supply.calibration.require_unsecured()
    supply.calibration.count += 1


def _choose_point(supply: E3631A, point: str) -> None:
    del point
    supply.calibration.require_unsecured()


# --- the command list (p. 84-108) -------------------------------------------------------------------------

_INTERFACES = {"gpib": GPIB, "rs232": RS232}
_DIALECT = Dialect(queue_depth=20, number_not_allowed=-128, integer=bare_integer)
"""The guide prints every integer of a reply bare; that the wire has no sign either is unverified."""
_NR3 = real(8)
_OUTPUT = Choice(("P6V", "P25V", "N25V"))
_OUTPUT_OR_SELECTED = (Choice(("P6V", "P25V", "N25V"), required=False),)
_VOLTS = (Number(unit="V", limits=_volt_limits),)
_AMPS = (Number(unit="A", limits=_amp_limits),)
_SLOT = (Integer(limits=Limits(1, 3)),)
_ON_OFF = (Boolean(),)

TABLE = CommandTable(
    *COMMON_COMMANDS,
    # outputs
    Command(
        "APPLy",
        (
            _OUTPUT,
            Number(unit="V", required=False, deferred=True),
            Number(unit="A", required=False, deferred=True),
        ),
        do=_apply,
        query=_applied,
        query_parameters=_OUTPUT_OR_SELECTED,
        reply=quoted,
        takes_s=_PROGRAMMING_S,
    ),
    Command("INSTrument[:SELect]", (_OUTPUT,), do=_select, query=_selected),
    Command(
        "INSTrument:NSELect",
        (Integer(limits=Limits(1, 3)),),
        do=_select_number,
        query=_selected_number,
        query_parameters=(),
        reply=bare_integer,
    ),
    Command(
        "INSTrument:COUPle[:TRIGger]",
        (Choice(("ALL", "NONE", "P6V", "P25V", "N25V")),),
        do=_couple,
        query=_coupling,
        repeat=True,
    ),
    Command(
        "MEASure[:VOLTage][:DC]",
        query=_measure_volts,
        query_parameters=_OUTPUT_OR_SELECTED,
        reply=_NR3,
        query_takes_s=_READBACK_S,
    ),
    Command(
        "MEASure:CURRent[:DC]",
        query=_measure_amps,
        query_parameters=_OUTPUT_OR_SELECTED,
        reply=_NR3,
        query_takes_s=_READBACK_S,
    ),
    Command("OUTPut[:STATe]", _ON_OFF, do=_switch, query=_switched, reply=boolean, takes_s=_PROGRAMMING_S),
    Command("OUTPut:TRACk[:STATe]", _ON_OFF, do=_track, query=_tracking, reply=boolean, takes_s=_PROGRAMMING_S),
    Command(
        "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]",
        _AMPS,
        do=_set_amps,
        query=_amps,
        reply=_NR3,
        takes_s=_PROGRAMMING_S,
    ),
    Command(
        "[SOURce:]CURRent[:LEVel]:TRIGgered[:AMPLitude]",
        _AMPS,
        do=_set_triggered_amps,
        query=_triggered_amps,
        reply=_NR3,
    ),
    Command(
        "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]",
        _VOLTS,
        do=_set_volts,
        query=_volts,
        reply=_NR3,
        takes_s=_PROGRAMMING_S,
    ),
    Command(
        "[SOURce:]VOLTage[:LEVel]:TRIGgered[:AMPLitude]",
        _VOLTS,
        do=_set_triggered_volts,
        query=_triggered_volts,
        reply=_NR3,
    ),
    # trigger
    Command("INITiate[:IMMediate]", do=_initiate),
    Command(
        "TRIGger[:SEQuence]:DELay",
        (Number(unit="S", limits=Limits(0.0, 3600.0)),),
        do=_set_delay,
        query=_delay,
        reply=_NR3,
    ),
    Command("TRIGger[:SEQuence]:SOURce", (Choice(("BUS", "IMMediate")),), do=_set_source, query=_source),
    Command("*TRG", do=_trigger),
    # display and system
    Command("DISPlay[:WINDow][:STATe]", _ON_OFF, do=_set_display, query=_display, reply=boolean),
    Command("DISPlay[:WINDow]:TEXT[:DATA]", (Text(),), do=_set_display_text, query=_display_text, reply=quoted),
    Command("DISPlay[:WINDow]:TEXT:CLEar", do=_clear_display_text),
    Command("SYSTem:BEEPer[:IMMediate]", do=_beep),
    Command("SYSTem:ERRor:NEXT", query=next_error),  # SCPI's own optional node; not in the guide, unverified
    Command("SYSTem:VERSion", query=_version),
    Command("SYSTem:LOCal", do=_go_local),
    Command("SYSTem:REMote", do=_go_remote),
    Command("SYSTem:RWLock", do=_go_remote),
    Command("*TST", query=_self_test, query_takes_s=_SELF_TEST_S),
    Command("*SAV", _SLOT, do=_save),
    Command("*RCL", _SLOT, do=_recall, takes_s=_PROGRAMMING_S),
    # status
    event("STATus:QUEStionable[:EVENt]", lambda supply: supply.questionable),
    enable("STATus:QUEStionable:ENABle", lambda supply: supply.questionable),
    event("STATus:QUEStionable:INSTrument[:EVENt]", lambda supply: supply.instrument_summary),
    enable("STATus:QUEStionable:INSTrument:ENABle", lambda supply: supply.instrument_summary),
    Command("STATus:QUEStionable:INSTrument:ISUMmary<1-3>[:EVENt]", query=_summary_event, reply=bare_integer),
    Command("STATus:QUEStionable:INSTrument:ISUMmary<1-3>:CONDition", query=_summary_condition, reply=bare_integer),
    Command(
        "STATus:QUEStionable:INSTrument:ISUMmary<1-3>:ENABle",
        (Integer(limits=Limits(0, 32767)),),
        do=_set_summary_enable,
        query=_summary_enable,
        query_parameters=(),
        reply=bare_integer,
    ),
    # calibration
    Command("CALibration:COUNt", query=_calibration_count, reply=bare_integer),
    Command("CALibration:SECure:CODE", (Word(),), do=_set_code),
    Command("CALibration:SECure:STATe", (Boolean(), Word()), do=_set_secured, query=_secured, reply=boolean),
    Command("CALibration:STRing", (Text(limit=40),), do=_set_calibration_text, query=_calibration_text, reply=quoted),
    Command("CALibration:VOLTage[:DATA]", (Number(unit="V"),), do=_adjust),
    Command("CALibration:CURRent[:DATA]", (Number(unit="A"),), do=_adjust),
    Command("CALibration:VOLTage:LEVel", (Choice(("MINimum", "MAXimum")),), do=_choose_point),
    Command("CALibration:CURRent:LEVel", (Choice(("MINimum", "MAXimum")),), do=_choose_point),
)
