"""What shuts the axis down by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import AttendedHost, Host


def test_over_rate_trips_on_the_measured_rate_and_latches(host: Host) -> None:
    host.ask(":Limit:Vtrip R,1,60;Acceleration Abort,1,100")
    host.servo()
    host.ask(":Demand:Rate 1,80")
    host.wait(0.7)
    assert host.ask(":Interlock? 1") == "Fault"
    assert host.ask(":Status:CSR? A1SWFLT,1;:Status:CSR? SI,3") == "1;1"
    host.wait(2.0)
    assert host.ask(":Status:CSR? A1STATE,6;:Status:CSR? A1STATE,4") == "1;0"
    assert host.world.table.rate_deg_s() == 0.0
    assert host.ask("*STB?") == "67"
    assert host.ask("*STB?") == "0"
    host.ask(":Interlock:Close 1")
    host.wait(1.0)
    assert host.ask(":Interlock? 1") == "Fault"
    host.ask(":Interlock:Reset")
    assert host.ask(":Interlock? 1;:Status:CSR? A1SWFLT") == "Open;0"


def test_broken_interlock_drops_drive_and_table_coasts(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,100")
    host.wait(2.0)
    host.table.set_interlock(9, faulty=True)
    start = host.world.clock.now()
    host.table.set_interlock(9, faulty=False)
    assert host.ask(":Status:CSR? A1INTLK,9;:Status:CSR? A1STATE,7;:Interlock? 1") == "1;1;Fault"
    host.table.set_interlock(9, faulty=True)
    host.world.clock.sleep_until(start + 1.0)
    assert host.world.table.rate_deg_s() == pytest.approx(100.0 - host.world.table.friction_deg_s2)
    host.ask(":Interlock:Reset")
    assert host.ask(":Interlock? 1") == "Fault"
    host.table.set_interlock(9, faulty=False)
    assert host.ask(":Interlock? 1") == "Open"


def test_an_interlock_is_tested_only_while_servoed(host: Host) -> None:
    host.table.set_interlock(7, faulty=True)
    host.table.set_interlock(7, faulty=False)
    assert host.ask(":Interlock? 1") == "Open"


def test_over_rate_trip_acts_at_crossing_unasked(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.ask(":Limit:Acceleration R,1,50;Acceleration Abort,1,500;Vtrip R,1,60")
    start = attended.world.clock.now()
    attended.acl.write(b":Demand:Rate 1,-100\n")
    attended.world.clock.sleep_until(start + 1.19)
    assert attended.world.table.rate_deg_s() == pytest.approx(-59, abs=1.0)
    # 60 deg/s after 1.2 s and the lag of the loop, then 0.12 s of ABORT profile
    attended.world.clock.sleep_until(start + 1.40)
    assert attended.world.table.rate_deg_s() == pytest.approx(0.0, abs=0.1)
    attended.world.clock.sleep_until(start + 1.50)
    assert not attended.world.table.servo_closed
    attended.acl.read(100)
    assert attended.ask(":Status:CSR? A1SWFLT,1") == "1"


def test_a_rate_just_beyond_the_trip_trips_too(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.ask(":Limit:Acceleration R,1,50;Vtrip R,1,60")
    attended.acl.write(b":Demand:Rate 1,60.01\n")
    attended.wait(5.0)
    assert not attended.world.table.servo_closed


def test_an_oscillation_beyond_the_trip_trips(attended: AttendedHost) -> None:
    attended.servo("Position")
    attended.ask(":Limit:Acceleration S,1,4000;Vtrip S,1,50;:Con:Osc 1,Disable,50,1,Pos,Lin")
    attended.ask(":Demand:Oscillator 1,20,0.6,0;:Mode:Synthesis 1")
    attended.wait(5.0)
    assert not attended.world.table.servo_closed
    assert attended.ask(":Status:CSR? A1SWFLT,1") == "1"


def test_held_axis_ignores_demands_until_its_servo_closes(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.wait(1.0)
    attended.ask(":Demand:Rate 1,50")
    attended.wait(5.0)
    attended.acl.jam(held=True)
    assert attended.ask(":Mode:Position 1;:Demand:Position 1,90") == "OK"
    attended.wait(5.0)
    assert not attended.world.table.servo_closed
    assert attended.world.table.rate_deg_s() == 0.0
    attended.acl.jam(held=False)
    attended.ask(":Interlock:Reset;:Interlock:Close 1")
    attended.wait(10.0)
    assert attended.world.table.angle_deg() % 360.0 == pytest.approx(90.0, abs=1e-3)
