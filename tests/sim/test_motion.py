from __future__ import annotations

import cmath
import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from simrack.motion import RateRipple, Swing, TableMotion
from simrack_tests.cells import few

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench, paper_bench

if TYPE_CHECKING:
    from simrack.motion import RateSegment

    from vcfbench.sim.parameters import TableMechanics

PERFECT = ideal_bench().table
REAL = paper_bench().table


def table(mechanics: TableMechanics = PERFECT) -> tuple[VirtualClock, TableMotion]:
    clock = VirtualClock()
    motion = TableMotion(clock, mechanics, lambda: None)
    motion.close_servo()
    return clock, motion


def test_profile_is_a_trapezoid() -> None:
    clock, motion = table()
    motion.demand_rate(200.0, 100.0)
    seen = []
    for instant in (0.5, 1.9, 2.0, 9.0):
        clock.sleep_until(instant)
        seen.append((motion.profile_rate_deg_s(), motion.profile_complete()))
    assert seen == [(50.0, False), (190.0, False), (200.0, True), (200.0, True)]


def test_true_rate_follows_the_second_order_loop() -> None:
    clock, motion = table()
    motion.demand_rate(100.0, 200.0)
    w, z = 2 * math.pi * 25.0, 0.8
    solved = solve_ivp(
        lambda t, s: [s[1], w * w * (min(200.0 * t, 100.0) - s[0]) - 2 * z * w * s[1], s[0]],
        (0.0, 0.8), [0.0, 0.0, 0.0], "DOP853", rtol=1e-10, atol=1e-10, max_step=1e-3, dense_output=True,
    )  # fmt: skip
    for instant in (0.003, 0.05, 0.3, 0.5, 0.51, 0.55, 0.8):
        clock.sleep_until(instant)
        assert solved.sol is not None
        rate, _, angle = solved.sol(instant)
        assert motion.rate_deg_s() == pytest.approx(rate, abs=1e-5)
        assert motion.angle_deg() == pytest.approx(angle, abs=1e-6)


def test_mean_rate_error_scales_the_rate() -> None:
    clock, motion = table(replace(PERFECT, rate_error=1e-3))
    motion.demand_rate(50.0, 1000.0)
    clock.sleep_until(2.0)
    assert motion.rate_deg_s() == pytest.approx(50.05, rel=1e-12)


def test_ripple_follows_angle_and_averages_out() -> None:
    """An angle error A sin(k angle + phase) makes the rate ripple by k A, 24 ppm for 5 arcsec once a turn."""
    mechanics = replace(PERFECT, ripple_arcsec=(5.0,), ripple_harmonic=(1,), ripple_phase_rad=(0.4,))
    clock, motion = table(mechanics)
    motion.demand_rate(100.0, 200.0)
    clock.sleep_until(2.0)
    start = motion.angle_deg()
    rates, angles = [], []
    for step in range(1, 361):
        clock.sleep_until(2.0 + 0.01 * step)
        rates.append(motion.rate_deg_s())
        angles.append(motion.angle_deg())
    wanted = 100.0 * (1 + math.radians(5 / 3600) * np.cos(np.radians(angles) + 0.4))
    assert np.max(np.abs(np.array(rates) - wanted)) < 1e-6  # 1e-8 of the rate: the ripple's own ripple
    assert motion.angle_deg() - start == pytest.approx(360.0, abs=1e-9)


def test_open_servo_coasts_down_by_dry_and_viscous_friction() -> None:
    clock, motion = table(REAL)
    motion.demand_rate(-100.0, 200.0)
    clock.sleep_until(3.0)
    rate = motion.rate_deg_s()
    motion.open_servo()
    assert not motion.servo_closed
    assert motion.rate_deg_s() == pytest.approx(rate)
    clock.sleep_until(4.0)
    assert motion.rate_deg_s() == pytest.approx((rate - 100.0) * math.exp(-1 / 20.0) + 100.0)
    clock.sleep_until(3.0 + 20.0 * math.log(1 + abs(rate) / 100.0) + 1e-6)
    assert motion.rate_deg_s() == 0.0
    with pytest.raises(RuntimeError, match="servo is open"):
        motion.demand_rate(1.0, 1.0)


