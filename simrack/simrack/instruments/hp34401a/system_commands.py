"""Display, beeper, interface and status of the 34401A (User's Guide p. 129-131)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import RS232, Boolean, Command, ScpiError, Text, boolean, enable, event, quoted

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_SELF_TEST_S = 15.0
"""*TST? (p. 86: about 15 s)."""
_ON_OFF = (Boolean(),)


def _set_display(meter: SimulatedHp34401A, state: object) -> None:
    meter.display_on = bool(state)


def _display(meter: SimulatedHp34401A) -> bool:
    return meter.display_on


def _set_text(meter: SimulatedHp34401A, text: str) -> None:
    meter.display_text = text[:12]


def _text(meter: SimulatedHp34401A) -> str:
    return meter.display_text


def _clear_text(meter: SimulatedHp34401A) -> None:
    meter.display_text = ""


def _nothing(meter: SimulatedHp34401A) -> None:
    del meter


def _set_beeper(meter: SimulatedHp34401A, state: object) -> None:
    meter.beeper = bool(state)


def _beeper(meter: SimulatedHp34401A) -> bool:
    return meter.beeper


def _version(meter: SimulatedHp34401A) -> str:
    del meter
    return "1991.0"


def _require_rs232(meter: SimulatedHp34401A) -> None:
    if meter.engine.interface is not RS232:
        raise ScpiError(514)


def _go_local(meter: SimulatedHp34401A) -> None:
    _require_rs232(meter)
    meter.local = True


def _go_remote(meter: SimulatedHp34401A) -> None:
    _require_rs232(meter)
    meter.local = False


def _self_test(meter: SimulatedHp34401A) -> str:
    meter.triggering.memory = []
    return "+0"


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
    Command("DISPlay[:WINDow][:STATe]", _ON_OFF, do=_set_display, query=_display, reply=boolean),
    Command("DISPlay[:WINDow]:TEXT[:DATA]", (Text(),), do=_set_text, query=_text, reply=quoted),
    Command("DISPlay[:WINDow]:TEXT:CLEar", do=_clear_text),
    Command("SYSTem:BEEPer[:IMMediate]", do=_nothing),
    Command("SYSTem:BEEPer:STATe", _ON_OFF, do=_set_beeper, query=_beeper, reply=boolean),
    Command("SYSTem:VERSion", query=_version),
    Command("SYSTem:LOCal", do=_go_local),
    Command("SYSTem:REMote", do=_go_remote),
    Command("SYSTem:RWLock", do=_go_remote),
    Command("*TST", query=_self_test, query_takes_s=_SELF_TEST_S),
    Command("L1", do=_language(1)),
    Command("L2", do=_language(2)),
    Command("L3", do=_language(3)),
    # status
    event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
    Command("STATus:PRESet", do=_preset_status),
)
