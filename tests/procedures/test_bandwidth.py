"""The rate response of simulated gyroscopes against the closed form of their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from msgspec import structs

import vcfbench
from vcfbench.bench.description import Limits
from vcfbench.errors import LimitError
from vcfbench.plans.steps import SetSine
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from pathlib import Path

COLD = {"thermal": {"self_heating_k": 0.0}}
"""A gyroscope that needs no warming up."""
QUICK = {
    "warm_up_s": 0.0,
    "frequencies_hz": [2.0, 6.0, 12.0, 18.0, 30.0, 40.0, 55.0],
    "around_split": [0.54, 0.75, 0.92, 0.97, 1.0, 1.03, 1.08, 1.2, 1.5],
}
SPLIT_HZ, Q = 3488.9 - 3464.1, 1224.0


@pytest.mark.exhaustive
def test_split_and_q_come_back_from_readings_alone(tmp_path: Path) -> None:
    """+3 dB, peak and -3 dB with the in-phase mode at equal sign are 14.24, 24.73 and 35.0 Hz (docs/theory.md)."""
    run = vcfbench.run("bandwidth", simulated(overrides=COLD), seed=4, settings=QUICK, runs=tmp_path)
    assert run.error is None
    found = run.results
    assert abs(found.split_hz.value - SPLIT_HZ) < 4.0 * found.split_hz.u < 0.01
    assert abs(found.q.value - Q) < 4.0 * found.q.u < 5.0
    assert found.plus_3_db_hz.value == pytest.approx(14.25, abs=0.02)
    assert found.peak_hz.value == pytest.approx(24.73, abs=0.01)
    assert found.minus_3_db_hz.value == pytest.approx(34.98, abs=0.04)
    assert found.drive_hz == pytest.approx(3488.9, abs=5.0 * found.u_drive_hz)
    assert found.split_hz.expanded_u == pytest.approx(found.split_hz.coverage_factor * found.split_hz.u)
    assert run.directory is not None
    again = vcfbench.load_run(run.directory)
    assert again.results == found


@pytest.mark.exhaustive
def test_without_an_oscilloscope_q_knows_less(tmp_path: Path) -> None:
    """It is in proportion to the drive frequency, of which only the window is known then."""
    limits = Limits(max_v_vc_v=10.0, min_rail_v=9.5, max_rail_v=10.5, max_rail_current_a=0.2)
    small = structs.replace(simulated(overrides=COLD), oscilloscope=None, rate_table=None, limits=limits)
    run = vcfbench.run("bandwidth", small, seed=5, settings=QUICK, runs=tmp_path)
    assert run.error is None
    assert run.results.q.u == pytest.approx(Q * 14.0 / 3**0.5 / 3489.0, rel=0.1)
    assert abs(run.results.q.value - Q) < 3.0 * run.results.q.u
    assert run.not_checked


def test_a_dry_run_goes_closely_about_the_expected_split() -> None:
    steps = vcfbench.dry_run("bandwidth").steps
    words = [each.step.describe() for each in steps]
    assert any("near 24.8" in each for each in words)
    assert sum("sample the output" in each for each in words) == 35


def test_what_the_leads_pick_up_of_the_mains_is_taken_for_no_response() -> None:
    asked = {"frequencies_hz": [4.0, 9.0, 16.0, 49.5, 50.0, 51.5], "around_split": [1.0, 2.01]}
    steps = vcfbench.dry_run("bandwidth", settings=asked).steps
    sines = [each.step.frequency_hz for each in steps if isinstance(each.step, SetSine)]
    assert sines == pytest.approx([4.0, 9.0, 16.0, 51.5, 24.8], rel=0.01)


def test_a_sine_beyond_the_limit_of_v_vc_is_refused_before_anything_is_opened() -> None:
    paper = vcfbench.load_bench()
    assert paper.limits is not None
    tight = structs.replace(paper, limits=structs.replace(paper.limits, max_v_vc_v=2.0))
    with pytest.raises(LimitError, match="peak voltage 3 V"):
        vcfbench.dry_run("bandwidth", tight, settings={"sine_amplitude_v": 3.0})
