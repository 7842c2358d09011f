from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.optimize import brentq
from simrack_tests.cells import few

from tests.sim.gyro.bench import locked_chain
from tests.sim.gyro.plain import combs, output_v, share, steady_output_v
from vcfbench.sim.gyro.chain import Chain, ChainDesign, Forcing
from vcfbench.sim.gyro.design import Targets, design, ideal_bench, paper_bench

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

IDEAL, PAPER = ideal_bench(), paper_bench()


def still(rate_rad_s: float = 0.0, virtual_v: float = 0.0) -> Forcing:
    return Forcing(rate_rad_s, 0j, [], virtual_v, [])


def settled_v(chain: Chain, forcing: Forcing) -> float:
    start = np.zeros(8, complex)
    return chain.respond(start, forcing, 1).filtered.constant.real


@pytest.mark.parametrize("bench", [IDEAL, PAPER])
@pytest.mark.parametrize(("rate", "virtual"), [(1.0, 0.0), (-3.4, 0.0), (0.0, 2.0), (0.7, -5.0), (0.0, 0.0)])
def test_steady_demodulated_gain_meets_the_closed_form_within_1e_9(
    bench: BenchParameters, rate: float, virtual: float
) -> None:
    wanted = steady_output_v(bench, rate, virtual)
    scale = abs(steady_output_v(IDEAL, 1.0))
    assert settled_v(locked_chain(bench), still(rate, virtual)) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * scale)


@pytest.mark.parametrize("phase_deg", [0.0, 30.0, 90.0, 180.0, -75.0])
def test_the_closed_form_holds_at_any_demodulator_phase(phase_deg: float) -> None:
    bench = replace(IDEAL, sense_path=replace(IDEAL.sense_path, demodulator_phase_rad=math.radians(phase_deg)))
    wanted = steady_output_v(bench, 2.0)
    assert settled_v(locked_chain(bench), still(2.0)) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("v_vc", [0.5, -5.0])
def test_equation_16_holds_on_ideal_within_1e_9(v_vc: float) -> None:
    """Equation (16): Omega = K_FBY V_dac / (2 A_x w_d m_y) V_Vc, rad/s; at carrier phase pi it has no other sign."""
    path, loop = IDEAL.virtual_path, IDEAL.drive_loop
    omega = 2 * math.pi * IDEAL.drive_mode.frequency_hz
    k_vc = (
        path.left_comb_n_per_v2 * IDEAL.sense_path.reference_amplitude_v / (2 * loop.amplitude_m * omega * path.mass_kg)
    )
    chain = locked_chain(IDEAL)
    assert settled_v(chain, still(0.0, v_vc)) == pytest.approx(settled_v(chain, still(k_vc * v_vc)), rel=1e-9)


def test_unequal_combs_mix_the_modes_otherwise_than_a_rate_does() -> None:
    """The paper's Error 1: K_Vc lies between what each mode alone would give, so split and Q enter after all."""
    path = IDEAL.virtual_path
    unequal = replace(path, left_comb_n_per_v2=1.01 * path.left_comb_n_per_v2)
    bench = replace(IDEAL, virtual_path=unequal)
    chain, start = locked_chain(bench), np.zeros(8, complex)
    by_rate = chain.respond(start, still(1.0), 1).sense.constant
    by_virtual = chain.respond(start, still(0.0, 1.0), 1).sense.constant
    ratios = [combs(bench, m) / share(m) for m in (bench.sense_in_phase, bench.sense_anti_phase)]
    omega = 2 * math.pi * bench.drive_mode.frequency_hz
    per_volt = bench.sense_path.reference_amplitude_v / (2 * bench.drive_loop.amplitude_m * omega)
    mixed = abs(by_virtual / by_rate) * bench.virtual_path.mass_kg / per_volt
    assert ratios[0] > 1.002 * ratios[1]
    # The in-phase mode carries about a seventh of the signal.
    assert (mixed - ratios[1]) / (ratios[0] - ratios[1]) == pytest.approx(1 / 7, abs=0.01)


def response_gain(chain: Chain, frequency_hz: float) -> float:
    """Gain from V_Vc to the filtered signal at a frequency, relative to direct voltage: part seen at +-f together."""
    s = 2j * math.pi * frequency_hz
    forcing = Forcing(0j, 0j, [], 0j, [(0.5 + 0j, s), (0.5 + 0j, -s)])
    signal = chain.respond(np.zeros(8, complex), forcing, 1).filtered
    plus, minus = (signal.amplitudes[8 + i] for i in range(2))  # after the eight eigenmodes
    return float(abs(plus + minus.conjugate()) / abs(settled_v(chain, still(0.0, 1.0))))


SINGLE = replace(IDEAL, sense_in_phase=replace(IDEAL.sense_in_phase, left_participation=0.0, right_participation=0.0))
OPPOSITE = replace(
    IDEAL, sense_in_phase=replace(IDEAL.sense_in_phase, left_participation=-0.8, right_participation=-0.2)
)


