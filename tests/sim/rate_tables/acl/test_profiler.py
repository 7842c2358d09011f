"""How the axis follows the demand of each mode; the moves on the World's own table behind an attended clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from simrack.rate_tables.acl import TableErrors

from tests.sim.rate_tables.acl import hosts as acl_hosts
from vcfbench.sim.gyro.design import paper_bench

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


def ended_s(attended: AttendedHost, command: str) -> float:
    """Give a command that moves the axis; return the instant at which its ramp will be over."""
    attended.acl.write(command.encode() + b"\n")
    attended.wait(0.05)
    attended.acl.read(100)
    return attended.world.table.complete_s


def test_a_run_obeys_the_jerk_limit(attended: AttendedHost) -> None:
    """From rest 1/2 j t^2: 0.72 deg/s at 0.12 s of 100 deg/s3, where the acceleration alone would give 12."""
    attended.servo("Rate")
    attended.ask(":Limit:Acceleration R,1,100;Jerk R,1,100")
    over = ended_s(attended, ":Demand:Rate 1,100")  # a/j up and a/j down
    attended.world.clock.sleep_until(over - 2.0 + 0.12)
    assert attended.world.table.profile_rate_deg_s() == pytest.approx(0.72, rel=1e-6)
    attended.world.clock.sleep_until(over - 2.0 + 0.5)
    attended.acl.write(b":Read:Acceleration? 1\n")
    attended.wait(0.2)
    assert 50.0 <= float(attended.acl.read(100)[0]) <= 70.0  # it was asked on its way up
    attended.world.clock.sleep_until(over - 0.12)
    assert attended.world.table.profile_rate_deg_s() == pytest.approx(100.0 - 0.72, rel=1e-6)
    assert not attended.world.table.profile_complete()
    attended.world.clock.sleep_until(over)
    assert attended.ask(":Status:CSR? A1DYN,9") == "1"


def test_jerk_within_controller_frame_is_step(attended: AttendedHost) -> None:
    """As at power-on: 100 deg/s2 are there after 0.1 ms of 1e6 deg/s3, one frame of 10 kHz; 4200 deg/s2 are not."""
    attended.servo("Rate")
    over = ended_s(attended, ":Demand:Rate 1,50")
    attended.world.clock.sleep_until(over - 0.25)
    assert attended.world.table.profile_rate_deg_s() == pytest.approx(25.0, rel=1e-12)
    attended.wait(2.0)
    attended.ask(":Limit:Acceleration R,1,4200")
    over = ended_s(attended, ":Demand:Rate 1,470")
    attended.world.clock.sleep_until(over - 0.05)
    assert attended.world.table.profile_rate_deg_s() == pytest.approx(470.0 - 4200.0 * (0.05 - 0.5 * 4.2e-3))


def test_abort_obeys_own_jerk_limit_and_power_loss_none(attended: AttendedHost) -> None:
    attended.ask(":Limit:Acceleration Abort,1,100;Jerk Abort,1,100")
    attended.servo("Rate")
    attended.ask(":Demand:Rate 1,100")
    attended.wait(5.0)
    over = ended_s(attended, ":Interlock:Open 1")
    attended.world.clock.sleep_until(over - 2.0 + 0.12)
    assert attended.world.table.profile_rate_deg_s() == pytest.approx(100.0 - 0.72, rel=1e-6)
    attended.acl.set_interlock("emergency_stop", faulty=True)
    attended.wait(1.0)
    assert not attended.world.table.servo_closed  # it coasts from then on
    mechanics = paper_bench().table
    braked = mechanics.friction_deg_s2 + 100.0 / mechanics.friction_time_s
    assert attended.world.table.rate_deg_s() > 100.0 - 0.72 - 100.0 * 0.03 - braked * 1.1


@pytest.mark.parametrize("jerk", [100.0, 1e4])
def test_a_position_move_obeys_the_jerk_limit(attended: AttendedHost, jerk: float) -> None:
    """Distance over rate, v/a and a/j: what a move takes whose profile has all seven phases."""
    attended.servo("Position")
    attended.ask(f":Limit:Rate P,1,20;Acceleration P,1,40;Jerk P,1,{jerk:g}")
    over = ended_s(attended, ":Demand:Position 1,60") + 60 / 20
    attended.world.clock.sleep_until(over - 0.05)
    assert attended.world.table.profile_rate_deg_s() == pytest.approx(
        0.5 * jerk * 0.05**2 if jerk < 1e3 else 40.0 * (0.05 - 0.5 * 40.0 / jerk), rel=1e-4
    )
    attended.world.clock.sleep_until(over + 0.2)
    assert attended.world.table.angle_deg() == pytest.approx(60.0, abs=1e-2)
    attended.wait(2.0)
    assert attended.ask(":Status:CSR? A1DYN,8") == "1"


def test_run_with_jerk_limit_stops_at_end_of_travel(attended: AttendedHost) -> None:
    attended.ask(":Limit:HighPosition P,1,90")
    attended.servo("Rate")
    attended.ask(":Limit:Acceleration R,1,50;Jerk R,1,100;:Demand:Rate 1,30")
    attended.wait(20.0)
    assert attended.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)
    assert attended.world.table.angle_deg() == pytest.approx(90.0, abs=0.5)


def test_a_zero_jerk_limit_inhibits_every_change(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.ask(":Demand:Rate 1,20")
    attended.wait(2.0)
    attended.ask(":Limit:Jerk R,1,0;:Demand:Rate 1,0")
    attended.wait(10.0)
    assert attended.world.table.profile_rate_deg_s() == 20.0


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
