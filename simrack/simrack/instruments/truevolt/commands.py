"""The command table of the Truevolt series (Operating and Service Guide, SCPI Programming Reference)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.truevolt import (
    calculation_commands,
    measuring_commands,
    range_commands,
    system_commands,
)
from simrack.scpi import COMMON_COMMANDS, CommandTable

if TYPE_CHECKING:
    from simrack.instruments.truevolt.kinds import MeterKind


def table(kind: MeterKind) -> CommandTable:
    """Return the command table of a model."""
    return CommandTable(
        *COMMON_COMMANDS,
        *measuring_commands.commands(kind),
        *range_commands.commands(kind),
        *calculation_commands.COMMANDS,
        *system_commands.commands(kind),
    )
