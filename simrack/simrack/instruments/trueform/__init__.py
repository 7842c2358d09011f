"""The simulated 33500B and 33600A function generators (Trueform series)."""

from __future__ import annotations

from simrack.instruments.trueform.instrument import TrueformErrors
from simrack.instruments.trueform.twin import TrueformTwin

__all__ = ["TrueformErrors", "TrueformTwin"]
