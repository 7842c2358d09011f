"""Ranges, resolution, integration and input of the 34401A (User's Guide p. 121-123)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from simrack.instruments.hp34401a.functions import APERTURES_S, BY_NAME, Function
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
from simrack.instruments.hp34401a.setup import attainable_fraction
from simrack.scpi import Boolean, Choice, Command, Limits, Number, attribute, boolean, real

_RANGE_CHANGE_S = 1 / 50
"""Range changes a second over the bus (p. 217)."""
FILTERS = MappingProxyType({3.0: 3.0, 20.0: 20.0, 200.0: 200.0})
_GATES_S = Limits(0.01, 1.0)
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


def range_commands(
    function: Function, header: str, reply: Callable[[Any], str] = _NR3, default: float | None = None
) -> tuple[Command, ...]:
    """Declare RANGe and RANGe:AUTO of one function; limits are the lowest range and the top one with its over-range."""
    ranged, name = function.voltage_ranged, function.name
    number = Number(unit=ranged.unit, limits=Limits(0.0, ranged.ranges[-1] * ranged.over_range, default))
    shown = Choice(("MINimum", "MAXimum"), required=False)
    bounds = {"MIN": ranged.ranges[0], "MAX": ranged.ranges[-1]}

    def write(meter: SimulatedHp34401A, value: float) -> None:
        setup = meter.setups[name]
        setup.range = meter.functions[name].voltage_ranged.range_for(value)
        setup.auto = False

    def read(meter: SimulatedHp34401A, which: str | None) -> float:
        return bounds[which] if which else float(meter.setups[name].range)

    return (
        Command(
            f"[SENSe:]{header}:RANGe[:UPPer]",
            (number,),
            do=write,
            query=read,
            query_parameters=(shown,),
            reply=reply,
            takes_s=_RANGE_CHANGE_S,
            reads=True,
        ),
        attribute(f"[SENSe:]{header}:RANGe:AUTO", Boolean(), f"setups[{name}].auto", boolean),
    )


def resolution_command(function: Function, header: str) -> Command:
    """Declare RESolution of one function."""
    legal, name = function.resolutions, function.name

    def write(meter: SimulatedHp34401A, value: Any) -> None:
        setup, function = meter.setups[name], meter.functions[name]
        setup.resolution = attainable_fraction(function, setup.range, value)
        setup.nplc = function.nplc_for(setup.resolution)

    def read(meter: SimulatedHp34401A, which: str | None) -> float:
        setup = meter.setups[name]
        part = {"MIN": min(legal), "MAX": max(legal)}[which] if which else setup.resolution
        return float(part * setup.range)

    return Command(
        f"[SENSe:]{header}:RESolution",
        (Number(unit=function.unit, deferred=True),),
        do=write,
        query=read,
        query_parameters=(Choice(("MINimum", "MAXimum"), required=False),),
        reply=_NR3,
        reads=True,
    )


def nplc_command(function: Function, header: str) -> Command:
    """Declare NPLCycles of one function: others are rounded to the nearest it has, by ratio (unverified)."""
    legal, name = tuple(function.fractions), function.name
    number = Number(limits=Limits(min(legal), max(legal)), legal=legal)

    def write(meter: SimulatedHp34401A, cycles: float) -> None:
        meter.setups[name].nplc = cycles
        meter.setups[name].resolution = meter.functions[name].fraction_of(cycles)

    return attribute(f"[SENSe:]{header}:NPLCycles", number, f"setups[{name}].nplc", _NR3, do=write)


def gate_command(
    name: str,
    header: str,
    limits: Limits = _GATES_S,
    legal: tuple[float, ...] = tuple(APERTURES_S),
    reply: Callable[[Any], str] = _NR3,
) -> Command:
    """Declare APERture of frequency or period: its gate time."""
    number = Number(unit="S", limits=limits, legal=legal)
    return attribute(f"[SENSe:]{header}:APERture", number, f"setups[{name}].aperture_s", reply)


def zero_command(name: str, header: str, parameter: Boolean) -> Command:
    """Declare the automatic zero of one function, of a meter that has one for each."""
    return Command(
        f"[SENSe:]{header}",
        (parameter,),
        do=lambda meter, state: meter.set_autozero(name, on=state is True),
        query=lambda meter: bool(meter.autozeroes(name)),
        reply=boolean,
        reads=True,
    )


def bandwidth_command(
    header: str, filters: Mapping[float, float] = FILTERS, reply: Callable[[Any], str] = _NR3
) -> Command:
    """Declare the bandwidth of alternating functions: a filter is chosen that is slow enough (p. 115).

    Where a meter has others (`filters`: its own to the 34401A's, Hz), it has the delays of the 34401A's (unverified).
    """
    shown = {filter_hz: hertz for hertz, filter_hz in filters.items()}
    return attribute(
        header,
        Number(unit="HZ", limits=Limits(min(filters), max(filters))),
        "bandwidth_hz",
        lambda filter_hz: reply(shown[filter_hz]),
        convert=lambda hertz: filters[max(each for each in filters if each <= hertz)],
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
    Command("ROUTe:TERMinals", query=lambda meter: "REAR" if meter.rear else "FRON", reads=True),
)
