"""The simulated DSO7104B oscilloscope."""

from __future__ import annotations

from simrack.instruments.dso7104b.commands import TABLE
from simrack.instruments.dso7104b.inputs import ScopeWorld
from simrack.instruments.dso7104b.record import ScopeErrors
from simrack.instruments.dso7104b.twin import Dso7104BTwin

__all__ = ["TABLE", "Dso7104BTwin", "ScopeErrors", "ScopeWorld"]
