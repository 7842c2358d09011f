"""Leads that are exchanged, reversed or pulled; the load on a rail; the air: what can be changed from outside."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.leads import Lead, Leads
from simrack.serve.adjust import adjustments_of

from tests.sim.gyro.bench import mean_v, powered
from vcfbench.clock import VirtualClock
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from simrack.adjustment import Adjustment

IDEAL = ideal_bench()


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def world(clock: VirtualClock) -> World:
    made = World(clock, IDEAL, 0)
    made.set_rail("positive", 10.0)
    made.set_rail("negative", -9.0)
    return made


@pytest.fixture
def leads(world: World) -> Leads:
    return Leads(world, "meter", {"a": "rail_positive", "b": "rail_negative"})


def test_an_input_reads_the_node_that_its_lead_goes_to(leads: Leads) -> None:
    assert leads.inputs == ("a", "b")
    assert (leads.value_v("a"), leads.value_v("b")) == (10.0, -9.0)
    leads.connect("a", "rail_negative")
    leads.connect("b", "rail_positive")
    assert (leads.value_v("a"), leads.value_v("b")) == (-9.0, 10.0)


def test_reversed_lead_changes_sign_and_free_lead_reads_zero(clock: VirtualClock, leads: Leads) -> None:
    leads.turn("a", reversed_=True)
    leads.connect("b", None)
    window, free, capture = leads.window("a", 0.0, 1.0), leads.window("b", 0.0, 1.0), leads.capture(0.0, 1.0)
    clock.sleep_until(1.0)
    times = np.array([0.25, 0.5])
    assert window.mean_v() == pytest.approx(-10.0)
    assert leads.value_v("a") == -10.0
    assert free.mean_v() == leads.value_v("b") == 0.0
    assert capture.samples("a", times).tolist() == [-10.0, -10.0]
    assert capture.samples("b", times).tolist() == [0.0, 0.0]
    assert leads.lead("a") == Lead("rail_positive", reversed=True)


def test_running_measurement_keeps_its_lead(clock: VirtualClock, leads: Leads) -> None:
    window, capture = leads.window("a", 0.0, 1.0), leads.capture(0.0, 1.0)
    leads.connect("a", "rail_negative")
    clock.sleep_until(1.0)
    assert window.mean_v() == pytest.approx(10.0)
    assert capture.samples("a", np.array([0.5])).tolist() == [10.0]


def test_there_are_only_the_nodes_of_the_pcb(leads: Leads) -> None:
    with pytest.raises(ValueError, match="'roof' is none of"):
        leads.connect("a", "roof")


def test_a_load_draws_beside_the_pcb(world: World) -> None:
    before = world.rail_current_a("negative", -10.0)
    world.set_load("negative", 100.0)
    assert world.rail_current_a("negative", -10.0) == pytest.approx(before + 0.1, abs=1e-12)
    assert world.load_ohm("negative") == 100.0
    world.set_load("negative", math.inf)
    assert world.rail_current_a("negative", -10.0) == before
    with pytest.raises(ValueError, match="more than 0 ohm"):
        world.set_load("negative", 0.0)


def test_the_gyro_follows_the_air_with_its_time_constant() -> None:
    thermal = replace(IDEAL.thermal, ambient_c=20.0, self_heating_k=0.0, time_constant_s=60.0, reference_c=20.0)
    bench = replace(IDEAL, thermal=replace(thermal, bias_coefficient_deg_s_k=0.01))
    clock, world = powered(bench)
    cold_v = mean_v(clock, world, 1.0)
    world.set_ambient_c(40.0)
    assert (world.ambient_c(), world.temperature_c()) == (40.0, pytest.approx(20.0))
    clock.sleep_until(clock.now() + 60.0)
    assert world.temperature_c() == pytest.approx(40.0 - 20.0 / math.e)
    clock.sleep_until(clock.now() + 3600.0)
    warm_v = mean_v(clock, world, 1.0)
    assert warm_v - cold_v == pytest.approx(-12.542e-3 * 0.01 * 20.0, rel=2e-2)


@pytest.mark.parametrize("ambient_c", [-60.0, 130.0, math.nan])
def test_air_that_no_laboratory_has_is_refused(world: World, ambient_c: float) -> None:
    with pytest.raises(ValueError, match="the air has -55 to 125 degC"):
        world.set_ambient_c(ambient_c)


def test_modes_that_would_not_oscillate_are_refused() -> None:
    dull = replace(IDEAL.sense_in_phase, quality_coefficient_per_k=-0.02)
    world = World(VirtualClock(), replace(IDEAL, sense_in_phase=dull), 0)
    with pytest.raises(ValueError, match="would not oscillate any more"):
        world.set_ambient_c(100.0)


# --- by name, as the control port has them ---


@pytest.fixture
def bench() -> SimulatedBench:
    return SimulatedBench.build(load_bench("ideal"), 0, VirtualClock())


@pytest.fixture
def quantities(bench: SimulatedBench) -> dict[str, Adjustment]:
    return adjustments_of(bench.world, bench.devices)


def ask(bench: SimulatedBench, role: str, message: str) -> str:
    device = bench.devices[role]
    device.write(message.encode() + b"\n")
    while True:
        data, end = device.read(4096)
        if end:
            return data.decode().strip()
        wake = device.wake_at()
        assert wake is not None
        bench.clock.sleep_until(wake)


def change(quantities: dict[str, Adjustment], name: str, value: object) -> None:
    write = quantities[name].write
    assert write is not None
    write(value)


def test_the_meters_leads_are_swapped_and_moved(bench: SimulatedBench, quantities: dict[str, Adjustment]) -> None:
    change(quantities, "rail.positive.voltage_v", 7.0)
    change(quantities, "multimeter.input.node", "rail_positive")
    assert float(ask(bench, "multimeter", "MEAS:VOLT:DC? 10")) == pytest.approx(7.0)
    change(quantities, "multimeter.input.reversed", True)  # noqa: FBT003  (as it comes over the wire)
    assert float(ask(bench, "multimeter", "MEAS:VOLT:DC? 10")) == pytest.approx(-7.0)
    assert quantities["multimeter.input.node"].read() == "rail_positive"
    assert quantities["multimeter.input.reversed"].read() is True
    with pytest.raises(ValueError, match="expected true or false"):
        change(quantities, "multimeter.input.reversed", 1)


def test_a_probe_is_moved(bench: SimulatedBench, quantities: dict[str, Adjustment]) -> None:
    change(quantities, "rail.positive.voltage_v", 3.0)
    change(quantities, "oscilloscope.channel_2.node", "rail_positive")
    shown = ask(bench, "oscilloscope", ":CHAN2:DISP 1;:CHAN2:RANG 16;:DIG CHAN2;:MEAS:VAV? CHAN2")
    assert float(shown) == pytest.approx(3.0, abs=0.2)


def test_a_short_takes_the_supply_into_its_current_limit(
    bench: SimulatedBench, quantities: dict[str, Adjustment]
) -> None:
    ask(bench, "power", "APPL P25V,10,0.2;:APPL N25V,-10,0.2;:OUTP ON;*OPC?")
    bench.clock.sleep_until(5.0)
    assert quantities["rail.positive.load_ohm"].read() is None
    change(quantities, "rail.positive.load_ohm", 10)
    bench.clock.sleep_until(5.05)
    assert bench.world.value_v("rail_positive") < 2.1  # 0.2 A into 10 ohm, as soon as 470 uF are discharged by them
    assert float(ask(bench, "power", "MEAS:CURR? P25V")) == pytest.approx(0.2, abs=1e-3)
    change(quantities, "rail.positive.load_ohm", None)
    bench.clock.sleep_until(bench.clock.now() + 0.05)
    assert bench.world.value_v("rail_positive") == pytest.approx(10.0, abs=0.05)


def test_the_air_is_warmed(bench: SimulatedBench, quantities: dict[str, Adjustment]) -> None:
    change(quantities, "ambient_c", 35)
    bench.clock.sleep_until(1e6)
    assert quantities["ambient_c"].read() == 35.0
    assert quantities["temperature_c"].read() == pytest.approx(35.0, abs=0.01)
    assert quantities["temperature_c"].write is None
