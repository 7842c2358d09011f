"""What a table that nobody speaks to is asked: when it next does something by itself."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from simrack.rate_tables.acl import AclTable, TableErrors
from simrack.rate_tables.axis import TableAxis
from simrack.rate_tables.zaber import StepperErrors, ZaberTable
from simrack_tests.rate_tables.test_serial import BAUD

from tests.sim.rate_tables.real import RealWorld
from vcfbench.clock import sleep

if TYPE_CHECKING:
    from collections.abc import Callable

TURN = {
    "acl": (b":Demand:Rate 1,50;:Mode:Rate 1\n", b":Interlock:Close 1\n"),
    "zaber": (b"/1 driver enable\n", b"/1 move vel 50000\n"),
}


def _acl(world: RealWorld) -> AclTable:
    return AclTable(world, TableErrors.none())


def _zaber(world: RealWorld) -> ZaberTable:
    return ZaberTable(world, StepperErrors.none())


@pytest.fixture(params=[_acl, _zaber])
def turning(request: pytest.FixtureRequest) -> tuple[RealWorld, Any, list[float]]:
    """Return a world, its table under way, and the instants at which that has been worked out since."""
    make: Callable[[RealWorld], Any] = request.param
    world = RealWorld()
    table = make(world)
    for message in TURN[make.__name__.removeprefix("_")]:
        table.write(message)
        sleep(world.clock, 0.5)
        table.read(1000)
    sleep(world.clock, 30.0)
    worked_out = list[float]()
    advance = table._advance
    table._advance = lambda: (worked_out.append(world.clock.now()), advance())
    table.wake_at()
    worked_out.clear()
    return world, table, worked_out


def test_idle_table_is_not_recomputed(turning: tuple[RealWorld, Any, list[float]]) -> None:
    world, table, worked_out = turning
    assert abs(world.table.rate_deg_s()) > 1.0
    before = table.wake_at()
    for _ in range(100):
        sleep(world.clock, 0.1)
        assert table.wake_at() == before
    assert worked_out == []


def test_a_message_does_not_work_out_what_has_not_changed(turning: tuple[RealWorld, Any, list[float]]) -> None:
    """Once after it, because it may have changed something: not before it too."""
    world, table, worked_out = turning
    sleep(world.clock, 1.0)
    table.write(b"\n")
    assert worked_out == []
    table.wake_at()
    assert worked_out == [world.clock.now()]


@pytest.mark.parametrize("turning", [_acl], indirect=True)
def test_a_question_works_out_nothing(turning: tuple[RealWorld, Any, list[float]]) -> None:
    """Whatever it asks: the axis goes on as it did."""
    world, table, worked_out = turning
    for question in (b":Read:Rate? 1\n", b":Interlock? 1\r", b":Status:CSR? A1STATE;:Mode? 1\n"):
        sleep(world.clock, 1.0)
        table.write(question)
        sleep(world.clock, 0.1)
        assert table.read(1000)[0]
        table.wake_at()
    assert worked_out == []
    for other in (b":Demand:Rate 1,2\n", b":Read:Rate? 1;:Demand:Rate 1,2\n", b"nonsense\n", b":Read:Rate? 1"):
        sleep(world.clock, 1.0)
        table.wake_at()
        worked_out.clear()
        table.write(other)
        table.wake_at()
        assert worked_out, other
        table.write(b"\n")


def test_an_encoder_far_from_the_trip_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    world = RealWorld()
    table = _acl(world)
    for message in TURN["acl"]:
        table.write(message)
        sleep(world.clock, 5.0)
        table.wake_at()
        table.read(1000)
    table.wake_at()
    sleep(world.clock, 5.0)
    table.wake_at()
    assert world.table.goal_deg_s() == 50.0
    asked: list[float] = []
    monkeypatch.setattr(TableAxis, "rate_deg_s", lambda _: asked.append(world.clock.now()) or 0)
    table.write(b":Demand:Rate 1,50\r")
    table.wake_at()
    assert table.answering
    assert asked == []


def test_a_command_from_elsewhere_is_noticed(turning: tuple[RealWorld, Any, list[float]]) -> None:
    world, table, worked_out = turning
    world.table.demand_rate(1e5, 1e6)
    sleep(world.clock, 0.2)
    table.wake_at()
    assert worked_out, "beyond its over-rate trip it must shut down"
    sleep(world.clock, 1.0)
    table.wake_at()
    assert not world.table.servo_closed or world.table.goal_deg_s() == 0.0


def test_a_hand_on_the_table_is_noticed(turning: tuple[RealWorld, Any, list[float]]) -> None:
    world, table, worked_out = turning
    table.jam(held=True)
    table.wake_at()
    assert worked_out
    sleep(world.clock, 5.0)
    assert world.table.goal_deg_s() == 0.0


def test_an_interlock_is_noticed(turning: tuple[RealWorld, Any, list[float]]) -> None:
    world, table, worked_out = turning
    table.set_interlock("door", faulty=True)
    table.wake_at()
    assert worked_out
    assert not world.table.servo_closed


def test_the_page_tells_the_speeds_of_their_lines() -> None:
    page = (Path(__file__).parents[3] / "docs/rate-tables.md").read_text(encoding="utf-8")
    section = page.partition("### The line")[2].partition("\n### ")[0]
    documented = {
        row[1]: float(row[2].replace(" ", "")) for row in re.finditer(r"\n\| `(\w+)` \| ([\d ]+) \|", section)
    }
    assert documented == BAUD
