"""Ranges, resolution, integration, autozero and input of the Truevolt series (guide p. 221, 223, 328, 345, 451)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from simrack.instruments.hp34401a import range_commands as classic
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.range_commands import RANGED
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.instruments.truevolt.measuring_commands import forgetting
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Limits,
    Number,
    Parameter,
    Text,
    attribute,
    bare_integer,
    boolean,
    quoted,
    real,
    remembered,
)

_NR3 = real(8)
_OF_PROBES: tuple[tuple[str, Parameter, Any, Callable[[Any], str]], ...] = (
    ("NPLCycles", Number(limits=Limits(0.02, 100.0), legal=(0.02, 0.2, 1.0, 10.0, 100.0)), 10.0, _NR3),
    ("ZERO:AUTO", Boolean(words=("ONCE",)), True, boolean),
    ("TRANsducer:TYPE", Choice(("FRTD", "RTD", "FTHermistor", "THERmistor", "TCouple")), "FRTD", str),
    ("TRANsducer:TCouple:TYPE", Choice(tuple("EJKNRT")), "J", str),
    *(
        (f"TRANsducer:{each}:TYPE", Number(limits=Limits(2252.0, 1e4), legal=(2252.0, 5e3, 1e4)), 5e3, bare_integer)
        for each in ("FTHermistor", "THERmistor")
    ),
    *(
        (f"TRANsducer:{each}:RESistance[:REFerence]", Number(unit="OHM", limits=Limits(49.0, 2100.0)), 100.0, _NR3)
        for each in ("FRTD", "RTD")
    ),
)
"""Of temperature, kept only (names: Keysight's help page of [SENSe:]TEMPerature; defaults unverified)."""
_ONCE = Boolean(words=("ONCE",))
_GATED = {"FREQ": "FREQuency", "PER": "PERiod"}
_NOTHING_THERE = {"TEMP": "TEMPerature", "CAP": "CAPacitance"}
_INTEGRATING = ("VOLT", "CURR", "RES", "FRES")
_ZEROED = ("VOLT", "CURR", "RES")
"""Four-wire resistance always takes a zero, as it does in the 34401A (unverified)."""


def _range_commands(function: Function, header: str) -> tuple[Command, ...]:
    """Declare RANGe as the 34401A has it, and RANGe:AUTO, which here knows ONCE too."""
    fixed, automatic = classic.range_commands(function, header)
    name = function.name

    def write(meter: SimulatedTruevolt, state: object) -> None:
        if state == "ONCE":
            meter.autorange_once(name)
        else:
            meter.setups[name].auto = bool(state)

    return fixed, replace(automatic, parameters=(_ONCE,), do=write)


def _aperture_commands(name: str, limits: tuple[float, float]) -> tuple[Command, ...]:
    header, seconds = RANGED[name], Number(unit="S", limits=Limits(*limits, 0.1))

    def write(meter: SimulatedTruevolt, seconds: float) -> None:
        """Keep the time as power line cycles, which need not be whole."""
        setup = meter.setups[name]
        setup.nplc = round(seconds, 6) * meter.line_hz
        setup.resolution = meter.functions[name].fraction_of(setup.nplc)
        meter.aperture_on[name] = True

    return (
        Command(
            f"[SENSe:]{header}:APERture",
            (seconds,),
            do=write,
            query=lambda meter: meter.inputs.aperture_s(meter.setups[name].nplc),
            reply=_NR3,
            reads=True,
        ),
        Command(
            f"[SENSe:]{header}:APERture:ENABled",
            (Boolean(),),
            do=lambda meter, state: meter.aperture_on.update({name: bool(state)}),
            query=lambda meter: meter.aperture_on[name],
            reply=boolean,
            reads=True,
        ),
    )


def _ending_aperture(name: str, command: Command) -> Command:
    """Power line cycles and resolution end an integration time in seconds (p. 329)."""
    do: Any = command.do

    def change(meter: SimulatedTruevolt, value: Any) -> None:
        do(meter, value)
        meter.aperture_on[name] = False

    return replace(command, do=change)


def _null_commands(name: str, header: str) -> tuple[Command, ...]:
    """Declare what is taken off the readings of a function, and what else may be shown beside them (kept only)."""
    null, path = f"[SENSe:]{header}:NULL", f"nulls[{name}]"
    number = Number(unit=("V", "A", "OHM", "HZ", "S", "C", "F"), limits=Limits(-1e15, 1e15, 0.0))
    return (
        attribute(f"{null}[:STATe]", Boolean(), f"{path}.on", boolean, do=lambda m, on: m.nulls[name].switch(on=on)),
        attribute(f"{null}:VALue", number, f"{path}.value", _NR3, do=lambda m, value: m.nulls[name].set_value(value)),
        attribute(f"{null}:VALue:AUTO", Boolean(), f"{path}.automatic", boolean),
        remembered(f"[SENSe:]{header}:SECondary", Text(), "OFF", quoted),
    )


def commands(kind: MeterKind) -> tuple[Command, ...]:
    """Return the commands of a model for ranges and integration."""
    functions = kind.functions()
    apertures = kind.apertures_s
    settings = (
        *(each for name, header in RANGED.items() for each in _range_commands(functions[name], header)),
        *(each for name, head in _GATED.items() for each in _range_commands(functions[name], f"{head}:VOLTage")),
        *(classic.gate_command(name, header) for name, header in _GATED.items()),
        *(
            remembered(f"[SENSe:]{head}:TIMeout:AUTO", Boolean(), default=False, reply=boolean)
            for head in _GATED.values()
        ),
        *(_ending_aperture(name, classic.resolution_command(functions[name], RANGED[name])) for name in _INTEGRATING),
        *(_ending_aperture(name, classic.nplc_command(functions[name], RANGED[name])) for name in _INTEGRATING),
        *(each for name in _INTEGRATING if apertures for each in _aperture_commands(name, apertures)),
        *(classic.zero_command(name, f"{RANGED[name]}:ZERO:AUTO", _ONCE) for name in _ZEROED),
        classic.bandwidth_command("[SENSe:]VOLTage:AC:BANDwidth"),
        classic.impedance_command("[SENSe:]VOLTage[:DC]:IMPedance:AUTO"),
        classic.bandwidth_command("[SENSe:]CURRent:AC:BANDwidth"),
        *(each for name, header in (RANGED | _GATED | _NOTHING_THERE).items() for each in _null_commands(name, header)),
        remembered("[SENSe:]CAPacitance:RANGe", Number(limits=Limits(1e-9, 1e-4)), 1e-6, _NR3),
        remembered("[SENSe:]CAPacitance:RANGe:AUTO", _ONCE, default=True, reply=boolean),
        *(
            remembered(f"[SENSe:]TEMPerature:{header}", parameter, default, reply)
            for header, parameter, default, reply in _OF_PROBES
        ),
        remembered("UNIT:TEMPerature", Choice(("C", "F", "K")), "C"),
    )
    return tuple(forgetting(each) for each in settings)
