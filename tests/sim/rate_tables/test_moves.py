"""What the tables do by themselves happens at its own instant, on the World's own table behind an attended clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from simrack.rate_tables.acl import TableErrors
from simrack.rate_tables.atl import AtlTable
from simrack.rate_tables.axis import TableAxis
from simrack.rate_tables.esp import EspTable
from simrack.rate_tables.ruya import RuyaTable
from simrack.rate_tables.zaber import StepperErrors, ZaberTable
from simrack_tests.rate_tables.ideal import exchange

from tests.sim.rate_tables.real import RealWorld

if TYPE_CHECKING:
    from collections.abc import Callable


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
    assert math.isclose(TableAxis(world, TableErrors.none()).angle_deg(), 0.0, abs_tol=2e-4)


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


def test_ruya_runs_sine_and_reports_steady() -> None:
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
