from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from simrack.serve.adjust import adjustments_of
from simrack.sources import Drive, Ripple, Sine

from tests.sim.gyro.bench import mean_v, powered
from tests.sim.gyro.plain import output_v, steady_output_v
from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench, paper_bench
from vcfbench.sim.world import NODES, World

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

IDEAL, PAPER = ideal_bench(), paper_bench()
QUIET = replace(
    PAPER,
    noise=replace(PAPER.noise, angle_random_walk_deg_sqrt_s=0.0, bias_instability_deg_s=0.0),
    table=replace(PAPER.table, flutter_per_sqrt_hz=0.0),
    pick_up=IDEAL.pick_up,
)
K_IDEAL = -12.542052e-3


def k_vc_deg_s_v(bench: BenchParameters) -> float:
    """Equation (16) with the left combs' K_FBY, deg/s per V."""
    omega = 2 * math.pi * bench.drive_mode.frequency_hz
    force = bench.virtual_path.left_comb_n_per_v2 * bench.sense_path.reference_amplitude_v
    return math.degrees(force / (2 * bench.drive_loop.amplitude_m * omega * bench.virtual_path.mass_kg))


def modulated_v(bench: BenchParameters, v: float) -> float:
    path = bench.virtual_path
    return path.offset_v + v + path.second_order_per_v * v**2 + path.third_order_per_v2 * v**3


def steady_v(bench: BenchParameters, rate_deg_s: float, virtual_v: float = 0.0) -> float:
    earth = 15.041067 / 3600 * math.sin(math.radians(bench.site.latitude_deg))
    return output_v(bench, steady_output_v(bench, math.radians(rate_deg_s + earth), virtual_v))


def test_without_supply_there_is_no_signal_and_no_current() -> None:
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.drive("v_vc", Drive(5.0))
    world.table.close_servo()
    world.table.demand_rate(100.0, 100.0)
    clock.sleep_until(5.0)
    for node in ("output", "drive", "carrier", "sense", "rail_positive", "rail_negative"):
        assert world.value_v(node) == 0.0
    assert mean_v(clock, world, 1.0) == 0.0
    assert world.rail_current_a("positive", 0.0) == 0.0


def test_one_rail_alone_is_no_supply() -> None:
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.set_rail("positive", 10.0)
    clock.sleep_until(2.0)
    assert world.value_v("output") == world.value_v("carrier") == 0.0
    assert world.value_v("rail_positive") == 10.0


def test_negative_rail_of_wrong_sign_gives_no_power() -> None:
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", 10.0)
    clock.sleep_until(2.0)
    assert world.value_v("carrier") == 0.0


def test_supply_current_is_resistive_and_larger_at_start() -> None:
    clock = VirtualClock()
    world, supply = World(clock, PAPER, 0), PAPER.supply
    assert world.rail_current_a("positive", 3.5) == pytest.approx(0.5 * supply.quiescent_a)
    assert world.rail_current_a("positive", 10.0) == pytest.approx(supply.quiescent_a)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    assert world.rail_current_a("negative", -10.0) > supply.quiescent_a + 0.9 * supply.start_up_a
    clock.sleep_until(2.0)
    assert world.rail_current_a("negative", -10.0) == pytest.approx(supply.quiescent_a)


def test_starting_rail_draws_the_start_up_current() -> None:
    """A supply asks before it gives: the other rail is there already, this one is not."""
    bench = paper_bench()
    world = World(VirtualClock(), bench, 0)
    world.set_rail("positive", 10.0)
    starting_a = bench.supply.quiescent_a + bench.supply.start_up_a
    assert world.rail_current_a("negative", -10.0) == pytest.approx(starting_a)
    assert world.rail_current_a("negative", 0.0) == 0.0


