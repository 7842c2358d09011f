"""The simulated 34401A as it is made: the meter behind its command table."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.hp34401a.commands import TABLE
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A

if TYPE_CHECKING:
    from simrack.scpi import CommandTable


class Hp34401ATwin(SimulatedHp34401A):
    """The 34401A with its commands; arguments as of the meter."""

    table: ClassVar[CommandTable] = TABLE
