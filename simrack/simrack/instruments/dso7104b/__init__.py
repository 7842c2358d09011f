"""The simulated DSO7104B oscilloscope."""

from __future__ import annotations

from typing import ClassVar

from simrack.instruments.dso7104b.accessory_commands import ACCESSORY_COMMANDS
from simrack.instruments.dso7104b.channel_commands import VERTICAL_COMMANDS
from simrack.instruments.dso7104b.inputs import ScopeWorld
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.instruments.dso7104b.math_commands import FUNCTION_COMMANDS
from simrack.instruments.dso7104b.measuring_commands import MEASURE_COMMANDS
from simrack.instruments.dso7104b.record import ScopeErrors
from simrack.instruments.dso7104b.system_commands import ROOT_COMMANDS, SYSTEM_COMMANDS
from simrack.instruments.dso7104b.timing_commands import TIMING_COMMANDS
from simrack.instruments.dso7104b.trigger_commands import TRIGGER_COMMANDS
from simrack.instruments.dso7104b.waveform_commands import WAVEFORM_COMMANDS
from simrack.scpi import COMMON_COMMANDS, CommandTable

__all__ = ["COMMANDS", "Dso7104BTwin", "ScopeErrors", "ScopeWorld"]

COMMANDS = (
    *(*COMMON_COMMANDS, *ROOT_COMMANDS, *VERTICAL_COMMANDS, *TIMING_COMMANDS, *TRIGGER_COMMANDS),
    *(*MEASURE_COMMANDS, *WAVEFORM_COMMANDS, *FUNCTION_COMMANDS, *SYSTEM_COMMANDS, *ACCESSORY_COMMANDS),
)
"""All its commands."""


class Dso7104BTwin(SimulatedDso7104B):
    """The DSO7104B with its commands; arguments as of the oscilloscope."""

    table: ClassVar[CommandTable] = CommandTable(*COMMANDS, limit_queries=False)
