"""The command table of the 34401A (User's Guide p. 105-147)."""

from __future__ import annotations

from simrack.instruments.hp34401a import (
    calculation_commands,
    calibration_commands,
    measuring_commands,
    range_commands,
    system_commands,
    trigger_commands,
)
from simrack.scpi import COMMON_COMMANDS, CommandTable

TABLE = CommandTable(
    *COMMON_COMMANDS,
    *measuring_commands.COMMANDS,
    *range_commands.COMMANDS,
    *calculation_commands.COMMANDS,
    *trigger_commands.COMMANDS,
    *system_commands.COMMANDS,
    *calibration_commands.COMMANDS,
)
