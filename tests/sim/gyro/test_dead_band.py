"""A dead band of the simulated gyroscope: nothing within, all but its half width beyond, by rate and by V_Vc."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.sources import Drive

import vcfbench
from tests.sim.gyro.bench import mean_v, powered
from vcfbench.sim.gyro.design import ideal_bench, paper_bench
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.parameters import Contradiction
from vcfbench.testing import simulated

IDEAL = ideal_bench()
HALF_DEG_S = 0.5
BANDED = replace(IDEAL, sense_path=replace(IDEAL.sense_path, dead_band_deg_s=HALF_DEG_S))
K_VC = 150.0


def settled_v(bench: object, rate_deg_s: float, volts: float | None) -> float:
    clock, world = powered(bench)  # type: ignore[arg-type]
    world.table.demand_rate(rate_deg_s, 1000.0)
    world.drive("v_vc", None if volts is None else Drive(volts, source_ohm=0.0))
    clock.sleep_until(10.0)
    return mean_v(clock, world, 1.0)


@pytest.mark.parametrize(
    ("rate_deg_s", "volts", "past_deg_s"),
    [
        (0.3, None, 0.0),
        (-0.3, None, 0.0),
        (2.0, None, 1.5),
        (-2.0, None, -1.5),
        (0.0, 0.4 / K_VC, 0.0),
        (0.0, -3.0 / K_VC, -2.5),
        (0.4, 0.4 / K_VC, 0.3),
        (3.0, -3.3 / K_VC, 0.0),
    ],
)
def test_the_output_is_that_of_what_lies_beyond(rate_deg_s: float, volts: float | None, past_deg_s: float) -> None:
    """Rate and virtual rate count together; against the line of the same gyroscope without it."""
    expected = warm_output(IDEAL, 0.0)(past_deg_s, None)
    assert settled_v(BANDED, rate_deg_s, volts) == pytest.approx(expected, abs=1e-7)
    assert warm_output(BANDED, 0.0)(rate_deg_s, volts) == pytest.approx(expected, abs=1e-7)


def test_step_out_of_dead_band_equals_smaller_step() -> None:
    seen = []
    for bench, volts in ((BANDED, 2.0 / K_VC), (IDEAL, 1.5 / K_VC)):
        clock, world = powered(bench)
        world.drive("v_vc", Drive(volts, source_ohm=0.0))
        capture = world.capture(4.0, 4.1)
        clock.sleep_until(4.2)
        seen.append(capture.samples("output", np.linspace(4.0, 4.1, 50)))
    assert seen[0] == pytest.approx(seen[1], abs=1e-9)
    assert abs(seen[1]).max() > 10e-3


@pytest.mark.parametrize("node", ["v_vc", "vibration"])
def test_a_sine_is_refused_before_anything_changes(node: str) -> None:
    clock, world = powered(BANDED)
    world.drive("v_vc", Drive(2.0 / K_VC, source_ohm=0.0))
    with pytest.raises(Contradiction, match=f"no sense_path.dead_band_deg_s where {node} gets more than a level"):
        world.drive(node, Drive(0.0, frequency_hz=5.0, amplitude_v=1.0 / K_VC, source_ohm=0.0))
    clock.sleep_until(10.0)
    assert mean_v(clock, world, 1.0) == pytest.approx(warm_output(IDEAL, 0.0)(1.5, None), abs=1e-7)
    powered(IDEAL)[1].drive(node, Drive(0.0, frequency_hz=5.0, amplitude_v=1.0 / K_VC, source_ohm=0.0))


@pytest.mark.exhaustive
def test_vibration_with_dead_band_is_refused_and_bench_safe() -> None:
    overrides = {"sense_path": {"dead_band_deg_s": 0.5}, "pick_up": {"v_vc_lead_v": 0.0}}
    with pytest.raises(Contradiction, match=r"where v_vc gets more than a level, got 0\.5"):
        vcfbench.run("bandwidth", simulated("lab", overrides=overrides), seed=1, runs=None)


def test_with_what_it_cannot_be_combined() -> None:
    paper = paper_bench()
    with pytest.raises(Contradiction, match=r"no sense_path\.v_vc_feedthrough and no pick_up\.v_vc_lead_v"):
        replace(paper, sense_path=replace(paper.sense_path, dead_band_deg_s=0.1))
    assert math.isclose(paper.pick_up.v_vc_lead_v, 20e-6)
