"""The simulated 33220A function generator."""

from __future__ import annotations

from simrack.instruments.agilent33220a.commands import TABLE
from simrack.instruments.agilent33220a.instrument import GeneratorErrors, GeneratorWorld, OutputRange
from simrack.instruments.agilent33220a.twin import Agilent33220ATwin

__all__ = ["TABLE", "Agilent33220ATwin", "GeneratorErrors", "GeneratorWorld", "OutputRange"]
