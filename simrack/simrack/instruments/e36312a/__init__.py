"""The simulated E36312A triple supply."""

from __future__ import annotations

from typing import ClassVar

from simrack.instruments.e36312a.commands import TABLE
from simrack.instruments.e36312a.instrument import Errors36312A, SimulatedE36312A
from simrack.scpi import CommandTable

__all__ = ["E36312ATwin", "Errors36312A"]


class E36312ATwin(SimulatedE36312A):
    """The E36312A with its commands; arguments as of the supply."""

    table: ClassVar[CommandTable] = TABLE
