"""Each imperfection of the simulated bench alone has the size that the closed forms predict."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[1] / "experiments" / "imperfections.py"


def script() -> Any:
    spec = importlib.util.spec_from_file_location("imperfections", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look up their annotations
    spec.loader.exec_module(module)
    return module


@pytest.mark.exhaustive
def test_each_imperfection_alone_is_as_large_as_predicted() -> None:
    wrong = [
        f"{case.name}, {case.what}: predicted {case.predicted:+.6g}, seen {value:+.6g} {case.unit}"
        for case, value in script().seen()
        if not abs(value - case.predicted) <= case.tolerance
    ]
    assert not wrong


def test_the_noise_of_a_reading_is_that_of_its_bandwidth() -> None:
    """2.5 Hz of 0.2 s, and more through a sense mode 25 Hz away: 3.4 Hz; 25 Hz of 20 ms, and eight times that."""
    bandwidth_hz = script().noise_bandwidth_hz
    assert bandwidth_hz(0.2) == pytest.approx(3.41, abs=0.01)
    assert bandwidth_hz(0.02) == pytest.approx(213.7, abs=0.5)
