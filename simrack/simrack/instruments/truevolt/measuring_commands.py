"""MEASure, CONFigure, READ, INITiate, FETCh, DATA, triggers and samples of the Truevolt series.

Source: Operating and Service Guide p. 204, 257, 306; the help page of the DATA subsystem.

INITiate is overlapped: other commands are executed while it measures, FETCh? waits for the end, R? does not.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from simrack import scpi
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.measuring_commands import CONFIGURATION, FUNCTION, measurement_commands
from simrack.instruments.hp34401a.range_commands import RANGED
from simrack.instruments.hp34401a.trigger_commands import BUS_TRIGGER, trigger_settings
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.scpi.formats import NOT_A_NUMBER

ROWS = scpi.Rows()

_NR3 = scpi.real(8)
_READINGS = scpi.comma_list(_NR3)
AUTO = math.nan
"""What the word AUTO in place of a range is handed over as; no number that can be typed is."""
_FORMAT = ("FORMat[:DATA]",)
_BINARY = {"REAL,32": "f", "REAL,64": "d"}
_UNITS = {"V": "VDC", "A": "ADC", "OHM": "OHM", "HZ": "HZ", "S": "SEC", "C": "C", "F": "F"}
"""Unit after DATA:LAST?'s reading; all but VDC are unverified."""
_PROBE = (
    scpi.Choice(("FRTD", "RTD", "FTHermistor", "THERmistor", "TCouple", "DEFault"), required=False),
    scpi.Number(required=False, words=dict.fromkeys("EJKNRT", 0.0)),
    *(scpi.Number(required=False),) * 2,
)
"""After CONFigure:TEMPerature: probe, its type, 1, resolution (command quick reference)."""

_OF_34465A = (
    scpi.attribute("SAMPle:SOURce", scpi.Choice(("IMMediate", "TIMer")), "ring.paced_by"),
    scpi.attribute(
        "SAMPle:TIMer",
        scpi.Number(unit="S", limits=lambda meter: scpi.Limits(meter.shortest_interval_s(), 3600.0, 1.0)),
        "ring.interval_s",
        _NR3,
    ),
    scpi.remembered("SAMPle:COUNt:PRETrigger", scpi.Integer(limits=scpi.Limits(0, 49_999, 0)), 0, scpi.signed_integer),
    scpi.remembered("TRIGger:LEVel", scpi.Number(unit=("V", "A"), limits=scpi.Limits(-1e9, 1e9, 0.0)), 0.0, _NR3),
)
"""The guide as QCoDeS' driver quotes it. A reading may outlast the timer. Level and pretrigger are kept only."""


def forgetting(command: scpi.Command) -> scpi.Command:
    """Return `command` such that its setting ends the measurement and forgets readings (help page of DATA)."""
    do = command.do
    if do is None:
        return command

    def change(meter: SimulatedTruevolt, *arguments: Any) -> Any:
        meter.forget()
        return do(meter, *arguments)

    return replace(command, do=change)


def once_idle(meter: SimulatedTruevolt, outcome: Callable[[], Any]) -> Any:
    """Return the value of `outcome`, once the measurement is at its end."""
    if meter.triggering.sequence is None:
        return outcome()
    return scpi.Pending(lambda: meter.clock.now() if meter.triggering.sequence is None else None, outcome)


@ROWS.do(
    *_FORMAT,
    (scpi.Choice(("ASCii", "REAL")), scpi.Integer(limits=scpi.Limits(0, 64), required=False)),
    query=lambda meter: meter.engine.remembered.get(_FORMAT, "ASC"),
    query_parameters=(),
    reads=True,
)
def _set_format(meter: SimulatedTruevolt, form: str, length: int | None) -> None:
    """FORMat[:DATA]: text of any length reads the same."""
    form = form if form == "ASC" else f"{form},{length or 64}"
    if form not in {"ASC", *_BINARY}:
        raise scpi.ScpiError(-222)
    meter.engine.remembered[_FORMAT] = form


def _formed(meter: SimulatedTruevolt, readings: list[float]) -> str | bytes:
    """Return readings as FORMat has them: text, or a block of numbers."""
    kept = meter.engine.remembered
    if (form := kept.get(_FORMAT, "ASC")) == "ASC":
        return _READINGS(readings)
    order = "<" if kept.get(("FORMat:BORDer",)) == "SWAP" else ">"
    return scpi.block(struct.pack(f"{order}{len(readings)}{_BINARY[form]}", *readings))


def _as_formed(readings: str | bytes) -> str | bytes:
    return readings


