"""The simulated 33220A as it is made: the generator behind its command table."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.agilent33220a.commands import TABLE
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A

if TYPE_CHECKING:
    from simrack.scpi import CommandTable


class Agilent33220ATwin(SimulatedAgilent33220A):
    """The 33220A with its commands; arguments as of the generator."""

    table: ClassVar[CommandTable] = TABLE
