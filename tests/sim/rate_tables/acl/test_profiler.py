"""How the axis follows the demand of each mode; the moves on the World's own table behind an attended clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tests.sim.rate_tables.acl import hosts as acl_hosts
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.rate_tables.acl import TableErrors

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import AttendedHost, Host


def test_a_rate_run_follows_the_trapezoid(host: Host) -> None:
    host.ask(":Limit:Acceleration R,1,50;Vtrip R,1,110")
    host.servo()
    start = host.world.clock.now()
    host.table.write(b":Demand:Rate 1,100\r\n")
    host.world.clock.sleep_until(start + 1.0)
    host.table.read(100)
    assert host.world.table.rate_deg_s() == pytest.approx(50.0, rel=1e-12)
    assert host.ask(":Status:CSR? A1DYN,9") == "0"
    assert host.ask(":Status:CSR? A1DYN,2") == "1"
    assert host.ask(":Read:Acc? 1") == "50.00000"
    host.world.clock.sleep_until(start + 3.0)
    assert host.ask(":Status:CSR? A1DYN,9") == "1"
    host.world.clock.sleep_until(start + 5.0)
    # 2 s of ramp cover 100 deg, 3 s at 100 deg/s another 300; the read-back wraps at 360
    host.table.write(b":Read:Pos? 1;Rate? 1\r\n")
    host.wait(0.2)
    assert host.table.read(100)[0] == b"40.00000;100.00000\r\n"


def test_selecting_a_mode_executes_the_stale_demand(host: Host) -> None:
    host.servo()
    host.ask(":Mode:Off 1;:Demand:Rate 1,77")
    host.wait(5.0)
    assert host.ask(":Read:Rate? 1") == "0.00000"
    host.ask(":Mode:Rate 1")
    host.wait(5.0)
    assert host.ask(":Read:Rate? 1") == "77.00000"


def test_mode_off_stops_and_keeps_the_servo(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,50")
    host.wait(2.0)
    host.ask(":Mode:Off 1;:Demand:Rate 1,90")
    host.wait(2.0)
    assert host.ask(":Read:Rate? 1;:Interlock? 1") == "0.00000;Close"


def test_a_zero_acceleration_limit_inhibits_every_change_even_stopping(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,20")
    host.wait(2.0)
    host.ask(":Limit:Acceleration R,1,0;:Demand:Rate 1,0")
    host.wait(100.0)
    assert host.ask(":Read:Rate? 1") == "20.00000"
    host.ask(":Limit:Acceleration R,1,10")
    host.wait(3.0)
    assert host.ask(":Read:Rate? 1") == "0.00000"


def test_the_demand_is_held_to_the_rate_limit(host: Host) -> None:
    host.servo()
    host.ask(":Limit:Rate R,1,40;:Demand:Rate 1,-90")
    host.wait(2.0)
    assert host.ask(":Read:Rate? 1;:Status:CSR? A1DYN,5;:Demand:Rate? 1") == "-40.00000;1;-90.00000"


@pytest.mark.parametrize(("target", "turned"), [(90.0, 90.0), (270.0, -90.0), (-30.0, -30.0), (359.0, -1.0)])
def test_position_mode_takes_the_shortest_path(attended: AttendedHost, target: float, turned: float) -> None:
    attended.servo("Position")
    attended.ask(f":Demand:Position 1,{target}")
    attended.wait(30.0)
    assert attended.world.table.angle_deg() == pytest.approx(turned, abs=2e-4)
    assert attended.ask(":Status:CSR? A1DYN,8") == "1"
    assert float(attended.ask(":Read:Position? 1")) == pytest.approx(target % 360.0, abs=2e-4)


def test_a_position_move_is_a_trapezoid(attended: AttendedHost) -> None:
    attended.servo("Position")
    attended.ask(":Limit:Rate P,1,20;Acceleration P,1,40")
    start = attended.world.clock.now()
    attended.acl.write(b":Demand:Position 1,60\n")
    attended.world.clock.sleep_until(start + 2.0)
    assert attended.world.table.profile_rate_deg_s() == 20.0
    mechanics = paper_bench().table
    lag_s = 2 * mechanics.loop_damping / (2 * math.pi * mechanics.loop_hz)
    assert attended.world.table.angle_deg() == pytest.approx(0.5 * 20 * 0.5 + 20 * (1.5 - lag_s), abs=1e-2)
    attended.world.clock.sleep_until(start + 60 / 20 + 20 / 40 + 0.2)
    assert attended.world.table.angle_deg() == pytest.approx(60.0, abs=1e-2)


def test_a_stale_position_is_executed_on_closing(attended: AttendedHost) -> None:
    attended.ask(":Demand:Position 1,45;:Mode:Position 1;:Interlock:Close 1")
    attended.wait(20.0)
    assert attended.world.table.angle_deg() == pytest.approx(45.0, abs=2e-4)


def test_a_position_limit_clips_a_demand_and_stops_a_run(attended: AttendedHost) -> None:
    attended.ask(":Limit:HighPosition P,1,90;LowPosition P,1,-45")
    attended.servo("Position")
    attended.ask(":Demand:Position 1,120")
    attended.wait(20.0)
    assert attended.world.table.angle_deg() == pytest.approx(90.0, abs=2e-4)
    attended.ask(":Mode:Rate 1;:Demand:Rate 1,-30")
    attended.wait(20.0)
    assert attended.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)
    assert attended.world.table.angle_deg() == pytest.approx(-45.0, abs=1.0)
    assert attended.ask(":Status:CSR? A1DYN,7") == "1"
    attended.ask(":Demand:Rate 1,-10")
    attended.wait(2.0)
    assert attended.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)
    attended.ask(":Demand:Rate 1,10")
    attended.wait(2.0)
    assert attended.world.table.rate_deg_s() == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize(
    ("demand", "turns_deg_s"), [("4e-6", 0.0), ("6e-6", 1e-5), ("-20.000004", -20.0), ("0.1", 0.1)]
)
def test_the_demand_goes_in_the_steps_of_the_rate(demand: str, turns_deg_s: float) -> None:
    host = acl_hosts.Host(TableErrors(0.0, 0.0, 1e-5, 1e-5))
    host.servo()
    host.ask(f":Demand:Rate 1,{demand}")
    host.wait(5.0)
    assert host.world.table.rate_deg_s() == pytest.approx(turns_deg_s, rel=1e-12, abs=1e-15)
