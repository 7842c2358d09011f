"""The simulated E3631A as it is made: the supply behind its command table."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.e3631a.commands import TABLE
from simrack.instruments.e3631a.instrument import SimulatedE3631A

if TYPE_CHECKING:
    from simrack.scpi import CommandTable


class E3631ATwin(SimulatedE3631A):
    """The E3631A with its commands; arguments as of the supply."""

    table: ClassVar[CommandTable] = TABLE
