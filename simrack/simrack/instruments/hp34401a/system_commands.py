"""Display, beeper, interface and status of the 34401A (User's Guide p. 129-131)."""

from __future__ import annotations

from collections.abc import Callable

from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
from simrack.scpi import RS232, Boolean, Command, Rows, ScpiError, Text, attribute, boolean, enable, event, quoted
from simrack.scpi.common import SERIAL_COMMANDS

ROWS = Rows()

_SELF_TEST_S = 15.0
"""*TST? (p. 86: about 15 s)."""


@ROWS.query("*TST", query_takes_s=_SELF_TEST_S)
def _self_test(meter: SimulatedHp34401A) -> str:
    meter.triggering.memory = []
    return "+0"


@ROWS.do("STATus:PRESet")
def _preset_status(meter: SimulatedHp34401A) -> None:
    meter.questionable.enable = 0


def _language(number: int) -> Callable[[SimulatedHp34401A], None]:
    """L1 is SCPI; with RS-232 there is no other."""

    def choose(meter: SimulatedHp34401A) -> None:
        if meter.engine.interface is RS232:
            raise ScpiError(-113)
        meter.language = number

    return choose


COMMANDS = (
    *ROWS,
    attribute("DISPlay[:WINDow][:STATe]", Boolean(), "display_on", boolean),
    attribute("DISPlay[:WINDow]:TEXT[:DATA]", Text(), "display_text", quoted, convert=lambda text: text[:12]),
    Command("DISPlay[:WINDow]:TEXT:CLEar", do=lambda meter: setattr(meter, "display_text", "")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    attribute("SYSTem:BEEPer:STATe", Boolean(), "beeper", boolean),
    Command("SYSTem:VERSion", query=lambda _: "1991.0", reads=True),
    *SERIAL_COMMANDS,
    *(Command(f"L{number}", do=_language(number)) for number in (1, 2, 3)),
    # status
    event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
)
