"""What the tables do by themselves happens at its own instant, on the World's own table behind an attended clock."""

from __future__ import annotations

import math

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
from vcfbench.sim.rate_tables.zaber import ZaberTable


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
        (ZaberTable, b"/1 1 move abs 80000\n/1 1 move rel -8000\n", 40.5),
        (EspTable, b"1MO;1PA30\r1PR-10\r", 20.0),
    ):
        world = RealWorld()
        device = make(world, TableErrors.none())
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
    stage = ZaberTable(world, TableErrors.none())
    world.clock.attend(stage)
    assert b"OK BUSY" in exchange(stage, world.clock, b"/1 1 move abs 640000\n")  # type: ignore[arg-type]
    world.clock.sleep_until(1.0)
    assert b"BUSY" in exchange(stage, world.clock, b"/1 1 stop\n")  # type: ignore[arg-type]
    world.clock.sleep_until(20.0)
    assert world.table.rate_deg_s() == 0.0 or abs(world.table.rate_deg_s()) < 1e-9
    assert world.table.angle_deg() < 200.0
    assert b"IDLE" in exchange(stage, world.clock, b"/1 1\n")  # type: ignore[arg-type]
