"""Ranges, resolution, integration, autozero and input of the Truevolt series (guide p. 221, 223, 328, 345, 451)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.range_commands import (
    bandwidth_command,
    gate_command,
    impedance_command,
    nplc_command,
    range_commands,
    resolution_command,
)
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.instruments.truevolt.measuring_commands import forgetting
from simrack.scpi import Boolean, Command, Limits, Number, attribute, boolean, real

_NR3 = real(8)
_ON_OFF = (Boolean(),)
_ONCE = (Boolean(words=("ONCE",)),)
_RANGED = {"VOLT": "VOLTage[:DC]", "VOLT:AC": "VOLTage:AC", "RES": "RESistance", "FRES": "FRESistance"}
_INTEGRATING = ("VOLT", "RES", "FRES")
_ZEROED = ("VOLT", "RES")
"""Four-wire resistance always takes a zero, as it does in the 34401A (unverified)."""


def _zero_command(name: str) -> Command:
    header = _RANGED[name]
    return Command(
        f"[SENSe:]{header}:ZERO:AUTO",
        _ONCE,
        do=lambda meter, state: meter.set_autozero(name, on=state is True),
        query=lambda meter: bool(meter.autozeroes(name)),
        reply=boolean,
    )


def _range_commands(function: Function, header: str) -> tuple[Command, ...]:
    """Declare RANGe as the 34401A has it, and RANGe:AUTO, which here knows ONCE too."""
    fixed, automatic = range_commands(function, header)
    name = function.name

    def write(meter: SimulatedTruevolt, state: object) -> None:
        if state == "ONCE":
            meter.autorange_once(name)
        else:
            meter.setups[name].auto = bool(state)

    return fixed, replace(automatic, parameters=_ONCE, do=write)


def _set_aperture(name: str) -> Callable[..., None]:
    """The integration time in seconds is kept as power line cycles, which need not be whole."""

    def write(meter: SimulatedTruevolt, seconds: float) -> None:
        setup = meter.setups[name]
        setup.nplc = round(seconds, 6) * meter.line_hz
        setup.resolution = meter.functions[name].fraction_of(setup.nplc)
        meter.aperture_on[name] = True

    return write


def _enable_aperture(name: str) -> Callable[..., None]:
    def write(meter: SimulatedTruevolt, state: object) -> None:
        meter.aperture_on[name] = bool(state)

    return write


def _aperture_commands(name: str, limits: tuple[float, float]) -> tuple[Command, ...]:
    header, seconds = _RANGED[name], Number(unit="S", limits=Limits(*limits, 0.1))
    return (
        Command(
            f"[SENSe:]{header}:APERture",
            (seconds,),
            do=_set_aperture(name),
            query=lambda meter: meter.inputs.aperture_s(meter.setups[name].nplc),
            reply=_NR3,
        ),
        Command(
            f"[SENSe:]{header}:APERture:ENABled",
            _ON_OFF,
            do=_enable_aperture(name),
            query=lambda meter: meter.aperture_on[name],
            reply=boolean,
        ),
    )


def _ending_aperture(name: str, command: Command) -> Command:
    """Power line cycles and resolution end an integration time in seconds (p. 329)."""
    do: Any = command.do

    def change(meter: SimulatedTruevolt, value: Any) -> None:
        do(meter, value)
        meter.aperture_on[name] = False

    return replace(command, do=change)


_NULL = "[SENSe:]VOLTage[:DC]:NULL"


def commands(kind: MeterKind) -> tuple[Command, ...]:
    """Return the commands of a model for ranges and integration."""
    functions = kind.functions()
    apertures = kind.apertures_s
    settings = (
        *(each for name, header in _RANGED.items() for each in _range_commands(functions[name], header)),
        *_range_commands(functions["FREQ"], "FREQuency:VOLTage"),
        *_range_commands(functions["PER"], "PERiod:VOLTage"),
        *(_ending_aperture(name, resolution_command(functions[name], _RANGED[name])) for name in _INTEGRATING),
        *(_ending_aperture(name, nplc_command(functions[name], _RANGED[name])) for name in _INTEGRATING),
        *(each for name in _INTEGRATING if apertures for each in _aperture_commands(name, apertures)),
        gate_command("FREQ", "FREQuency"),
        gate_command("PER", "PERiod"),
        *(_zero_command(name) for name in _ZEROED),
        bandwidth_command("[SENSe:]VOLTage:AC:BANDwidth"),
        impedance_command("[SENSe:]VOLTage[:DC]:IMPedance:AUTO"),
        attribute(f"{_NULL}[:STATe]", Boolean(), "null.on", boolean, do=lambda meter, on: meter.null.switch(on=on)),
        attribute(
            f"{_NULL}:VALue",
            Number(unit="V", limits=Limits(-1200.0, 1200.0, 0.0)),
            "null.value",
            _NR3,
            do=lambda meter, volts: meter.null.set_value(volts),
        ),
        attribute(f"{_NULL}:VALue:AUTO", Boolean(), "null.automatic", boolean),
    )
    return tuple(forgetting(each) for each in settings)
