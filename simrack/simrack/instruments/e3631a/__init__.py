"""The simulated E3631A triple supply."""

from __future__ import annotations

from typing import ClassVar

from simrack.instruments.e3631a.calibration_commands import CALIBRATION_COMMANDS
from simrack.instruments.e3631a.instrument import OutputErrors, SimulatedE3631A, SupplyErrors
from simrack.instruments.e3631a.output_commands import OUTPUT_COMMANDS, TRIGGER_COMMANDS
from simrack.instruments.e3631a.system_commands import STATUS_COMMANDS, SYSTEM_COMMANDS
from simrack.scpi import COMMON_COMMANDS, CommandTable

__all__ = ["E3631ATwin", "OutputErrors", "SupplyErrors"]


class E3631ATwin(SimulatedE3631A):
    """The E3631A with its commands (User's Guide E3631-90002, ed. 10, p. 84-108); arguments as of the supply."""

    table: ClassVar[CommandTable] = CommandTable(
        *COMMON_COMMANDS, *OUTPUT_COMMANDS, *TRIGGER_COMMANDS, *SYSTEM_COMMANDS, *STATUS_COMMANDS, *CALIBRATION_COMMANDS
    )
