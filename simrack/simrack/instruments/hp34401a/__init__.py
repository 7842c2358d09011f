"""The simulated 34401A multimeter."""

from __future__ import annotations

from simrack.instruments.hp34401a.instrument import MeterErrors
from simrack.instruments.hp34401a.twin import Hp34401ATwin

__all__ = ["Hp34401ATwin", "MeterErrors"]
