"""CALibration of the E3631A (User's Guide E3631-90002, ed. 10, p. 104-108)."""

from __future__ import annotations

from collections.abc import Callable

from simrack import scpi
from simrack.instruments.e3631a.calibration import CalibrationPoint, adjust_amps, adjust_volts, level_a, level_v
from simrack.instruments.e3631a.instrument import SimulatedE3631A
from simrack.instruments.e3631a.output import SupplyOutput
from simrack.instruments.e3631a.system_commands import remote_only


def _require_on(supply: SimulatedE3631A) -> None:
    supply.calibration.require_unsecured()
    if not supply.output_on:
        raise scpi.ScpiError(708)


@remote_only
def _go_to_volts(supply: SimulatedE3631A, level: str) -> None:
    _require_on(supply)
    supply.calibration.begin(supply.selected, "VOLT", level)
    supply.program(supply.selected, volts=level_v(supply.output, level))


@remote_only
def _go_to_amps(supply: SimulatedE3631A, level: str) -> None:
    _require_on(supply)
    supply.calibration.begin(supply.selected, "CURR", level)
    supply.program(supply.selected, amps=level_a(supply.output, level))


def _take(
    supply: SimulatedE3631A,
    quantity: str,
    measured: float,
    programmed_and_shown: Callable[[SupplyOutput], tuple[float, float]],
    adjust: Callable[[SupplyOutput, CalibrationPoint, CalibrationPoint], None],
) -> None:
    """Take a value measured outside of the selected output; the second point makes new constants."""
    _require_on(supply)
    supply.observe()
    programmed, shown = programmed_and_shown(supply.output)
    point = CalibrationPoint(programmed, measured, shown)
    both = supply.calibration.take(supply.selected, quantity, point)
    if both is not None:
        adjust(supply.output, *both)
        supply.drive()


@remote_only
def _take_volts(supply: SimulatedE3631A, measured: float) -> None:
    _take(supply, "VOLT", measured, lambda output: (output.volts, output.voltage_reading()), adjust_volts)


@remote_only
def _take_amps(supply: SimulatedE3631A, measured: float) -> None:
    _take(supply, "CURR", measured, lambda output: (output.amps, output.current_reading()), adjust_amps)


@remote_only
def _set_code(supply: SimulatedE3631A, code: str) -> None:
    supply.calibration.require_unsecured()
    supply.calibration.code = code


@remote_only
def _set_secured(supply: SimulatedE3631A, state: object, code: str) -> None:
    if code != supply.calibration.code:
        raise scpi.ScpiError(703)
    supply.calibration.secured = bool(state)


@remote_only
def _set_text(supply: SimulatedE3631A, text: str) -> None:
    supply.calibration.require_unsecured()
    supply.calibration.text = text


_CODE = scpi.Word(word_too_long=704)
_LEVEL = (scpi.Choice(("MINimum", "MAXimum")),)

CALIBRATION_COMMANDS = (
    scpi.Command(
        "CALibration:COUNt", query=lambda supply: supply.calibration.count, reply=scpi.bare_integer, reads=True
    ),
    scpi.Command("CALibration:SECure:CODE", (_CODE,), do=_set_code),
    scpi.Command(
        "CALibration:SECure:STATe",
        (scpi.Boolean(), _CODE),
        do=_set_secured,
        query=lambda supply: supply.calibration.secured,
        reply=scpi.boolean,
        reads=True,
    ),
    scpi.attribute("CALibration:STRing", scpi.Text(limit=40), "calibration.text", scpi.quoted, do=_set_text),
    scpi.Command("CALibration:VOLTage[:DATA]", (scpi.Number(unit="V"),), do=_take_volts),
    scpi.Command("CALibration:CURRent[:DATA]", (scpi.Number(unit="A"),), do=_take_amps),
    scpi.Command("CALibration:VOLTage:LEVel", _LEVEL, do=_go_to_volts),
    scpi.Command("CALibration:CURRent:LEVel", _LEVEL, do=_go_to_amps),
)
