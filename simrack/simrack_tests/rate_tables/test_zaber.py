from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.rate_tables.zaber import StepperErrors, ZaberTable, longitudinal_redundancy

from simrack_tests.rate_tables.ideal import IdealWorld, exchange, sleep


class Host:
    def __init__(self) -> None:
        self.world = IdealWorld()
        self.stage = ZaberTable(self.world, StepperErrors.none())

    def ask(self, text: str) -> str:
        return exchange(self.stage, self.world.clock, text.encode("latin-1") + b"\n").decode().removesuffix("\r\n")

    def wait(self, seconds: float) -> None:
        sleep(self.world.clock, seconds)


@pytest.fixture
def host() -> Host:
    return Host()


def test_the_golden_run(host: Host) -> None:
    assert host.ask("/1 1 01 get pos") == "@01 1 01 OK IDLE -- 0"
    assert host.ask("/1 1 02 move vel 29127") == "@01 1 02 OK BUSY -- 0"
    assert host.ask("/1 1 03 bogus") == "@01 1 03 RJ BUSY -- BADCOMMAND"
    host.wait(2.0)
    assert host.world.table.rate_deg_s() == pytest.approx(10.0, rel=1e-5)
    assert host.ask("/1 1 04 stop").startswith("@01 1 04 OK")
    host.wait(2.0)
    assert host.ask("/1 1 05") == "@01 1 05 OK IDLE -- 0"


@pytest.mark.parametrize(("message", "checksum"), [("1 0 00 get deviceid", "42"), ("1 1 move vel 16384", "1A")])
def test_golden_checksums(message: str, checksum: str) -> None:
    assert longitudinal_redundancy(message) == checksum


def test_a_right_checksum_is_taken_and_a_wrong_one_dropped(host: Host) -> None:
    assert host.ask("/1 0 00 get deviceid:42") == "@01 0 00 OK IDLE -- 50081"
    assert host.ask("/1 0 00 get deviceid:43") == ""


def test_replies_carry_checksums_when_asked(host: Host) -> None:
    host.ask("/1 set comm.checksum 1")
    reply = host.ask("/1 1 get pos")
    body, _, given_checksum = reply[1:].partition(":")
    assert (body, given_checksum) == ("01 1 OK IDLE -- 0", longitudinal_redundancy(body))


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("/", "@01 0 OK IDLE -- 0"),
        ("/get deviceid", "@01 0 OK IDLE -- 50081"),
        ("/1 2 get pos", "@01 2 RJ IDLE -- BADAXIS"),
        ("/2 1 get pos", ""),
        ("/1 1 move vel fast", "@01 1 RJ IDLE -- BADDATA"),
        ("/1 1 move vel 99999999", "@01 1 RJ IDLE -- BADDATA"),
        ("/1 1 move sin 100", "@01 1 RJ IDLE -- BADCOMMAND"),
        ("/1 1 set accel 0", "@01 1 RJ IDLE -- BADDATA"),
        ("/1 1 warnings", "@01 1 OK IDLE -- 00"),
        ("get pos", ""),
    ],
)
def test_replies_and_refusals(host: Host, command: str, reply: str) -> None:
    assert host.ask(command) == reply


def test_a_disabled_driver_coasts_and_refuses(host: Host) -> None:
    host.ask("/1 1 move vel 29127.1111")
    host.wait(1.0)
    assert host.ask("/1 1 driver disable") == "@01 1 OK BUSY FO 0"
    assert host.ask("/1 1 move vel 1").split()[2:] == ["RJ", "BUSY", "FO", "DRIVERDISABLED"]
    host.wait(2.0)
    assert host.ask("/1 1 driver enable") == "@01 1 OK IDLE -- 0"


def test_position_and_velocity_read_back(host: Host) -> None:
    host.ask("/1 1 set accel 1000")
    host.ask("/1 1 move vel 29127.1111")
    host.wait(20.0)
    angle = host.world.table.angle_deg()
    host.stage.write(b"/1 1 get pos\n")
    host.wait(0.1)
    assert int(host.stage.read(100)[0].split()[-1]) == round(angle * 640000 / 360)
    assert int(host.ask("/1 1 get vel").split()[-1]) == 29127


@given(st.text(st.characters(max_codepoint=255, exclude_characters="\r\n"), max_size=40))
def test_every_reply_is_well_formed(text: str) -> None:
    reply = Host().ask("/" + text)
    assert not reply or re.fullmatch(r"@01 \d+( \d\d+)? (OK|RJ) (BUSY|IDLE) (--|[A-Z]{2}) \S.*", reply)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("comm.address", "1"),
        ("resolution", "64"),
        ("peripheralid", "0"),
        ("motion.busy", "0"),
        ("comm.rs232.baud", "115200"),
        ("knob.enable", "0"),
    ],
)
def test_settings_that_clients_ask_for(host: Host, setting: str, value: str) -> None:
    assert host.ask(f"/1 1 get {setting}") == f"@01 1 OK IDLE -- {value}"


def test_interrupted_movement_is_flagged_until_one_begins_at_rest(host: Host) -> None:
    host.ask("/1 1 move vel 29127")
    host.wait(0.02)
    assert host.ask("/1 1 move vel 2000") == "@01 1 OK BUSY NI 0"
    host.ask("/1 1 stop")
    host.wait(2.0)
    assert host.ask("/1 1 warnings") == "@01 1 OK IDLE NI 01 NI"
    assert host.ask("/1 1 move rel 100") == "@01 1 OK BUSY -- 0"
    host.ask("/1 1 move rel 100")
    assert host.ask("/1 1 warnings clear").endswith(" 01 NI")
    assert host.ask("/1 1 warnings").endswith(" 00")


def test_identifiers_have_two_digits(host: Host) -> None:
    assert host.ask("/1 1 300 get pos") == ""
    assert host.ask("/1 1 99 get pos") == "@01 1 99 OK IDLE -- 0"


def test_a_speed_beyond_all_numbers_is_refused(host: Host) -> None:
    assert host.ask("/1 1 set maxspeed 999999999999") == "@01 1 RJ IDLE -- BADDATA"


def test_echo_and_reset(host: Host) -> None:
    assert host.ask("/1 tools echo one two") == "@01 0 OK IDLE -- one two"
    host.ask("/1 1 set accel 7")
    host.ask("/1 1 move vel 29127")
    host.wait(1.0)
    assert host.ask("/1 system reset").startswith("@01 0 OK")
    host.wait(20.0)
    assert host.world.table.rate_deg_s() == 0.0
    assert host.ask("/1 1 warnings") == "@01 1 OK IDLE -- 00"
