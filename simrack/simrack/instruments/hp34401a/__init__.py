"""The simulated 34401A multimeter."""

from __future__ import annotations

from typing import ClassVar

from simrack.instruments.hp34401a import (
    calculation_commands,
    calibration_commands,
    measuring_commands,
    range_commands,
    system_commands,
    trigger_commands,
)
from simrack.instruments.hp34401a.instrument import MeterErrors, SimulatedHp34401A
from simrack.scpi import COMMON_COMMANDS, CommandTable

__all__ = ["Hp34401ATwin", "MeterErrors"]


class Hp34401ATwin(SimulatedHp34401A):
    """The 34401A with its commands (User's Guide p. 105-147); arguments as of the meter."""

    table: ClassVar[CommandTable] = CommandTable(
        *COMMON_COMMANDS,
        *(*measuring_commands.COMMANDS, *range_commands.COMMANDS, *calculation_commands.COMMANDS),
        *(*trigger_commands.COMMANDS, *system_commands.COMMANDS, *calibration_commands.COMMANDS),
    )
