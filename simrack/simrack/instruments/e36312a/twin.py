"""The simulated E36312A as it is made: the supply behind its command table."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.e36312a.commands import TABLE
from simrack.instruments.e36312a.instrument import SimulatedE36312A

if TYPE_CHECKING:
    from simrack.scpi import CommandTable


class E36312ATwin(SimulatedE36312A):
    """The E36312A with its commands; arguments as of the supply."""

    table: ClassVar[CommandTable] = TABLE
