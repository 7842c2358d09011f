"""CALibration of the 34401A (User's Guide p. 146-147)."""

from __future__ import annotations

from simrack import scpi
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

ROWS = scpi.Rows()

_NR3 = scpi.real(8)


@ROWS.do("CALibration:SECure:CODE", (scpi.Word(word_too_long=704),))
def _set_code(meter: SimulatedHp34401A, code: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.code = code


def _set_secured(meter: SimulatedHp34401A, state: object, code: str) -> None:
    if code != meter.calibration.code:
        raise scpi.ScpiError(703)
    meter.calibration.secured = bool(state)


@ROWS.attribute("CALibration:STRing", scpi.Text(limit=40), "calibration.text", scpi.quoted)
def _set_calibration_text(meter: SimulatedHp34401A, text: str) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.text = text


@ROWS.attribute("CALibration:VALue", scpi.Number(), "calibration.value", _NR3)
def _set_calibration_value(meter: SimulatedHp34401A, value: float) -> None:
    meter.calibration.require_unsecured()
    meter.calibration.value = value


COMMANDS = (
    *ROWS,
    scpi.Command("CALibration", query=lambda meter: meter.calibrate()),
    scpi.Command(
        "CALibration:COUNt", query=lambda meter: meter.calibration.count, reply=scpi.signed_integer, reads=True
    ),
    scpi.Command(
        "CALibration:SECure:STATe",
        (scpi.Boolean(), scpi.Word()),
        do=_set_secured,
        query=lambda meter: meter.calibration.secured,
        reply=scpi.boolean,
        reads=True,
    ),
)
