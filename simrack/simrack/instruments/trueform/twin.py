"""The simulated 33500B and 33600A as they are made: a generator of the series behind its command table."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.trueform.commands import TABLE
from simrack.instruments.trueform.instrument import SimulatedTrueform

if TYPE_CHECKING:
    from simrack.scpi import CommandTable


class TrueformTwin(SimulatedTrueform):
    """A generator of the series with its commands; arguments as of the 33220A."""

    table: ClassVar[CommandTable] = TABLE
