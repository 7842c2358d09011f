"""What acts on the chain is noted, and worked out when somebody looks: the same as for who looks all the time."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.sources import Drive

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.chain import Chain
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

IDEAL = ideal_bench()
QUIET = replace(
    IDEAL,
    noise=replace(IDEAL.noise, angle_random_walk_deg_sqrt_s=0.0, bias_instability_deg_s=0.0),
    table=replace(IDEAL.table, flutter_per_sqrt_hz=0.0),
)


def started(clock: VirtualClock) -> World:
    """Return a world whose rails have just come."""
    world = World(clock, QUIET, 0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    world.table.close_servo()
    return world


@pytest.mark.parametrize("seen_s", [0.3, 0.9, 3.0, 20.0])
def test_who_looks_late_sees_what_one_who_always_looked_sees(seen_s: float) -> None:
    """The start-up has 66 pieces, then table and V_Vc change; the chain forgets what was 5 s ago."""
    clock = VirtualClock()
    always, late = started(clock), started(clock)
    recording = always.record()
    for world in (always, late):
        world.table.demand_rate(100.0, 50.0)
    clock.sleep_until(0.2)
    for world in (always, late):
        world.drive("v_vc", Drive(1.0))
    clock.sleep_until(seen_s)
    times = seen_s + np.arange(200) * 1e-5
    capture = late.capture(seen_s, times[-1])
    clock.sleep_until(times[-1])
    for node, rounding_v in (("output", 1e-13), ("sense", 1e-9)):  # a carrier's phase of 4e5 rad is known to 1e-10
        seen = capture.samples(node, times)
        np.testing.assert_allclose(seen, recording.samples(node, times), rtol=1e-12, atol=rounding_v)


def test_what_nobody_sees_and_nothing_remembers_is_not_worked_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start-up and the way down to rest have some hundred pieces each; who looks later needs the last of them alone."""
    clock, worked_out = VirtualClock(), []
    respond = Chain.respond
    monkeypatch.setattr(Chain, "respond", lambda *asked: worked_out.append(asked) or respond(*asked))
    world = started(clock)
    world.table.demand_rate(100.0, 50.0)
    clock.sleep_until(30.0)
    world.set_rail("positive", 0.0)
    clock.sleep_until(90.0)
    assert world.value_v("output") == 0.0
    world.set_rail("positive", 10.0)
    clock.sleep_until(120.0)
    assert world.value_v("rail_positive") == 10.0
    assert not worked_out
    assert world.value_v("output") == pytest.approx(-1.24, rel=0.1)
    assert len(worked_out) == 1


def test_a_picture_of_the_output_may_be_asked_for_late() -> None:
    """What acts has changed meanwhile, and the chain would have forgotten what the picture shows."""
    clock = VirtualClock()
    at_once, late = started(clock), started(clock)
    clock.sleep_until(0.5)
    captures = [world.capture(0.5, 0.6) for world in (at_once, late)]
    clock.sleep_until(0.6)
    times = np.linspace(0.5, 0.6, 50)
    shown = captures[0].samples("output", times)
    late.advance()
    for instant_s in (0.7, 3.0, 30.0):
        clock.sleep_until(instant_s)
        late.drive("v_vc", Drive(instant_s))
        late.value_v("output")
    np.testing.assert_array_equal(captures[1].samples("output", times), shown)


def test_what_nobody_sees_does_not_pile_up() -> None:
    """A V_Vc that changes for an hour leaves as much behind as the chain remembers."""
    clock = VirtualClock()
    world = started(clock)
    lengths = []
    for number in range(400):
        clock.sleep_until(1.0 + number)
        world.drive("v_vc", Drive(0.01 * (number % 7)))
        lengths.append(len(world._gyro._course._noted))
    assert max(lengths[100:]) <= 10
