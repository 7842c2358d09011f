"""The simulated InfiniiVision 3000 X and 4000 X oscilloscopes."""

from __future__ import annotations

from vcfbench.sim.instruments.infiniivision.instrument import (
    InfiniiVisionX,
    KeysightDsoX3024A,
    KeysightDsoX4104A,
    KeysightMsoX3104T,
    XSeriesErrors,
)

__all__ = ["InfiniiVisionX", "KeysightDsoX3024A", "KeysightDsoX4104A", "KeysightMsoX3104T", "XSeriesErrors"]
