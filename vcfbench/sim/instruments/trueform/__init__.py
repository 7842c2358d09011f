"""The simulated 33500B and 33600A function generators (Trueform series)."""

from __future__ import annotations

from vcfbench.sim.instruments.trueform.instrument import (
    Keysight33509B,
    Keysight33510B,
    Keysight33511B,
    Keysight33512B,
    Keysight33521B,
    Keysight33522B,
    Keysight33611A,
    Keysight33612A,
    Keysight33621A,
    Keysight33622A,
    Trueform,
    TrueformErrors,
)

__all__ = [
    "Keysight33509B",
    "Keysight33510B",
    "Keysight33511B",
    "Keysight33512B",
    "Keysight33521B",
    "Keysight33522B",
    "Keysight33611A",
    "Keysight33612A",
    "Keysight33621A",
    "Keysight33622A",
    "Trueform",
    "TrueformErrors",
]
