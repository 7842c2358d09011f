"""The simulated DSO7104B oscilloscope."""

from __future__ import annotations

from vcfbench.sim.instruments.dso7104b.instrument import (
    TABLE,
    Dso7104BTwin,
    ScopeErrors,
    ScopeWorld,
)

__all__ = ["TABLE", "Dso7104BTwin", "ScopeErrors", "ScopeWorld"]
