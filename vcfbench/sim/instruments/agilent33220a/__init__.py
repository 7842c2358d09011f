"""The simulated 33220A function generator."""

from __future__ import annotations

from vcfbench.sim.instruments.agilent33220a.instrument import (
    TABLE,
    Agilent33220A,
    GeneratorErrors,
    GeneratorWorld,
    OutputRange,
)

__all__ = ["TABLE", "Agilent33220A", "GeneratorErrors", "GeneratorWorld", "OutputRange"]
