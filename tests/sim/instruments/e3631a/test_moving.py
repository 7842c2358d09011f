"""The outputs of the simulated E3631A while they move, against exponentials written out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack.attendance import AttendedClock
from simrack.instruments.e3631a import E3631ATwin, OutputErrors, SupplyErrors
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.e3631a.test_instrument import bench

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from simrack_tests.instruments.fake_world import FakeWorld

TO_1_PERCENT = math.log(100.0)
FINE_S = 10e-6
TRANSIENT_S = 50e-6 / TO_1_PERCENT
"""The guide's 50 us, its settling taken to 1 %."""


class Real(NamedTuple):
    world: World
    supply: E3631ATwin
    talk: Conversation


def real(errors: SupplyErrors | None = None) -> Real:
    clock = AttendedClock(VirtualClock())
    world = World(clock, ideal_bench(), 0)
    supply = E3631ATwin(world, errors=errors or SupplyErrors.none())
    clock.attend(supply)
    return Real(world, supply, Conversation(supply, clock))


def tau_s(idle_s: float, full_s: float, current_a: float) -> float:
    return (idle_s + (full_s - idle_s) * current_a / 1.03) / TO_1_PERCENT


def rail(world: FakeWorld, start_s: float, stop_s: float) -> tuple[np.ndarray, np.ndarray]:
    times = np.arange(start_s, stop_s, FINE_S)
    return times, np.array([world.rail_v("positive", each) for each in times])


def test_level_replaced_at_its_start_is_no_movement() -> None:
    """Set and reset in one message, so at one instant: from nothing to nothing there is no logarithm to take."""
    world, _, talk = bench()
    talk.write("OUTP ON;:CURR MIN;:VOLT 0")
    talk.write("APPL P25V,10,0.1;*RST")
    talk.settle()
    world.clock.sleep_until(world.clock.now() + 1.0)
    assert talk.ask("MEAS:VOLT? P25V;:SYST:ERR?").split(";") == ["+0.00000000E+00", '+0,"No error"']


@pytest.mark.exhaustive
def test_up_and_off_are_one_exponential_each() -> None:
    world, _, talk = bench()
    talk.write("APPL P25V,10,1;:OUTP ON")
    talk.settle()
    times, volts = rail(world, 0.1, 0.2)
    expected = 10.0 * -np.expm1(-(times - 0.1) / tau_s(0.02, 0.05, 0.0))
    assert np.abs(volts - expected).max() < 1e-6
    start = world.clock.now() + 0.05
    talk.write("OUTP OFF")
    talk.settle()
    times, volts = rail(world, start, start + 2.0)
    expected = 10.0 * np.exp(-(times - start) / tau_s(0.4, 0.045, 0.1))
    assert np.abs(volts - expected).max() < 1e-6
    assert (np.diff(volts) <= 0.0).all()


def test_level_changed_on_the_way_turns_at_present_voltage() -> None:
    world, _, talk = bench()
    talk.write("APPL P25V,10,1;:OUTP ON")
    talk.settle()
    talk.write("VOLT 4")
    first = world.clock.now() + 0.05
    second = first + 0.06
    world.clock.sleep_until(second - 0.05)
    talk.write("VOLT 8")
    talk.settle()
    times, volts = rail(world, second, second + 0.1)
    turned = 4.0 + 6.0 * math.exp(-(second - first) / tau_s(0.4, 0.045, 0.1))
    current = 0.1  # of 10 V, as the output last looked: it looks at eighths of its way
    assert 5.5 < turned < 8.0
    assert volts[0] == pytest.approx(turned, abs=1e-6)
    share = np.log((8.0 - turned) / (8.0 - volts[1:200])) / (times[1:200] - second)
    assert share == pytest.approx(np.full(199, share[0]), rel=1e-6)
    assert tau_s(0.02, 0.05, 0.0) <= 1.0 / share[0] <= tau_s(0.02, 0.05, current)


