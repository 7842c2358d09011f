"""The simulated E3631A triple supply."""

from __future__ import annotations

from vcfbench.sim.instruments.e3631a.instrument import (
    E3631A,
    TABLE,
    OutputErrors,
    SupplyErrors,
)

__all__ = ["E3631A", "TABLE", "OutputErrors", "SupplyErrors"]
