"""The simulated InfiniiVision 3000 X and 4000 X oscilloscopes."""

from __future__ import annotations

from vcfbench.sim.instruments.infiniivision.instrument import (
    InfiniiVisionXTwin,
    KeysightDsoX3024ATwin,
    KeysightDsoX4104ATwin,
    KeysightMsoX3104TTwin,
    XSeriesErrors,
)

__all__ = [
    "InfiniiVisionXTwin",
    "KeysightDsoX3024ATwin",
    "KeysightDsoX4104ATwin",
    "KeysightMsoX3104TTwin",
    "XSeriesErrors",
]
