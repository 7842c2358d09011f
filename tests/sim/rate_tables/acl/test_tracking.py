"""TRACK mode on the World's own table behind an attended clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import AttendedHost


def test_track_follows_the_vectors_of_a_host(attended: AttendedHost) -> None:
    """A host asks for 20 deg/s by vectors at 10 Hz; the axis is within a tenth of a second of where it should be."""
    attended.servo("Track")
    attended.ask(":Mode:Track 1,500")
    for step in range(40):
        attended.acl.write(f":Demand:Vector 1,{2.0 * step},20,0\n".encode())
        attended.wait(0.1)
    assert attended.world.table.rate_deg_s() == pytest.approx(20.0, rel=0.02)
    assert attended.world.table.angle_deg() == pytest.approx(80.0, abs=2.0)
    attended.ask(":Mode:Track 1,0;:Demand:Vector 1,90,0,0")
    attended.wait(10.0)
    assert attended.world.table.angle_deg() == pytest.approx(90.0, abs=2e-4)


@pytest.mark.parametrize(("interval", "stops"), [(",200", True), ("", True), (",0", False)])
def test_a_host_that_falls_silent_in_track_mode_is_missed(attended: AttendedHost, interval: str, stops: bool) -> None:  # noqa: FBT001
    attended.servo("Track")
    attended.ask(f":Mode:Track 1{interval}")
    attended.wait(5.0)
    assert attended.ask(":Mode? 1") == "Track"  # the test begins with the first demand
    attended.acl.write(b":Demand:Vector 1,0,20,0\n")
    attended.wait(30.0)
    assert abs(attended.world.table.rate_deg_s()) == pytest.approx(0.0 if stops else 20.0, rel=1e-3, abs=1e-6)
    attended.acl.read(100)
    assert attended.ask(":Mode? 1") == ("Off" if stops else "Track")


def test_an_interval_of_track_mode_is_within_its_range(attended: AttendedHost) -> None:
    assert attended.ask(":Mode:Track 1,65536") == ""
    assert "PARAMETER OUT OF RANGE" in attended.ask(":Status:MSG? QERROR")