@pytest.mark.parametrize("rate", [200.0, -50.0, 1.0])
def test_ideal_scale_factor_agrees_within_1e_9(rate: float) -> None:
    clock, world = powered(IDEAL)
    world.table.demand_rate(rate, 100.0)
    clock.sleep_until(12.0)
    assert mean_v(clock, world, 10.0) == pytest.approx(K_IDEAL * rate, rel=1e-9)


def test_v_vc_by_equation_16_gives_the_rates_output() -> None:
    clock, world = powered(IDEAL)
    world.table.demand_rate(80.0, 100.0)
    clock.sleep_until(12.0)
    turned = mean_v(clock, world, 1.0)
    world.table.demand_rate(0.0, 100.0)
    v_vc = 80.0 / k_vc_deg_s_v(IDEAL)
    loaded = (1e6 + 50.0) / 1e6  # the generator's 50 ohm against the pull-down
    world.drive("v_vc", Drive(v_vc * loaded))
    clock.sleep_until(22.0)
    assert world.value_v("v_vc") == pytest.approx(v_vc, rel=1e-12)
    assert mean_v(clock, world, 1.0) == pytest.approx(turned, rel=1e-9)


def test_generator_at_0_v_shifts_the_output_by_leakage() -> None:
    clock, world = powered(QUIET, wait_s=20.0)
    before = mean_v(clock, world, 1.0)
    world.drive("v_vc", Drive(0.0))
    clock.sleep_until(25.0)
    shift = steady_v(PAPER, 0.0, PAPER.virtual_path.offset_v) - steady_v(PAPER, 0.0)
    assert mean_v(clock, world, 1.0) - before == pytest.approx(shift, abs=0.1e-3)
    assert 0.03 < shift < 0.08
    world.drive("v_vc", None)
    clock.sleep_until(30.0)
    assert mean_v(clock, world, 1.0) == pytest.approx(before, abs=1e-5)


@pytest.mark.parametrize(("latitude", "earth_deg_h"), [(0.0, 0.0), (38.0, 9.26), (52.0, 11.85), (-38.0, -9.26)])
def test_earth_rate_by_latitude(latitude: float, earth_deg_h: float) -> None:
    clock, world = powered(replace(IDEAL, site=replace(IDEAL.site, latitude_deg=latitude)))
    assert mean_v(clock, world, 1.0) / K_IDEAL * 3600 == pytest.approx(earth_deg_h, abs=0.006)


