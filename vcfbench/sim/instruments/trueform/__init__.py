"""The simulated 33500B and 33600A function generators (Trueform series)."""

from __future__ import annotations

from vcfbench.sim.instruments.trueform.instrument import Trueform, TrueformErrors

__all__ = ["Trueform", "TrueformErrors"]
