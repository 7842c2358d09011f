"""Resistances on the nodes of the PCB, against Ohm's law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.leads import Leads
from simrack.sources import Drive, Sine

from tests.sim.gyro.bench import mean_v, powered
from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

IDEAL = ideal_bench()
UNEVEN = replace(IDEAL, source=replace(IDEAL.source, output_ohm=200.0, drive_ohm=50.0, carrier_ohm=25.0))


@pytest.mark.parametrize(("node", "source_ohm"), [("output", 200.0), ("drive", 50.0), ("carrier", 25.0)])
def test_an_output_divides_with_its_own_resistance(node: str, source_ohm: float) -> None:
    clock, world = powered(UNEVEN)
    world.table.demand_rate(50.0, 100.0)
    clock.sleep_until(12.0)
    open_v = world.value_v(node)
    world.load_node("scope", node, 50.0)
    assert world.value_v(node) == pytest.approx(open_v * 50.0 / (50.0 + source_ohm), rel=1e-12)
    world.load_node("scope", node, math.inf)
    assert world.value_v(node) == pytest.approx(open_v, rel=1e-12)


def test_windows_and_captures_see_load_from_its_start() -> None:
    clock, world = powered(UNEVEN)
    world.table.demand_rate(50.0, 100.0)
    clock.sleep_until(12.0)
    open_v = mean_v(clock, world, 1.0)
    start = clock.now()
    window, capture = world.window("output", start, start + 1.0), world.capture(start, start + 1.0)
    clock.sleep_until(start + 0.25)
    world.load_node("scope", "output", 50.0)
    clock.sleep_until(start + 1.0)
    assert window.mean_v() == pytest.approx(open_v * (0.25 + 0.75 * 0.2), rel=1e-6)
    before, after = capture.samples("output", start + np.array([0.2, 0.3]))
    assert after / before == pytest.approx(0.2, rel=1e-6)


def test_two_loads_on_one_node_are_parallel() -> None:
    clock, world = powered(UNEVEN)
    clock.sleep_until(12.0)
    open_v = world.value_v("drive")
    world.load_node("one", "drive", 50.0)
    world.load_node("other", "drive", 50.0)
    assert world.value_v("drive") == pytest.approx(open_v / 3.0, rel=1e-12)


def test_load_on_v_vc_reduces_drive_of_gyroscope() -> None:
    clock, world = powered(IDEAL)
    world.drive("v_vc", Drive(1.0, overtones=(Sine(0.5, 10.0, 0.0),)))
    world.load_node("scope", "v_vc", 50.0)
    clock.sleep_until(22.0)
    pull_down = IDEAL.virtual_path.pull_down_ohm
    loaded = 1.0 / (1.0 + 50.0 / 50.0 + 50.0 / pull_down)
    assert world.value_v("v_vc") == pytest.approx(loaded, rel=1e-9)  # a whole number of periods: the sine is at zero
    full = mean_v(clock, world, 1.0)
    other_clock, other = powered(IDEAL)
    other.drive("v_vc", Drive(loaded * (pull_down + 50.0) / pull_down, overtones=(Sine(0.25, 10.0, 0.0),)))
    other_clock.sleep_until(22.0)
    assert full == pytest.approx(mean_v(other_clock, other, 1.0), rel=1e-4)


def test_a_rail_holds_its_voltage_and_supplies_the_load() -> None:
    _, world = powered(IDEAL)
    unloaded_a = world.rail_current_a("positive", 10.0)
    called: list[float] = []
    world.on_load(lambda: called.append(1.0))
    world.load_node("scope", "rail_positive", 50.0)
    assert world.value_v("rail_positive") == 10.0
    assert world.rail_current_a("positive", 10.0) == pytest.approx(unloaded_a + 0.2, rel=1e-12)
    assert called


def test_the_load_of_an_input_goes_with_its_lead() -> None:
    clock, world = powered(UNEVEN)
    clock.sleep_until(12.0)
    leads = Leads(world, "oscilloscope", {"channel_1": "drive"})
    drive_v, carrier_v = world.value_v("drive"), world.value_v("carrier")
    leads.load_node("anybody", "channel_1", 50.0)
    assert world.value_v("drive") == pytest.approx(drive_v / 2.0, rel=1e-12)
    leads.connect("channel_1", "carrier")
    assert world.value_v("drive") == drive_v
    assert world.value_v("carrier") == pytest.approx(carrier_v * 50.0 / 75.0, rel=1e-12)
    leads.connect("channel_1", None)
    assert world.value_v("carrier") == carrier_v
    leads.load_node("anybody", "channel_1", math.inf)
    leads.connect("channel_1", "drive")
    assert world.value_v("drive") == drive_v


@pytest.mark.parametrize("resistance_ohm", [0.0, -1.0, math.nan])
def test_a_load_that_is_none_is_refused(resistance_ohm: float) -> None:
    with pytest.raises(ValueError, match="more than 0 ohm"):
        World(VirtualClock(), IDEAL, 0).load_node("scope", "drive", resistance_ohm)


def test_recording_keeps_its_content_when_closed() -> None:
    clock, world = powered(IDEAL)
    start = clock.now()
    capture, recording = world.capture(start, start + 1.0), world.record()
    clock.sleep_until(start + 0.5)
    early = start + np.linspace(0.0, 0.5, 7)
    with pytest.raises(RuntimeError, match="has not reached"):
        recording.samples("drive", np.array([start + 0.6]))
    seen = recording.samples("drive", early)
    recording.close()
    recording.close()
    clock.sleep_until(start + 1.0)
    assert capture.samples("drive", early) == pytest.approx(recording.samples("drive", early), rel=1e-9)
    assert (seen == recording.samples("drive", early)).all()


def test_a_recording_forgets_what_it_is_told_to() -> None:
    clock, world = powered(IDEAL)
    recording = world.record()
    for _ in range(50):
        clock.sleep_until(clock.now() + 0.1)
        world.advance()
        recording.forget(clock.now() - 0.25)
    now = clock.now()
    assert recording.whole(now - 0.05, now)
    assert not recording.whole(now - 0.25, now)
    assert recording.whole(0.0, now - 0.5)  # nothing is left of it


def test_what_a_capture_says_of_its_finest_features() -> None:
    clock, world = powered(IDEAL)
    world.drive("v_vc", Drive(0.0, 1.0, 1e6, overtones=(Sine(0.1, 3e6, 0.0),)))
    capture = world.capture(clock.now(), clock.now() + 1e-3)
    clock.sleep_until(clock.now() + 1e-3)
    capture.samples("drive", np.array([capture.start_s]))
    assert capture.finest_s("drive") == 2e-6
    assert capture.finest_s("v_vc") == pytest.approx(0.05 / (2 * math.pi * 3e6))
    assert capture.finest_s("rail_positive") == math.inf