@pytest.mark.exhaustive
def test_current_limit_is_reached_without_jump() -> None:
    """10 V into 5 ohm with 0.5 A: the exponential until 2.5 V, then nothing but 2.5 V."""
    world, _, talk = bench()
    world.load_ohm["positive"] = 5.0
    talk.write("APPL P25V,10,0.5;:OUTP ON")
    talk.settle()
    times, volts = rail(world, 0.1, 0.3)
    open_v = 10.0 * -np.expm1(-(times - 0.1) / tau_s(0.02, 0.05, 0.0))
    assert np.abs(volts - np.minimum(open_v, 2.5)).max() < 1e-5
    start = world.clock.now() + 0.05
    talk.write("OUTP OFF")
    talk.settle()
    times, volts = rail(world, start, start + 1.0)
    open_v = 10.0 * np.exp(-(times - start) / tau_s(0.4, 0.045, 0.5))
    assert np.abs(volts - np.minimum(open_v, 2.5)).max() < 1e-5


def test_load_discharges_the_capacitor() -> None:
    """470 uF (guide p. 187) and 5 ohm on the way to 2.5 V; back as a rise at half of the largest current."""
    world, _, talk = bench()
    talk.write("APPL P25V,10,0.5;:OUTP ON")
    talk.settle()
    start = world.clock.now()
    world.load_ohm["positive"] = 5.0
    world.on_load_change()
    world.clock.sleep_until(start + 0.2)
    times, volts = rail(world, start, start + 0.2)
    expected = 2.5 + 7.5 * np.exp(-(times - start) / (470e-6 * 5.0))
    assert np.abs(volts - expected).max() < 1e-6
    start = world.clock.now()
    world.load_ohm["positive"] = 1e6
    world.on_load_change()
    world.clock.sleep_until(start + 0.2)
    times, volts = rail(world, start, start + 0.2)
    expected = 10.0 - 7.5 * np.exp(-(times - start) / tau_s(0.02, 0.05, 0.5))
    assert np.abs(volts - expected).max() < 1e-6


REGULATION = SupplyErrors(p25v=OutputErrors(resistance_ohm=2e-3, sag=1e-4))


def test_a_load_step_is_answered_within_the_guides_50_us() -> None:
    """At the rail of the gyroscope, as an oscilloscope sees it: 2 mV/A and 0.01 % of 20 V an ampere."""
    world, _, talk = real(REGULATION)
    talk.write("APPL P25V,20,1;:OUTP ON")
    talk.settle()
    talk.clock.sleep_until(10.0)
    idle_a = world.rail_current_a("positive", 20.0)
    capture = world.capture(10.0, 10.01)
    world.set_load("positive", 40.0)
    talk.clock.sleep_until(10.01)
    times = 10.0 + np.arange(0.0, 10e-3, 1e-6)
    seen = capture.samples("rail_positive", times)

    def rest_v(current_a: float) -> float:
        return 20.0 - 2e-3 * current_a - 20.0 * 1e-4 * current_a

    expected = rest_v(idle_a + 0.5) + (rest_v(idle_a) - rest_v(idle_a + 0.5)) * np.exp(-(times - 10.0) / TRANSIENT_S)
    assert np.abs(seen - expected).max() < 2e-6
    assert seen[0] - seen[-1] == pytest.approx(2e-3, rel=1e-2)


