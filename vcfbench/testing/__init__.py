"""Helpers for the tests of drivers and procedures, here and in other projects.

Names are loaded when they are first asked for: pytest imports this package in every project where it is installed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vcfbench.testing.benches import ServedLab, SimulatedLab, open_simulated, serve_simulated, simulated
    from vcfbench.testing.conformance import (
        ConformanceCase,
        conformance_cases,
        conformance_problems,
        model_case,
        scpi_case,
    )
    from vcfbench.testing.disk import Disk, DiskState
    from vcfbench.testing.exchange import Exchange, ScriptedWire, expected_exchange, over_serial, over_visa
    from vcfbench.testing.replay import ReplayWire, read_trace, replay_trace
    from vcfbench.testing.soaking import Draw, Verdict, drawn, shrunk, soak, tried
    from vcfbench.testing.wire_faults import WIRE_FAULTS, FaultyWire, WireFault, faulty_wire

__all__ = [
    "WIRE_FAULTS",
    "ConformanceCase",
    "Disk",
    "DiskState",
    "Draw",
    "Exchange",
    "FaultyWire",
    "ReplayWire",
    "ScriptedWire",
    "ServedLab",
    "SimulatedLab",
    "Verdict",
    "WireFault",
    "conformance_cases",
    "conformance_problems",
    "drawn",
    "expected_exchange",
    "faulty_wire",
    "model_case",
    "open_simulated",
    "over_serial",
    "over_visa",
    "read_trace",
    "replay_trace",
    "scpi_case",
    "serve_simulated",
    "shrunk",
    "simulated",
    "soak",
    "tried",
]

_MODULES = {
    "vcfbench.testing.benches": ("ServedLab", "SimulatedLab", "open_simulated", "serve_simulated", "simulated"),
    "vcfbench.testing.conformance": (
        "ConformanceCase",
        "conformance_cases",
        "conformance_problems",
        "model_case",
        "scpi_case",
    ),
    "vcfbench.testing.disk": ("Disk", "DiskState"),
    "vcfbench.testing.exchange": ("Exchange", "ScriptedWire", "expected_exchange", "over_serial", "over_visa"),
    "vcfbench.testing.replay": ("ReplayWire", "read_trace", "replay_trace"),
    "vcfbench.testing.soaking": ("Draw", "Verdict", "drawn", "shrunk", "soak", "tried"),
    "vcfbench.testing.wire_faults": ("WIRE_FAULTS", "FaultyWire", "WireFault", "faulty_wire"),
}


def __getattr__(name: str) -> Any:
    """Load the public name `name`."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
