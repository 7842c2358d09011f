"""The command table of a 33220A, subsystem by subsystem."""

from __future__ import annotations

from simrack.instruments.agilent33220a import (
    arbitrary_commands,
    burst_commands,
    level_commands,
    modulation_commands,
    output_commands,
    pulse_commands,
    state_commands,
    sweep_commands,
    system_commands,
)
from simrack.scpi import COMMON_COMMANDS, CommandTable

TABLE = CommandTable(
    *COMMON_COMMANDS,
    *output_commands.COMMANDS,
    *level_commands.COMMANDS,
    *pulse_commands.COMMANDS,
    *modulation_commands.COMMANDS,
    *sweep_commands.COMMANDS,
    *burst_commands.COMMANDS,
    *arbitrary_commands.COMMANDS,
    *state_commands.COMMANDS,
    *system_commands.COMMANDS,
)
