"""The simulated 33220A function generator."""

from __future__ import annotations

from vcfbench.sim.instruments.agilent33220a.commands import TABLE
from vcfbench.sim.instruments.agilent33220a.instrument import GeneratorErrors, GeneratorWorld, OutputRange
from vcfbench.sim.instruments.agilent33220a.twin import Agilent33220ATwin

__all__ = ["TABLE", "Agilent33220ATwin", "GeneratorErrors", "GeneratorWorld", "OutputRange"]
