"""Flutter of the table against the closed forms of white noise through a loop of the second order."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.flutter import Flutter
from simrack.motion import TableMotion

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import paper_bench

F0, Z = 25.0, 0.8
REAL = replace(
    paper_bench().table,
    rate_error=0.0,
    ripple_arcsec=(),
    ripple_harmonic=(),
    ripple_phase_rad=(),
    flutter_per_sqrt_hz=1e-3,
)


def flutter(seed: int) -> Flutter:
    return Flutter.drawn(F0, Z, np.random.default_rng(seed))


def sampled(noise: Flutter, step_s: float, count: int, start_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Rate and angle on a grid."""
    turned = np.exp(1j * np.multiply.outer(start_s + step_s * np.arange(count), noise.speeds_rad_s))
    return (turned @ noise.rates).real, (turned @ noise.angles_s).real


@pytest.mark.exhaustive
def test_rate_and_angle_have_the_variances_of_the_closed_forms() -> None:
    """Of white torque through the loop: rate pi z f0, angle z / (2 w0), in units of the density at f0."""
    rates, angles = zip(*(sampled(flutter(seed), 3.7e-3, 6_000) for seed in range(12)), strict=True)
    assert [rate.var() for rate in rates] == pytest.approx([math.pi * Z * F0] * 12, rel=0.05)
    assert np.mean([angle.var() for angle in angles]) == pytest.approx(Z / (4 * math.pi * F0), rel=0.06)


@pytest.mark.exhaustive
def test_flutter_density_falls_with_square_of_frequency() -> None:
    """Twelve specimens, octave by octave, against |2 z w0 s / (s^2 + 2 z w0 s + w0^2)|^2; 8 s resolve 0.1 Hz."""
    step, count = 1e-3, 8_000
    shape = np.hanning(count)
    power = np.mean([np.abs(np.fft.rfft(shape * sampled(flutter(s), step, count)[0])) ** 2 for s in range(12)], axis=0)
    power *= 2.0 * step / (shape @ shape)
    frequencies = np.fft.rfftfreq(count, step)
    wanted = (2 * Z * F0 * frequencies) ** 2
    wanted /= (F0**2 - frequencies**2) ** 2 + wanted
    edges = 2.0 * 2.0 ** np.arange(8)
    for low, high in pairwise(edges):
        octave = (low <= frequencies) & (frequencies < high)
        assert power[octave].mean() == pytest.approx(wanted[octave].mean(), rel=0.3), (low, high)
    below = frequencies < 2.0
    assert power[below].mean() == pytest.approx(wanted[below].mean(), rel=0.3)
    assert wanted[below].mean() < 0.01


def test_the_angle_stays_within_bounds_for_an_hour() -> None:
    """White noise of the rate would be off by sqrt(t/2), 42 after an hour; an encoder-locked table by 0.1 at most."""
    noise = flutter(3)
    minutes = [sampled(noise, 3.1e-3, 5000, 60.0 * minute)[1] for minute in range(0, 61, 10)]
    spread = [each.std() for each in minutes]
    assert spread == pytest.approx([math.sqrt(Z / (4 * math.pi * F0))] * len(minutes), rel=0.12)
    assert np.max(np.abs(minutes)) < 0.3


def turning(rate_deg_s: float) -> tuple[VirtualClock, TableMotion]:
    clock = VirtualClock()
    motion = TableMotion(clock, REAL, lambda: None, flutter(5))
    motion.close_servo()
    motion.demand_rate(rate_deg_s, 1000.0)
    clock.sleep_until(3.0)
    return clock, motion


def test_true_rate_is_derivative_of_true_angle() -> None:
    clock, motion = turning(100.0)
    segment, step = motion.segment(clock.now()), 1e-6
    times = 3.0 + 1e-3 * np.arange(2000)
    slopes = [(segment.angle_at(t + step) - segment.angle_at(t - step)) / (2 * step) for t in times]
    rates = [segment.rate_at(t) for t in times]
    assert np.max(np.abs(np.array(slopes) - rates)) < 2e-6
    assert np.std(rates) == pytest.approx(1e-3 * 100.0 * math.sqrt(math.pi * Z * F0), rel=0.15)


def test_no_jump_and_no_angle_is_left_where_rates_change() -> None:
    """A hundred changes: the angle is that of a table without flutter to within what there is of it at the moment."""
    calm_clock = VirtualClock()
    calm = TableMotion(calm_clock, replace(REAL, flutter_per_sqrt_hz=0.0), lambda: None)
    calm.close_servo()
    clock = VirtualClock()
    motion = TableMotion(clock, REAL, lambda: None, flutter(5))
    motion.close_servo()
    for change in range(100):
        rate = 100.0 * (-1) ** change
        before = motion.angle_deg()
        for each, at in ((calm, calm_clock), (motion, clock)):
            each.demand_rate(rate, 400.0)
            if each is motion:
                assert motion.angle_deg() == pytest.approx(before, abs=1e-9)
            at.sleep_until(1.3 * (change + 1))
    off = motion.angle_deg() - calm.angle_deg()
    assert off == pytest.approx(1e-3 * 100.0 * flutter(5).angle_at(clock.now()), abs=1e-9)
    for each, at in ((calm, calm_clock), (motion, clock)):
        each.demand_rate(0.0, 400.0)
        at.sleep_until(200.0)
    assert motion.angle_deg() == pytest.approx(calm.angle_deg(), abs=1e-9)
    assert motion.rate_deg_s() == pytest.approx(0.0, abs=1e-12)
