"""How the servo closes and opens."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import AttendedHost, Host


def test_closing_the_interlock_executes_the_stale_demand(host: Host) -> None:
    host.ask(":Mode:Rate 1;:Demand:Rate 1,30;:Interlock:Close 1")
    host.wait(0.3)
    host.ask(":Interlock? 1")
    host.wait(5.0)
    assert host.ask(":Read:Rate? 1") == "30.00000"


def test_open_interlock_aborts_then_opens_servo(host: Host) -> None:
    host.servo()
    host.ask(":Limit:Acceleration Abort,1,200;:Demand:Rate 1,100")
    host.wait(2.0)
    host.ask(":Interlock:Open 1")
    start = host.world.clock.now()
    assert host.ask(":Status:CSR? A1STATE,4") == "1"
    host.world.clock.sleep_until(start + 0.5)
    assert host.ask(":Interlock? 1") == "Open"
    assert host.world.table.rate_deg_s() == 0.0
    assert host.ask(":Status:CSR? A1STATE,5;:Status:CSR? A1STATE,6") == "1;0"


def test_the_servo_closes_though_nobody_asks(attended: AttendedHost) -> None:
    attended.acl.write(b":Interlock:Close 1\n")
    attended.world.clock.sleep_until(0.19)
    assert not attended.world.table.servo_closed
    attended.world.clock.sleep_until(0.21)
    assert attended.world.table.servo_closed


def test_orderly_shutdown_opens_servo_at_rest_unasked(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.ask(":Demand:Rate 1,50;:Limit:Acceleration Abort,1,100")
    attended.wait(2.0)
    start = attended.world.clock.now()
    attended.acl.write(b":Interlock:Open 1\n")
    attended.world.clock.sleep_until(start + 0.499)
    assert attended.world.table.servo_closed
    attended.world.clock.sleep_until(start + 0.6)
    assert not attended.world.table.servo_closed
    assert abs(attended.world.table.rate_deg_s()) < 0.03
