"""Ramps within a jerk, against a controller that looks at each instant what it may do next, and against textbooks."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack.s_curve import JerkSegment, braking_deg, peak_deg_s, ramp, ramp_s


def stepped(rate: float, slope: float, goal: float, most: float, jerk: float) -> tuple[float, float]:
    """Time and angle until `goal` of who brakes the acceleration as late as it can be, in small steps of time."""
    dt = 2e-4 * min(most / jerk, math.sqrt(max(abs(goal - rate), 1e-3) / jerk))
    time = angle = 0.0
    while abs(goal - rate) > 2e-3 * max(1.0, abs(goal)) or abs(slope) > 5.0 * jerk * dt:
        left = goal - rate - slope * abs(slope) / (2.0 * jerk)
        change = math.copysign(jerk * dt, left)
        slope = max(min(slope + change, max(most, slope - jerk * dt)), min(-most, slope + jerk * dt))
        angle += dt * (rate + 0.5 * dt * slope)
        rate, time = rate + dt * slope, time + dt
    return time, angle


STARTS = [
    (0.0, 0.0, 100.0, 50.0, 100.0),  # all three phases
    (0.0, 0.0, 10.0, 50.0, 100.0),  # never at the limit
    (40.0, 30.0, 90.0, 50.0, 100.0),  # already speeding up
    (40.0, 30.0, 41.0, 50.0, 100.0),  # speeding up too much: beyond the goal and back
    (40.0, -45.0, 90.0, 50.0, 100.0),  # still braking
    (0.0, 80.0, 100.0, 50.0, 100.0),  # the limit was lowered meanwhile
    (-60.0, 10.0, 60.0, 200.0, 90.0),
]


@pytest.mark.parametrize("start", STARTS)
def test_ramp_has_time_and_angle_of_stepped_ramp(start: tuple[float, ...]) -> None:
    rate, slope, goal, most, jerk = start
    pieces = ramp(rate, slope, goal, most_deg_s2=most, jerk_deg_s3=jerk)
    time, angle = stepped(rate, slope, goal, most, jerk)
    assert sum(piece.lasts_s for piece in pieces) == pytest.approx(time, rel=0.01)
    assert sum(piece.way_deg() for piece in pieces) == pytest.approx(angle, rel=0.01, abs=0.2)


@settings(max_examples=40, deadline=None)
@given(st.floats(-500, 500), st.floats(-300, 300), st.floats(-500, 500), st.floats(1.0, 5000.0), st.floats(1.0, 1e5))
def test_a_ramp_holds_its_limits_and_joins(rate: float, slope: float, goal: float, most: float, jerk: float) -> None:
    pieces = ramp(rate, slope, goal, most_deg_s2=most, jerk_deg_s3=jerk)
    assert len(pieces) <= 3
    if not pieces:
        assert (rate, slope) == pytest.approx((goal, 0.0), abs=1e-6)
        return
    first, last = pieces[0], pieces[-1]
    assert (first.rate_deg_s, first.acceleration_deg_s2) == pytest.approx((rate, slope), abs=1e-6)
    assert last.rate_at(last.lasts_s) == pytest.approx(goal, abs=1e-6)
    assert slope_at_end(last) == pytest.approx(0.0, abs=1e-6)
    for before, after in pairwise(pieces):
        assert before.rate_at(before.lasts_s) == pytest.approx(after.rate_deg_s, abs=1e-6)
        assert slope_at_end(before) == pytest.approx(after.acceleration_deg_s2, abs=1e-6)
    for piece in pieces:
        assert abs(piece.jerk_deg_s3) in {0.0, jerk}
        assert max(abs(piece.acceleration_deg_s2), abs(slope_at_end(piece))) <= max(most, abs(slope)) * (1 + 1e-9)


def slope_at_end(piece: JerkSegment) -> float:
    return piece.acceleration_deg_s2 + piece.jerk_deg_s3 * piece.lasts_s


def test_without_a_limit_of_the_jerk_a_ramp_is_straight() -> None:
    assert ramp(20.0, 7.0, -60.0, most_deg_s2=40.0, jerk_deg_s3=math.inf) == [JerkSegment(2.0, 20.0, -40.0)]
    assert ramp(20.0, 0.0, 20.0, most_deg_s2=40.0, jerk_deg_s3=math.inf) == []


def test_the_time_of_a_ramp_from_rest_is_the_textbooks() -> None:
    """With the limit reached v/a + a/j, else 2 sqrt(v/j); at the border both are the same."""
    assert ramp_s(100.0, 50.0, 100.0) == pytest.approx(100.0 / 50.0 + 50.0 / 100.0)
    assert ramp_s(-9.0, 50.0, 100.0) == pytest.approx(2.0 * math.sqrt(9.0 / 100.0))
    assert ramp_s(25.0, 50.0, 100.0) == pytest.approx(2.0 * math.sqrt(25.0 / 100.0))
    assert ramp_s(100.0, 50.0, math.inf) == 2.0


@pytest.mark.parametrize("jerk", [100.0, 3e3, math.inf])
@pytest.mark.parametrize("distance", [0.01, 3.0, 500.0])
def test_move_to_a_peak_and_back_has_its_length(distance: float, jerk: float) -> None:
    peak = peak_deg_s(distance, 50.0, jerk)
    times = np.linspace(0.0, ramp_s(peak, 50.0, jerk), 20_001)
    if math.isinf(jerk):
        rates = 50.0 * times
    else:  # up by a jerk, along, and down by it: the double integral of what the acceleration does
        rising = min(50.0 / jerk, times[-1] / 2.0)
        slopes = jerk * np.minimum(np.minimum(times, rising), np.maximum(times[-1] - times, 0.0))
        rates = np.concatenate(([0.0], np.cumsum((slopes[1:] + slopes[:-1]) / 2.0 * np.diff(times))))
    assert rates[-1] == pytest.approx(peak, rel=1e-3)
    assert 2.0 * np.trapezoid(rates, times) == pytest.approx(distance, rel=1e-3)


def test_braking_from_a_rate_that_still_grows_takes_longer() -> None:
    steady = braking_deg(100.0, 0.0, most_deg_s2=50.0, jerk_deg_s3=100.0)
    assert steady == pytest.approx(0.5 * 100.0 * (100.0 / 50.0 + 50.0 / 100.0))
    assert braking_deg(100.0, 50.0, most_deg_s2=50.0, jerk_deg_s3=100.0) > steady + 100.0 * 50.0 / 100.0
    assert braking_deg(100.0, 0.0, most_deg_s2=50.0, jerk_deg_s3=math.inf) == 100.0
