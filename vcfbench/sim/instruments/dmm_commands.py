"""The command table of the 34401A (User's Guide p. 105-147)."""

from __future__ import annotations

from vcfbench.sim.instruments import (
    dmm_calibration_commands,
    dmm_math_commands,
    dmm_measuring_commands,
    dmm_range_commands,
    dmm_system_commands,
    dmm_trigger_commands,
)
from vcfbench.sim.scpi import COMMON_COMMANDS, CommandTable

__all__ = ["TABLE"]

TABLE = CommandTable(
    *COMMON_COMMANDS,
    *dmm_measuring_commands.COMMANDS,
    *dmm_range_commands.COMMANDS,
    *dmm_math_commands.COMMANDS,
    *dmm_trigger_commands.COMMANDS,
    *dmm_system_commands.COMMANDS,
    *dmm_calibration_commands.COMMANDS,
)
