"""What the gyroscope feels of a rail on its way, against formulas of the rail."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.sources import Approach, Ripple

from tests.sim.gyro.bench import powered
from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

IDEAL = ideal_bench()
TAU_S = 0.08


def clipping(volts: float) -> tuple[VirtualClock, World, float]:
    """A bench whose output, if the rails let it, would stand at `volts`, and that; no second product of the carrier."""
    bench = replace(IDEAL, output_stage=replace(IDEAL.output_stage, offset_v=volts))
    clock, world = powered(bench)
    return clock, world, world.value_v("output")


@pytest.mark.parametrize(("rail", "sign"), [("positive", 1.0), ("negative", -1.0)])
def test_the_output_clips_at_the_rail_as_it_moves(rail: str, sign: float) -> None:
    """Pictures are exact; means are to 1e-7 V. Headroom 1.5 V: from 9 V of rail on, 7.5 V clip."""
    clock, world, free_v = clipping(sign * 7.5)
    assert free_v == pytest.approx(sign * 7.5, abs=0.05)
    start, stop = clock.now(), clock.now() + 0.12
    world.move_rail(rail, Approach(sign * 7.6, start, ((sign * 2.4, TAU_S),)))
    capture = world.capture(start, stop)
    begins = [start + since for since in (0.0, 0.03, 0.06, 0.09)]
    windows = [world.window("output", each, each + 0.03) for each in begins]
    clock.sleep_until(stop)

    def expected(times: np.ndarray) -> np.ndarray:
        return sign * np.minimum(sign * free_v, 7.6 + 2.4 * np.exp(-(times - start) / TAU_S) - 1.5)

    times = start + np.arange(0.0, 0.12, 10e-6)
    assert np.abs(capture.samples("output", times) - expected(times)).max() < 1e-7
    for window in windows:
        fine = window.start_s + (np.arange(60_000) + 0.5) * (0.03 / 60_000)
        assert window.mean_v() == pytest.approx(expected(fine).mean(), abs=2e-7)


def test_sudden_fall_of_rail_clips_mean() -> None:
    """A rail that is taken down in 50 us, as by a short circuit, in the middle of a reading of 20 ms."""
    clock, world, free_v = clipping(7.5)
    start = clock.now()
    window = world.window("output", start, start + 0.02)
    clock.sleep_until(start + 0.01)
    world.move_rail("positive", Approach(7.5, start + 0.01, ((2.5, 50e-6),)))
    clock.sleep_until(start + 0.02)
    fine = (np.arange(1_000_000) + 0.5) * 1e-8
    clipped = np.minimum(free_v, 6.0 + 2.5 * np.exp(-fine / 50e-6))
    assert window.mean_v() == pytest.approx((free_v + clipped.mean()) / 2, abs=1e-6)


def test_only_ripple_of_a_moving_rail_reaches_the_output() -> None:
    """1e-3 of the way, 10 mV of 10 V, would be seen at once."""
    bench = replace(IDEAL, supply=replace(IDEAL.supply, ripple_feedthrough=1e-3))
    clock, world = powered(bench)
    ripple = Ripple(0.3e-3, 100.0, 0.4)
    world.set_ripple("positive", ripple)
    start, stop = clock.now(), clock.now() + 0.05
    quiet_v = world.value_v("output") - 1e-3 * math.sqrt(2) * 0.3e-3 * math.cos(2 * math.pi * 100.0 * start + 0.4)
    world.move_rail("positive", Approach(8.0, start, ((2.0, 5e-3),)))
    capture = world.capture(start, stop)
    clock.sleep_until(stop)
    times = start + np.arange(0.0, 0.05, 10e-6)
    waving = math.sqrt(2) * 0.3e-3 * np.cos(2 * math.pi * 100.0 * times + 0.4)
    moved = 8.0 + 2.0 * np.exp(-(times - start) / 5e-3)
    assert np.abs(capture.samples("rail_positive", times) - moved - waving).max() < 1.1e-6
    assert np.abs(capture.samples("output", times) - quiet_v - 1e-3 * waving).max() < 2e-7


def test_reversed_supply_is_blocked_below_0_volts() -> None:
    clock, world = powered(IDEAL)
    start = clock.now()
    world.move_rail("positive", Approach(-5.0, start, ((15.0, TAU_S),)))
    capture = world.capture(start, start + 0.5)
    clock.sleep_until(start + 0.5)
    times = start + np.arange(0.0, 0.5, 50e-6)
    expected = np.maximum(-5.0 + 15.0 * np.exp(-(times - start) / TAU_S), 0.0)
    assert np.abs(capture.samples("rail_positive", times) - expected).max() < 1e-8


def test_moving_rail_is_no_sine_in_its_history() -> None:
    clock, world = powered(IDEAL)
    trace, start = world.trace(1.0), clock.now()
    world.move_rail("positive", Approach(9.0, start, ((1.0, TAU_S),)))
    clock.sleep_until(start + 0.1)
    moving = [piece for piece in trace.pieces("rail_positive") if piece.stop_s > start]
    assert all(piece.sines is None for piece in moving)
    middle = start + 0.05
    held = next(piece for piece in moving if piece.start_s <= middle <= piece.stop_s)
    assert held.at(np.array([middle]))[0] == pytest.approx(9.0 + math.exp(-0.05 / TAU_S), abs=1e-9)


def test_nodes_are_dead_below_dead_voltage() -> None:
    clock = VirtualClock()
    bench = replace(IDEAL, output_stage=replace(IDEAL.output_stage, offset_v=0.3))
    world = World(clock, bench, 0)
    world.set_rail("positive", 10.0)
    world.move_rail("negative", Approach(-10.0, 0.0, ((10.0, TAU_S),)))
    capture = world.capture(0.0, 0.2)
    clock.sleep_until(0.2)
    begins = TAU_S * math.log(10.0 / (10.0 - IDEAL.supply.dead_v))
    assert not capture.samples("output", np.linspace(0.0, begins - 1e-6, 100)).any()
    assert capture.samples("output", np.array([begins + 1e-6]))[0] == pytest.approx(0.3, abs=1e-6)


def test_rails_that_move_together_by_any_distance_arrive() -> None:
    """The amplitude follows in steps of 0.5 V; half a step and a rounding error that are left are no step more."""
    loop = replace(IDEAL.drive_loop, amplitude_supply_coefficient_per_v=2e-4)
    clock, world = powered(replace(IDEAL, drive_loop=loop))
    for moved_v in (0.4, 0.3, 0.41, 0.7):
        start = clock.now()
        for sign, rail in ((1.0, "positive"), (-1.0, "negative")):
            way = sign * moved_v / (1.0 + 1e-7 * sign)
            world.move_rail(rail, Approach(sign * 10.0, start, ((way, 0.0847 + 1e-8 * sign),)))
        clock.sleep_until(start + 2.0)
        world.advance()
        assert world.reached_s == start + 2.0
