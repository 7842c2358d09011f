"""The simulated InfiniiVision 3000 X and 4000 X oscilloscopes."""

from __future__ import annotations

from simrack.instruments.infiniivision.instrument import InfiniiVisionXTwin, XSeriesErrors

__all__ = ["InfiniiVisionXTwin", "XSeriesErrors"]
