"""A run that a failing wire ends leaves the table at rest and outputs off where they still hear, and says so."""

from __future__ import annotations

import os
import runpy
from itertools import product
from pathlib import Path

import pytest

from tests.faults.matrix import MODES, OTHERS, WIRES, Case, all_cases, run_cases

PAGE = Path(__file__).parents[2] / "docs" / "make_faults.py"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals"),
]

FEW = [
    Case("acl", "table at rate", "tcp", "silent", lasting=True),
    Case("acl", "V_Vc on", "pty", "truncated", lasting=True),
    Case("acl", "rails on", "tcp", "doubled", lasting=True),
    Case("acl", "rails on, meter", "tcp", "doubled", lasting=True),
]


@pytest.mark.exhaustive
def test_a_few_cells(tmp_path: Path) -> None:
    ended = run_cases(FEW, tmp_path, measured=False)
    assert [(str(end.case), end.begun, end.wrong) for end in ended] == [(str(case), True, ()) for case in FEW]


@pytest.mark.fault_matrix
def test_every_cell(tmp_path: Path) -> None:
    """All cells, and the page in the docs anew."""
    ended = run_cases(all_cases(), tmp_path, workers=8)
    runpy.run_path(str(PAGE))["write_cells"]([end.as_json() for end in ended])
    assert not [(str(end.case), end.wrong) for end in ended if end.wrong or not end.begun]


@pytest.mark.fault_matrix
def test_instruments_that_drive_nothing(tmp_path: Path) -> None:
    """Every mode on the wires of multimeter and oscilloscope."""
    places = product(OTHERS, WIRES, MODES, (True, False))
    cases = [Case("acl", moment, wires, mode, lasting=lasting) for moment, wires, mode, lasting in places]
    ended = run_cases(cases, tmp_path)
    assert not [(str(end.case), end.wrong) for end in ended if end.wrong]
