"""The 50 ohm inputs on the real World: division, what it does to others, the protection."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from msgspec.structs import replace
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.leads import Leads
from simrack.sources import Drive
from simrack_tests.instruments.dso7104b.bench import Bench

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

IDEAL = ideal_bench()
BENCH = replace(IDEAL, source=replace(IDEAL.source, drive_ohm=75.0, output_ohm=150.0))


@dataclass
class Host:
    """A program on an oscilloscope whose leads go to drive, v_vc, rail_positive and output."""

    clock: VirtualClock
    world: World
    leads: Leads
    scope: Dso7104BTwin

    def ask(self, text: str) -> str:
        self.scope.write(text.encode("latin-1") + b"\n")
        while not (reply := self.scope.read(1 << 20)[0]):
            wake = self.scope.wake_at()
            assert wake is not None, text
            self.clock.sleep_until(wake)
        return reply.decode("latin-1").removesuffix("\n")

    def wait(self, seconds: float) -> None:
        """Wait as a served bench does: whoever has something to do is woken."""
        stop = self.clock.now() + seconds
        while (wake := self.scope.wake_at()) is not None and wake < stop:
            self.clock.sleep_until(wake)
        self.clock.sleep_until(stop)


@pytest.fixture
def host() -> Host:
    clock = VirtualClock()
    world = World(clock, BENCH, 0)
    nodes = ("drive", "v_vc", "rail_positive", "output")
    leads = Leads(world, "oscilloscope", {f"channel_{n}": node for n, node in enumerate(nodes, 1)})
    scope = Dso7104BTwin(leads, {n: f"channel_{n}" for n in (1, 2, 3, 4)}, ScopeErrors.none())
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    clock.sleep_until(5.0)
    return Host(clock, world, leads, scope)


def test_the_amplitude_divides(host: Host) -> None:
    open_v = float(host.ask(":CHAN1:RANG 8;:TIM:RANG 1E-3;:DIG CHAN1;:MEAS:VPP?"))
    loaded_v = float(host.ask(":CHAN1:IMP FIFTy;:DIG CHAN1;:MEAS:VPP?"))
    assert loaded_v / open_v == pytest.approx(50.0 / 125.0, rel=1e-3)
    again_v = float(host.ask(":CHAN1:IMP ONEMeg;:DIG CHAN1;:MEAS:VPP?"))
    assert again_v == pytest.approx(open_v, rel=1e-3)
    assert host.ask(":SYST:ERR?") == '+0,"No error"'


def test_the_generator_is_loaded_and_the_gyroscope_gets_less(host: Host) -> None:
    host.world.drive("v_vc", Drive(2.0))
    host.clock.sleep_until(10.0)
    open_v, output_v = host.world.value_v("v_vc"), host.world.value_v("output")
    host.ask(":CHAN2:IMP FIFT;:CHAN2:IMP?")
    host.wait(5.0)
    assert host.world.value_v("v_vc") / open_v == pytest.approx(0.5, rel=1e-3)
    assert host.world.value_v("output") / output_v == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("undone", ["*RST", ":SYST:SET", "*RCL 1", "the lead"])
def test_what_takes_the_setting_back_takes_the_load_off(host: Host, undone: str) -> None:
    host.ask("*SAV 1;*OPC?")
    setup = host.ask(":SYST:SET?")
    host.ask(":CHAN1:IMP FIFT;:CHAN1:IMP?")
    assert host.world.source_ohm("drive") == pytest.approx(75.0 * 50.0 / 125.0)
    if undone == "the lead":
        host.leads.connect("channel_1", None)
    else:
        host.ask(f"{undone} {setup};*OPC?" if undone == ":SYST:SET" else f"{undone};*OPC?")
    assert host.world.source_ohm("drive") == 75.0


def test_more_than_5_v_rms_trips_the_protection(host: Host) -> None:
    loaded_a = host.world.rail_current_a("positive", 10.0)
    assert host.ask(":OVL 4;:CHAN3:IMP FIFT;PROT?") == "NORM"
    assert host.world.rail_current_a("positive", 10.0) == pytest.approx(loaded_a + 0.2)
    host.wait(0.02)
    assert host.world.rail_current_a("positive", 10.0) == pytest.approx(loaded_a)
    assert host.ask(":CHAN3:IMP?;PROT?;:OPER:COND?") == f"ONEM;TRIP;+{8 + 2048}"
    assert host.ask(":OVLR?;:OPER:COND?") == "+4;+8"
    assert host.ask(":CHAN3:IMP FIFT;:SYST:ERR?").startswith("-221")
    assert host.ask(":CHAN3:PROT:CLEar;:CHAN3:PROT?;IMP FIFT;IMP?") == "NORM;FIFT"
    host.wait(0.02)
    assert host.ask(":CHAN3:PROT?;:OVLR?") == "TRIP;+4"


def test_less_than_5_v_rms_does_not(host: Host) -> None:
    host.world.set_rail("positive", 4.9)
    host.ask(":CHAN3:IMP FIFT;:CHAN1:IMP FIFT;:CHAN1:IMP?")
    for _ in range(5):
        host.wait(0.02)
        assert host.ask(":CHAN3:PROT?;:CHAN1:PROT?;:OVLR?") == "NORM;NORM;+0"


def test_an_idle_oscilloscope_does_not_wake_anybody(host: Host) -> None:
    host.ask(":CHAN1:IMP FIFT;:CHAN1:IMP?")
    assert host.scope.wake_at() == pytest.approx(host.clock.now() + 0.01)
    host.wait(0.02)
    assert host.scope.wake_at() is None


def test_an_input_that_is_not_wired_loads_nothing() -> None:
    bench = Bench()
    scope = Dso7104BTwin(bench, {1: "drive"}, ScopeErrors.none())
    scope.write(b":CHAN2:IMP FIFT;:CHAN2:IMP?\n")
    assert scope.read(10)[0] == b"FIFT\n"
    assert bench.loads_ohm == {}
    scope.write(b":CHAN1:IMP FIFT;:CHAN1:IMP ONEM\n")
    assert bench.loads_ohm == {"drive": math.inf}
