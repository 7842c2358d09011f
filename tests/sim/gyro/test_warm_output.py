"""The closed form that uncertainties are compared with, against the carrier level and against the World, warm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.sources import Drive

from tests.sim.gyro.carrier import CarrierModel
from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

PAPER = paper_bench()
LEAKING = replace(PAPER, sense_path=replace(PAPER.sense_path, carrier_feedthrough=1e-3, v_vc_feedthrough=1e-3))
OFF = {"angle_random_walk_deg_sqrt_s": 0.0, "bias_instability_deg_s": 0.0}


@pytest.mark.parametrize(("rate_deg_s", "volts"), [(0.0, None), (150.0, None), (0.0, 1.2), (-60.0, -0.8)])
def test_feedthrough_is_that_of_the_carrier_level(rate_deg_s: float, volts: float | None) -> None:
    """At the reference temperature, integrated cycle by cycle; the output stage is the closed form's own."""
    cool, equator = replace(LEAKING.thermal, self_heating_k=0.0), replace(LEAKING.site, latitude_deg=0.0)
    still = replace(LEAKING, thermal=cool, site=equator)
    model, path, stage = CarrierModel(still), still.virtual_path, still.output_stage
    v = 0.0 if volts is None else volts
    bent = path.offset_v + v + path.second_order_per_v * v**2 + path.third_order_per_v2 * v**3
    run = model.run(
        model.at_rest(), 9000, rate_rad_s=math.radians(rate_deg_s), virtual_v=0.0 if volts is None else bent
    )
    u = stage.gain * float(np.mean(run.filtered[-64:]))
    expected = stage.offset_v + u + stage.second_order_per_v * u**2 + stage.third_order_per_v2 * u**3
    assert warm_output(still, 0.0)(rate_deg_s, volts) == pytest.approx(expected, abs=1e-7)


def settled_v(bench: BenchParameters, rail_v: float, rate_deg_s: float, volts: float | None) -> float:
    """Return the output of the simulated gyroscope on such rails, warm, V."""
    clock = VirtualClock()
    world = World(clock, bench, 0)
    world.set_rail("positive", rail_v)
    world.set_rail("negative", -rail_v)
    world.table.close_servo()
    world.table.demand_rate(rate_deg_s, 1000.0)
    if volts is not None:
        world.drive("v_vc", Drive(volts, source_ohm=50.0))
    clock.sleep_until(10_000.0)
    return world.value_v("output")


@pytest.mark.parametrize("limit_n_per_v", [3.5e-7, 7e-8])
@pytest.mark.parametrize(("rate_deg_s", "volts"), [(150.0, None), (0.0, 1.2)])
def test_warm_gyroscope_at_39_degc_matches_the_closed_form(
    limit_n_per_v: float, rate_deg_s: float, volts: float | None
) -> None:
    """Quadrature of 100 deg/s would show a stiffness at another frequency; the force limit acts or not."""
    bench = replace(
        LEAKING,
        noise=replace(LEAKING.noise, **OFF),
        table=replace(LEAKING.table, rate_error=0.0, ripple_arcsec=(0.0, 0.0), flutter_per_sqrt_hz=0.0),
        pick_up=replace(LEAKING.pick_up, meter_leads_v=0.0, v_vc_lead_v=0.0),
        thermal=replace(LEAKING.thermal, ambient_c=38.7),
        sense_anti_phase=replace(LEAKING.sense_anti_phase, quadrature_rad_s=math.radians(100.0)),
        drive_loop=replace(LEAKING.drive_loop, force_limit_n_per_v=limit_n_per_v),
    )
    seen = settled_v(bench, 9.0, rate_deg_s, volts)
    assert warm_output(bench, 50.0, (9.0, -9.0))(rate_deg_s, volts) == pytest.approx(seen, abs=3e-7)
    nominal = warm_output(bench, 50.0)(rate_deg_s, volts)
    assert abs(nominal - seen) > 1e-4 * abs(seen)


def test_the_output_saturates_where_the_rails_are() -> None:
    output = warm_output(PAPER, 50.0, (9.0, -9.5))
    assert (output(-2000.0, None), output(2000.0, None)) == (9.0 - 1.5, -9.5 + 1.5)
