"""Commands of the E3631A for display, remote and local, memories and status.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 96-108, 113-122).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from operator import attrgetter
from typing import Any

from msgspec.structs import replace

from simrack import scpi
from simrack.instruments.e3631a.instrument import SimulatedE3631A
from simrack.instruments.e3631a.kinds import KINDS
from simrack.scpi.common import SERIAL_COMMANDS

_SELF_TEST_S = 1.0
"""*TST?; unverified."""
_RECALL_S = 0.05
"""*RCL: the change at the output starts as that of a programming command, in less than this (p. 187)."""


def remote_only(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Refuse with 550 while an RS-232 unit is in local; that all setting commands do so is unverified."""

    @wraps(handler)
    def guarded(supply: SimulatedE3631A, *arguments: Any) -> Any:
        if supply.local and supply.engine.interface is scpi.RS232:
            raise scpi.ScpiError(550)
        return handler(supply, *arguments)

    return guarded


def remote(command: scpi.Command) -> scpi.Command:
    """Return a setting that an RS-232 unit in local refuses."""
    assert command.do is not None  # noqa: S101  (a setting can be set)
    return replace(command, do=remote_only(command.do))


def _summary(supply: SimulatedE3631A, number: int) -> scpi.Register:
    """Return the register of an output, as it is now."""
    supply.observe()
    return supply.outputs[KINDS[number - 1].name].register


_ISUM, _BARE = "STATus:QUEStionable:INSTrument:ISUMmary<1-3>", scpi.bare_integer
_SLOT = (scpi.Integer(limits=scpi.Limits(1, 3), named=False),)

SYSTEM_COMMANDS = (
    scpi.attribute("DISPlay[:WINDow][:STATe]", scpi.Boolean(), "display_on", scpi.boolean),
    scpi.attribute(
        "DISPlay[:WINDow]:TEXT[:DATA]", scpi.Text(), "display_text", scpi.quoted, convert=lambda text: text[:12]
    ),
    scpi.Command("DISPlay[:WINDow]:TEXT:CLEar", do=lambda supply: setattr(supply, "display_text", "")),
    scpi.Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    scpi.Command("SYSTem:ERRor:NEXT", query=scpi.next_error),  # SCPI's own optional node; not in the guide, unverified
    scpi.Command("SYSTem:VERSion", query=lambda _: "1995.0", reads=True),
    *SERIAL_COMMANDS,
    scpi.Command("*TST", query=lambda _: "0", query_takes_s=_SELF_TEST_S),
    remote(scpi.Command("*SAV", _SLOT, do=lambda supply, slot: supply.save(slot))),
    remote(scpi.Command("*RCL", _SLOT, do=lambda supply, slot: supply.recall(slot), takes_s=_RECALL_S)),
)

STATUS_COMMANDS = (
    scpi.event("STATus:QUEStionable[:EVENt]", lambda supply: supply.questionable),
    scpi.enable("STATus:QUEStionable:ENABle", "questionable"),
    scpi.event("STATus:QUEStionable:INSTrument[:EVENt]", lambda supply: supply.instrument_summary),
    scpi.enable("STATus:QUEStionable:INSTrument:ENABle", "instrument_summary"),
    *(
        scpi.Command(f"{_ISUM}{node}", query=lambda supply, number, of=of: of(_summary(supply, number)), reply=_BARE)
        for node, of in (("[:EVENt]", scpi.Register.read_event), (":CONDition", attrgetter("condition")))
    ),
    scpi.Command(
        f"{_ISUM}:ENABle",
        (scpi.MASK_16,),
        do=lambda supply, number, mask: setattr(_summary(supply, number), "enable", mask),
        query=lambda supply, number: _summary(supply, number).enable,
        query_parameters=(),
        reply=_BARE,
        reads=True,
    ),
)
