"""Common parts of the simulated 2000 and DMM6500: ranges, integration, relative values, specimens."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simrack.instruments.hp34401a.functions import BY_NAME, Function
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.hp34401a.range_commands import RANGED, range_commands
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import NOTHING_THERE
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    ScpiError,
    Text,
    attribute,
    boolean,
    quoted,
    real,
    signed_integer,
)
from simrack.specifications import VoltmeterSpecification

_NR3 = real(8)
NAMES = MappingProxyType(
    {
        "VOLT": "VOLT:DC",
        "VOLT:AC": "VOLT:AC",
        "CURR": "CURR:DC",
        "CURR:AC": "CURR:AC",
        "RES": "RES",
        "FRES": "FRES",
        "FREQ": "FREQ",
        "PER": "PER",
        "CONT": "CONT",
        "DIOD": "DIOD",
        "TEMP": "TEMP",
    }
)
"""The functions that are simulated, and what the makers call them in replies; nothing is wired to the current input."""
_SHORT = {
    "VOLTAGE": "VOLT",
    "CURRENT": "CURR",
    "RESISTANCE": "RES",
    "FRESISTANCE": "FRES",
    "FREQUENCY": "FREQ",
    "PERIOD": "PER",
    "CONTINUITY": "CONT",
    "DIODE": "DIOD",
    "TEMPERATURE": "TEMP",
    "CAPACITANCE": "CAP",
}
ERROR_WORDS = {-222: "Parameter data out of range", -230: "Data corrupt or stale"}
"""Words that differ from SCPI's (manuals of both, as users quote them)."""
UNITS = MappingProxyType(
    {
        "VOLT": "VDC",
        "VOLT:AC": "VAC",
        "CURR": "ADC",
        "CURR:AC": "AAC",
        "RES": "OHM",
        "FRES": "OHM4W",
        "FREQ": "HZ",
        "PER": "SEC",
        "CONT": "OHM",
        "DIOD": "VDC",
        "TEMP": "C",
    }
)
"""Units as the 2000 writes them behind a reading (users' records of its readings; OHM4W and C unverified)."""


def functions_of(sheet: VoltmeterSpecification, *more: str) -> Mapping[str, Function]:
    """Return the measurement functions by name: a 34401A's with the resolutions of `sheet`, and `more`."""
    all_ = BY_NAME | NOTHING_THERE
    return MappingProxyType(
        {
            name: replace(all_[name], fractions=sheet.resolution) if all_[name].integrating else all_[name]
            for name in (*NAMES, *more, "VOLT:RAT")
        }
    )


def drawn(sheet: VoltmeterSpecification, rng: np.random.Generator) -> dict[str, Any]:
    """Return the imperfections of a 34401A, those of direct voltage drawn uniformly within the 1-year limits."""
    like, limit = MeterErrors.drawn(rng), sheet.accuracy_of(10.0, 365)
    fields = {name: getattr(like, name) for name in MeterErrors.__struct_fields__}
    gain_error, offset_v = (float(rng.uniform(-each, each)) for each in (limit.reading, limit.range * 10.0))
    return {**fields, "gain_error": gain_error, "offset_v": offset_v}


def ignored(meter: SimulatedTruevolt, *values: Any) -> None:
    """Take a command without any effect on this bench."""
    del meter, values


def chosen_function(meter: SimulatedTruevolt) -> str:
    """Return the name of the present function."""
    return NAMES.get(meter.function.name, meter.function.name)


def function_command(pattern: str, reply: Callable[[str], str] = quoted) -> Command:
    """Declare the choice of a function by name: VOLT:DC, VOLTage, RESistance."""

    def choose(meter: SimulatedTruevolt, name: str) -> None:
        known = ":".join(_SHORT.get(word, word) for word in name.strip().upper().split(":")).removesuffix(":DC")
        if known not in meter.functions or known == "VOLT:RAT":
            raise ScpiError(-224)
        meter.choose(meter.functions[known])

    return Command(pattern, (Text(),), do=choose, query=chosen_function, reply=reply)


def digits_commands(functions: Mapping[str, Function], root: str, limits: Limits) -> tuple[Command, ...]:
    """Declare the digits of each function, which are only shown."""
    return tuple(
        attribute(
            f"{root}{functions[name].header}:DIGits", Integer(limits=limits), f"kept[{name}].digits", signed_integer
        )
        for name in NAMES
    )


def with_sense(commands: Iterable[Command]) -> tuple[Command, ...]:
    """Return commands whose ``[SENSe:]`` may be written with its 1, as ``:SENS1:``."""
    return tuple(replace(each, pattern=each.pattern.replace("[SENSe:]", "[SENSe<1-1>:]")) for each in commands)


class KeptOfFunction(Struct):
    """Settings of a function that change no reading of this bench."""

    average: bool
    digits: int
    averaging: str = "REP"
    count: int = 10
    reference: float = 0.0
    relative: bool = False


def _integration(name: str, header: str, limits: tuple[float, float]) -> Command:
    """Any power-line cycles within the limits can be set; the resolution goes with them."""

    def write(meter: SimulatedTruevolt, cycles: float) -> None:
        setup = meter.setups[name]
        setup.nplc, setup.resolution = cycles, meter.functions[name].fraction_of(cycles)

    return Command(
        f"[SENSe:]{header}:NPLCycles",
        (Number(limits=Limits(*limits, 1.0)),),
        do=write,
        query=lambda meter: float(meter.setups[name].nplc),
        reply=_NR3,
    )


def settings_of_functions(
    functions: Mapping[str, Function], nplc: tuple[float, float], relative: str
) -> tuple[Command, ...]:
    """Declare ranges, integration, averaging and relative values of every function; `relative` is their word for it."""
    commands: list[Command] = []
    for name, header in RANGED.items():
        fixed, automatic = range_commands(functions[name], header)
        commands += [fixed, automatic]
        if functions[name].integrating:
            commands.append(_integration(name, header, nplc))
        commands += [
            attribute(f"[SENSe:]{header}:AVERage:STATe", Boolean(), f"kept[{name}].average", boolean),
            attribute(f"[SENSe:]{header}:AVERage:TCONtrol", Choice(("REPeat", "MOVing")), f"kept[{name}].averaging"),
            attribute(
                f"[SENSe:]{header}:AVERage:COUNt", Integer(limits=Limits(1, 100)), f"kept[{name}].count", signed_integer
            ),
            attribute(
                f"[SENSe:]{header}:{relative}", Number(limits=Limits(-1e9, 1e9, 0.0)), f"kept[{name}].reference", _NR3
            ),
            attribute(f"[SENSe:]{header}:{relative}:STATe", Boolean(), f"kept[{name}].relative", boolean),
        ]
    return tuple(commands)
