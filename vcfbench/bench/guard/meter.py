"""What may be said to the multimeter (34401A, commands after guide 34401-90004 p. 105-147)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.bench.guard.message import Unreadable, header_pattern, read_message
from vcfbench.bench.guard.rules import Beyond, is_one_of

if TYPE_CHECKING:
    from vcfbench.bench.guard.message import Part
    from vcfbench.bench.guard.rules import Ask

__all__ = ["MeterRules"]

_SOURCING = ("RESistance", "FRESistance", "CONTinuity", "DIODe")
"""Functions that send a test current of up to 1 mA out of the terminals (guide p. 51-53)."""

_CHOOSING = tuple(f"{verb}:{function}" for verb in ("MEASure", "CONFigure") for function in _SOURCING)
_OTHER_LANGUAGES = ("L2", "L3")


class MeterRules:
    """Everything may be said but what sends a test current into the node that the meter reads."""

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        del ask
        for part in read_message(message):
            if is_one_of(part, _CHOOSING) or _chooses_by_name(part):
                raise Beyond(f"{part.path} would send a test current into the PCB")
            if part.path in _OTHER_LANGUAGES:
                raise Unreadable(f"{part.path} makes the meter speak another language")


def _chooses_by_name(part: Part) -> bool:
    if part.query or not part.arguments or not header_pattern("[SENSe:]FUNCtion").fullmatch(part.path):
        return False
    wanted = part.argument(0).strip("\"'")
    return any(header_pattern(each).fullmatch(wanted) for each in _SOURCING)
