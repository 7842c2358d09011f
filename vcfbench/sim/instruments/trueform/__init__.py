"""The simulated 33500B and 33600A function generators (Trueform series)."""

from __future__ import annotations

from vcfbench.sim.instruments.trueform.instrument import TrueformErrors
from vcfbench.sim.instruments.trueform.twin import TrueformTwin

__all__ = ["TrueformErrors", "TrueformTwin"]
