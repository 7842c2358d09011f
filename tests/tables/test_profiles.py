"""The shipped profiles send and read the frames that are known of the four tables, to the byte."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tests.drivers.rate_table import SHIPPED
from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import ConfigError, LimitError
from vcfbench.testing import ScriptedWire
from vcfbench_tables.configurable import ConfigurableDialect
from vcfbench_tables.profile import load_profile
from vcfbench_tables.profile_replies import ProfileReplies

if TYPE_CHECKING:
    from collections.abc import Mapping

    from vcfbench.testing import Exchange
    from vcfbench_tables.messages import Value


def dialect(name: str, axis: int = 1) -> ConfigurableDialect:
    return ConfigurableDialect(load_profile(name), axis)


def line(*exchanges: Exchange) -> TableLine:
    clock = VirtualClock()
    wire = ScriptedWire(exchanges, clock=clock, interface="serial")
    return TableLine(wire, name="rate_table", resource="script://", clock=clock, timeout_s=1.0)


def soon(on: TableLine) -> Deadline:
    return Deadline.after(on.clock, 5.0)


def messages(of: ConfigurableDialect, command: str, values: Mapping[str, Value] | None = None) -> list[bytes]:
    steps = of.profile.commands[command]
    return [of.message(step.send, values) for step in steps if step.send is not None]


def motion(of: ConfigurableDialect, rate_deg_s: float, acceleration_deg_s2: float) -> dict[str, Value]:
    return of.motion(line(), rate_deg_s, acceleration_deg_s2)


def dd(text: str) -> bytes:
    """Write out a frame that is shortened by ``..`` for zeros."""
    begin, _, end = text.partition("..")
    head, tail = bytes.fromhex(begin), bytes.fromhex(end)
    return head + bytes(16 - len(head) - len(tail)) + tail


@pytest.mark.parametrize(
    ("command", "frame"),
    [
        ("remote", "DD 00 55 .. CE"),
        ("power_on", "DD 01 03 .. 1F"),
        ("stop", "DD 01 07 .. 1B"),
        ("estop", "DD 03 08 .. 18"),
        ("home", "DD 01 09 .. 19"),
        ("start", "DD 01 10 02 .. 10"),
    ],
)
def test_dd16_frames(command: str, frame: str) -> None:
    assert messages(dialect("dd16"), command)[-1] == dd(frame)


def test_dd16_servo_closes_after_a_stop() -> None:
    assert messages(dialect("dd16"), "enable") == [dd("DD 01 07 .. 1B"), dd("DD 01 05 .. 1D")]


@pytest.mark.parametrize(
    ("rate", "frame"),
    [
        (10.0, "DD 01 0C 40 42 0F 00 80 84 1E 00 00 00 00 00 63"),
        (-10.0, "DD 01 0C C0 BD F0 FF 80 84 1E 00 00 00 00 00 88"),
    ],
)
def test_dd16_loads_a_rate(rate: float, frame: str) -> None:
    table = dialect("dd16")
    loaded = messages(table, "load_rate", motion(table, rate, 20.0))
    assert [each[:-1] for each in loaded] == [bytes.fromhex(frame)[:-1]]
    assert all(sum(each) % 256 == 0 for each in loaded)


def test_dd16_loads_a_position() -> None:
    table = dialect("dd16")
    values = {"position": 90.0, "abs_rate": 20.0, "acc": 10.0}
    assert messages(table, "goto", values)[0] == bytes.fromhex("DD 01 0B 40 54 89 00 80 84 1E 00 40 42 0F 00 47")


def test_dd16_second_axis_has_run_code_in_fifth_byte() -> None:
    assert messages(dialect("dd16", 2), "start") == [bytes.fromhex("DD 02 10 00 00 00 00 02 00 00 00 00 00 00 00 0F")]


def test_dd16_reads_position_and_rate() -> None:
    poll = dd("DD 01 13 .. 0F")
    reply = bytes.fromhex("DD 01 13 59 DA 44 00 42 42 0F 00 00 00 00 00 05")
    on = line((poll, reply), (poll, b"\xdd\x01" + reply))
    assert dialect("dd16").number(on, "position", soon(on)) == pytest.approx(45.12345, abs=1e-9)
    assert dialect("dd16").number(on, "rate", soon(on)) == pytest.approx(10.00002, abs=1e-9)


@pytest.mark.parametrize(
    ("command", "message"),
    [("remote", "$MNREM,1*DC"), ("start", "$MNRUN,1*ED"), ("stop", "$MNSTP,1*EF"), ("load_rate", "$MNVEL,0,0,10*C7")],
)
def test_mn_messages(command: str, message: str) -> None:
    table = dialect("mn_as", axis=3)
    assert messages(table, command, motion(table, 10.0, 20.0)) == [message.encode() + b"\r\n"]


def test_mn_servo() -> None:
    assert b"$MNENB,1*CD\r\n" in messages(dialect("mn_as"), "enable")


@pytest.mark.parametrize(
    ("command", "sent", "reply"),
    [
        ("remote", "$MNREM,1*DC", "$ASREM,OK*3E"),
        ("start", "$MNRUN,1*ED", "$ASRUN,OK*4F"),
    ],
)
def test_mn_replies(command: str, sent: str, reply: str) -> None:
    on = line((f"{sent}\r\n".encode(), f"{reply}\r\n".encode()))
    assert dialect("mn_as").perform(on, command, soon(on)) is not None


def test_mn_stop_is_sent_twice() -> None:
    stop = (b"$MNSTP,1*EF\r\n", b"$ASSTP,OK*51\r\n")
    on = line(stop, stop)
    dialect("mn_as").hold(on, soon(on))


def test_ruya_rate_command() -> None:
    table = dialect("ruya")  # its sign is turned, so that bench rates are counter-clockwise positive
    assert messages(table, "start", motion(table, 20.0, 10.0)) == [b"$13100100020.0000\r\n"]
    assert messages(table, "start", motion(table, -20.0, 10.9)) == [b"$13000100020.0000\r\n"]


@pytest.mark.parametrize(("command", "message"), [("disable", "$1mo=0"), ("stop", "$1st"), ("home", "$11")])
def test_ruya_messages(command: str, message: str) -> None:
    assert messages(dialect("ruya"), command) == [message.encode() + b"\r\n"]


def test_ruya_status_is_read() -> None:
    table, on = dialect("ruya"), line((b"x", b"$10542630.0000\r\n"))
    on.send(b"x", soon(on))
    received = ProfileReplies(table.profile, table.axis).await_reply(on, "status", soon(on))
    assert dict(received.groups) == {"alarm": "0", "state": "5", "seq": "42", "angle": "630.0000"}
    assert ProfileReplies(table.profile, table.axis).number(table.profile.fields["position"], received) == -90.0


def test_aaaa_frames_are_21_bytes_with_a_byte_sum() -> None:
    table = dialect("aaaa")
    (frame,) = messages(table, "start", motion(table, -12.34, 100.0))
    assert frame[:8] == bytes.fromhex("AA AA 81 FF FF FF D2 04")
    assert len(frame) == 21
    assert frame[-1] == sum(frame[:-1]) % 256
    assert [frame[8], frame[14]] == [0x80, 0x80]
    assert messages(table, "enable")[0][2] == 0xAB
    assert messages(table, "disable")[0][2] == 0xAC


def test_aaaa_status_is_read() -> None:
    body = bytes.fromhex("AA AA 40 E2 81 03") + bytes(16)
    frame = body + bytes([sum(body) % 256])
    table, on = dialect("aaaa"), line((b"x", b"\xaa" + frame))
    on.send(b"x", soon(on))
    replies = ProfileReplies(table.profile, table.axis)
    received = replies.await_reply(on, "status", soon(on))
    assert replies.number(table.profile.fields["position"], received) == pytest.approx(-12.3456)
    assert replies.holds(table.profile.status["enabled"], received)


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize("rate", [math.nan, math.inf, -math.inf, 1e6])
def test_rates_that_no_table_can_take_are_not_sent(name: str, rate: float) -> None:
    on = line()
    with pytest.raises(LimitError, match="nothing was sent"):
        dialect(name).demand_rate(on, rate, 10.0, soon(on))


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize("acceleration", [math.nan, 0.0, -1.0])
def test_accelerations_that_no_table_can_take_are_not_sent(name: str, acceleration: float) -> None:
    on = line()
    with pytest.raises(LimitError, match="nothing was sent"):
        dialect(name).demand_rate(on, 1.0, acceleration, soon(on))


def test_a_rate_below_the_resolution_is_not_taken_for_zero() -> None:
    on = line()
    with pytest.raises(LimitError, match=r"below the least of its profile, 0\.01 deg/s"):
        dialect("aaaa").demand_rate(on, 0.001, 10.0, soon(on))


def test_the_realised_rate() -> None:
    assert dialect("aaaa").rate_quantum_deg_s == 0.01
    assert dialect("aaaa").realised_deg_s(1.0 / 3.0) == pytest.approx(0.33)


def test_an_axis_that_the_table_does_not_have() -> None:
    with pytest.raises(ConfigError, match=r"rate_table\.axis: expected one of 1, 2, 3 \(\$MN/\$AS table\), got 4"):
        dialect("mn_as", 4)
