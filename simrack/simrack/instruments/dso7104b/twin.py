"""The simulated DSO7104B as it is made: the oscilloscope behind its command table."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.dso7104b.commands import TABLE
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

if TYPE_CHECKING:
    from simrack.scpi import CommandTable


class Dso7104BTwin(SimulatedDso7104B):
    """The DSO7104B with its commands; arguments as of the oscilloscope."""

    table: ClassVar[CommandTable] = TABLE
