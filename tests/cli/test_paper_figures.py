"""The embedded bench gives the figures of the paper, each within the tolerance that was asked for."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from vcfbench.cli.main import app

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("seed", few([0, 1, 2], 0))
def test_the_four_step_calibration_gives_the_papers_table_1(seed: int, tmp_path: Path) -> None:
    """K within 0.1 and 0.2 %, biases within 1 mV, non-linearities within 15 %, the error within 0.15 points."""
    command = ["run", "virtual-coriolis", "--json", "--quiet", "--seed", str(seed), "--runs", str(tmp_path)]
    results = json.loads(CliRunner().invoke(app, command).stdout)["results"]
    turntable, virtual = results["turntable"], results["virtual"]
    assert turntable["scale_factor"]["value"] == pytest.approx(-12.54e-3, rel=1e-3)
    assert turntable["bias"]["value"] == pytest.approx(-42.04e-3, abs=1e-3)
    assert turntable["nonlinearity_ppm"]["max_span_rounded"] == pytest.approx(742, rel=0.15)
    assert virtual["scale_factor"]["value"] == pytest.approx(-12.73e-3, rel=2e-3)
    assert virtual["bias"]["value"] == pytest.approx(0.66e-3, abs=1e-3)
    assert virtual["nonlinearity_ppm"]["max_span_rounded"] == pytest.approx(3389, rel=0.15)
    assert results["scale_factor_error_percent"] == pytest.approx(1.515, abs=0.15)
    assert virtual["zero_v"] - turntable["zero_v"] == pytest.approx(51.7e-3, abs=1e-3)
