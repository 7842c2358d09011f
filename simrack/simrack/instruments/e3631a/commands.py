"""The command list of the E3631A (User's Guide E3631-90002, ed. 10, p. 84-108)."""

from __future__ import annotations

from simrack.instruments.e3631a.calibration_commands import CALIBRATION_COMMANDS
from simrack.instruments.e3631a.output_commands import OUTPUT_COMMANDS, TRIGGER_COMMANDS
from simrack.instruments.e3631a.system_commands import STATUS_COMMANDS, SYSTEM_COMMANDS
from simrack.scpi import COMMON_COMMANDS, CommandTable

TABLE = CommandTable(
    *COMMON_COMMANDS,
    *OUTPUT_COMMANDS,
    *TRIGGER_COMMANDS,
    *SYSTEM_COMMANDS,
    *STATUS_COMMANDS,
    *CALIBRATION_COMMANDS,
)
