"""The simulated tables with recovered formats, by frames written out by hand from what is known of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.rate_tables.aaaa import AaaaTable
from simrack.rate_tables.axis import TableErrors
from simrack.rate_tables.dd16 import Dd16Table
from simrack.rate_tables.mn_as import MnAsTable, character_sum
from simrack.rate_tables.ruya import RuyaTable

from simrack_tests.rate_tables.ideal import IdealWorld, exchange, sleep

if TYPE_CHECKING:
    from simrack.device import Device


class Host:
    def __init__(self, kind: type, **settings: int) -> None:
        self.world = IdealWorld()
        self.device: Device = kind(self.world, TableErrors.none(), **settings)

    def tell(self, *messages: bytes) -> None:
        for message in messages:
            self.device.write(message)

    def ask(self, message: bytes) -> bytes:
        return exchange(self.device, self.world.clock, message, wait_s=0.5)

    def wait(self, seconds: float) -> None:
        """Wait, looking in on the device when it does something by itself."""
        end = self.world.clock.now() + seconds
        while (wake := self.device.wake_at()) is not None and self.world.clock.now() < wake < end:
            self.world.clock.sleep_until(wake)
            while self.device.read(4096)[0]:
                pass
        sleep(self.world.clock, max(0.0, end - self.world.clock.now()))

    @property
    def rate(self) -> float:
        return self.world.table.rate_deg_s()


def dd(text: str) -> bytes:
    begin, _, end = text.partition("..")
    head, tail = bytes.fromhex(begin), bytes.fromhex(end)
    return head + bytes(16 - len(head) - len(tail)) + tail


CONNECT, POWER_ON, CLOSE = dd("DD 00 55 .. CE"), dd("DD 01 03 .. 1F"), dd("DD 01 05 .. 1D")
LOAD_10 = bytes.fromhex("DD 01 0C 40 42 0F 00 80 84 1E 00 00 00 00 00 63")
LOAD_MINUS_10 = bytes.fromhex("DD 01 0C C0 BD F0 FF 80 84 1E 00 00 00 00 00 88")
LOAD_POSITION = bytes.fromhex("DD 01 0B 40 54 89 00 80 84 1E 00 40 42 0F 00 47")
RUN_RATE, STOP, ZERO = dd("DD 01 10 02 .. 10"), dd("DD 01 07 .. 1B"), dd("DD 01 09 .. 19")


def test_dd16_golden_run() -> None:
    host = Host(Dd16Table)
    assert host.ask(dd("DD 01 16 .. 0C")) == b""  # not connected
    assert host.ask(CONNECT) == CONNECT
    host.tell(POWER_ON, CLOSE, LOAD_10, RUN_RATE)
    assert host.ask(dd("DD 01 16 .. 0C"))[3] == 0
    host.wait(1.0)
    assert host.rate == 10.0
    assert host.ask(dd("DD 01 16 .. 0C")) == dd("DD 01 16 02 .. 0A")
    reply = host.ask(dd("DD 01 13 .. 0F"))
    assert int.from_bytes(reply[7:11], "little") == 1_000_000
    assert sum(reply) % 256 == 0
    host.tell(LOAD_MINUS_10, RUN_RATE)
    host.wait(2.0)
    assert host.rate == -10.0
    host.tell(STOP)
    host.wait(1.0)
    assert host.rate == 0.0
    assert host.ask(dd("DD 01 16 .. 0C"))[3] & 4


def test_dd16_order_of_power_servo_and_run() -> None:
    host = Host(Dd16Table)
    host.tell(CONNECT, CLOSE)
    assert not host.world.table.servo_closed
    host.tell(POWER_ON, RUN_RATE, CLOSE, RUN_RATE)  # nothing loaded
    assert (host.world.table.servo_closed, host.rate) == (True, 0.0)
    host.tell(LOAD_10, RUN_RATE)
    host.wait(1.0)
    host.tell(LOAD_POSITION, dd("DD 01 10 01 .. 11"))  # another kind of run, without a stop
    host.wait(1.0)
    assert host.rate == 10.0


def test_dd16_homes_and_moves() -> None:
    host = Host(Dd16Table)
    host.tell(CONNECT, POWER_ON, CLOSE, LOAD_POSITION, dd("DD 01 10 01 .. 11"))
    host.wait(12.0)
    assert host.world.table.angle_deg() == pytest.approx(90.0, abs=1e-3)
    assert host.ask(dd("DD 01 16 .. 0C"))[3] == 5
    host.tell(dd("DD 01 07 .. 1B"), ZERO)
    assert host.ask(dd("DD 01 15 .. 0D"))[3] == 1
    host.wait(12.0)
    assert host.ask(dd("DD 01 15 .. 0D"))[3] == 2
    assert host.world.table.angle_deg() == pytest.approx(0.0, abs=1e-3)


@given(st.binary(max_size=40))
def test_dd16_finds_a_frame_after_noise_without_its_header(noise: bytes) -> None:
    host = Host(Dd16Table)
    host.tell(noise.replace(b"\xdd", b""))
    assert host.ask(CONNECT) == CONNECT


def test_dd16_a_damaged_frame_costs_one_byte() -> None:
    host = Host(Dd16Table)
    assert host.ask(b"\xdd\xdd\xdd" + CONNECT) == CONNECT


def mn(text: str) -> bytes:
    return f"${text}*{character_sum(text)}\r\n".encode()


@pytest.mark.parametrize(
    ("message", "check"), [("MNREM,1", "DC"), ("ASREM,OK", "3E"), ("MNENB,1", "CD"), ("MNVEL,0,0,10", "C7")]
)
def test_mn_golden_sums(message: str, check: str) -> None:
    assert character_sum(message) == check


def test_mn_golden_run() -> None:
    host = Host(MnAsTable, axis=3)
    assert host.ask(b"$MNENB,1*CD\r\n") == b""  # not under remote control
    assert host.ask(b"$MNREM,1*DC\r\n") == b"$ASREM,OK*3E\r\n"
    for text in ("MNENB,1", "MNMOD,0,0,1", "MNACC,5,5,5", "MNVEL,0,0,10"):
        assert host.ask(mn(text)) == f"$AS{text[2:5]},OK*{character_sum(f'AS{text[2:5]},OK')}\r\n".encode()
    assert host.ask(b"$MNRUN,1*ED\r\n") == b"$ASRUN,OK*4F\r\n"
    host.wait(3.0)
    assert host.rate == 10.0
    assert b",10.0000,1D,OK*" in host.ask(mn("MNSTS"))
    assert host.ask(b"$MNSTP,1*EF\r\n") == b"$ASSTP,OK*51\r\n"
    host.wait(3.0)
    assert b",0.0000,00,OK*" in host.ask(mn("MNSTS"))


@pytest.mark.parametrize(
    "message", [b"$MNREM,1*DD\r\n", b"MNREM,1*DC\r\n", b"$MNXYZ,1*11\r\n", b"\r\n", mn("MNACC,0,0,0")]
)
def test_mn_what_is_damaged_or_unknown_is_not_answered(message: bytes) -> None:
    assert Host(MnAsTable).ask(message) == b""


def test_mn_a_dollar_begins_a_message_anew() -> None:
    host = Host(MnAsTable)
    assert host.ask(b"$MNVEL,1" + mn("MNCHK,1")) == b"$" + b"ASCHK,OK*" + character_sum("ASCHK,OK").encode() + b"\r\n"
    assert host.ask(b"\x00noise$$" + mn("MNCHK,1")).startswith(b"$ASCHK,OK*")


def test_mn_other_axes_accept_commands_at_rest() -> None:
    host = Host(MnAsTable, axis=1)
    for text in ("MNREM,1", "MNENB,1", "MNMOD,1,1,1", "MNVEL,0,10,20", "MNRUN,1"):
        assert host.ask(mn(text)).startswith(b"$AS" + text[2:5].encode() + b",OK*")
    host.wait(3.0)
    assert host.ask(mn("MNSTS")).startswith(b"$ASSTS" + 3 * b",0.0000,0.0000,00" + b",OK*")
    assert host.rate == 0.0


def status(host: Host) -> str:
    """Return the next status that the table sends by itself."""
    while host.device.read(4096)[0]:
        pass
    return exchange(host.device, host.world.clock, b"").decode().strip()


def test_ruya_golden_run() -> None:
    host = Host(RuyaTable)
    assert status(host)[:4] == "$100"
    host.tell(b"$13100100020.0000\r\n")
    host.wait(1.0)
    assert host.rate == 0.0  # released
    host.tell(b"$1mo=1\r\n")
    host.wait(0.3)
    assert status(host)[3] == "1"
    host.tell(b"$13100100020.0000\r\n")
    host.wait(1.0)
    assert status(host)[3] == "4"
    host.wait(2.0)
    assert (status(host)[3], host.rate) == ("5", 20.0)  # 1 is counter-clockwise
    host.tell(b"$13000100020.0000\r\n")
    host.wait(1.0)
    assert host.rate == 20.0  # motion is taken up in state 1 only
    host.tell(b"$1st\r\n")
    assert status(host)[3] == "8"
    host.wait(3.0)
    assert (status(host)[3], host.rate) == ("1", 0.0)


def test_ruya_numbers_status_and_adds_720_to_negative_angles() -> None:
    host = Host(RuyaTable)
    first, second = status(host), status(host)
    assert int(second[4:6]) == int(first[4:6]) + 1
    host.tell(b"$1mo=1\r\n")
    host.wait(0.3)
    host.tell(b"$12101000100.0000010.0000\r\n")
    host.wait(3.0)
    assert status(host)[6:] == "710.0000"  # ten degrees counter-clockwise
    host.tell(b"$11\r\n")
    host.wait(5.0)
    assert float(status(host)[6:]) % 720.0 == pytest.approx(0.0, abs=1e-3)
    host.tell(b"$15001000100.0000010.000002\r\n")
    host.wait(15.0)
    assert host.world.table.angle_deg() == pytest.approx(-730.0, abs=1e-2)


@pytest.mark.parametrize("kind", [RuyaTable, AaaaTable])
def test_status_that_nobody_reads_does_not_pile_up(kind: type) -> None:
    host = Host(kind)
    for _ in range(1000):
        wake = host.device.wake_at()
        assert wake is not None
        host.world.clock.sleep_until(wake)
    waiting = 0
    while data := host.device.read(65536)[0]:
        waiting += len(data)
    assert 0 < waiting <= 4096


def aaaa(first: str) -> bytes:
    body = bytes.fromhex("AA AA") + bytes.fromhex(first) + bytes.fromhex("80 00 00 00 00 00") * 2
    return body + bytes([sum(body) % 256])


def aaaa_status(host: Host) -> tuple[int, int]:
    while host.device.read(4096)[0]:
        pass
    frame = exchange(host.device, host.world.clock, b"")
    assert (len(frame), frame[:2], frame[-1]) == (23, b"\xaa\xaa", sum(frame[:-1]) % 256)
    return int.from_bytes(frame[2:5], "little"), frame[5]


def test_aaaa_moves_by_sign_and_magnitude() -> None:
    host = Host(AaaaTable)
    assert aaaa_status(host) == (0, 0)
    host.tell(aaaa("81 10 27 00 64 00"))
    assert not host.world.table.servo_closed
    host.tell(aaaa("AB 00 00 00 00 00"))
    assert aaaa_status(host) == (0, 1)
    host.tell(aaaa("81 40 0D 83 E8 03"))  # -20 deg at 10 deg/s
    host.wait(1.0)
    assert host.rate == -10.0
    assert aaaa_status(host)[1] == 3
    host.wait(4.0)
    position, flags = aaaa_status(host)
    assert (position, flags) == (0x830D40, 1)
    host.tell(aaaa("AC 00 00 00 00 00"))
    assert aaaa_status(host)[1] == 0


def test_aaaa_stops_and_a_wrong_sum_is_not_taken() -> None:
    host = Host(AaaaTable)
    move = aaaa("81 40 0D 03 E8 03")
    host.tell(aaaa("AB 00 00 00 00 00"), move[:-1] + bytes([move[-1] ^ 1]))
    host.wait(1.0)
    assert host.rate == 0.0
    host.tell(move)
    host.wait(1.0)
    host.tell(aaaa("80 00 00 00 00 00"))
    host.wait(1.0)
    assert host.rate == 0.0
