"""The simulated E36312A triple supply."""

from __future__ import annotations

from vcfbench.sim.instruments.e36312a.instrument import E36312A, Errors36312A

__all__ = ["E36312A", "Errors36312A"]
