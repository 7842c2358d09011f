"""The simulated E3631A triple supply."""

from __future__ import annotations

from simrack.instruments.e3631a.instrument import OutputErrors, SupplyErrors
from simrack.instruments.e3631a.twin import E3631ATwin

__all__ = ["E3631ATwin", "OutputErrors", "SupplyErrors"]
