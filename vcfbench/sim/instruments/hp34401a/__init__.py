"""The simulated 34401A multimeter."""

from __future__ import annotations

from vcfbench.sim.instruments.hp34401a.instrument import (
    TABLE,
    Hp34401A,
    MeterErrors,
)

__all__ = ["TABLE", "Hp34401A", "MeterErrors"]
