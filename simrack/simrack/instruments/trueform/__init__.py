"""The simulated 33500B and 33600A function generators (Trueform series)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.trueform.commands import TABLE
from simrack.instruments.trueform.instrument import SimulatedTrueform, TrueformErrors

if TYPE_CHECKING:
    from simrack.scpi import CommandTable

__all__ = ["TrueformErrors", "TrueformTwin"]


class TrueformTwin(SimulatedTrueform):
    """A generator of the series with its commands; arguments as of the 33220A."""

    table: ClassVar[CommandTable] = TABLE
