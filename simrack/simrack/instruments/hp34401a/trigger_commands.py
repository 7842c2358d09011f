"""Reading memory and triggers of the 34401A (User's Guide p. 126-128)."""

from __future__ import annotations

from simrack import scpi
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_NR3 = scpi.real(8)


def _trigger(meter: SimulatedHp34401A) -> None:
    if meter.triggering.source != "BUS" or not meter.triggering.waiting():
        raise scpi.ScpiError(-211)
    meter.triggering.fire()


def _set_feed(meter: SimulatedHp34401A, destination: str, source: str) -> None:
    del destination
    if source and source.upper() not in ("CALC", "CALCULATE"):
        raise scpi.ScpiError(-224)
    meter.triggering.feed = "CALC" if source else ""


def trigger_settings(counts: scpi.Limits, delay_digits: int) -> tuple[scpi.Command, ...]:
    """Declare source, delay and counts; delays are kept to so many decimals of a second."""

    def set_delay(meter: SimulatedHp34401A, seconds: float) -> None:
        meter.triggering.delay_s, meter.triggering.delay_auto = round(seconds, delay_digits), False

    count = scpi.Integer(limits=counts, words={"INFinity": float("inf")})
    return (
        scpi.attribute("TRIGger:SOURce", scpi.Choice(("BUS", "IMMediate", "EXTernal")), "triggering.source"),
        scpi.Command(
            "TRIGger:DELay",
            (scpi.Number(unit="S", limits=scpi.Limits(0.0, 3600.0)),),
            do=set_delay,
            query=lambda meter: meter.delay_s(),
            reply=_NR3,
            reads=True,
        ),
        scpi.attribute("TRIGger:DELay:AUTO", scpi.Boolean(), "triggering.delay_auto", scpi.boolean),
        scpi.attribute("TRIGger:COUNt", count, "triggering.trigger_count", _NR3, convert=float),
        scpi.attribute("SAMPle:COUNt", scpi.Integer(limits=counts), "triggering.sample_count", scpi.signed_integer),
    )


BUS_TRIGGER = scpi.Command("*TRG", do=_trigger, urgent=True)

COMMANDS = (
    scpi.Command(
        "DATA:FEED",
        (scpi.Choice(("RDG_STORE",)), scpi.Text()),
        do=_set_feed,
        query=lambda meter, _: meter.triggering.feed,
        query_parameters=(scpi.Choice(("RDG_STORE",), required=False),),
        reply=scpi.quoted,
        reads=True,
    ),
    scpi.Command(
        "DATA:POINts", query=lambda meter: len(meter.triggering.memory), reply=scpi.signed_integer, reads=True
    ),
    *trigger_settings(scpi.Limits(1, 50000), 5),
    BUS_TRIGGER,
)
