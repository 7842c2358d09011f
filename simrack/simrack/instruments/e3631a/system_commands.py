"""Commands of the E3631A beside its outputs: display, remote and local, memories, status.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 96-108, 113-122).
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from simrack.instruments.e3631a.kinds import KINDS
from simrack.scpi import (
    MASK_16,
    RS232,
    Boolean,
    Command,
    Integer,
    Limits,
    Register,
    ScpiError,
    Text,
    attribute,
    bare_integer,
    boolean,
    enable,
    event,
    next_error,
    quoted,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.e3631a.instrument import SimulatedE3631A

_SELF_TEST_S = 1.0
"""*TST?; unverified."""
_RECALL_S = 0.05
"""*RCL: the change at the output starts as that of a programming command, in less than this (p. 187)."""


def remote_only(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Refuse with 550 while an RS-232 unit is in local; that all setting commands do so is unverified."""

    @wraps(handler)
    def guarded(supply: SimulatedE3631A, *arguments: Any) -> Any:
        if supply.local and supply.engine.interface is RS232:
            raise ScpiError(550)
        return handler(supply, *arguments)

    return guarded


def remote(command: Command) -> Command:
    """Return a setting that an RS-232 unit in local refuses."""
    assert command.do is not None  # noqa: S101  (a setting can be set)
    return replace(command, do=remote_only(command.do))


def _go_local(supply: SimulatedE3631A) -> None:
    _require_rs232(supply)
    supply.local = True


def _go_remote(supply: SimulatedE3631A) -> None:
    _require_rs232(supply)
    supply.local = False


def _require_rs232(supply: SimulatedE3631A) -> None:
    if supply.engine.interface is not RS232:
        raise ScpiError(514)


@remote_only
def _save(supply: SimulatedE3631A, slot: int) -> None:
    supply.save(slot)


@remote_only
def _recall(supply: SimulatedE3631A, slot: int) -> None:
    supply.recall(slot)


def _summary_condition(supply: SimulatedE3631A, number: int) -> int:
    supply.observe()
    return _summary(supply, number).condition


def _summary(supply: SimulatedE3631A, number: int) -> Register:
    return supply.outputs[KINDS[number - 1].name].register


def _summary_event(supply: SimulatedE3631A, number: int) -> int:
    supply.observe()
    return _summary(supply, number).read_event()


def _set_summary_enable(supply: SimulatedE3631A, number: int, mask: int) -> None:
    _summary(supply, number).enable = mask


def _summary_enable(supply: SimulatedE3631A, number: int) -> int:
    return _summary(supply, number).enable


_SLOT = (Integer(limits=Limits(1, 3), named=False),)

SYSTEM_COMMANDS = (
    attribute("DISPlay[:WINDow][:STATe]", Boolean(), "display_on", boolean),
    attribute("DISPlay[:WINDow]:TEXT[:DATA]", Text(), "display_text", quoted, convert=lambda text: text[:12]),
    Command("DISPlay[:WINDow]:TEXT:CLEar", do=lambda supply: setattr(supply, "display_text", "")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    Command("SYSTem:ERRor:NEXT", query=next_error),  # SCPI's own optional node; not in the guide, unverified
    Command("SYSTem:VERSion", query=lambda _: "1995.0"),
    Command("SYSTem:LOCal", do=_go_local),
    Command("SYSTem:REMote", do=_go_remote),
    Command("SYSTem:RWLock", do=_go_remote),
    Command("*TST", query=lambda _: "0", query_takes_s=_SELF_TEST_S),
    Command("*SAV", _SLOT, do=_save),
    Command("*RCL", _SLOT, do=_recall, takes_s=_RECALL_S),
)

STATUS_COMMANDS = (
    event("STATus:QUEStionable[:EVENt]", lambda supply: supply.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
    event("STATus:QUEStionable:INSTrument[:EVENt]", lambda supply: supply.instrument_summary),
    enable("STATus:QUEStionable:INSTrument:ENABle", "instrument_summary"),
    Command("STATus:QUEStionable:INSTrument:ISUMmary<1-3>[:EVENt]", query=_summary_event, reply=bare_integer),
    Command("STATus:QUEStionable:INSTrument:ISUMmary<1-3>:CONDition", query=_summary_condition, reply=bare_integer),
    Command(
        "STATus:QUEStionable:INSTrument:ISUMmary<1-3>:ENABle",
        (MASK_16,),
        do=_set_summary_enable,
        query=_summary_enable,
        query_parameters=(),
        reply=bare_integer,
    ),
)
