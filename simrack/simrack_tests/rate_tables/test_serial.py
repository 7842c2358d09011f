"""A rate table at the end of a serial line: each character takes its time, at the right speed only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack.attendance import AttendedClock
from simrack.rate_tables.aaaa import AaaaTable
from simrack.rate_tables.acl import AclTable, TableErrors
from simrack.rate_tables.atl import AtlTable
from simrack.rate_tables.dd16 import Dd16Table
from simrack.rate_tables.esp import EspTable
from simrack.rate_tables.mn_as import MnAsTable
from simrack.rate_tables.ruya import RuyaTable
from simrack.rate_tables.zaber import StepperErrors, ZaberTable
from simrack.wires.serial_line import CharacterFrame, ThreeWireLine

from simrack_tests.rate_tables.ideal import IdealWorld
from simrack_tests.rate_tables.turning import CONNECT, POLL, START

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.rate_tables.line import LineDevice

MAKE: dict[str, Callable[[IdealWorld], LineDevice]] = {
    "acl": lambda world: AclTable(world, TableErrors.none()),
    "zaber": lambda world: ZaberTable(world, StepperErrors.none()),
    "atl": lambda world: AtlTable(world, TableErrors.none()),
    "esp": lambda world: EspTable(world, TableErrors.none()),
    "dd16": lambda world: Dd16Table(world, TableErrors.none()),
    "mn_as": lambda world: MnAsTable(world, TableErrors.none()),
    "ruya": lambda world: RuyaTable(world, TableErrors.none()),
    "aaaa": lambda world: AaaaTable(world, TableErrors.none()),
}
BAUD = {
    "acl": 9600,
    "zaber": 115200,
    "atl": 9600,
    "esp": 19200,
    "dd16": 9600,
    "mn_as": 115200,
    "ruya": 115200,
    "aaaa": 38400,
}
"""What clients of such tables open the port with; 8 data bits, no parity, 1 stop bit."""
OTHER_BAUDS = (1200, 9600, 19200, 38400, 57600, 115200)


class Desk:
    """A table of one language behind its line, on a clock that stops wherever something happens."""

    def __init__(self, name: str, *, by_message: bool = False) -> None:
        world = IdealWorld()
        self.world = world
        self.table = MAKE[name](world)
        self.line = ThreeWireLine(self.table, world.clock, self.table.frame, by_message=by_message)
        self.clock = AttendedClock(world.clock, [self.line])
        self.character_s = 10 / BAUD[name]

    def wait(self, seconds: float) -> bytes:
        self.clock.sleep_until(self.clock.now() + seconds)
        return self.line.read(1 << 20)[0]

    def open_at(self, baud: float) -> None:
        self.line.configure(CharacterFrame(float(baud), stop_bits=1.0), handshake=False)

    def instants(self, message: bytes, seconds: float = 1.0) -> list[float]:
        """Return when each character of the answer to `message` arrives, counted from the write."""
        start = self.clock.now()
        self.line.write(message)
        found = list[float]()
        while (wake := self.line.wake_at()) is not None and wake < start + seconds:
            self.clock.sleep_until(wake)
            found += [self.clock.now() - start] * len(self.line.read(1 << 20)[0])
        return found


@pytest.mark.parametrize("name", MAKE)
def test_its_port_is_set_as_its_clients_open_it(name: str) -> None:
    assert Desk(name).table.frame == CharacterFrame(float(BAUD[name]), 8, "none", 1.0)


@pytest.mark.parametrize(
    ("name", "message", "reply", "own_s"),
    [
        ("acl", b":Mode? 1\r", b"Off\r\n", 0.002),
        ("zaber", b"/1 1 get pos\n", b"@01 1 OK IDLE -- 0\r\n", 0.002),
        ("atl", b"PPO\r", b"0.0000\r\n>\r\n", 0.005),
        ("esp", b"1TP\r", b"0.0000\r\n", 0.002),
        ("dd16", CONNECT, CONNECT, 0.005),
    ],
)
def test_an_exchange_takes_the_characters_of_both_ways(name: str, message: bytes, reply: bytes, own_s: float) -> None:
    desk = Desk(name)
    began_s = len(message) * desk.character_s + own_s
    expected = [began_s + (place + 1) * desk.character_s for place in range(len(reply))]
    assert desk.instants(message) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("times", [1, 2])
def test_time_stops_only_at_message_ends(times: int) -> None:
    reply = times * b"0.0000\r\n>\r\n"
    by_character, by_message = (Desk("atl", by_message=each).instants(times * b"PPO\r") for each in (False, True))
    ends = [place for place, byte in enumerate(reply) if byte < 32]
    assert len(by_message) == len(reply)
    assert [by_message[place] for place in ends] == [by_character[place] for place in ends]
    assert len(set(by_message)) <= len(ends) + 1  # the second question arrives meanwhile


def test_position_is_taken_when_the_query_has_come() -> None:
    desk = Desk("acl")
    for message in START["acl"]:
        desk.line.write(message)
        desk.wait(1.0)
    desk.wait(10.0)
    question = b":Read:Position? 1\r"
    arrives_s = desk.clock.now() + len(question) * 10 / 9600
    desk.line.write(question)
    desk.clock.sleep_until(arrives_s)
    there_deg = desk.world.table.angle_deg() % 360.0
    assert float(desk.wait(0.1)) == pytest.approx(there_deg, abs=6e-6)  # five decimals are said


def test_a_demand_begins_when_its_last_character_has_come() -> None:
    desk = Desk("acl")
    for message in START["acl"][:-1]:
        desk.line.write(message)
        desk.wait(1.0)
    *_, demand = START["acl"]
    start = desk.clock.now()
    began_s = start + len(demand) * 10 / 9600
    desk.line.write(demand)
    desk.clock.sleep_until(began_s - 1e-9)
    assert desk.world.table.goal_deg_s() == 0.0
    desk.clock.sleep_until(began_s + 1e-9)
    assert desk.world.table.goal_deg_s() == 50.0


def test_unasked_status_does_not_delay_commands() -> None:
    desk = Desk("aaaa")
    for message in START["aaaa"]:
        desk.wait(0.0999)  # the next status is about to be sent
        desk.line.write(message)
    desk.wait(0.1)
    assert desk.world.table.servo_closed
    assert len(desk.wait(1.0)) == 10 * 23


@pytest.mark.parametrize("name", MAKE)
def test_it_answers_at_the_right_speed_only(name: str) -> None:
    right = Desk(name)
    right.open_at(BAUD[name])
    right.line.write(POLL[name])
    wanted = right.wait(0.5)
    assert wanted
    for baud in OTHER_BAUDS:
        desk = Desk(name)
        desk.open_at(baud)
        desk.line.write(POLL[name])
        assert (wanted in desk.wait(0.5)) is (baud == BAUD[name]), baud


@pytest.mark.parametrize("name", MAKE)
def test_at_the_wrong_speed_nothing_turns(name: str) -> None:
    for baud in OTHER_BAUDS:
        desk = Desk(name)
        desk.open_at(baud)
        for message in START[name]:
            desk.line.write(message)
            desk.wait(1.0)
        assert (desk.world.table.goal_deg_s() != 0.0) is (baud == BAUD[name]), baud


def test_mismatched_parity_garbles_a_command() -> None:
    """7E1 and 8N1 have as many bits: half of the characters come with a wrong eighth bit."""
    desk = Desk("acl")
    desk.line.configure(CharacterFrame(9600.0, 7, "even", 1.0), handshake=False)
    desk.line.write(b":Mode? 1\r")
    assert b"Off" not in desk.wait(0.5)
