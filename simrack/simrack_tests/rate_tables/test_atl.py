from __future__ import annotations

import pytest
from simrack.rate_tables.atl import AtlTable, TableErrors

from simrack_tests.rate_tables.ideal import IdealWorld, exchange, sleep


class Host:
    def __init__(self, *, prompt_after_motion: bool = True) -> None:
        self.world = IdealWorld()
        self.table = AtlTable(self.world, TableErrors.none(), prompt_after_motion=prompt_after_motion)

    def ask(self, text: str) -> str:
        return exchange(self.table, self.world.clock, text.encode() + b"\r").decode()

    def wait(self, seconds: float) -> None:
        sleep(self.world.clock, seconds)


@pytest.fixture
def host() -> Host:
    return Host()


def test_the_golden_run(host: Host) -> None:
    assert host.ask("ACL200") == "\r\n>\r\n"
    assert host.ask("JOG30") == "\r\n>\r\n"
    host.wait(1.0)
    assert host.ask("PVE") == "30.0000\r\n>\r\n"
    assert host.ask("XYZ") == "?\r\n>\r\n"
    assert host.ask("\rSTO") == "\r\n>\r\n"
    host.wait(1.0)
    assert host.ask("PVE") == "0.0000\r\n>\r\n"


def test_the_ramp_takes_rate_over_acceleration(host: Host) -> None:
    host.ask("ACL50")
    start = host.world.clock.now()
    host.table.write(b"JOG-100\r\n")
    host.world.clock.sleep_until(start + 1.0)
    assert host.world.table.rate_deg_s() == pytest.approx(-50.0)
    host.world.clock.sleep_until(start + 2.0)
    assert host.world.table.rate_deg_s() == -100.0


def test_the_prompt_after_a_jog_may_be_absent() -> None:
    host = Host(prompt_after_motion=False)
    assert host.ask("JOG10") == ""
    host.wait(1.0)
    assert host.ask("PVE") == "10.0000\r\n>\r\n"


def test_a_stop_without_a_terminator_does_nothing(host: Host) -> None:
    host.ask("JOG10")
    host.table.write(b"STO")
    host.wait(5.0)
    assert host.world.table.rate_deg_s() == 10.0
    host.table.write(b"\r")
    host.wait(5.0)
    assert host.world.table.rate_deg_s() == 0.0


@pytest.mark.parametrize(
    "command", ["JOG", "JOG361", "JOGfast", "ACL0", "ACL-1", "SRV2", "STO1", "PPO1", "HOM1", "jo", "°"]
)
def test_refusals_contain_a_question_mark(host: Host, command: str) -> None:
    assert host.ask(command) == "?\r\n>\r\n"
    assert host.world.table.rate_deg_s() == 0.0


def test_servo_and_zero(host: Host) -> None:
    host.ask("SRV1")
    host.ask("JOG10")
    host.wait(1.05)
    host.ask("STO")
    host.wait(1.0)
    host.ask("ZER90")
    assert host.ask("PPO") == "90.0000\r\n>\r\n"
    host.ask("SRV0")
    assert not host.world.table.servo_closed


@pytest.mark.parametrize("motion", ["JOG20", "HOM", "MOV10", "RMO10"])
def test_what_srv0_has_switched_off_does_not_move_before_srv1(host: Host, motion: str) -> None:
    host.ask("SRV0")
    assert host.ask(motion) == "?\r\n>\r\n"
    host.wait(2.0)
    assert host.world.table.angle_deg() == 0.0
    host.ask("SRV1")
    assert "?" not in host.ask(motion)
