"""Ranges, resolution, integration and input of the 34401A (User's Guide p. 121-123)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simrack.instruments.hp34401a.functions import APERTURES_S, BY_NAME
from simrack.instruments.hp34401a.setup import attainable_fraction
from simrack.scpi import Boolean, Choice, Command, Limits, Number, boolean, real

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.hp34401a.functions import Function
    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_RANGE_CHANGE_S = 1 / 50
"""Range changes a second over the bus (p. 217)."""
_NR3 = real(8)
_ON_OFF = (Boolean(),)
_RANGED = {
    "VOLT": "VOLTage[:DC]",
    "VOLT:AC": "VOLTage:AC",
    "CURR": "CURRent[:DC]",
    "CURR:AC": "CURRent:AC",
    "RES": "RESistance",
    "FRES": "FRESistance",
}
_INTEGRATING = ("VOLT", "CURR", "RES", "FRES")


def _set_range(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, value: float) -> None:
        setup = meter.setups[name]
        setup.range = meter.functions[name].voltage_ranged.range_for(value)
        setup.auto = False

    return write


def _range(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].range)


def _set_auto(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, state: object) -> None:
        meter.setups[name].auto = bool(state)

    return write


def _auto(name: str) -> Callable[..., bool]:
    return lambda meter: bool(meter.setups[name].auto)


def _resolution_limits(function: Function) -> Callable[[SimulatedHp34401A], Limits]:
    legal, name = function.resolutions, function.name
    return lambda meter: Limits(min(legal) * meter.setups[name].range, max(legal) * meter.setups[name].range)


def _set_resolution(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, value: Any) -> None:
        setup, function = meter.setups[name], meter.functions[name]
        setup.resolution = attainable_fraction(function, setup.range, value)
        setup.nplc = function.nplc_for(setup.resolution)

    return write


def _resolution(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].resolution * meter.setups[name].range)


def _set_nplc(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, cycles: float) -> None:
        meter.setups[name].nplc = cycles
        meter.setups[name].resolution = meter.functions[name].fraction_of(cycles)

    return write


def _nplc(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].nplc)


def _set_aperture(name: str) -> Callable[..., None]:
    def write(meter: SimulatedHp34401A, seconds: float) -> None:
        meter.setups[name].aperture_s = seconds

    return write


def _aperture(name: str) -> Callable[..., float]:
    return lambda meter: float(meter.setups[name].aperture_s)


def _set_bandwidth(meter: SimulatedHp34401A, hertz: float) -> None:
    """A filter is chosen that is slow enough for `hertz` (p. 115)."""
    meter.bandwidth_hz = 200.0 if hertz >= 200.0 else 20.0 if hertz >= 20.0 else 3.0


def _bandwidth(meter: SimulatedHp34401A) -> float:
    return meter.bandwidth_hz


def _set_autozero(meter: SimulatedHp34401A, state: object) -> None:
    meter.autozero = state is True


def _autozero(meter: SimulatedHp34401A) -> bool:
    return meter.autozero


def _set_impedance(meter: SimulatedHp34401A, state: object) -> None:
    meter.high_impedance = bool(state)


def _impedance(meter: SimulatedHp34401A) -> bool:
    return meter.high_impedance


def _terminals(meter: SimulatedHp34401A) -> str:
    del meter
    return "FRON"


def range_commands(function: Function, header: str) -> tuple[Command, ...]:
    """Declare RANGe and RANGe:AUTO of one function; limits are the lowest range and the top one with its over-range."""
    ranged, name = function.voltage_ranged, function.name
    number = Number(unit=ranged.unit, limits=Limits(0.0, ranged.ranges[-1] * ranged.over_range))
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
            reply=_NR3,
            takes_s=_RANGE_CHANGE_S,
        ),
        Command(f"[SENSe:]{header}:RANGe:AUTO", _ON_OFF, do=_set_auto(name), query=_auto(name), reply=boolean),
    )


def resolution_command(function: Function, header: str) -> Command:
    """Declare RESolution of one function."""
    limits, name = _resolution_limits(function), function.name
    return Command(
        f"[SENSe:]{header}:RESolution",
        (Number(unit=function.unit, deferred=True),),
        do=_set_resolution(name),
        query=_limited(_resolution(name), limits),
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
    """Declare NPLCycles of one function: other power line cycles are rounded up to those it has."""
    legal, name = tuple(function.fractions), function.name
    number = Number(limits=Limits(min(legal), max(legal)), legal=legal)
    return Command(f"[SENSe:]{header}:NPLCycles", (number,), do=_set_nplc(name), query=_nplc(name), reply=_NR3)


def gate_command(name: str, header: str) -> Command:
    """Declare APERture of frequency or period: its gate time."""
    number = Number(unit="S", limits=Limits(0.01, 1.0), legal=tuple(APERTURES_S))
    return Command(f"[SENSe:]{header}:APERture", (number,), do=_set_aperture(name), query=_aperture(name), reply=_NR3)


COMMANDS = (
    *(command for name, header in _RANGED.items() for command in range_commands(BY_NAME[name], header)),
    *range_commands(BY_NAME["FREQ"], "FREQuency:VOLTage"),
    *range_commands(BY_NAME["PER"], "PERiod:VOLTage"),
    *(resolution_command(BY_NAME[name], header) for name, header in _RANGED.items()),
    *(nplc_command(BY_NAME[name], _RANGED[name]) for name in _INTEGRATING),
    gate_command("FREQ", "FREQuency"),
    gate_command("PER", "PERiod"),
    Command(
        "[SENSe:]DETector:BANDwidth",
        (Number(unit="HZ", limits=Limits(3.0, 200.0)),),
        do=_set_bandwidth,
        query=_bandwidth,
        reply=_NR3,
    ),
    Command("[SENSe:]ZERO:AUTO", (Boolean(words=("ONCE",)),), do=_set_autozero, query=_autozero, reply=boolean),
    Command("INPut:IMPedance:AUTO", _ON_OFF, do=_set_impedance, query=_impedance, reply=boolean),
    Command("ROUTe:TERMinals", query=_terminals),
)