def test_closing_the_servo_on_a_coasting_table_holds_its_rate() -> None:
    clock, motion = table(REAL)
    motion.demand_rate(100.0, 200.0)
    clock.sleep_until(3.0)
    motion.open_servo()
    clock.sleep_until(4.0)
    rate = motion.rate_deg_s()
    motion.close_servo()
    clock.sleep_until(6.0)
    assert motion.rate_deg_s() == pytest.approx(rate, rel=1e-4)


def test_a_demand_needs_an_acceleration() -> None:
    _, motion = table()
    with pytest.raises(ValueError, match="acceleration"):
        motion.demand_rate(1.0, 0.0)
    with pytest.raises(ValueError, match="jerk"):
        motion.demand_rate(1.0, 1.0, 0.0)


def jerked(t: np.ndarray, change: float, most: float, jerk: float) -> np.ndarray:
    """A rate from rest to `change` within acceleration and jerk, by numbers: the integral of what a piece does."""
    rising = min(most / jerk, math.sqrt(change / jerk))
    along = max(change / most - most / jerk, 0.0)
    slope = jerk * np.clip(np.minimum(t, 2 * rising + along - t), 0.0, rising)
    return np.concatenate(([0.0], np.cumsum((slope[1:] + slope[:-1]) / 2.0 * np.diff(t))))


@pytest.mark.parametrize(
    ("change", "most", "jerk"),
    few([(100.0, 100.0, 100.0), (100.0, 50.0, 100.0), (30.0, 1000.0, 2e4)], (30.0, 1000.0, 2e4)),
)
def test_ramp_with_jerk_is_response_of_loop(change: float, most: float, jerk: float) -> None:
    """Runge-Kutta of u'' + 2 zeta w u' + w^2 u = w^2 r, r the profile on a grid; 0.72 deg/s at 0.12 s of jerk 100."""
    clock, motion = table()
    motion.demand_rate(change, most, jerk)
    natural, damping, step = 2 * math.pi * PERFECT.loop_hz, PERFECT.loop_damping, 1e-4
    whole = change / most + most / jerk if change > most**2 / jerk else 2 * math.sqrt(change / jerk)
    fine = np.arange(0.0, whole + 0.4, step / 20)
    profile = jerked(fine, change, most, jerk)[::10]  # twice a step
    y = np.zeros(3)

    def slope(state: np.ndarray, commanded: float) -> np.ndarray:
        rate, acceleration, _ = state
        return np.array([acceleration, natural**2 * (commanded - rate) - 2 * damping * natural * acceleration, rate])

    looks = {round(share * (whole + 0.35) / step) for share in (0.01, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0)}
    for n in range(max(looks)):
        now, middle, then = profile[2 * n : 2 * n + 3]
        k1 = slope(y, now)
        k2 = slope(y + step / 2 * k1, middle)
        k3 = slope(y + step / 2 * k2, middle)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + slope(y + step * k3, then))
        if n + 1 in looks:
            clock.sleep_until((n + 1) * step)
            assert motion.profile_rate_deg_s() == pytest.approx(then, abs=1e-7 * change)
            assert motion.rate_deg_s() == pytest.approx(y[0], abs=2e-7 * change)
            assert motion.angle_deg() == pytest.approx(y[2], abs=2e-7 * change)
    assert motion.profile_complete()
    assert motion.complete_s == pytest.approx(whole)
    if (most, jerk) == (100.0, 100.0):
        assert jerked(np.linspace(0.0, 0.12, 1001), change, most, jerk)[-1] == pytest.approx(0.72, rel=1e-3)


def test_demand_amid_ramp_leaves_acceleration_continuous() -> None:
    clock, motion = table()
    motion.demand_rate(100.0, 50.0, 100.0)
    clock.sleep_until(1.0)
    before = motion.profile_rate_deg_s(), motion.profile_acceleration_deg_s2(), motion.angle_deg()
    assert before[1] == pytest.approx(50.0)
    motion.demand_rate(-20.0, 50.0, 100.0)
    after = motion.profile_rate_deg_s(), motion.profile_acceleration_deg_s2(), motion.angle_deg()
    assert after == pytest.approx(before, rel=1e-9)
    clock.sleep_until(1.25)  # half of the acceleration is gone, and the rate has still grown
    assert motion.profile_acceleration_deg_s2() == pytest.approx(25.0)
    assert motion.profile_rate_deg_s() == pytest.approx(before[0] + 0.25 * (50.0 + 25.0) / 2)


