"""What changes the noise is noted, and its steps are drawn when somebody looks: the same as if drawn at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro import noise_course
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.gyro.noise import NoisyChain
from vcfbench.sim.world import World

if TYPE_CHECKING:
    import pytest


def readings_v() -> list[float]:
    """Return what a bench shows after changes of rails and rate that nobody watched, and after some more."""
    clock = VirtualClock()
    world = World(clock, paper_bench(), 5)
    means = []
    for rail_v, wait_s in ((10.0, 3.0), (9.0, 1.0), (0.0, 2.0), (10.0, 4.0)):
        world.set_rail("positive", rail_v)
        world.set_rail("negative", -rail_v)
        world.table.close_servo()
        for rate_deg_s in (50.0, -20.0):
            world.table.demand_rate(rate_deg_s, 100.0)
            clock.sleep_until(clock.now() + wait_s)
            world.advance()
        window = world.window("output", clock.now(), clock.now() + 0.2)
        clock.sleep_until(clock.now() + 0.3)
        means.append(window.mean_v())
    return means


def test_readings_equal_noise_drawn_at_each_change(monkeypatch: pytest.MonkeyPatch) -> None:
    noted = readings_v()
    monkeypatch.setattr(noise_course, "MOST_NOTED", 0)
    assert readings_v() == noted


def test_what_nobody_watches_draws_no_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[float] = []
    step = NoisyChain.step
    monkeypatch.setattr(
        NoisyChain,
        "step",
        lambda chain, state, interval_s, random: steps.append(interval_s) or step(chain, state, interval_s, random),
    )
    clock = VirtualClock()
    world = World(clock, paper_bench(), 5)
    for rail_v in (10.0, 9.0, 10.0, 0.0):
        world.set_rail("positive", rail_v)
        world.set_rail("negative", -rail_v)
        world.table.close_servo()
        world.table.demand_rate(rail_v, 100.0)
        clock.sleep_until(clock.now() + 5.0)
        world.advance()
    assert not steps
    assert world.value_v("output") == 0.0
    assert len(steps) > 3


def test_no_more_is_noted_than_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table that is told rates for ever, with nobody at the meter, does not fill the memory."""
    monkeypatch.setattr(noise_course, "MOST_NOTED", 4)
    clock = VirtualClock()
    world = World(clock, paper_bench(), 5)
    world.table.close_servo()
    for number in range(20):
        world.table.demand_rate(float(number % 3), 100.0)
        clock.sleep_until(clock.now() + 1.0)
        world.advance()
    assert len(world._gyro._noise._noted) <= 4
