"""What the tables do by themselves happens at its own instant, on the World's own table behind an attended clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from tests.sim.rate_tables.ideal import exchange
from vcfbench.clock import VirtualClock
from vcfbench.sim.attendance import AttendedClock
from vcfbench.sim.motion import TableMotion
from vcfbench.sim.parameters import BenchParameters
from vcfbench.sim.rate_tables.acl import AclTable, TableErrors
from vcfbench.sim.rate_tables.atl import AtlTable
from vcfbench.sim.rate_tables.axis import Axis
from vcfbench.sim.rate_tables.esp import EspTable
from vcfbench.sim.rate_tables.ruya import RuyaTable
from vcfbench.sim.rate_tables.zaber import StepperErrors, ZaberTable

if TYPE_CHECKING:
    from collections.abc import Callable


class RealWorld:
    """A clock and the table with its loop, mean-rate error and ripple."""

    def __init__(self) -> None:
        self.clock = AttendedClock(VirtualClock())
        self.table = TableMotion(self.clock, BenchParameters.paper().table, lambda: None)


class AclHost:
    def __init__(self) -> None:
        self.world = RealWorld()
        self.acl = AclTable(self.world, TableErrors.none())
        self.world.clock.attend(self.acl)

    def ask(self, text: str) -> str:
        self.acl.write(text.encode() + b"\n")
        self.wait(0.5)
        return self.acl.read(1000)[0].decode().strip()

    def wait(self, seconds: float) -> None:
        self.world.clock.sleep_until(self.world.clock.now() + seconds)

    def servo(self, mode: str) -> None:
        self.ask(f":Demand:Rate 1,0;Position 1,0;:Mode:{mode} 1;:Interlock:Close 1")


@pytest.fixture
def host() -> AclHost:
    return AclHost()


def test_the_servo_closes_though_nobody_asks(host: AclHost) -> None:
    host.acl.write(b":Interlock:Close 1\n")
    host.world.clock.sleep_until(0.19)
    assert not host.world.table.servo_closed
    host.world.clock.sleep_until(0.21)
    assert host.world.table.servo_closed


def test_the_over_rate_trip_acts_at_the_crossing_though_nobody_asks(host: AclHost) -> None:
    host.servo("Rate")
    host.ask(":Limit:Acceleration R,1,50;Acceleration Abort,1,500;Vtrip R,1,60")
    start = host.world.clock.now()
    host.acl.write(b":Demand:Rate 1,-100\n")
    host.world.clock.sleep_until(start + 1.19)
    assert host.world.table.rate_deg_s() == pytest.approx(-59, abs=1.0)
    # 60 deg/s after 1.2 s and the lag of the loop, then 0.12 s of ABORT profile
    host.world.clock.sleep_until(start + 1.40)
    assert host.world.table.rate_deg_s() == pytest.approx(0.0, abs=0.1)
    host.world.clock.sleep_until(start + 1.50)
    assert not host.world.table.servo_closed
    host.acl.read(100)
    assert host.ask(":Status:CSR? A1SWFLT,1") == "1"


def test_a_rate_just_beyond_the_trip_trips_too(host: AclHost) -> None:
    host.servo("Rate")
    host.ask(":Limit:Acceleration R,1,50;Vtrip R,1,60")
    host.acl.write(b":Demand:Rate 1,60.01\n")
    host.wait(5.0)
    assert not host.world.table.servo_closed


def test_an_orderly_shutdown_opens_the_servo_at_rest_though_nobody_asks(host: AclHost) -> None:
    host.servo("Rate")
    host.ask(":Demand:Rate 1,50;:Limit:Acceleration Abort,1,100")
    host.wait(2.0)
    start = host.world.clock.now()
    host.acl.write(b":Interlock:Open 1\n")
    host.world.clock.sleep_until(start + 0.499)
    assert host.world.table.servo_closed
    host.world.clock.sleep_until(start + 0.6)
    assert not host.world.table.servo_closed
    assert abs(host.world.table.rate_deg_s()) < 0.03


@pytest.mark.parametrize(("target", "turned"), [(90.0, 90.0), (270.0, -90.0), (-30.0, -30.0), (359.0, -1.0)])
def test_position_mode_takes_the_shortest_path(host: AclHost, target: float, turned: float) -> None:
    host.servo("Position")
    host.ask(f":Demand:Position 1,{target}")
    host.wait(30.0)
    assert host.world.table.angle_deg() == pytest.approx(turned, abs=2e-4)
    assert host.ask(":Status:CSR? A1DYN,8") == "1"
    assert float(host.ask(":Read:Position? 1")) == pytest.approx(target % 360.0, abs=2e-4)


def test_a_position_move_is_a_trapezoid(host: AclHost) -> None:
    host.servo("Position")
    host.ask(":Limit:Rate P,1,20;Acceleration P,1,40")
    start = host.world.clock.now()
    host.acl.write(b":Demand:Position 1,60\n")
    host.world.clock.sleep_until(start + 2.0)
    assert host.world.table.profile_rate_deg_s() == 20.0
    mechanics = BenchParameters.paper().table
    lag_s = 2 * mechanics.loop_damping / (2 * math.pi * mechanics.loop_hz)
    assert host.world.table.angle_deg() == pytest.approx(0.5 * 20 * 0.5 + 20 * (1.5 - lag_s), abs=1e-2)
    host.world.clock.sleep_until(start + 60 / 20 + 20 / 40 + 0.2)
    assert host.world.table.angle_deg() == pytest.approx(60.0, abs=1e-2)


def test_a_stale_position_is_executed_on_closing(host: AclHost) -> None:
    host.ask(":Demand:Position 1,45;:Mode:Position 1;:Interlock:Close 1")
    host.wait(20.0)
    assert host.world.table.angle_deg() == pytest.approx(45.0, abs=2e-4)


def test_zaber_and_esp_and_atl_reach_their_positions() -> None:
    for make, commands, degrees in (
        (lambda world: ZaberTable(world, StepperErrors.none()), b"/1 1 move abs 80000\n/1 1 move rel -8000\n", 40.5),
        (lambda world: EspTable(world, TableErrors.none()), b"1MO;1PA30\r1PR-10\r", 20.0),
    ):
        world = RealWorld()
        device = make(world)
        world.clock.attend(device)
        for command in commands.splitlines():
            device.write(command + b"\r")
            world.clock.sleep_until(world.clock.now() + 20.0)
        assert world.table.angle_deg() == pytest.approx(degrees, abs=3e-4)
    world = RealWorld()
    table = AtlTable(world, TableErrors.none())
    world.clock.attend(table)
    for command in (b"JOG10\r", b"HOM\r"):
        table.write(command)
        world.clock.sleep_until(world.clock.now() + 20.0)
    assert math.isclose(Axis(world, TableErrors.none()).angle_deg(), 0.0, abs_tol=2e-4)


def test_a_stop_ends_a_move() -> None:
    world = RealWorld()
    stage = ZaberTable(world, StepperErrors.none())
    world.clock.attend(stage)
    assert b"OK BUSY" in exchange(stage, world.clock, b"/1 1 move abs 640000\n")  # type: ignore[arg-type]
    world.clock.sleep_until(1.0)
    assert b"BUSY" in exchange(stage, world.clock, b"/1 1 stop\n")  # type: ignore[arg-type]
    world.clock.sleep_until(20.0)
    assert world.table.rate_deg_s() == 0.0 or abs(world.table.rate_deg_s()) < 1e-9
    assert world.table.angle_deg() < 200.0
    assert b"IDLE" in exchange(stage, world.clock, b"/1 1\n")  # type: ignore[arg-type]


# --- oscillations -----------------------------------------------------------------------------------------------------


def extremes(host: AclHost, seconds: float) -> tuple[float, float]:
    """The largest and the smallest true angle of a while."""
    angles = []
    for _ in range(round(seconds / 0.01)):
        host.wait(0.01)
        angles.append(host.world.table.angle_deg())
    return max(angles), min(angles)


def test_synthesis_oscillates_about_the_demanded_position(host: AclHost) -> None:
    host.servo("Position")
    host.ask(":Demand:Position 1,30;Oscillator 1,10,0.5,0")
    host.wait(10.0)
    assert host.ask(":Mode:Synthesis 1") == "OK"
    assert host.ask(":Status:CSR? A1DYN,10;CSR? A1DYN,11;CSR? A1DYN,9") == "0;1;0"
    host.wait(2.0)  # 10 deg at 10 deg/s
    highest, lowest = extremes(host, 4.0)
    # 25 Hz of loop let half a hertz pass as it is
    assert (highest + lowest) / 2 == pytest.approx(30.0, abs=0.1)
    assert (highest - lowest) / 2 == pytest.approx(10.0, rel=2e-3)
    assert host.ask(":Status:CSR? A1DYN,10") == "1"
    host.ask(":Mode:Off 1")
    host.wait(1.0)
    assert host.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)


def test_the_amplitude_slews_and_the_phase_goes_on_where_a_demand_changes(host: AclHost) -> None:
    host.servo("Position")
    host.ask(":Limit:Acceleration S,1,1000")
    host.ask(":Configure:Oscillator 1,Disable,5,0.1,Pos,Lin;:Demand:Oscillator 1,10,1,0;:Mode:Synthesis 1")
    host.wait(1.0)
    assert host.ask(":Status:CSR? A1DYN,10") == "0"
    host.wait(5.0)
    before = host.world.table.rate_deg_s(), host.world.table.angle_deg()
    host.acl.write(b":Demand:Oscillator 1,4,1,0\n")
    assert (host.world.table.rate_deg_s(), host.world.table.angle_deg()) == pytest.approx(before)
    host.wait(2.0)
    host.acl.read(100)
    highest, lowest = extremes(host, 1.0)
    assert (highest - lowest) / 2 == pytest.approx(4.0, rel=5e-3)
    assert host.ask(":Configure:Oscillator? 1") == "Disable,5.00000,0.10000,Position,Linear"


@pytest.mark.parametrize(("state", "amplitude"), [("Rate", 62.83), ("Accel", 394.8)])
def test_the_amplitude_may_be_of_rate_or_acceleration(host: AclHost, state: str, amplitude: float) -> None:
    """Both are 10 deg at 1 Hz."""
    host.servo("Position")
    host.ask(":Limit:Acceleration S,1,1000")
    host.ask(f":Con:Osc 1,Enable,1000,1,{state},Lin;:Demand:Oscillator 1,{amplitude},1,0;:Mode:Synthesis 1")
    host.wait(2.0)
    highest, lowest = extremes(host, 2.0)
    assert (highest - lowest) / 2 == pytest.approx(10.0, rel=3e-3)


@pytest.mark.parametrize("limit", ["Rate S,1,20", "Acceleration S,1,125.66"])
def test_the_limits_of_synthesis_mode_hold(host: AclHost, limit: str) -> None:
    host.servo("Position")
    host.ask(f":Limit:Acceleration S,1,4000;{limit};:Demand:Oscillator 1,100,1,0;:Mode:Synthesis 1")
    host.wait(5.0)
    rates = []
    for _ in range(100):
        host.wait(0.01)
        rates.append(abs(host.world.table.rate_deg_s()))
    assert max(rates) == pytest.approx(20.0, rel=3e-3)


def test_a_turning_axis_is_stopped_before_it_oscillates(host: AclHost) -> None:
    host.servo("Rate")
    host.ask(":Demand:Rate 1,50")
    host.wait(2.0)
    host.ask(":Demand:Oscillator 1,2,1,0;:Mode:Synthesis 1")
    host.wait(4.0)
    highest, lowest = extremes(host, 2.0)
    assert (highest - lowest) / 2 == pytest.approx(2.0, rel=5e-3)


def test_an_oscillation_beyond_the_trip_trips(host: AclHost) -> None:
    host.servo("Position")
    host.ask(":Limit:Acceleration S,1,4000;Vtrip S,1,50;:Con:Osc 1,Disable,50,1,Pos,Lin")
    host.ask(":Demand:Oscillator 1,20,0.6,0;:Mode:Synthesis 1")
    host.wait(5.0)
    assert not host.world.table.servo_closed
    assert host.ask(":Status:CSR? A1SWFLT,1") == "1"


# --- TRACK mode -------------------------------------------------------------------------------------------------------


def test_track_follows_the_vectors_of_a_host(host: AclHost) -> None:
    """A host asks for 20 deg/s by vectors at 10 Hz; the axis is within a tenth of a second of where it should be."""
    host.servo("Track")
    host.ask(":Mode:Track 1,500")
    for step in range(40):
        host.acl.write(f":Demand:Vector 1,{2.0 * step},20,0\n".encode())
        host.wait(0.1)
    assert host.world.table.rate_deg_s() == pytest.approx(20.0, rel=0.02)
    assert host.world.table.angle_deg() == pytest.approx(80.0, abs=2.0)
    host.ask(":Mode:Track 1,0;:Demand:Vector 1,90,0,0")
    host.wait(10.0)
    assert host.world.table.angle_deg() == pytest.approx(90.0, abs=2e-4)


@pytest.mark.parametrize(("interval", "stops"), [(",200", True), ("", True), (",0", False)])
def test_a_host_that_falls_silent_in_track_mode_is_missed(host: AclHost, interval: str, stops: bool) -> None:  # noqa: FBT001
    host.servo("Track")
    host.ask(f":Mode:Track 1{interval}")
    host.wait(5.0)
    assert host.ask(":Mode? 1") == "Track"  # the test begins with the first demand
    host.acl.write(b":Demand:Vector 1,0,20,0\n")
    host.wait(30.0)
    assert abs(host.world.table.rate_deg_s()) == pytest.approx(0.0 if stops else 20.0, rel=1e-3, abs=1e-6)
    host.acl.read(100)
    assert host.ask(":Mode? 1") == ("Off" if stops else "Track")


def test_an_interval_of_track_mode_is_within_its_range(host: AclHost) -> None:
    assert host.ask(":Mode:Track 1,65536") == ""
    assert "PARAMETER OUT OF RANGE" in host.ask(":Status:MSG? QERROR")


# --- position limits --------------------------------------------------------------------------------------------------


def test_a_position_limit_clips_a_demand_and_stops_a_run(host: AclHost) -> None:
    host.ask(":Limit:HighPosition P,1,90;LowPosition P,1,-45")
    host.servo("Position")
    host.ask(":Demand:Position 1,120")
    host.wait(20.0)
    assert host.world.table.angle_deg() == pytest.approx(90.0, abs=2e-4)
    host.ask(":Mode:Rate 1;:Demand:Rate 1,-30")
    host.wait(20.0)
    assert host.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)
    assert host.world.table.angle_deg() == pytest.approx(-45.0, abs=1.0)
    assert host.ask(":Status:CSR? A1DYN,7") == "1"
    host.ask(":Demand:Rate 1,-10")
    host.wait(2.0)
    assert host.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)
    host.ask(":Demand:Rate 1,10")
    host.wait(2.0)
    assert host.world.table.rate_deg_s() == pytest.approx(10.0, rel=1e-3)


def sine_table(make: Callable[[RealWorld], Any]) -> tuple[RealWorld, Any]:
    world = RealWorld()
    device = make(world)
    world.clock.attend(device)
    return world, device


def swing(world: RealWorld, seconds: float) -> float:
    angles = []
    for _ in range(round(seconds / 0.01)):
        world.clock.sleep_until(world.clock.now() + 0.01)
        angles.append(world.table.angle_deg())
    return (max(angles) - min(angles)) / 2


def test_an_atl_table_oscillates_for_its_cycles() -> None:
    world, table = sine_table(lambda world: AtlTable(world, TableErrors.none()))
    table.write(b"AMP10\rFRQ0.5\rCYC5\rSGO\r")
    world.clock.sleep_until(5.0)
    assert swing(world, 2.0) == pytest.approx(10.0, rel=3e-3)
    world.clock.sleep_until(11.0)
    assert world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-3)
    table.write(b"PER0.1\rSGO\r")  # 628 deg/s are beyond it
    world.clock.sleep_until(20.0)
    assert table.read(1000)[0].startswith(b"\r\n>")
    assert world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-3)


def test_an_atl_table_moves_by_all_its_words() -> None:
    world, table = sine_table(lambda world: AtlTable(world, TableErrors.none()))
    for command, degrees in ((b"VEL50\rMOV30\r", 30.0), (b"RMO-50\r", -20.0), (b"P10\r", 10.0), (b"HOM\r", 0.0)):
        table.write(command)
        world.clock.sleep_until(world.clock.now() + 0.3)
        table.clear()
        assert exchange(table, world.clock, b"STA\r") == b"1\r\n>\r\n"
        world.clock.sleep_until(world.clock.now() + 10.0)
        assert world.table.angle_deg() == pytest.approx(degrees, abs=2e-4)
        assert exchange(table, world.clock, b"MCO5\r") == b"1\r\n>\r\n"


def test_a_ruya_table_runs_a_sine_and_says_when_it_is_steady() -> None:
    world, table = sine_table(lambda world: RuyaTable(world, TableErrors.none()))
    states = set()

    def watch(seconds: float) -> None:
        until = world.clock.now() + seconds
        while world.clock.now() < until:
            world.clock.sleep_until(world.clock.now() + 0.1)
            while data := table.read(100)[0]:
                states.add(chr(data[3]))

    table.write(b"$1mo=1\r\n")
    watch(1.0)
    states.clear()
    table.write(b"$14010.000000.500\r\n")
    watch(6.0)
    assert states >= {"6", "7"}
    assert swing(world, 2.0) == pytest.approx(10.0, rel=3e-3)
    table.write(b"$1st\r\n")
    watch(3.0)
    assert world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)
