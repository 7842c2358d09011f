"""The simulated 34461A and 34465A multimeters (Truevolt series)."""

from __future__ import annotations

from simrack.instruments.truevolt.instrument import Errors34461A, Errors34465A, SimulatedTruevolt
from simrack.instruments.truevolt.twin import Keysight34461ATwin, Keysight34465ATwin

__all__ = ["Errors34461A", "Errors34465A", "Keysight34461ATwin", "Keysight34465ATwin", "SimulatedTruevolt"]
