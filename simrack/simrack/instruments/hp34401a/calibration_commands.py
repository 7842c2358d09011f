"""CALibration of the 34401A (User's Guide p. 146-147)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.scpi import Boolean, Command, Number, ScpiError, Text, Word, boolean, quoted, real, signed_integer

if TYPE_CHECKING:
    from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
    from simrack.scpi import Pending

_NR3 = real(8)


def _calibrate(meter: SimulatedHp34401A) -> Pending:
    return meter.calibrate()


def _calibration_count(meter: SimulatedHp34401A) -> int:
    return meter.calibration.count


def _set_code(meter: SimulatedHp34401A, code: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.code = code


def _set_secured(meter: SimulatedHp34401A, state: object, code: str) -> None:
    if code != meter.calibration.code:
        raise ScpiError(703)
    meter.calibration.secured = bool(state)


def _secured(meter: SimulatedHp34401A) -> bool:
    return meter.calibration.secured


def _set_calibration_text(meter: SimulatedHp34401A, text: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.text = text


def _calibration_text(meter: SimulatedHp34401A) -> str:
    return meter.calibration.text


def _set_calibration_value(meter: SimulatedHp34401A, value: float) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.value = value


def _calibration_value(meter: SimulatedHp34401A) -> float:
    return meter.calibration.value


COMMANDS = (
    Command("CALibration", query=_calibrate),
    Command("CALibration:COUNt", query=_calibration_count, reply=signed_integer),
    Command("CALibration:SECure:CODE", (Word(word_too_long=704),), do=_set_code),
    Command("CALibration:SECure:STATe", (Boolean(), Word()), do=_set_secured, query=_secured, reply=boolean),
    Command("CALibration:STRing", (Text(limit=40),), do=_set_calibration_text, query=_calibration_text, reply=quoted),
    Command("CALibration:VALue", (Number(),), do=_set_calibration_value, query=_calibration_value, reply=_NR3),
)
