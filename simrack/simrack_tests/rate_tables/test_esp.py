from __future__ import annotations

import pytest
from simrack.rate_tables.esp import EspTable, TableErrors

from simrack_tests.rate_tables.ideal import IdealWorld, exchange, sleep


class Host:
    def __init__(self) -> None:
        self.world = IdealWorld()
        self.table = EspTable(self.world, TableErrors.none())

    def ask(self, text: str) -> str:
        return exchange(self.table, self.world.clock, text.encode() + b"\r").decode().removesuffix("\r\n")

    def wait(self, seconds: float) -> None:
        sleep(self.world.clock, seconds)


@pytest.fixture
def host() -> Host:
    return Host()


def test_a_run_in_one_direction_and_a_stop(host: Host) -> None:
    assert host.ask("1MO") == ""
    assert host.ask("1MO?") == "1"
    host.ask("1AC50;1AG25;1VA20")
    start = host.world.clock.now()
    host.table.write(b"1MV-\r")
    host.world.clock.sleep_until(start + 0.2)
    assert host.world.table.rate_deg_s() == pytest.approx(-10.0)
    assert host.ask("1MD?") == "0"
    host.wait(1.0)
    assert host.ask("1TV") == "-20.0000"
    start = host.world.clock.now()
    host.table.write(b"1ST\r")
    host.world.clock.sleep_until(start + 0.4)
    assert host.world.table.rate_deg_s() == pytest.approx(-10.0)
    host.world.clock.sleep_until(start + 0.8)
    assert host.ask("1MD?") == "1"
    assert host.ask("TE?") == "0"


def test_a_velocity_set_while_moving_takes_effect(host: Host) -> None:
    host.ask("1MO;1VA20;1MV+")
    host.wait(1.0)
    host.ask("1VA5")
    host.wait(1.0)
    assert host.ask("1TV") == "5.0000"


@pytest.mark.parametrize(
    ("command", "number", "words"),
    [
        ("1XX", 6, "COMMAND DOES NOT EXIST"),
        ("XX", 6, "COMMAND DOES NOT EXIST"),
        ("2TP", 9, "AXIS NUMBER OUT OF RANGE"),
        ("TP", 37, "AXIS NUMBER MISSING"),
        ("1MV+", 113, "AXIS-1 MOTOR NOT ENABLED"),
        ("1VA999", 110, "AXIS-1 MAXIMUM VELOCITY EXCEEDED"),
        ("1AC0", 101, "PARAMETER OUT OF RANGE"),
        ("1PA90", 113, "AXIS-1 MOTOR NOT ENABLED"),
        *((f"1{verb}", 38, "COMMAND PARAMETER MISSING") for verb in ("VA", "AC", "AG", "MV", "PA", "PR", "SN", "SL")),
    ],
)
def test_errors_go_to_the_queue(host: Host, command: str, number: int, words: str) -> None:
    assert host.ask(command) == ""
    assert host.ask("TB?").split(", ")[::2] == [str(number), words]
    host.ask(command)
    assert host.ask("TE?") == str(number)
    assert host.ask("TE?") == "0"


def test_the_status_character(host: Host) -> None:
    assert host.ask("TS") == "@"
    host.ask("1MO")
    assert host.ask("TS") == "P"
    host.ask("1MV+")
    assert host.ask("TS") == "Q"


def test_chained_queries_answer_one_line_each(host: Host) -> None:
    assert host.ask("1TP;1TV;1VA?") == "0.0000\r\n0.0000\r\n20.0000"


def test_abort_cuts_the_motor(host: Host) -> None:
    host.ask("1MO;1MV+")
    host.wait(1.0)
    host.ask("AB")
    assert host.ask("1MO?") == "0"
    assert host.world.table.rate_deg_s() < 20.0


def test_home_can_be_defined(host: Host) -> None:
    host.ask("1MO;1VA10;1MV+")
    host.wait(3.0)
    host.ask("1ST")
    host.wait(1.0)
    host.ask("1DH0")
    assert host.ask("1TP") == "0.0000"


def test_what_follows_ws_waits_until_the_stage_stands(host: Host) -> None:
    start = host.world.clock.now()
    host.table.write(b"1MO;1VA50;1PA100;1WS500;1TP;TE?\r1TP\r")
    reply = exchange(host.table, host.world.clock, b"", 10.0)
    # 100 deg at 50 deg/s and 100 deg/s2 are 2.5 s; half a second beyond that, and the pause of the move's own control
    assert host.world.clock.now() - start == pytest.approx(3.1, abs=0.25)
    assert reply.split() == [b"100.0000", b"0"]
    assert host.ask("TE?") == "100.0000"  # what came in the second message
    assert host.ask("1DP?") == "0"


def test_software_limits_refuse_a_move_and_stop_a_jog(host: Host) -> None:
    host.ask("1MO;1SL-10;1SR20")
    assert host.ask("1SL?;1SR?") == "-10.0000\r\n20.0000"
    for command, number in (("1PA21", "106"), ("1PA-11", "107")):
        host.ask(command)
        assert host.ask("TE?") == number
    host.ask("1VA50;1MV+")
    for _ in range(50):
        host.wait(0.02)
        host.table.wake_at()
    host.wait(2.0)
    assert host.ask("TE?") == "106"
    assert host.world.table.rate_deg_s() == 0.0
    assert host.world.table.angle_deg() == pytest.approx(20.0 + 50.0**2 / 200.0, abs=1.5)


def test_positions_and_rates_are_in_the_unit_that_is_set(host: Host) -> None:
    host.ask("1MO;1SN9;1VA1;1SL-2;1SR2;1PA0.25;1WS")
    host.wait(2.0)
    assert host.ask("1TP") == host.ask("1DP?") == "0.2500"
    assert host.ask("1SN7;1TP") == "14.3239"
    assert host.ask("1VA?") == "57.2958"
    assert host.ask("1SR?") == "114.5916"
    assert host.ask("TE?") == "0"


def test_the_stage_knows_no_unit_of_lengths(host: Host) -> None:
    assert host.ask("1SN?") == "7"
    host.ask("1SN7")
    assert host.ask("TE?") == "0"
    host.ask("1SN2")
    assert host.ask("TE?") == "101"
    assert host.ask("1VU?;1AU?") == "400.0000\r\n1000.0000"


@pytest.mark.parametrize("spelt", ["1TP", "1 TP", " 1TP ", "1 TP;"])
def test_blanks_are_passed_over(host: Host, spelt: str) -> None:
    assert host.ask(spelt) == "0.0000"
    assert host.ask("TE?") == "0"


def test_wp_holds_up_what_follows_until_the_stage_is_past(host: Host) -> None:
    host.ask("1MO;1AC1000;1VA10")
    start = host.world.clock.now()
    assert float(host.ask("1PA20;1WP10;1TP?")) == pytest.approx(10.0, abs=0.2)
    assert host.world.clock.now() - start == pytest.approx(1.0, abs=0.1)
    assert host.ask("1MD?") == "0"


def test_stored_settings_are_reported_and_limit_motion(host: Host) -> None:
    assert host.ask("1JK?;1QM?;1ZH?") == "1000.0000\r\n1\r\n24H"
    host.ask("1JK250;1VU15;1AU40")
    assert host.ask("1JK?;1VU?;1AU?") == "250.0000\r\n15.0000\r\n40.0000"
    host.ask("1VA16")
    assert host.ask("TE?") == "110"
    host.ask("1AC41")
    assert host.ask("TE?") == "101"
    host.ask("1JK")
    assert host.ask("TE?") == "38"