@pytest.mark.parametrize(
    ("bench", "up_hz", "down_hz"), few([(SINGLE, 13.49, 38.6), (IDEAL, 14.24, 35.0), (OPPOSITE, 12.60, 46.9)], every=3)
)
def test_frequency_response_has_its_three_points(bench: BenchParameters, up_hz: float, down_hz: float) -> None:
    chain, root_2 = locked_chain(bench), math.sqrt(2)
    up = brentq(lambda f: response_gain(chain, f) - root_2, 5.0, 20.0)
    down = brentq(lambda f: response_gain(chain, f) - 1 / root_2, 28.0, 60.0)
    assert up == pytest.approx(up_hz, abs=0.011)
    assert down == pytest.approx(down_hz, abs=0.11)
    grid = np.linspace(24.0, 25.5, 601)
    peak = grid[int(np.argmax([response_gain(chain, f) for f in grid]))]
    assert peak == pytest.approx(24.8, abs=0.1)  # damping and the in-phase mode pull it by some 0.05 Hz


def test_single_mode_peaks_8_8_fold_at_24_76_hz() -> None:
    chain = locked_chain(SINGLE)
    grid = np.linspace(24.0, 25.5, 601)
    gains = [response_gain(chain, f) for f in grid]
    assert max(gains) == pytest.approx(8.8, abs=0.06)
    assert grid[int(np.argmax(gains))] == pytest.approx(24.76, abs=0.03)


def test_response_rises_3_db_at_0_54_of_split() -> None:
    """|H| = df^2/(df^2 - f^2) for a single mode of high quality: +3 dB at 0.5412 df, as the paper's bandwidth."""
    assert 20 * math.log10(response_gain(locked_chain(SINGLE), 0.5412 * 24.8)) == pytest.approx(3.0, abs=0.1)


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.5, 3.5), st.floats(-50, 50), st.floats(0.01, 2.0), st.floats(0.05, 0.95))
def test_two_intervals_are_one_interval(rate: float, slope: float, duration: float, part: float) -> None:
    chain = locked_chain(PAPER)
    terms = [(0.3 + 0j, -125.0 + 90j), (0.3 + 0j, -125.0 - 90j)]
    start = np.zeros(8, complex)
    once = chain.respond(start, Forcing(rate, slope, terms, 1.0, []), 1).modal(duration)
    first = duration * part
    middle = chain.respond(start, Forcing(rate, slope, terms, 1.0, []), 1).modal(first)
    later = [(a * np.exp(s * first), s) for a, s in terms]
    turn = complex(np.exp(2j * chain.drive_rad_s * first))
    forcing = Forcing(rate + slope * first, slope, later, 1.0, [])
    twice = chain.respond(middle, forcing, turn).modal(duration - first)
    assert np.max(np.abs(once - twice)) < 1e-11 * np.max(np.abs(once))


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.5, 3.5), st.floats(-5.0, 5.0), st.floats(0.001, 1.0))
def test_reversed_inputs_give_the_reversed_signal_on_ideal(rate: float, virtual: float, at: float) -> None:
    chain = locked_chain(IDEAL)
    start = np.zeros(8, complex)
    seen = chain.respond(start, still(rate, virtual), 1).filtered.at(np.array([at]))[0]
    mirrored = chain.respond(start, still(-rate, -virtual), 1).filtered.at(np.array([at]))[0]
    assert mirrored == pytest.approx(-seen, rel=1e-12, abs=1e-18)


def test_design_meets_its_targets() -> None:
    """Structure of the turntable column: c2 = -1.06e-7, c3 = 3.3e-10 V/(deg/s)^n, slope and intercept of its line."""
    targets = Targets(-42.041e-3, -12.55e-3, -1.06e-7, 3.3e-10, 40.0, 51.7e-3)
    bench = design(PAPER, targets)
    rates = np.linspace(-200.0, 200.0, 9)
    earth = 15.041067 / 3600 * math.sin(math.radians(bench.site.latitude_deg))
    volts = [output_v(bench, steady_output_v(bench, math.radians(r + earth))) for r in rates]
    found = np.polynomial.polynomial.polyfit(rates, volts, 3)
    wanted = (targets.bias_v, targets.scale_factor_v_s_deg, targets.second_order, targets.third_order)
    assert found == pytest.approx(wanted, rel=1e-6)
    per_volt = output_v(bench, steady_output_v(bench, 0.0, 1e-3)) - output_v(bench, steady_output_v(bench, 0.0))
    assert per_volt / (-12.55e-3 * 1e-3) == pytest.approx(40.0, rel=1e-4)
    switched = output_v(bench, steady_output_v(bench, 0.0, bench.virtual_path.offset_v))
    assert switched - output_v(bench, steady_output_v(bench, 0.0)) == pytest.approx(51.7e-3, rel=1e-3)


