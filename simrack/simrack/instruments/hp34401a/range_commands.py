"""Ranges, resolution, integration and input of the 34401A (User's Guide p. 121-123)."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Any

from simrack.instruments.hp34401a.functions import APERTURES_S, BY_NAME, Function
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
from simrack.instruments.hp34401a.setup import attainable_fraction
from simrack.scpi import Boolean, Choice, Command, Limits, Number, attribute, boolean, real

_RANGE_CHANGE_S = 1 / 50
"""Range changes a second over the bus (p. 217)."""
_NR3 = real(8)
RANGED = MappingProxyType(
    {
        "VOLT": "VOLTage[:DC]",
        "VOLT:AC": "VOLTage:AC",
        "CURR": "CURRent[:DC]",
        "CURR:AC": "CURRent:AC",
        "RES": "RESistance",
        "FRES": "FRESistance",
    }
)
"""The functions with ranges, and their headers."""
_INTEGRATING = ("VOLT", "CURR", "RES", "FRES")


def _set_range(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, value: float) -> None:
        setup = meter.setups[name]
        setup.range = meter.functions[name].voltage_ranged.range_for(value)
        setup.auto = False

    return write


def _resolution_limits(function: Function) -> Callable[[SimulatedHp34401A], Limits]:
    legal, name = function.resolutions, function.name
    return lambda meter: Limits(min(legal) * meter.setups[name].range, max(legal) * meter.setups[name].range)


def _set_resolution(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, value: Any) -> None:
        setup, function = meter.setups[name], meter.functions[name]
        setup.resolution = attainable_fraction(function, setup.range, value)
        setup.nplc = function.nplc_for(setup.resolution)

    return write


def range_commands(
    function: Function, header: str, reply: Callable[[Any], str] = _NR3, default: float | None = None
) -> tuple[Command, ...]:
    """Declare RANGe and RANGe:AUTO of one function; limits are the lowest range and the top one with its over-range."""
    ranged, name = function.voltage_ranged, function.name
    number = Number(unit=ranged.unit, limits=Limits(0.0, ranged.ranges[-1] * ranged.over_range, default))
    shown = Choice(("MINimum", "MAXimum"), required=False)
    bounds = {"MIN": ranged.ranges[0], "MAX": ranged.ranges[-1]}

    def read(meter: SimulatedHp34401A, which: str | None) -> float:
        return bounds[which] if which else float(meter.setups[name].range)

    return (
        Command(
            f"[SENSe:]{header}:RANGe[:UPPer]",
            (number,),
            do=_set_range(name),
            query=read,
            query_parameters=(shown,),
            reply=reply,
            takes_s=_RANGE_CHANGE_S,
        ),
        attribute(f"[SENSe:]{header}:RANGe:AUTO", Boolean(), f"setups[{name}].auto", boolean),
    )


def resolution_command(function: Function, header: str) -> Command:
    """Declare RESolution of one function."""
    limits, name = _resolution_limits(function), function.name
    return Command(
        f"[SENSe:]{header}:RESolution",
        (Number(unit=function.unit, deferred=True),),
        do=_set_resolution(name),
        query=_limited(lambda meter: float(meter.setups[name].resolution * meter.setups[name].range), limits),
        query_parameters=(Choice(("MINimum", "MAXimum"), required=False),),
        reply=_NR3,
    )


def _limited(value: Callable[..., float], limits: Callable[[SimulatedHp34401A], Limits]) -> Callable[..., float]:
    def read(meter: SimulatedHp34401A, which: str | None) -> float:
        if which is None:
            return value(meter)
        bounds = limits(meter)
        return bounds.minimum if which == "MIN" else bounds.maximum

    return read


def nplc_command(function: Function, header: str) -> Command:
    """Declare NPLCycles of one function: others are rounded to the nearest it has, by ratio (unverified)."""
    legal, name = tuple(function.fractions), function.name
    number = Number(limits=Limits(min(legal), max(legal)), legal=legal)

    def write(meter: SimulatedHp34401A, cycles: float) -> None:
        meter.setups[name].nplc = cycles
        meter.setups[name].resolution = meter.functions[name].fraction_of(cycles)

    return attribute(f"[SENSe:]{header}:NPLCycles", number, f"setups[{name}].nplc", _NR3, do=write)


def gate_command(name: str, header: str) -> Command:
    """Declare APERture of frequency or period: its gate time."""
    number = Number(unit="S", limits=Limits(0.01, 1.0), legal=tuple(APERTURES_S))
    return attribute(f"[SENSe:]{header}:APERture", number, f"setups[{name}].aperture_s", _NR3)


def bandwidth_command(header: str) -> Command:
    """Declare the bandwidth of alternating functions: a filter is chosen that is slow enough (p. 115)."""
    return attribute(
        header,
        Number(unit="HZ", limits=Limits(3.0, 200.0)),
        "bandwidth_hz",
        _NR3,
        convert=lambda hertz: 200.0 if hertz >= 200.0 else 20.0 if hertz >= 20.0 else 3.0,
    )


def impedance_command(header: str) -> Command:
    """Declare the automatic input impedance."""
    return attribute(header, Boolean(), "high_impedance", boolean)


COMMANDS = (
    *(command for name, header in RANGED.items() for command in range_commands(BY_NAME[name], header)),
    *range_commands(BY_NAME["FREQ"], "FREQuency:VOLTage"),
    *range_commands(BY_NAME["PER"], "PERiod:VOLTage"),
    *(resolution_command(BY_NAME[name], header) for name, header in RANGED.items()),
    *(nplc_command(BY_NAME[name], RANGED[name]) for name in _INTEGRATING),
    gate_command("FREQ", "FREQuency"),
    gate_command("PER", "PERiod"),
    bandwidth_command("[SENSe:]DETector:BANDwidth"),
    attribute("[SENSe:]ZERO:AUTO", Boolean(words=("ONCE",)), "autozero", boolean, convert=lambda state: state is True),
    impedance_command("INPut:IMPedance:AUTO"),
    Command("ROUTe:TERMinals", query=lambda _: "FRON"),
)
