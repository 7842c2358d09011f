"""The case of the simulated gyroscope turned: gravity along its axes, the Earth's rate and the table's along z."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace

from tests.sim.gyro.bench import mean_v, powered
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.parameters import Contradiction, Site
from vcfbench.sim.world import UP_AXES

IDEAL = ideal_bench()
FELT = replace(
    IDEAL,
    sense_path=replace(IDEAL.sense_path, g_sensitivity_deg_s_g=(0.5, -0.2, 1.0)),
    site=replace(IDEAL.site, latitude_deg=60.0),
)
EARTH_DEG_S = 15.041067 / 3600.0
GRAVITY = 9.81918 / 9.80665
"""At 60 degrees, sea level (WGS 84)."""


@pytest.mark.parametrize(
    ("up", "felt", "upright"),
    [("+x", 0.5, 0.0), ("-x", -0.5, 0.0), ("+y", -0.2, 0.0), ("-y", 0.2, 0.0), ("+z", 1.0, 1.0), ("-z", -1.0, -1.0)],
)
def test_output_follows_gravity_and_rates_about_the_input_axis(up: str, felt: float, upright: float) -> None:
    clock, world = powered(FELT)
    world.set_up_axis(up)
    world.table.demand_rate(10.0, 1000.0)
    clock.sleep_until(20.0)
    assert world.up_axis() == up
    rate = GRAVITY * felt + upright * (10.0 + EARTH_DEG_S * math.sin(math.radians(60.0)))
    expected = warm_output(IDEAL, 0.0)(rate, None)
    assert mean_v(clock, world, 1.0) == pytest.approx(expected, abs=3e-8)
    turned = replace(FELT, site=replace(FELT.site, up=UP_AXES[up]))
    assert warm_output(turned, 0.0)(10.0 * upright, None) == pytest.approx(expected, abs=3e-8)


def test_directions_that_are_none() -> None:
    _, world = powered(IDEAL)
    with pytest.raises(ValueError, match=r"up is one of \+x, -x, \+y, -y, \+z, -z, not 'up'"):
        world.set_up_axis("up")
    with pytest.raises(Contradiction, match=r"length 1 in site\.up"):
        replace(IDEAL, site=Site(up=(1.0, 1.0, 0.0)))
    with pytest.raises(Contradiction, match="three figures in sense_path"):
        replace(IDEAL, sense_path=replace(IDEAL.sense_path, g_sensitivity_deg_s_g=(1.0,)))
