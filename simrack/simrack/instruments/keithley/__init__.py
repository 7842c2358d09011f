"""The simulated Keithley 2000 and DMM6500 multimeters."""

from __future__ import annotations

from simrack.instruments.keithley.dmm6500 import Errors6500, KeithleyDMM6500Twin
from simrack.instruments.keithley.k2000 import Errors2000, Keithley2000Twin

__all__ = ["Errors2000", "Errors6500", "Keithley2000Twin", "KeithleyDMM6500Twin"]
