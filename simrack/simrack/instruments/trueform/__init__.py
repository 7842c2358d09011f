"""The simulated 33500B and 33600A function generators (Trueform series)."""

from __future__ import annotations

from typing import ClassVar

from simrack.instruments.trueform.commands import table
from simrack.instruments.trueform.instrument import SimulatedTrueform, TrueformErrors

__all__ = ["TrueformErrors", "TrueformTwin"]


class TrueformTwin(SimulatedTrueform):
    """A generator of the series with its commands; arguments as of the 33220A."""

    table_of: ClassVar = staticmethod(table)
