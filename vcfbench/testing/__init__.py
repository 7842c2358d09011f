"""Helpers for the tests of drivers and procedures, here and in other projects."""

from __future__ import annotations

from vcfbench.testing.conformance import ConformanceCase, conformance_cases, conformance_problems
from vcfbench.testing.exchange import Exchange, ScriptedWire, expected_exchange, over_serial, over_visa

__all__ = [
    "ConformanceCase",
    "Exchange",
    "ScriptedWire",
    "conformance_cases",
    "conformance_problems",
    "expected_exchange",
    "over_serial",
    "over_visa",
]