@pytest.mark.parametrize("jerk", [math.inf, 200.0, 1e5])
@pytest.mark.parametrize("goal", [120.0, -120.0])
def test_when_a_ramp_is_beyond_a_rate_is_told_before(goal: float, jerk: float) -> None:
    clock, motion = table()
    motion.demand_rate(goal, 60.0, jerk)
    for rate in (1.0, 60.0, 119.0):
        crossing = motion.beyond_s(rate)
        clock.sleep_until(crossing)
        assert motion.profile_rate_deg_s() == pytest.approx(math.copysign(rate, goal), rel=1e-6)
    assert motion.beyond_s(120.0) == math.inf


demands = st.lists(
    st.tuples(
        st.floats(-300, 300),
        st.floats(1.0, 1000.0),
        st.sampled_from([math.inf, 50.0, 1e4]),
        st.floats(0.001, 3.0),
    ),
    min_size=1,
    max_size=4,
)


def integral(segment: RateSegment, start_s: float, stop_s: float) -> float:
    """Gauss-Legendre of the rate, 10 nodes each 20 ms (half a period of the rate loop)."""
    nodes, weights = np.polynomial.legendre.leggauss(10)
    edges = np.linspace(start_s, stop_s, math.ceil((stop_s - start_s) / 0.02) + 2)
    half = (edges[1] - edges[0]) / 2
    return float(half) * math.fsum(
        w * segment.rate_at(edge + half * (1 + x)) for edge in edges[:-1] for x, w in zip(nodes, weights, strict=True)
    )


@settings(max_examples=20, deadline=None)
@given(demands)
def test_angle_is_continuous_integral_of_rate(
    orders: list[tuple[float, float, float, float]],
) -> None:
    clock, motion = table(replace(REAL, ripple_arcsec=(), ripple_harmonic=(), ripple_phase_rad=()))
    for rate, acceleration, jerk, wait in orders:
        before = (motion.rate_deg_s(), motion.angle_deg())
        motion.demand_rate(rate, acceleration, jerk)
        now = clock.now()
        segment = motion.segment(now)
        rounded = 4.0 * math.ulp(sum(abs(a) for a, _ in segment.terms))  # t^2 of a jerk is a sum of large exponentials
        assert (motion.rate_deg_s(), motion.angle_deg()) == pytest.approx(before, rel=1e-9, abs=1e-9 + rounded)
        end = min(now + wait, segment.stop_s)
        turned = integral(segment, now, end)
        assert segment.angle_at(end) - segment.angle_at(now) == pytest.approx(turned, rel=1e-6, abs=1e-6)
        clock.sleep_until(now + wait)


@settings(max_examples=20, deadline=None)
@given(demands)
def test_reversed_demands_give_the_reversed_motion(orders: list[tuple[float, float, float, float]]) -> None:
    (clock, motion), (other_clock, mirror) = table(), table()
    for rate, acceleration, jerk, wait in orders:
        motion.demand_rate(rate, acceleration, jerk)
        mirror.demand_rate(-rate, acceleration, jerk)
        clock.sleep_until(clock.now() + wait)
        other_clock.sleep_until(other_clock.now() + wait)
        assert mirror.rate_deg_s() == -motion.rate_deg_s()


def swinging(
    mechanics: TableMechanics = REAL, slew_deg_s: float = 20.0, phase_rad: float = 0.3
) -> tuple[VirtualClock, TableMotion]:
    clock, motion = table(mechanics)
    motion.demand_rate(40.0, 200.0)
    clock.sleep_until(1.0)
    motion.demand_rate(0.0, 200.0)
    clock.sleep_until(3.0)
    motion.oscillate(Swing(0.0, 10.0, slew_deg_s, 2.0, phase_rad))
    return clock, motion


