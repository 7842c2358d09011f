"""The simulated 33220A function generator."""

from __future__ import annotations

from typing import ClassVar

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
from simrack.instruments.agilent33220a.instrument import GeneratorWorld, SimulatedAgilent33220A
from simrack.instruments.agilent33220a.settings import GeneratorErrors, OutputRange
from simrack.scpi import COMMON_COMMANDS, CommandTable

__all__ = ["COMMANDS", "Agilent33220ATwin", "GeneratorErrors", "GeneratorWorld", "OutputRange"]

COMMANDS = (
    *(*output_commands.COMMANDS, *level_commands.COMMANDS, *pulse_commands.COMMANDS, *modulation_commands.COMMANDS),
    *(*sweep_commands.COMMANDS, *burst_commands.COMMANDS, *state_commands.COMMANDS, *system_commands.COMMANDS),
)
"""All but those of waveforms in memory."""


class Agilent33220ATwin(SimulatedAgilent33220A):
    """The 33220A with its commands; arguments as of the generator."""

    table: ClassVar[CommandTable] = CommandTable(*COMMON_COMMANDS, *COMMANDS, *arbitrary_commands.COMMANDS)
