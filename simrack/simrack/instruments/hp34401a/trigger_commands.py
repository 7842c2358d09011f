"""Reading memory and triggers of the 34401A (User's Guide p. 126-128)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    ScpiError,
    Text,
    boolean,
    quoted,
    real,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_NR3 = real(8)
_ON_OFF = (Boolean(),)


def _trigger(meter: SimulatedHp34401A) -> None:
    if meter.triggering.source != "BUS" or not meter.triggering.waiting():
        raise ScpiError(-211)
    meter.triggering.fire()


def _set_feed(meter: SimulatedHp34401A, destination: str, source: str) -> None:
    del destination
    if source and source.upper() not in ("CALC", "CALCULATE"):
        raise ScpiError(-224)
    meter.triggering.feed = "CALC" if source else ""


def _feed(meter: SimulatedHp34401A, destination: str | None) -> str:
    del destination
    return meter.triggering.feed


def _points(meter: SimulatedHp34401A) -> int:
    return len(meter.triggering.memory)


def _set_source(meter: SimulatedHp34401A, source: str) -> None:
    meter.triggering.source = source


def _source(meter: SimulatedHp34401A) -> str:
    return meter.triggering.source


def _set_delay(meter: SimulatedHp34401A, seconds: float) -> None:
    meter.triggering.delay_s = round(seconds, 5)
    meter.triggering.delay_auto = False


def _delay(meter: SimulatedHp34401A) -> float:
    return meter.delay_s()


def _set_delay_auto(meter: SimulatedHp34401A, state: object) -> None:
    meter.triggering.delay_auto = bool(state)


def _delay_auto(meter: SimulatedHp34401A) -> bool:
    return meter.triggering.delay_auto


def _set_samples(meter: SimulatedHp34401A, count: int) -> None:
    meter.triggering.sample_count = count


def _samples(meter: SimulatedHp34401A) -> int:
    return meter.triggering.sample_count


def _set_triggers(meter: SimulatedHp34401A, count: float) -> None:
    meter.triggering.trigger_count = float(count)


def _triggers(meter: SimulatedHp34401A) -> float:
    return meter.triggering.trigger_count


COMMANDS = (
    Command(
        "DATA:FEED",
        (Choice(("RDG_STORE",)), Text()),
        do=_set_feed,
        query=_feed,
        query_parameters=(Choice(("RDG_STORE",), required=False),),
        reply=quoted,
    ),
    Command("DATA:POINts", query=_points, reply=signed_integer),
    Command("TRIGger:SOURce", (Choice(("BUS", "IMMediate", "EXTernal")),), do=_set_source, query=_source),
    Command("TRIGger:DELay", (Number(unit="S", limits=Limits(0.0, 3600.0)),), do=_set_delay, query=_delay, reply=_NR3),
    Command("TRIGger:DELay:AUTO", _ON_OFF, do=_set_delay_auto, query=_delay_auto, reply=boolean),
    Command(
        "TRIGger:COUNt",
        (Integer(limits=Limits(1, 50000), words={"INFinity": float("inf")}),),
        do=_set_triggers,
        query=_triggers,
        reply=_NR3,
    ),
    Command("SAMPle:COUNt", (Integer(limits=Limits(1, 50000)),), do=_set_samples, query=_samples, reply=signed_integer),
    Command("*TRG", do=_trigger, urgent=True),
)