def test_filter_takes_the_product_with_the_reference_through_ramps() -> None:
    """First-order filter at 1 kHz, where the 2 w_d product is a seventh: v = int w_c e^(-w_c (t - s)) V_s ref ds."""
    sense = replace(PAPER.sense_path, low_pass_order=1, low_pass_hz=1000.0)
    bench = replace(PAPER, sense_path=sense)
    chain = locked_chain(bench)
    forcing = Forcing(0.5, 300.0, [(0.2 + 0j, -80.0 + 200j), (0.2 + 0j, -80.0 - 200j)], 0.3, [])
    turn = np.exp(2j * 0.4)
    response = chain.respond(np.zeros(5, complex), forcing, turn)
    cut_off, stop, count = 2 * math.pi * 1000.0, 0.02, 400_000
    times = np.asarray((np.arange(count) + 0.5) * (stop / count), float)
    phase = 0.4 + chain.drive_rad_s * times
    v_s = (response.sense.at(times) * np.exp(1j * phase)).real
    product = sense.multiplier_per_v * sense.reference_amplitude_v * np.sin(phase + sense.demodulator_phase_rad) * v_s
    wanted = float(np.sum(cut_off * np.exp(-cut_off * (stop - times)) * product)) * stop / count
    assert response.filtered.at(np.array([stop]))[0].real == pytest.approx(wanted, rel=1e-6)


@given(
    later_s=st.floats(1e-6, 0.3), rate=st.floats(-3.0, 3.0), slope=st.floats(-1.0, 1.0), sine_hz=st.floats(0.1, 500.0)
)
@settings(max_examples=15, deadline=None)
def test_a_response_looked_at_later_is_the_same_signal(
    later_s: float, rate: float, slope: float, sine_hz: float
) -> None:
    chain = locked_chain(PAPER)
    terms = [(0.1 + 0.2j, 2j * math.pi * sine_hz)]
    start = np.zeros(8, complex)
    response = chain.respond(start, Forcing(rate, slope, terms, 0.5, [], 0.3), cmath.exp(0.7j))
    times = np.linspace(0.0, 0.2, 7)
    for signal in (response.filtered, response.sense):
        scale = signal.swing() + abs(signal.constant)
        np.testing.assert_allclose(signal.later(later_s).at(times), signal.at(later_s + times), atol=1e-9 * scale)
        whole = signal.integral(later_s + 0.2) - signal.integral(later_s)
        assert abs(signal.later(later_s).integral(0.2) - whole) < 1e-9 * scale


def written_out(chain: Chain, modal: np.ndarray, turn: complex, other: Chain) -> np.ndarray:
    """The coordinates by what outlives a change: both modes' displacement and velocity, the filter's parts."""
    parts: list[complex] = []
    for (plus, minus), (own, opposite), (p, q) in zip(
        (mode.poles for mode in chain.resonances),
        (mode.poles for mode in other.resonances),
        modal[:4].reshape(2, 2),
        strict=True,
    ):
        y, dy = (p - q) / (plus - minus), (plus * p - minus * q) / (plus - minus)
        parts += [dy - opposite * y, dy - own * y]
    filtered = modal[4:] + (chain.coupling + turn * chain.turned_coupling) @ modal[:4]
    return np.concatenate((parts, filtered - (other.coupling + turn * other.turned_coupling) @ np.array(parts)))


def test_a_change_of_the_drive_alone_leaves_the_modes_parts() -> None:
    """The short way of `handed_over` gives the same coordinates as the state written out."""
    chain, random = locked_chain(PAPER), np.random.default_rng(3)
    design_ = ChainDesign(PAPER)
    other = design_.chain(chain.resonances, chain.drive_rad_s * 1.001, -1.1e-6 + 2e-8j, -0.05j)
    modal, turn = random.standard_normal(8) + 1j * random.standard_normal(8), cmath.exp(1.3j)
    expected = written_out(chain, modal, turn, other)
    np.testing.assert_allclose(chain.handed_over(modal, turn, other), expected, rtol=1e-9)


def test_a_change_of_the_modes_writes_the_state_out() -> None:
    """Two temperatures: the parts of the modes are others in the other chain."""
    chain, random = locked_chain(PAPER), np.random.default_rng(4)
    warmer = [replace(mode, natural_rad_s=mode.natural_rad_s * 1.001) for mode in chain.resonances]
    other = ChainDesign(PAPER).chain(tuple(warmer), chain.drive_rad_s, -1.1e-6 + 2e-8j, -0.05j)
    modal, turn = random.standard_normal(8) + 1j * random.standard_normal(8), cmath.exp(1.3j)
    given, expected = chain.handed_over(modal, turn, other), written_out(chain, modal, turn, other)
    np.testing.assert_allclose(given, expected, rtol=1e-9)
    assert np.abs(given[:4] - modal[:4]).max() > 1e-6
