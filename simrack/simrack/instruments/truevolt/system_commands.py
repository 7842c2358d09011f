"""Display, beeper, identity and status of the Truevolt series (guide p. 269)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import Boolean, Choice, Command, Text, attribute, boolean, condition, enable, event, quoted

if TYPE_CHECKING:
    from simrack.instruments.truevolt.instrument import SimulatedTruevolt
    from simrack.instruments.truevolt.kinds import MeterKind

_SELF_TEST_S = 2.0
"""*TST? (unverified)."""
_TEXT_LIMIT = 40
"""Characters on the display (users' drivers)."""


def _self_test(meter: SimulatedTruevolt) -> str:
    meter.forget()
    return "+0"


def _preset_status(meter: SimulatedTruevolt) -> None:
    meter.questionable.enable = 0
    meter.operation.enable = 0


def _identities(kind: MeterKind) -> tuple[str, ...]:
    """Return the words of SYSTem:IDENtify (p. 270)."""
    older = ("HP34401A", "AT34461A") if kind.model == "34461A" else ("HP34401A", "AT34410A", "AT34411A")
    return ("DEFault", *older)


def commands(kind: MeterKind) -> tuple[Command, ...]:
    """Return the system commands of a model."""
    return (
        attribute("DISPlay[:STATe]", Boolean(), "display_on", boolean),
        attribute("DISPlay:TEXT[:DATA]", Text(), "display_text", quoted, convert=lambda text: text[:_TEXT_LIMIT]),
        Command("DISPlay:TEXT:CLEar", do=lambda meter: setattr(meter, "display_text", "")),
        Command("ROUTe:TERMinals", query=lambda _meter: "FRON"),
        Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
        attribute("SYSTem:BEEPer:STATe", Boolean(), "beeper", boolean),
        attribute("SYSTem:IDENtify", Choice(_identities(kind)), "identifies_as"),
        Command("SYSTem:LFRequency", query=lambda meter: f"{meter.line_hz:+d}"),
        Command("SYSTem:LICense:CATalog", query=lambda _meter: '""'),
        Command("SYSTem:LOCal", do=lambda _: None),
        Command("SYSTem:PRESet", do=lambda meter: meter.reset()),
        Command("SYSTem:VERSion", query=lambda _meter: "1994.0"),
        Command("*OPT", query=lambda _meter: "0,0,0"),
        Command("*TST", query=_self_test, query_takes_s=_SELF_TEST_S),
        event("STATus:OPERation[:EVENt]", lambda meter: meter.operation),
        condition("STATus:OPERation:CONDition", lambda meter: meter.operation),
        enable("STATus:OPERation:ENABle", "operation"),
        event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
        condition("STATus:QUEStionable:CONDition", lambda meter: meter.questionable),
        enable("STATus:QUEStionable:ENABle", "questionable"),
        Command("STATus:PRESet", do=_preset_status),
    )
