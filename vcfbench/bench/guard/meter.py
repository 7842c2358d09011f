"""Guard of the multimeter (34401A, guide 34401-90004 p. 105-147; 34461A and 34465A, Truevolt guide).

Keithley 2000 and DMM6500 choose functions by the same words.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.bench.guard.message import Unreadable, header_pattern, read_message
from vcfbench.bench.guard.rules import BeyondLimit, is_one_of

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.guard.message import MessagePart
    from vcfbench.bench.guard.rules import Ask

_QUIET = ("VOLTage...", "CURRent...", "FREQuency...", "PERiod...")
"""Functions that only measure. Resistance, continuity and diode tests send up to 1 mA out of the meter (p. 51-53), and
so do capacitance and temperature with a resistive sensor (34461A, 34465A)."""

_CHOOSING = ("MEASure...", "CONFigure...")
_OTHER_LANGUAGES = ("L2", "L3")
"""Languages of the 34401A; a DMM6500 has ``*LANG``."""
_RECALLING = ("*RCL", "MMEMory:LOAD...", "MEMory:STATe:RECall...")
"""Stored states of the newer models may hold a resistance measurement."""


def meter_rules(description: BenchDescription) -> MeterRules:
    """Return the rules of the bench's multimeter, which no limit of the bench concerns."""
    del description
    return MeterRules()


class MeterRules:
    """Rules of a meter: any message but one that sends a test current into the node that the meter reads."""

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        del ask
        for part in read_message(message):
            function = _chosen(part)
            if function is not None and not any(header_pattern(each).fullmatch(function) for each in _QUIET):
                raise BeyondLimit(
                    f"{part.path} could send a test current into the PCB: {function} is no quiet function"
                )
            if is_one_of(part, _RECALLING):
                raise Unreadable(f"{part.path} brings back a state that nobody here knows")
            if part.path in _OTHER_LANGUAGES or (part.path == "*LANG" and not part.query):
                raise Unreadable(f"{part.path} makes the meter speak another language")


def _chosen(part: MessagePart) -> str | None:
    """Return the function that `part` makes the meter measure, None when it chooses none."""
    if is_one_of(part, _CHOOSING):
        return part.path.partition(":")[2] or None  # CONFigure? alone asks
    if part.query or not part.arguments or not is_one_of(part, ("[SENSe:]FUNCtion...",)):
        return None
    return part.argument(0).strip("\"'")