def _read(meter: SimulatedTruevolt) -> Any:
    """READ?: INITiate, then FETCh?."""
    if meter.triggering.source == "BUS":
        raise scpi.ScpiError(-214)
    meter.triggering.start(stored=True)
    return once_idle(meter, lambda: _formed(meter, meter.triggering.memory))


def _fetch(meter: SimulatedTruevolt) -> Any:
    def stored() -> str | bytes:
        if not meter.triggering.memory:
            raise scpi.ScpiError(-230)
        return _formed(meter, meter.triggering.memory)

    return once_idle(meter, stored)


def _take_whole(meter: SimulatedTruevolt, count: int, wait: str | None) -> Any:
    """DATA:REMove?: with WAIT it waits for them; that too few without it are -222 is unverified."""
    memory = meter.ring

    def taken() -> str | bytes:
        if len(memory.memory) < count:
            raise scpi.ScpiError(-222)
        return _formed(meter, memory.take(count))

    if wait is None or len(memory.memory) >= count:
        return taken()

    def ready_at() -> float | None:
        there = len(memory.memory) >= count or memory.sequence is None
        return meter.clock.now() if there else None

    return scpi.Pending(ready_at, taken)


def _last(meter: SimulatedTruevolt) -> str:
    last = meter.ring.last
    unit = {"VOLT:AC": "VAC", "CURR:AC": "AAC"}.get(meter.function.name, _UNITS[meter.function.unit])
    return f"{_NR3(NOT_A_NUMBER if last is None else last)} {unit}"


def _second(meter: SimulatedTruevolt) -> float:
    """Return the secondary measurement: the reading before mathematics, not a number for what is kept only."""
    header = RANGED.get(meter.function.name, meter.function.header)
    second = meter.engine.remembered.get((f"[SENSe:]{header}:SECondary",), "OFF")
    known = second.upper().startswith("CALC") and meter.ring.last is not None
    return meter.before_mathematics if known else NOT_A_NUMBER


def _temperature_commands(function: Function) -> tuple[scpi.Command, ...]:
    """Declare CONFigure and MEASure of temperature; without a probe all of them read the same."""
    configure, measure = measurement_commands(function, _read)

    def set_up(meter: SimulatedTruevolt, *_probe: object) -> None:
        meter.configure(function, None, None)

    def read(meter: SimulatedTruevolt, *_probe: object) -> Any:
        set_up(meter)
        return _read(meter)

    return replace(configure, parameters=_PROBE, do=set_up), replace(measure, query_parameters=_PROBE, query=read)


def commands(kind: MeterKind) -> tuple[scpi.Command, ...]:
    """Return the measuring commands of a model."""
    functions = dict(kind.functions())
    temperature = _temperature_commands(functions.pop("TEMP"))
    short = [replace(functions[name], header=word) for name, word in (("VOLT", "DC"), ("VOLT:AC", "AC"))]
    all_of_them = (*functions.values(), *short)
    of_functions = (each for function in all_of_them for each in measurement_commands(function, _read, {"AUTO": AUTO}))
    return (
        *ROWS,
        *(forgetting(replace(each, reply=_as_formed)) for each in (*of_functions, *temperature)),
        CONFIGURATION,
        replace(forgetting(FUNCTION), pattern="[SENSe:]FUNCtion[:ON]"),
        scpi.Command("READ", query=_read),
        scpi.Command("INITiate[:IMMediate]", do=lambda meter: meter.triggering.start(stored=True)),
        scpi.Command("ABORt", do=lambda meter: meter.triggering.abort()),
        scpi.Command("FETCh", query=_fetch),
        scpi.Command(
            "R",
            query=lambda meter, most: _READINGS(meter.ring.take(most or meter.kind.memory)).encode(),
            query_parameters=(scpi.Integer(limits=scpi.Limits(1, 2e6), required=False),),
            reply=scpi.block,
        ),
        scpi.Command(
            "DATA:REMove",
            query=_take_whole,
            query_parameters=(scpi.Integer(limits=scpi.Limits(1, 2e6)), scpi.Choice(("WAIT",), required=False)),
        ),
        scpi.Command("DATA:LAST", query=_last),
        scpi.Command("[SENSe:]DATA2", query=_second, reply=_NR3),
        scpi.Command(
            "DATA:POINts", query=lambda meter: len(meter.triggering.memory), reply=scpi.signed_integer, reads=True
        ),
        *(forgetting(each) for each in trigger_settings(scpi.Limits(1, kind.most_readings, 1), 6)),
        forgetting(scpi.attribute("TRIGger:SLOPe", scpi.Choice(("POSitive", "NEGative")), "ring.slope")),
        *(forgetting(each) for each in _OF_34465A if kind.apertures_s),
        BUS_TRIGGER,
    )
