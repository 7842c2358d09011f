"""CALibration of the 34401A (User's Guide p. 146-147)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import (
    Boolean,
    Command,
    Number,
    ScpiError,
    Text,
    Word,
    attribute,
    boolean,
    quoted,
    real,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

_NR3 = real(8)


def _set_code(meter: SimulatedHp34401A, code: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.code = code


def _set_secured(meter: SimulatedHp34401A, state: object, code: str) -> None:
    if code != meter.calibration.code:
        raise ScpiError(703)
    meter.calibration.secured = bool(state)


def _set_calibration_text(meter: SimulatedHp34401A, text: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.text = text


def _set_calibration_value(meter: SimulatedHp34401A, value: float) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.value = value


COMMANDS = (
    Command("CALibration", query=lambda meter: meter.calibrate()),
    Command("CALibration:COUNt", query=lambda meter: meter.calibration.count, reply=signed_integer),
    Command("CALibration:SECure:CODE", (Word(word_too_long=704),), do=_set_code),
    Command(
        "CALibration:SECure:STATe",
        (Boolean(), Word()),
        do=_set_secured,
        query=lambda meter: meter.calibration.secured,
        reply=boolean,
    ),
    attribute("CALibration:STRing", Text(limit=40), "calibration.text", quoted, do=_set_calibration_text),
    attribute("CALibration:VALue", Number(), "calibration.value", _NR3, do=_set_calibration_value),
)