def test_oscillation_grows_about_present_angle() -> None:
    clock, motion = swinging()
    centre = motion.angle_deg()
    natural, damping, s = 2 * math.pi * REAL.loop_hz, REAL.loop_damping, 2j * math.pi * 2.0
    answer = (1 + REAL.rate_error) * natural**2 / (s * s + 2 * damping * natural * s + natural**2)
    for instant in (3.0, 3.2, 3.4, 3.5, 3.9, 10.0, 11.37):
        clock.sleep_until(instant)
        t = instant - 3.0
        wanted = (answer * min(20.0 * t, 10.0) * cmath.exp(1j * (2 * math.pi * 2.0 * t + 0.3))).imag
        # while it grows the loop lags the envelope by its group delay, 10 ms of 20 deg/s; later only the centre is off
        assert motion.angle_deg() - centre == pytest.approx(wanted, abs=0.25 if t < 0.6 else 0.06)
    rates = []
    for _ in range(1000):
        clock.sleep_until(clock.now() + 0.5e-3)
        rates.append(motion.rate_deg_s())
    assert max(rates) == pytest.approx(10.0 * 2 * math.pi * 2.0 * abs(answer), rel=1e-4)
    assert motion.profile_complete()


def test_an_oscillation_is_the_loop_equation_integrated() -> None:
    """The loop is u'' + 2 zeta w u' + w^2 u = w^2 r, r the rate of a growing sinusoid; by Runge-Kutta from rest."""
    clock, motion = swinging(replace(REAL, rate_error=0.0), slew_deg_s=15.0, phase_rad=1.0)
    natural, damping = 2 * math.pi * REAL.loop_hz, REAL.loop_damping
    turning = 2 * math.pi * 2.0

    def commanded(t: float) -> float:
        growing = t < 10.0 / 15.0
        size, change = (15.0 * t, 15.0) if growing else (10.0, 0.0)
        return change * math.sin(turning * t + 1.0) + size * turning * math.cos(turning * t + 1.0)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], natural**2 * (commanded(t) - y[0]) - 2 * damping * natural * y[1]])

    y, step = np.array([motion.rate_deg_s(), 0.0]), 2e-4
    for n in range(5000):
        t = n * step
        k1 = slope(t, y)
        k2 = slope(t + step / 2, y + step / 2 * k1)
        k3 = slope(t + step / 2, y + step / 2 * k2)
        k4 = slope(t + step - 1e-12, y + step * k3)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if n % 500 == 499:
            clock.sleep_until(3.0 + (n + 1) * step)
            assert motion.rate_deg_s() == pytest.approx(y[0], abs=2e-3)


def test_oscillation_angle_is_integral_of_rate() -> None:
    _, motion = swinging()
    for start, stop in ((3.0, 3.4), (3.6, 7.1)):
        segment = motion.segment(start)
        turned = segment.angle_at(stop) - segment.angle_at(start)
        assert turned == pytest.approx(integral(segment, start, stop), abs=1e-6)


def test_a_demand_ends_an_oscillation_without_a_jump() -> None:
    clock, motion = swinging()
    clock.sleep_until(5.123)
    before = motion.rate_deg_s(), motion.angle_deg()
    motion.demand_rate(0.0, 500.0)
    assert (motion.rate_deg_s(), motion.angle_deg()) == pytest.approx(before, rel=1e-9)
    clock.sleep_until(7.0)
    assert motion.rate_deg_s() == pytest.approx(0.0, abs=1e-9)


def test_ripple_that_a_motor_adds_turns_with_the_table() -> None:
    clock, motion = table(replace(REAL, ripple_arcsec=(), ripple_harmonic=(), ripple_phase_rad=(), rate_error=0.0))
    motion.add_ripple(RateRipple(10.0, 200))
    motion.demand_rate(36.0, 1000.0)
    clock.sleep_until(5.0)
    rates = []
    for _ in range(1000):
        clock.sleep_until(clock.now() + 1e-4)
        rates.append(motion.rate_deg_s())
    # 36 deg/s times 200 times 10 arcsec, both ways, twenty times a second
    size = 36.0 * 200 * math.radians(10.0 / 3600.0)
    assert max(rates) - 36.0 == pytest.approx(size, rel=1e-3)
    assert 36.0 - min(rates) == pytest.approx(size, rel=1e-3)
    upwards = [n for n, (a, b) in enumerate(pairwise(rates)) if a < 36.0 <= b]
    assert np.diff(upwards) * 1e-4 == pytest.approx(np.full(len(upwards) - 1, 0.05), abs=2e-4)
