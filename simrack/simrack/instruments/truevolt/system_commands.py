"""Display, beeper, identity and status of the Truevolt series (guide p. 269)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import Boolean, Choice, Command, Text, boolean, condition, enable, event, quoted

if TYPE_CHECKING:
    from simrack.instruments.truevolt.instrument import SimulatedTruevolt
    from simrack.instruments.truevolt.kinds import MeterKind

_SELF_TEST_S = 2.0
"""*TST? (unverified)."""
_ON_OFF = (Boolean(),)
_TEXT_LIMIT = 40
"""Characters on the display (users' drivers)."""


def _nothing(meter: SimulatedTruevolt) -> None:
    del meter


def _set_display(meter: SimulatedTruevolt, state: object) -> None:
    meter.display_on = bool(state)


def _set_text(meter: SimulatedTruevolt, text: str) -> None:
    meter.display_text = text[:_TEXT_LIMIT]


def _clear_text(meter: SimulatedTruevolt) -> None:
    meter.display_text = ""


def _set_beeper(meter: SimulatedTruevolt, state: object) -> None:
    meter.beeper = bool(state)


def _self_test(meter: SimulatedTruevolt) -> str:
    meter.forget()
    return "+0"


def _identify_as(meter: SimulatedTruevolt, name: str) -> None:
    meter.identifies_as = name


def _preset(meter: SimulatedTruevolt) -> None:
    meter.reset()


def _preset_status(meter: SimulatedTruevolt) -> None:
    meter.questionable.enable = 0
    meter.operation.enable = 0


def _identities(kind: MeterKind) -> tuple[str, ...]:
    """Return what SYSTem:IDENtify takes (p. 270)."""
    older = ("HP34401A", "AT34461A") if kind.model == "34461A" else ("HP34401A", "AT34410A", "AT34411A")
    return ("DEFault", *older)


def commands(kind: MeterKind) -> tuple[Command, ...]:
    """Return what a model understands of itself."""
    return (
        Command("DISPlay[:STATe]", _ON_OFF, do=_set_display, query=lambda meter: meter.display_on, reply=boolean),
        Command("DISPlay:TEXT[:DATA]", (Text(),), do=_set_text, query=lambda meter: meter.display_text, reply=quoted),
        Command("DISPlay:TEXT:CLEar", do=_clear_text),
        Command("ROUTe:TERMinals", query=lambda _meter: "FRON"),
        Command("SYSTem:BEEPer[:IMMediate]", do=_nothing),
        Command("SYSTem:BEEPer:STATe", _ON_OFF, do=_set_beeper, query=lambda meter: meter.beeper, reply=boolean),
        Command(
            "SYSTem:IDENtify",
            (Choice(_identities(kind)),),
            do=_identify_as,
            query=lambda meter: meter.identifies_as,
        ),
        Command("SYSTem:LFRequency", query=lambda meter: f"{meter.line_hz:+d}"),
        Command("SYSTem:LICense:CATalog", query=lambda _meter: '""'),
        Command("SYSTem:LOCal", do=_nothing),
        Command("SYSTem:PRESet", do=_preset),
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