def test_an_axis_askew_sees_the_cosine_of_table_and_earth() -> None:
    """Of constant rate, ramp, ripple and flutter alike; 45 degrees on a table whose axis is vertical, at a pole."""
    table = replace(PAPER.table, flutter_per_sqrt_hz=1e-3, loop_hz=5.0)
    seen = []
    for angle_deg in (0.0, 45.0):
        askew = replace(table, misalignment_deg=angle_deg)
        clock, world = powered(replace(IDEAL, table=askew, site=replace(IDEAL.site, latitude_deg=90.0)), seed=5)
        still = mean_v(clock, world, 1.0)
        world.table.demand_rate(50.0, 100.0)
        means = [mean_v(clock, world, 0.1) for _ in range(20)]
        assert world.table.rate_deg_s() == pytest.approx(50.0, abs=1.0)
        seen.append([still, *means])
    straight, tilted = seen
    assert straight[0] / K_IDEAL * 3600 == pytest.approx(15.041, abs=0.006)
    assert np.ptp(straight[10:]) > 1e-4
    assert tilted == pytest.approx([math.sqrt(0.5) * each for each in straight], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_output_is_linear_at_200_and_saturates_below_the_rails(sign: float) -> None:
    clock, world = powered(IDEAL)
    world.table.demand_rate(sign * 200.0, 100.0)
    clock.sleep_until(15.0)
    assert world.value_v("output") == pytest.approx(sign * 200 * K_IDEAL, rel=1e-6)
    world.table.demand_rate(sign * 1000.0, 1000.0)
    clock.sleep_until(25.0)
    assert world.value_v("output") == -sign * 8.5
    assert mean_v(clock, world, 1.0) == pytest.approx(-sign * 8.5)


def test_warm_up_moves_the_bias_as_one_exponential() -> None:
    """Bias coefficient times self-heating; the rest of the drift is that of scale factor and quadrature."""
    clock, world = powered(QUIET)
    seen = []
    for instant in (10.0, 310.0, 610.0):
        clock.sleep_until(instant)
        seen.append(mean_v(clock, world, 1.0))
    bias = replace(QUIET, thermal=replace(QUIET.thermal, bias_coefficient_deg_s_k=0.0))
    clock, world = powered(bias)
    for index, instant in enumerate((10.0, 310.0, 610.0)):
        clock.sleep_until(instant)
        seen[index] -= mean_v(clock, world, 1.0)
    thermal = QUIET.thermal
    end = -12.5527e-3 * thermal.bias_coefficient_deg_s_k * thermal.self_heating_k
    wanted = [end * (1 - math.exp(-(t + 0.5) / thermal.time_constant_s)) for t in (10.0, 310.0, 610.0)]
    assert seen == pytest.approx(wanted, rel=2e-3)


def bias_rise_v(world: World, clock: VirtualClock, bench: BenchParameters) -> float:
    """How far the warm-up has taken the output of a bench whose bias alone answers to temperature."""
    return mean_v(clock, world, 1.0) - steady_v(bench, 0.0)


def test_only_the_powered_board_warms_up() -> None:
    still = {"frequency_coefficient_per_k": 0.0, "quality_coefficient_per_k": 0.0}
    modes = {name: replace(getattr(QUIET, name), **still) for name in ("sense_in_phase", "sense_anti_phase")}
    bench = replace(QUIET, drive_mode=replace(QUIET.drive_mode, **still), **modes)
    thermal = bench.thermal
    warm = -12.5527e-3 * thermal.bias_coefficient_deg_s_k * thermal.self_heating_k
    clock = VirtualClock()
    world = World(clock, bench, 0)
    clock.sleep_until(2000.0)  # nobody has switched it on yet
    for rail, volts in (("positive", 10.0), ("negative", -10.0)):
        world.set_rail(rail, volts)
    clock.sleep_until(2005.0)
    assert bias_rise_v(world, clock, bench) == pytest.approx(warm * (1 - math.exp(-5.5 / 300.0)), rel=0.02)
    clock.sleep_until(5000.0)
    world.set_rail("positive", 0.0)
    clock.sleep_until(5010.0)
    world.set_rail("positive", 10.0)
    clock.sleep_until(5015.0)
    left = 1 - math.exp(-5.5 / 300.0) * (1 - math.exp(-10.0 / 300.0))
    assert bias_rise_v(world, clock, bench) == pytest.approx(warm * left, rel=2e-3)


@pytest.mark.parametrize("rail_v", [9.0, 9.9])
def test_k_vc_does_not_see_an_error_of_the_agc(rail_v: float) -> None:
    """V_dac follows the drive pick-off: K and the answer to V_Vc both go as A_x^2, K_Vc not at all (equation (16))."""
    loop = replace(IDEAL.drive_loop, amplitude_supply_coefficient_per_v=1e-2)
    clock, world = powered(replace(IDEAL, drive_loop=loop))
    world.set_rail("positive", rail_v)
    amplitude = 1 + 1e-2 * (rail_v - 10.0)
    world.table.demand_rate(75.0, 1000.0)
    clock.sleep_until(12.0)
    assert mean_v(clock, world, 1.0) == pytest.approx(75.0 * K_IDEAL * amplitude**2, rel=1e-9)
    world.table.demand_rate(0.0, 1000.0)
    world.drive("v_vc", Drive(0.5, source_ohm=0.0))
    clock.sleep_until(22.0)
    assert mean_v(clock, world, 1.0) == pytest.approx(0.5 * k_vc_deg_s_v(IDEAL) * K_IDEAL * amplitude**2, rel=1e-9)
    capture = world.capture(clock.now(), clock.now() + 0.002)
    clock.sleep_until(capture.stop_s)
    volts = capture.samples("carrier", np.linspace(capture.start_s, capture.stop_s, 20_001))
    assert np.max(volts) == pytest.approx(2.0 * amplitude, rel=1e-5)


def test_sine_at_twice_drive_frequency_gives_steady_output() -> None:
    """The carrier's image at f_d passes the demodulator: half of V_Vc, one more exponential that does not turn."""
    clock, world = powered(IDEAL)
    world.drive("v_vc", Drive(0.2, 0.3, 2 * 3488.9, 0.2))
    clock.sleep_until(12.0)
    window = world.window("output", 12.0, 13.0)
    clock.sleep_until(13.0)
    assert window.mean_v() == pytest.approx(world.value_v("output"), rel=1e-5)


def test_1_ppm_of_split_is_141_ppm_of_scale_factor() -> None:
    """K goes as 1/df, a single mode at 24.8 Hz: 3.5 mHz/K."""
    sense = replace(IDEAL.sense_anti_phase, frequency_coefficient_per_k=1e-6)
    other = replace(IDEAL.sense_in_phase, pick_off_v_per_m=0.0)
    gains = []
    for heating in (0.0, 1.0):
        warm = replace(IDEAL.thermal, self_heating_k=heating, time_constant_s=1.0)
        bench = replace(IDEAL, sense_anti_phase=sense, sense_in_phase=other, thermal=warm)
        clock, world = powered(bench, wait_s=30.0)
        world.table.demand_rate(100.0, 100.0)
        clock.sleep_until(40.0)
        gains.append(mean_v(clock, world, 1.0))
    assert gains[1] / gains[0] - 1 == pytest.approx(141e-6, rel=0.02)


steps = st.lists(st.floats(1e-4, 1.5), min_size=1, max_size=30)


@settings(max_examples=15, deadline=None)
@given(steps)
def test_any_partition_of_time_gives_same_state(cuts: list[float]) -> None:
    """Through start-up, a ramp, a V_Vc sine, warm-up bands: asking in between changes nothing."""

    def run(looks: list[float]) -> float:
        clock = VirtualClock()
        world = World(clock, QUIET, 0)
        world.set_rail("positive", 10.0)
        world.set_rail("negative", -10.0)
        world.drive("v_vc", Drive(1.0, 0.5, 7.0, 0.3))
        world.table.close_servo()
        world.table.demand_rate(50.0, 40.0)
        for wait in looks:
            if clock.now() + wait < 30.0:
                clock.sleep_until(clock.now() + wait)
                world.advance()
        clock.sleep_until(30.0)
        return world.value_v("output")

    assert run(cuts) == pytest.approx(run([]), rel=1e-12)


@settings(max_examples=5, deadline=None)
@given(st.lists(st.floats(1e-4, 0.9), min_size=1, max_size=10))
def test_looking_in_the_middle_of_a_ramp_changes_nothing(looks: list[float]) -> None:
    def run(instants: list[float]) -> tuple[float, float]:
        clock, world = powered(QUIET)
        world.table.demand_rate(100.0, 100.0)
        window = world.window("output", 4.2, 4.95)
        for instant in sorted(instants):
            clock.sleep_until(4.0 + instant)
            world.advance()
        clock.sleep_until(4.95)
        return world.value_v("output"), window.mean_v()

    assert run(looks) == pytest.approx(run([]), rel=1e-10)


def test_a_thousand_intervals_are_one_within_1e_12() -> None:
    (clock, world), (other_clock, other) = powered(QUIET), powered(QUIET)
    for each in (world, other):
        each.table.demand_rate(-30.0, 100.0)
        each.drive("v_vc", Drive(1.0))
    clock.sleep_until(14.0)
    for index in range(1, 1001):
        other_clock.sleep_until(4.0 + 0.01 * index)
        other.advance()
    assert other.value_v("output") == pytest.approx(world.value_v("output"), rel=1e-12)


def test_a_day_of_dwell_is_one_step() -> None:
    """Every noise process but the slowest has long forgotten; nothing overflows, nothing is lost."""
    clock, world = powered(PAPER)
    clock.sleep_until(86_400.0)
    assert mean_v(clock, world, 1.0) == pytest.approx(-42e-3, abs=2e-3)


def test_a_seed_repeats_itself_and_another_does_not() -> None:
    def record(seed: int) -> list[float]:
        clock, world = powered(PAPER, seed)
        return [mean_v(clock, world, 0.2) for _ in range(20)]

    assert record(5) == record(5)
    assert record(5) != record(6)


def test_window_over_transient_is_mean_of_capture() -> None:
    clock, world = powered(QUIET)
    start = clock.now()
    world.table.demand_rate(200.0, 1000.0)
    world.drive("v_vc", Drive(0.0, 8.0 / k_vc_deg_s_v(PAPER), 24.0))
    window, capture = world.window("output", start + 0.05, start + 0.65), world.capture(start, start + 1.0)
    node = world.window("v_vc", start + 0.01, start + 0.02)
    clock.sleep_until(start + 1.0)
    middles = np.asarray(start + 0.05 + (np.arange(60_000) + 0.5) * 1e-5, float)
    assert window.mean_v() == pytest.approx(float(capture.samples("output", middles).mean()), abs=2e-9)
    fine = np.linspace(start + 0.01, start + 0.02, 20_001)
    assert node.mean_v() == pytest.approx(float(capture.samples("v_vc", fine).mean()), abs=1e-4)


def test_clipping_window_is_right_to_a_microvolt() -> None:
    clock, world = powered(QUIET)
    start = clock.now()
    world.drive("v_vc", Drive(120.0 / k_vc_deg_s_v(PAPER), 80.0 / k_vc_deg_s_v(PAPER), 24.0))
    window, capture = world.window("output", start + 0.05, start + 0.65), world.capture(start, start + 1.0)
    clock.sleep_until(start + 1.0)
    middles = np.asarray(start + 0.05 + (np.arange(60_000) + 0.5) * 1e-5, float)
    volts = capture.samples("output", middles)
    assert volts.min() == -8.5
    assert window.mean_v() == pytest.approx(float(volts.mean()), abs=1e-6)


def test_overlapping_windows_do_not_disturb_each_other() -> None:
    clock, world = powered(QUIET)
    start = clock.now()
    world.drive("v_vc", Drive(1.0))
    alone = [world.window("output", start + a, start + b) for a, b in ((0.1, 0.3), (0.2, 0.4), (0.1, 0.4))]
    clock.sleep_until(start + 1.0)
    first, second, both = (each.mean_v() for each in alone)
    clock, world = powered(QUIET)
    world.drive("v_vc", Drive(1.0))
    middle = world.window("output", start + 0.2, start + 0.3)
    clock.sleep_until(start + 1.0)
    assert 0.3 * both == pytest.approx(0.2 * first + 0.2 * second - 0.1 * middle.mean_v(), rel=1e-12)


def test_the_scope_sees_the_phase_of_the_carrier_itself() -> None:
    """0.3 deg beyond antiphase with the drive force on `paper`; the drive is -cos(th)."""
    clock, world = powered(QUIET, wait_s=10.0)
    capture = world.capture(10.0, 10.01)
    clock.sleep_until(10.01)
    times = 10.0 + np.arange(0, 34 / 3488.9, 1e-7)
    carrier, drive = (
        np.sum(capture.samples(node, times) * np.exp(-2j * math.pi * 3488.9 * times)) for node in ("carrier", "drive")
    )
    assert np.degrees(np.angle(carrier / drive)) == pytest.approx(-90.0 + 0.3, abs=0.02)


def test_phases_on_the_scope_are_those_of_the_model() -> None:
    """Drive -cos(th), carrier V_dac sin(th + phi_c), V_s for a rate close to antiphase with the Coriolis force."""
    clock, world = powered(IDEAL)
    world.table.demand_rate(100.0, 100.0)
    clock.sleep_until(10.0)
    capture = world.capture(10.0, 10.01)
    clock.sleep_until(10.01)
    times = 10.0 + np.arange(0, 34 / 3488.9, 1e-7)
    phasors = {
        node: 2 * np.mean(capture.samples(node, times) * np.exp(-2j * math.pi * 3488.9 * times))
        for node in ("drive", "carrier", "sense")
    }
    assert abs(phasors["carrier"]) == pytest.approx(2.0, rel=1e-3)
    assert abs(phasors["drive"]) == pytest.approx(1.0, rel=1e-3)
    lead = np.degrees(np.angle(phasors["carrier"] / phasors["drive"]))
    assert lead == pytest.approx(-90.0, abs=0.1)  # -sin(th) against -cos(th)
    response = np.degrees(np.angle(phasors["sense"] / phasors["carrier"]))
    # V_s follows the Coriolis force, which has the carrier's phase, by -(180 - 3.28) deg for the anti-phase mode
    # and -(180 - 0.5) deg for the in-phase one.
    assert response == pytest.approx(-176.9, abs=0.4)


def test_slow_time_base_shows_the_output_over_events() -> None:
    clock, world = powered(QUIET)
    capture = world.capture(4.0, 14.0)
    world.table.demand_rate(100.0, 50.0)
    clock.sleep_until(8.0)
    v_vc = 40.0 / k_vc_deg_s_v(PAPER)
    world.drive("v_vc", Drive(v_vc))
    clock.sleep_until(14.0)
    volts = capture.samples("output", np.linspace(4.0, 14.0, 1001))
    before, after = steady_v(PAPER, 100.0), steady_v(PAPER, 100.0, modulated_v(PAPER, v_vc))
    assert volts[0] == pytest.approx(steady_v(PAPER, 0.0), abs=1e-3)
    assert volts[399] == pytest.approx(before, abs=1e-3)
    assert volts[-1] == pytest.approx(after, abs=1e-3)
    assert np.max(np.abs(volts[400:])) < abs(before + 2 * (after - before))  # a step overshoots to twice its size
    assert capture.samples("rail_negative", np.array([5.0]))[0] == -10.0


def test_unfinished_window_or_capture_has_no_value() -> None:
    clock, world = powered(QUIET)
    window, capture = world.window("output", 5.0, 6.0), world.capture(5.0, 6.0)
    clock.sleep_until(5.5)
    with pytest.raises(RuntimeError, match="not over"):
        window.mean_v()
    with pytest.raises(RuntimeError, match="not over"):
        capture.samples("output", np.array([5.2]))


def test_observations_of_the_past_and_unknown_names_are_refused() -> None:
    _, world = powered(QUIET)
    with pytest.raises(ValueError, match="cannot be registered"):
        world.window("output", 3.0, 5.0)
    with pytest.raises(ValueError, match="cannot be registered"):
        world.capture(5.0, 5.0)
    with pytest.raises(ValueError, match="none of output"):
        world.window("outptu", 5.0, 6.0)
    with pytest.raises(ValueError, match="none of positive"):
        world.set_rail("plus", 10.0)


@pytest.mark.parametrize("node", NODES)
def test_every_node_can_be_seen_all_ways(node: str) -> None:
    clock, world = powered(PAPER)
    window, capture = world.window(node, 4.0, 4.5), world.capture(4.0, 4.5)
    clock.sleep_until(4.5)
    assert math.isfinite(world.value_v(node))
    assert math.isfinite(window.mean_v())
    assert np.all(np.isfinite(capture.samples(node, np.linspace(4.0, 4.5, 100))))


def test_supply_ripple_is_at_pin_and_averages_out() -> None:
    clock = VirtualClock()
    world = World(clock, IDEAL, 0)
    world.set_ripple("positive", Ripple(0.3e-3, 100.0, 0.4))
    assert world.value_v("rail_positive") == 0.0  # an output that is off has none
    powered_v = {"positive": 10.0, "negative": -10.0}
    for rail, volts in powered_v.items():
        world.set_rail(rail, volts)
    capture, window = world.capture(0.0, 0.04), world.window("rail_positive", 0.0, 0.02)
    part = world.window("rail_positive", 0.0, 0.005)
    clock.sleep_until(0.05)
    times = np.linspace(0.0, 0.04, 4000, endpoint=False)
    seen = capture.samples("rail_positive", times)
    np.testing.assert_allclose(seen - 10.0, 0.3e-3 * math.sqrt(2) * np.cos(200 * math.pi * times + 0.4), atol=1e-9)
    assert window.mean_v() == pytest.approx(10.0, abs=1e-12)
    assert part.mean_v() == pytest.approx(seen[:500].mean(), abs=1e-6)
    assert np.all(capture.samples("rail_negative", times) == -10.0)


def test_who_supplies_the_rails_hears_of_a_load() -> None:
    world = World(VirtualClock(), IDEAL, 0)
    world.set_rail("positive", 10.0)
    heard: list[float] = []
    world.on_load(lambda: heard.append(world.rail_current_a("positive", 10.0)))
    before = world.rail_current_a("positive", 10.0)
    world.set_load("positive", 10.0)
    assert heard == [pytest.approx(before + 1.0)]


def test_several_sines_on_v_vc_are_seen_and_averaged() -> None:
    sines = (Sine(0.4, 30.0, 0.3), Sine(0.2, 90.0, -1.0), Sine(0.1, 7.0, 2.0))
    first, *others = sines
    clock, world = powered(QUIET)
    world.drive("v_vc", Drive(0.5, first.amplitude_v, first.frequency_hz, first.phase_rad, 50.0, tuple(others)))
    start = clock.now()
    capture, window = world.capture(start, start + 1.0), world.window("v_vc", start, start + 0.13)
    clock.sleep_until(start + 1.0)
    times = start + np.linspace(0.0, 1.0, 2000)
    wanted = 0.5 + sum(
        each.amplitude_v * np.sin(2 * math.pi * each.frequency_hz * times + each.phase_rad) for each in sines
    )
    loaded = QUIET.virtual_path.pull_down_ohm / (QUIET.virtual_path.pull_down_ohm + 50.0)
    np.testing.assert_allclose(capture.samples("v_vc", times), wanted * loaded, atol=1e-9)
    fine = start + (np.arange(20_000) + 0.5) * 0.13 / 20_000
    assert window.mean_v() == pytest.approx(capture.samples("v_vc", fine).mean(), abs=1e-7)


def test_part_of_rail_ripple_reaches_output() -> None:
    """The difference that the ripple makes is its share of the sum of both rails, in waveforms and in means."""
    bench = replace(IDEAL, supply=replace(IDEAL.supply, ripple_feedthrough=2e-3))
    times = np.linspace(4.0, 4.02, 500, endpoint=False)
    seen, means = [], []
    for rippling in (True, False):
        clock, world = powered(bench)
        if rippling:
            world.set_ripple("positive", Ripple(0.3e-3, 100.0, 0.4))
            world.set_ripple("negative", Ripple(0.2e-3, 100.0, -1.1))
        start = clock.now()
        capture = world.capture(start, start + 0.02)
        windows = [world.window("output", start, start + length) for length in (0.003, 0.02)]
        clock.sleep_until(start + 0.02)
        seen.append(capture.samples("output", times - 4.0 + start))
        means.append([window.mean_v() for window in windows])

    def ripple_v(at: Any) -> Any:
        turns = 2 * math.pi * 100.0 * at
        return 2e-3 * math.sqrt(2) * (0.3e-3 * np.cos(turns + 0.4) + 0.2e-3 * np.cos(turns - 1.1))

    instants = times - 4.0 + start
    np.testing.assert_allclose(seen[0] - seen[1], ripple_v(instants), atol=1e-12)
    fine = start + (np.arange(3000) + 0.5) * 1e-6
    assert means[0][0] - means[1][0] == pytest.approx(ripple_v(fine).mean(), rel=1e-6)
    assert means[0][1] == pytest.approx(means[1][1], abs=1e-12)


@pytest.mark.exhaustive
def test_looks_from_outside_change_no_reading_that_comes_later() -> None:
    """Through start-up, a turning table, V_Vc: nodes, currents and temperature as the control port reads them."""

    def means(*, looking: bool) -> list[float]:
        clock = VirtualClock()
        world = World(clock, PAPER, 7)
        looks = adjustments_of(world, {})
        world.set_rail("positive", 10.0)
        world.set_rail("negative", -10.0)
        world.table.close_servo()
        seen = []
        for index in range(40):
            if index == 10:
                world.table.demand_rate(50.0, 60.0)
            if index == 20:
                world.drive("v_vc", Drive(0.3, 0.1, 7.0))
            window = world.window("output", clock.now() + 0.05, clock.now() + 0.25)
            for _ in range(3):
                clock.sleep_until(clock.now() + 0.11)
                if looking:
                    assert all(math.isfinite(looks[f"node.{node}"].read()) for node in NODES)
                    assert math.isfinite(looks["rail.positive.current_a"].read() + looks["temperature_c"].read())
            seen.append(window.mean_v())
        return seen

    assert means(looking=True) == means(looking=False)


@pytest.mark.exhaustive
def test_looks_from_outside_see_noise_that_goes_on() -> None:
    """Each 50 ms for 100 s, no instrument asking: as scattered as looks of an instrument, and no two alike."""
    (clock, world), (other_clock, other) = powered(PAPER, 5), powered(PAPER, 6)
    looks, readings = [], []
    for _ in range(2000):
        clock.sleep_until(clock.now() + 0.05)
        other_clock.sleep_until(clock.now())
        looks.append(world.glance_v("output"))
        readings.append(other.value_v("output"))
    assert len(set(looks)) == 2000
    assert np.std(looks) == pytest.approx(np.std(readings), rel=0.2)
    first = world.glance_v("output")
    assert world.glance_v("output") == first
    world.value_v("output")
    clock.sleep_until(clock.now() + 1e-6)
    assert world.glance_v("output") == pytest.approx(world.value_v("output"), abs=1e-5)


def test_asking_in_between_changes_nothing_but_the_draws() -> None:
    """A reading asks for its window alone; whoever takes the world to now meanwhile finds the same noise-free volts."""

    def means(*, asking: bool) -> list[float]:
        clock, world = powered(QUIET, 3)
        seen = []
        for index in range(30):
            if index == 10:
                world.table.demand_rate(50.0, 60.0)
            if index == 20:
                world.drive("v_vc", Drive(0.3, 0.1, 7.0))
            window = world.window("output", clock.now() + 0.05, clock.now() + 0.25)
            for _ in range(3):
                clock.sleep_until(clock.now() + 0.11)
                if asking:
                    world.advance()
                    world.value_v("output")
            seen.append(window.mean_v())
        return seen

    assert means(asking=True) == pytest.approx(means(asking=False), rel=1e-11)


def test_rail_current_queries_do_not_change_readings() -> None:
    """The supply looks at its load again and again; readings do not depend on how often."""
    seen = []
    for asking in (False, True):
        clock, world = powered(PAPER, 5)
        window = world.window("output", clock.now() + 0.1, clock.now() + 0.3)
        for _ in range(5):
            clock.sleep_until(clock.now() + 0.07)
            if asking:
                world.rail_current_a("positive", 10.0)
        seen.append(window.mean_v())
    assert seen[0] == seen[1]
