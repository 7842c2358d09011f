from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.rate_tables.axis import TableAxis, TableErrors

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

QUIET = TableErrors.none()


def world() -> tuple[VirtualClock, World]:
    clock = VirtualClock()
    made = World(clock, ideal_bench(), 0)
    made.table.close_servo()
    return clock, made


@pytest.mark.parametrize("goal", [50.0, -120.0])
def test_rate_read_back_is_a_delayed_mean(goal: float) -> None:
    clock, made = world()
    axis = TableAxis(made, replace(QUIET, readback_delay_s=2e-3, rate_estimate_s=20e-3))
    clock.sleep_until(1.0)
    made.table.demand_rate(goal, 100.0)
    clock.sleep_until(1.1)
    # in the ramp the estimate is as old as the delay and half the estimator
    age = 2e-3 + 10e-3
    assert made.table.rate_deg_s() - axis.rate_deg_s() == pytest.approx(np.sign(goal) * 100.0 * age, rel=0.05)
    clock.sleep_until(5.0)
    assert axis.rate_deg_s() == pytest.approx(goal, rel=1e-9)


def test_the_angle_read_back_is_late_by_its_delay() -> None:
    clock, made = world()
    axis = TableAxis(made, replace(QUIET, readback_delay_s=5e-3))
    made.table.demand_rate(80.0, 400.0)
    clock.sleep_until(2.0)
    assert made.table.angle_deg() - axis.angle_deg() == pytest.approx(80.0 * 5e-3, rel=1e-9)


def test_looking_back_reaches_across_commands() -> None:
    clock, made = world()
    angles = {}
    for instant in np.arange(0.0, 1.0, 0.1):
        clock.sleep_until(float(instant))
        angles[float(instant)] = made.table.angle_deg()
        made.table.demand_rate(30.0 * float(instant), 200.0)
    made.table.open_servo()
    clock.sleep_until(1.0)
    for instant, angle in angles.items():
        assert made.table.past_angle_deg(1.0 - instant) == pytest.approx(angle, abs=1e-9)


def test_times_that_the_motion_is_not_remembered_for_are_refused() -> None:
    with pytest.raises(ValueError, match=r"at most 0\.5"):
        replace(QUIET, rate_estimate_s=0.6)
    with pytest.raises(ValueError, match="at least 0"):
        replace(QUIET, readback_delay_s=-1e-3)


def test_none_says_what_is_now() -> None:
    clock, made = world()
    axis = TableAxis(made, QUIET)
    made.table.demand_rate(80.0, 400.0)
    clock.sleep_until(0.1)
    assert (axis.angle_deg(), axis.rate_deg_s()) == (made.table.angle_deg(), made.table.rate_deg_s())
