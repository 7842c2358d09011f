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
    attribute,
    boolean,
    quoted,
    real,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_NR3 = real(8)


def _trigger(meter: SimulatedHp34401A) -> None:
    if meter.triggering.source != "BUS" or not meter.triggering.waiting():
        raise ScpiError(-211)
    meter.triggering.fire()


def _set_feed(meter: SimulatedHp34401A, destination: str, source: str) -> None:
    del destination
    if source and source.upper() not in ("CALC", "CALCULATE"):
        raise ScpiError(-224)
    meter.triggering.feed = "CALC" if source else ""


def trigger_settings(counts: Limits, delay_digits: int) -> tuple[Command, ...]:
    """Declare source, delay and counts; delays are kept to so many decimals of a second."""

    def set_delay(meter: SimulatedHp34401A, seconds: float) -> None:
        meter.triggering.delay_s, meter.triggering.delay_auto = round(seconds, delay_digits), False

    count = Integer(limits=counts, words={"INFinity": float("inf")})
    return (
        attribute("TRIGger:SOURce", Choice(("BUS", "IMMediate", "EXTernal")), "triggering.source"),
        Command(
            "TRIGger:DELay",
            (Number(unit="S", limits=Limits(0.0, 3600.0)),),
            do=set_delay,
            query=lambda meter: meter.delay_s(),
            reply=_NR3,
        ),
        attribute("TRIGger:DELay:AUTO", Boolean(), "triggering.delay_auto", boolean),
        attribute("TRIGger:COUNt", count, "triggering.trigger_count", _NR3, convert=float),
        attribute("SAMPle:COUNt", Integer(limits=counts), "triggering.sample_count", signed_integer),
    )


BUS_TRIGGER = Command("*TRG", do=_trigger, urgent=True)

COMMANDS = (
    Command(
        "DATA:FEED",
        (Choice(("RDG_STORE",)), Text()),
        do=_set_feed,
        query=lambda meter, _: meter.triggering.feed,
        query_parameters=(Choice(("RDG_STORE",), required=False),),
        reply=quoted,
    ),
    Command("DATA:POINts", query=lambda meter: len(meter.triggering.memory), reply=signed_integer),
    *trigger_settings(Limits(1, 50000), 5),
    BUS_TRIGGER,
)
