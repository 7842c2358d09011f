"""The script of closed-loop gyroscopes: its closed form is the solution of the equations, the page has its table."""

from __future__ import annotations

import re
from importlib.util import module_from_spec, spec_from_file_location
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
LOOPS = [None, 20.0, 1e6]


@pytest.fixture(scope="module")
def script() -> Any:
    spec = spec_from_file_location("force_balance", ROOT / "examples" / "closed-loop" / "force_balance.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def output(script: Any, values: dict[str, float], loop_gain: float | None, rate: float, volts: float) -> float:
    """Solve the sense mode's motion for its parts in phase and in quadrature, and the loop, as one linear system."""
    drive, sense = tau * script.DRIVE_HZ, tau * (script.DRIVE_HZ - values["split_hz"])
    lossy = sense * drive / values["q"]
    combs = values["combs"] * values["drive"]
    nominal = sense_of = tau * (script.DRIVE_HZ - script.SPLIT_HZ)
    stiff = sense_of**2 - drive**2
    h = stiff / (stiff**2 + (nominal * drive / script.Q) ** 2)
    fed_back = 0.0 if loop_gain is None else -loop_gain / h  # volts on the combs for the read-out of the motion
    # unknowns: motion in phase, motion in quadrature, voltage of the loop
    system = np.array(
        [
            [sense**2 - drive**2, lossy, -combs],
            [-lossy, sense**2 - drive**2, 0.0],
            [-fed_back * values["read_out"], 0.0, 1.0],
        ]
    )
    in_phase, _, loop_v = np.linalg.solve(system, [values["drive"] * rate + combs * volts, 0.0, 0.0])
    return float(values["read_out"] * in_phase if loop_gain is None else loop_v)


@pytest.mark.parametrize("loop_gain", LOOPS)
def test_the_closed_form_is_the_solution_of_the_equations(script: Any, loop_gain: float | None) -> None:
    for change in ({}, *script.CAUSES.values()):
        values = script.NOMINAL | change
        solved = output(script, values, loop_gain, 1.0, 0.0), output(script, values, loop_gain, 0.0, 1.0)
        assert script.slopes(loop_gain, values) == pytest.approx(solved, rel=1e-9)


def test_the_page_has_the_table_of_the_script(script: Any) -> None:
    page = (ROOT / "docs" / "other-ways.md").read_text(encoding="utf-8").replace("**", "")
    for cause, change in script.CAUSES.items():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| {cause.partition(' (')[0]}"))
        shown = [int(cell) for cell in re.findall(r"\| (-?\d[\d ]*?) (?=\||\()", re.sub(r"(\d) (\d{3})", r"\1\2", row))]
        found = [script.changes_ppm(gain, script.NOMINAL | change) for gain in (None, 1e6)]
        assert shown == [round(each) for k, seen in found for each in (k, seen, k - seen)]
