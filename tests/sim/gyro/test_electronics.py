from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from simrack.oscillation import Oscillation
from simrack.sources import Approach, Drive, Ripple, Sine

from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.gyro.electronics import OutputLimits, Pin, amplify, modulate, passage, rail_current_a
from vcfbench.sim.gyro.thermal import WarmUp, resonance_at

PAPER = paper_bench()


@given(st.floats(-5, 5), st.floats(0.01, 5), st.floats(0, 6), st.floats(-1e-2, 1e-2), st.floats(-1e-2, 1e-2))
def test_modulator_of_a_sine_is_its_polynomial_at_every_instant(
    dc: float, amplitude: float, phase: float, second: float, third: float
) -> None:
    path = replace(PAPER.virtual_path, second_order_per_v=second, third_order_per_v2=third)
    speed = 2 * math.pi * 10
    node = Oscillation(dc, [(-1j * amplitude * cmath.exp(1j * phase), 1j * speed)])
    made = modulate(path, node)
    for t in np.linspace(0, 0.1, 7):
        v = dc + amplitude * math.sin(speed * t + phase)
        seen = made.constant_v + sum((a * cmath.exp(s * t)).real for a, s in made.terms)
        assert seen == pytest.approx(path.offset_v + v + second * v**2 + third * v**3, abs=1e-9)


def test_output_amplifier_is_a_clipped_polynomial() -> None:
    stage = replace(PAPER.output_stage, gain=2.0, offset_v=0.1, second_order_per_v=0.01, third_order_per_v2=0.001)
    assert amplify(stage, np.array([1.0, -1.0, 9.0]), (-8.5, 8.5)) == pytest.approx([2.148, -1.868, 8.5])
    limits = OutputLimits(stage, Oscillation(10.0, []), Oscillation(-9.0, []))
    assert limits.tightest(1.0) == (-7.5, 8.5)


def test_moving_limits_are_cut_at_three_times() -> None:
    limits = OutputLimits(PAPER.output_stage, Oscillation(10.0, [(0.1, -2.0)]), Oscillation(-10.0, [(0.1, -0.1)]))
    assert sorted(limits.cuts_s(100.0)) == pytest.approx([0.5, 2.0, 8.0, 10.0, 40.0])
    assert limits.cuts_s(1.0) == {0.5}


def test_the_generators_source_loads_against_the_pull_down() -> None:
    v_vc = passage(Drive(5.0, source_ohm=50.0), PAPER.virtual_path, 0.0).v_vc
    assert v_vc.at(np.zeros(1)) == pytest.approx(5.0 * 1e6 / 1000050)


def test_bands_of_temperature_are_entered_where_the_exponential_crosses_them() -> None:
    thermal = replace(PAPER.thermal, refresh_k=0.1)
    for start, goal in ((20.0, 21.0), (21.0, 20.0), (20.0, 20.0)):
        warm_up = WarmUp(5.0, start, goal, 300.0)
        bands = warm_up.bands(thermal)
        assert bands[0] == (5.0, round(start / 0.1))
        assert bands[-1][1] == round(goal / 0.1)
        for instant, band in bands[1:]:
            assert abs(warm_up.at(instant) - band * 0.1) == pytest.approx(0.05)


def test_frequency_and_quality_follow_the_temperature() -> None:
    mode = resonance_at(PAPER.drive_mode, PAPER.thermal, 30.0)
    assert mode.natural_rad_s / (2 * math.pi) == pytest.approx(3488.9 * (1 - 300e-6), rel=1e-12)
    assert mode.quality == pytest.approx(1395 * 0.98)


def test_rail_below_brown_out_draws_no_start_up_current() -> None:
    supply = PAPER.supply
    assert rail_current_a(supply, -3.5, 1.0) == pytest.approx(0.5 * supply.quiescent_a)
    assert rail_current_a(supply, 10.0, 0.5) == pytest.approx(supply.quiescent_a + 0.5 * supply.start_up_a)


def test_several_sines_stay_exact_through_the_modulators_curvature() -> None:
    path = replace(paper_bench().virtual_path, offset_v=0.01, second_order_per_v=0.02, third_order_per_v2=0.03)
    terms = [(0.4 + 0.1j, 200j), (0.2 - 0.3j, 600j), (0.1j, 47j), (0.05 + 0j, 153j)]
    node = Oscillation(0.7, terms)
    times = np.linspace(0.0, 1.0, 777)
    v = node.at(times)
    np.testing.assert_allclose(modulate(path, node).at(times), 0.01 + v + 0.02 * v**2 + 0.03 * v**3, atol=1e-8)
    np.testing.assert_allclose(node.later(0.3).at(times), node.at(times + 0.3), atol=1e-12)


def test_rail_has_its_ripple_and_the_sines_beside_it() -> None:
    beside = (Sine(2e-3, 300.0, 0.7), Sine(1e-3, 1234.5, -0.2))
    pin = Pin(1.0, Approach(9.7), Ripple(0.3e-3, 100.0, 0.4, beside))
    elapsed_s = np.linspace(0.0, 0.02, 41)
    t = 3.3 + elapsed_s
    expected = 9.7 + math.sqrt(2.0) * 0.3e-3 * np.cos(2.0 * np.pi * 100.0 * t + 0.4)
    for sine in beside:
        expected += sine.amplitude_v * np.sin(2.0 * np.pi * sine.frequency_hz * t + sine.phase_rad)
    assert pin.voltage(3.3).at(elapsed_s) == pytest.approx(expected, abs=1e-12)