def test_scope_meter_and_read_back_show_the_same_exponential() -> None:
    world, supply, talk = real()
    talk.write("APPL P25V,10,1;:APPL N25V,-10,1;:OUTP ON")
    talk.clock.sleep_until(0.15)
    start, tau = 0.15, tau_s(0.02, 0.05, 0.0)
    talk.clock.sleep_until(start + 1e-3)
    capture = world.capture(start + 1e-3, start + 0.2)
    window = world.window("rail_negative", start + 1e-3, start + 11e-3)
    for since in np.arange(2e-3, 20e-3, 0.7e-3):
        talk.clock.sleep_until(start + since)
        supply.observe()
        shown = [supply.outputs[name].voltage_reading() for name in ("P25V", "N25V")]
        assert shown == pytest.approx([10.0 * -math.expm1(-since / tau), 10.0 * math.expm1(-since / tau)], abs=2e-6)
    talk.clock.sleep_until(start + 0.2)
    times = start + np.arange(1e-3, 0.2, FINE_S)
    for node, sign in (("rail_positive", 1.0), ("rail_negative", -1.0)):
        expected = sign * 10.0 * -np.expm1(-(times - start) / tau)
        assert np.abs(capture.samples(node, times) - expected).max() < 2e-6
    left = tau * (math.exp(-1e-3 / tau) - math.exp(-11e-3 / tau)) / 10e-3
    assert window.mean_v() == pytest.approx(-10.0 * (1.0 - left), abs=2e-6)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["volts", "amps", "off", "on", "load"]), st.floats(0.0, 1.0)), max_size=12))
def test_whatever_is_done_to_it_the_rail_never_jumps(deeds: list[tuple[str, float]]) -> None:
    """At each new way the rail is where the old one had it, to 1 uV; so is what it shows."""
    world, supply, talk = bench(REGULATION)
    talk.write("APPL P25V,10,0.5;:OUTP ON")
    for deed, size in deeds:
        if deed == "load":
            world.load_ohm["positive"] = 1.0 + 1e3 * size**3
            world.on_load_change()
        else:
            talk.write({"volts": f"VOLT {25 * size}", "amps": f"CURR {size}", "off": "OUTP OFF", "on": "OUTP ON"}[deed])
        world.clock.sleep_until(world.clock.now() + 0.05 + 0.1 * size)
    talk.settle()
    ways = [way for _, name, way in world.rails if name == "positive"]
    instants = [instant for instant, name, _ in world.rails if name == "positive"]
    for before, after, instant in zip(ways, ways[1:], instants[1:], strict=False):
        assert after.at(instant) == pytest.approx(before.at(instant), abs=1.001e-6)
    assert supply.outputs["P25V"].voltage_reading() == pytest.approx(world.rail_v("positive"), abs=1e-9)


def test_outputs_at_rest_are_not_regulated_until_their_load_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    world, _, talk = real()
    looked: list[str] = []
    current_a = World.rail_current_a
    monkeypatch.setattr(
        World, "rail_current_a", lambda self, rail, volts: looked.append(rail) or current_a(self, rail, volts)
    )
    talk.write("APPL P25V,10,1;:APPL N25V,-10,1;:OUTP ON")
    world.clock.sleep_until(10.0)
    before_a = float(talk.ask("MEAS:CURR? P25V"))
    looked.clear()
    for _ in range(10):
        assert float(talk.ask("MEAS:CURR? P25V")) == before_a
        assert talk.ask("STAT:QUES:INST:ISUM2:COND?") == "2"
        world.clock.sleep_until(world.clock.now() + 0.1)
    assert looked == []
    world.set_load("positive", 100.0)
    assert float(talk.ask("MEAS:CURR? P25V")) == pytest.approx(before_a + 0.1, abs=1e-4)
    world.set_load("positive", 5.0)
    world.clock.sleep_until(world.clock.now() + 5.0)
    assert talk.ask("STAT:QUES:INST:ISUM2:COND?") == "1"
    talk.write("CURR MAX")
    talk.write("APPL P25V,8,1")
    world.clock.sleep_until(world.clock.now() + 5.0)
    world.set_load("positive", math.inf)
    world.clock.sleep_until(world.clock.now() + 5.0)
    assert float(talk.ask("MEAS:VOLT? P25V")) == pytest.approx(8.0, abs=1e-3)
    looked.clear()
    talk.write("OUTP OFF")
    assert talk.ask("STAT:QUES:INST:ISUM2:COND?") == "0"
    assert looked
