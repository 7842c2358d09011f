"""MEASure, CONFigure, READ, INITiate, FETCh, DATA, triggers and samples of the Truevolt series.

Source: Operating and Service Guide p. 204, 257, 306; the help page of the DATA subsystem.

INITiate is overlapped: other commands are executed while it measures, FETCh? waits for the end, R? does not.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from simrack.instruments.hp34401a import trigger_commands
from simrack.instruments.hp34401a.measuring_commands import CONFIGURATION, FUNCTION, measurement_commands
from simrack.scpi import (
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    Pending,
    ScpiError,
    block,
    boolean,
    comma_list,
    real,
    signed_integer,
)
from simrack.scpi.parameters import Boolean

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.truevolt.instrument import SimulatedTruevolt
    from simrack.instruments.truevolt.kinds import MeterKind

_NR3 = real(8)
_READINGS = comma_list(_NR3)
_NOT_A_NUMBER = 9.91e37
AUTO = math.nan
"""What the word AUTO in place of a range is handed over as; no number that can be typed is."""
_UNITS = {"V": "VDC", "OHM": "OHM", "HZ": "HZ", "S": "SEC"}
"""Unit after DATA:LAST?'s reading; all but VDC are unverified."""


def forgetting(command: Command) -> Command:
    """Return `command` such that its setting ends the measurement and forgets readings (help page of DATA)."""
    do = command.do
    if do is None:
        return command

    def change(meter: SimulatedTruevolt, *arguments: Any) -> Any:
        meter.forget()
        return do(meter, *arguments)

    return replace(command, do=change)


def _finished(meter: SimulatedTruevolt, outcome: Callable[[], Any]) -> Any:
    """Return what `outcome` returns, once the measurement is at its end."""
    if meter.triggering.sequence is None:
        return outcome()
    return Pending(lambda: meter.clock.now() if meter.triggering.sequence is None else None, outcome)


def _read(meter: SimulatedTruevolt) -> Any:
    """READ?: INITiate, then FETCh?."""
    if meter.triggering.source == "BUS":
        raise ScpiError(-214)
    meter.triggering.start(stored=True)
    return _finished(meter, lambda: list(meter.triggering.memory))


def _initiate(meter: SimulatedTruevolt) -> None:
    meter.triggering.start(stored=True)


def _abort(meter: SimulatedTruevolt) -> None:
    meter.triggering.abort()


def _fetch(meter: SimulatedTruevolt) -> Any:
    def stored() -> list[float]:
        if not meter.triggering.memory:
            raise ScpiError(-230)
        return list(meter.triggering.memory)

    return _finished(meter, stored)


def _take_now(meter: SimulatedTruevolt, most: int | None) -> bytes:
    taken = meter.ring.take(most or meter.kind.memory)
    return block(_READINGS(taken).encode())


def _take_whole(meter: SimulatedTruevolt, count: int, wait: str | None) -> Any:
    """DATA:REMove?: with WAIT it waits for them; that too few without it are -222 is unverified."""
    memory = meter.ring

    def taken() -> list[float]:
        if len(memory.memory) < count:
            raise ScpiError(-222)
        return memory.take(count)

    if wait is None or len(memory.memory) >= count:
        return taken()

    def ready_at() -> float | None:
        there = len(memory.memory) >= count or memory.sequence is None
        return meter.clock.now() if there else None

    return Pending(ready_at, taken)


def _last(meter: SimulatedTruevolt) -> str:
    last = meter.ring.last
    unit = "VAC" if meter.function.name == "VOLT:AC" else _UNITS[meter.function.unit]
    return f"{_NR3(_NOT_A_NUMBER if last is None else last)} {unit}"


def _set_slope(meter: SimulatedTruevolt, slope: str) -> None:
    meter.ring.slope = slope


def _slope(meter: SimulatedTruevolt) -> str:
    return meter.ring.slope


def _set_samples(meter: SimulatedTruevolt, count: int) -> None:
    meter.triggering.sample_count = count


def _samples(meter: SimulatedTruevolt) -> int:
    return meter.triggering.sample_count


def _set_triggers(meter: SimulatedTruevolt, count: float) -> None:
    meter.triggering.trigger_count = float(count)


def _triggers(meter: SimulatedTruevolt) -> float:
    return meter.triggering.trigger_count


def _set_source(meter: SimulatedTruevolt, source: str) -> None:
    meter.triggering.source = source


def _source(meter: SimulatedTruevolt) -> str:
    return meter.triggering.source


def _set_delay(meter: SimulatedTruevolt, seconds: float) -> None:
    meter.triggering.delay_s = round(seconds, 6)
    meter.triggering.delay_auto = False


def _delay(meter: SimulatedTruevolt) -> float:
    return meter.delay_s()


def _set_delay_auto(meter: SimulatedTruevolt, state: object) -> None:
    meter.triggering.delay_auto = bool(state)


def _delay_auto(meter: SimulatedTruevolt) -> bool:
    return meter.triggering.delay_auto


def _trigger_commands(kind: MeterKind) -> tuple[Command, ...]:
    counts = Limits(1, kind.most_readings, 1)
    settings = (
        Command("SAMPle:COUNt", (Integer(limits=counts),), do=_set_samples, query=_samples, reply=signed_integer),
        Command(
            "TRIGger:COUNt",
            (Integer(limits=counts, words={"INFinity": float("inf")}),),
            do=_set_triggers,
            query=_triggers,
            reply=_NR3,
        ),
        Command("TRIGger:SOURce", (Choice(("IMMediate", "EXTernal", "BUS")),), do=_set_source, query=_source),
        Command(
            "TRIGger:DELay", (Number(unit="S", limits=Limits(0.0, 3600.0)),), do=_set_delay, query=_delay, reply=_NR3
        ),
        Command("TRIGger:DELay:AUTO", (Boolean(),), do=_set_delay_auto, query=_delay_auto, reply=boolean),
        Command("TRIGger:SLOPe", (Choice(("POSitive", "NEGative")),), do=_set_slope, query=_slope),
    )
    return tuple(forgetting(each) for each in settings)


def commands(kind: MeterKind) -> tuple[Command, ...]:
    """Return what a model understands of measuring."""
    of_functions = (
        each for function in kind.functions().values() for each in measurement_commands(function, _read, {"AUTO": AUTO})
    )
    return (
        *(forgetting(each) for each in of_functions),
        CONFIGURATION,
        replace(forgetting(FUNCTION), pattern="[SENSe:]FUNCtion[:ON]"),
        Command("READ", query=_read, reply=_READINGS),
        Command("INITiate[:IMMediate]", do=_initiate),
        Command("ABORt", do=_abort),
        Command("FETCh", query=_fetch, reply=_READINGS),
        Command("R", query=_take_now, query_parameters=(Integer(limits=Limits(1, 2e6), required=False),)),
        Command(
            "DATA:REMove",
            query=_take_whole,
            query_parameters=(Integer(limits=Limits(1, 2e6)), Choice(("WAIT",), required=False)),
            reply=_READINGS,
        ),
        Command("DATA:LAST", query=_last),
        Command("DATA:POINts", query=lambda meter: len(meter.triggering.memory), reply=signed_integer),
        *_trigger_commands(kind),
        *(each for each in trigger_commands.COMMANDS if each.pattern == "*TRG"),
    )
