"""What a profile can say beyond the four that are shipped: echo, prompt, refusals, frames of every kind, states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError, InterlockError, LimitError, OutOfSync
from vcfbench.testing import ScriptedWire
from vcfbench_tables.configurable import ConfigurableDialect
from vcfbench_tables.messages import Frame, frame_bytes, frame_text, take_frame, take_text
from vcfbench_tables.profile import parse_profile

if TYPE_CHECKING:
    from vcfbench.testing import Exchange

LEAST = """
title = "a table"
evidence = "none"
units = { rate = "rpm", rate_quantum = 0.001, rate_max = 100, acceleration_quantum = 1 }
LINK
[commands]
set_accel = [{ send = "A{acc:d}" ACK }]
start = [{ send = "V{rate:.3f}" ACK }]
stop = [{ send = "S" ACK }]
read_all = [{ send = "R", expect = "both" }]
[replies]
both = { pattern = "(?P<p>[-.0-9]+),(?P<v>[-.0-9]+)", split = "," }
ok = { pattern = "OK" }
beep = { pattern = "BEEP", late = true }
[fields]
position = { from = "read_all", group = "p" }
rate = { from = "read_all", group = "v", scale = 6.0 }
"""


def table(link: str = "", ack: str = ', expect = "ok"', more: str = "") -> ConfigurableDialect:
    return ConfigurableDialect(parse_profile(LEAST.replace("LINK", link).replace(" ACK", ack) + more, "lab.toml"))


def line(*said: tuple[str, str | None]) -> TableLine:
    clock = VirtualClock()
    exchanges: list[Exchange] = [
        (f"{sent}\r\n".encode(), None if answer is None else f"{answer}\r\n".encode()) for sent, answer in said
    ]
    wire = ScriptedWire(exchanges, clock=clock, interface="serial")
    return TableLine(wire, name="rate_table", resource="script://", clock=clock, timeout_s=1.0)


def soon(on: TableLine) -> Deadline:
    return Deadline.after(on.clock, 1.0)


def test_a_rate_by_angles_may_take_longer_than_one_answer() -> None:
    slope = 'rate = { differentiate = "position", span_s = 2.0 }'
    text = (
        LEAST.replace("LINK", "")
        .replace(" ACK", "")
        .replace('rate = { from = "read_all", group = "v", scale = 6.0 }', slope)
    )
    on = line(("R", "1.5,0.0"), ("R", "7.5,0.0"))
    assert ConfigurableDialect(parse_profile(text, "lab.toml")).rate_deg_s(on, soon(on)) == pytest.approx(3.0)


def test_units_are_the_table_s() -> None:
    on = line(("A20", "OK"), ("V2.000", "OK"), ("R", "1.5,2.0"))
    dialect = table()
    dialect.demand_rate(on, 12.0, 120.0, soon(on))
    assert dialect.rate_deg_s(on, soon(on)) == 12.0
    assert dialect.rate_quantum_deg_s == pytest.approx(0.006)


def test_rate_zero_is_stop_even_with_a_refused_acceleration() -> None:
    on = line(("A20", "NO"), ("S", "OK"))
    with pytest.raises(InstrumentError, match=r"refused \(NO\)"):
        table(more='[refusals]\npattern = "NO"\n').demand_rate(on, 0.0, 120.0, soon(on))


def test_a_table_that_does_not_stop_is_not_switched_on() -> None:
    enable = LEAST.replace("stop =", 'enable = [{ send = "E" ACK }]\nstop =').replace("LINK", "")
    dialect = ConfigurableDialect(parse_profile(enable.replace(" ACK", ', expect = "ok"'), "lab.toml"))
    on = line(("S", "NO"))
    with pytest.raises(DeadlineExceeded, match="no answer but 'NO', command 'S'"):
        dialect.close_servo(on, soon(on))
    on = line(("S", "OK"), ("R", "90.0,15.0"))
    with pytest.raises(InterlockError, match="told to stop, it reads 90 deg/s; the servo was not closed"):
        dialect.close_servo(on, soon(on))
    on = line(("S", "OK"), ("R", "90.0,0.0"), ("E", "OK"))
    dialect.close_servo(on, soon(on))


def test_what_comes_late_is_not_the_answer() -> None:
    on = line(("R", "BEEP\r\n1.5,2.0"), ("R", "OK\r\n1.5,2.0"))
    assert table().angle_deg(on, soon(on)) == 1.5
    with pytest.raises(FramingError, match="got 'OK', which is no answer"):
        table().angle_deg(on, soon(on))


BYTES = """
title = "a table"
evidence = "none"
frame = { kind = "fixed", header = "AA", length = 4 }
units = { rate_quantum = 1, rate_max = 100 }
stream = { reply = "state" }
[commands]
start = [{ send = "02 {rate:u8}", no_reply = true }]
stop = [{ send = "03", no_reply = true }]
read_all = [{ send = "01", expect = "said" }]
[replies]
said = { bytes = [{ at = 1, is = 1 }] }
state = { bytes = [{ at = 1, is = 2 }] }
[fields]
position = { from = "read_all", at = 2, type = "u8" }
"""


def test_status_of_bytes_that_comes_unasked_is_not_the_answer() -> None:
    clock = VirtualClock()
    asked = b"\xaa\x01\0\0"
    said: list[Exchange] = [(asked, b"\xaa\x02\0\0\xaa\x01\x05\0"), (asked, b"\xaa\x03\0\0")]
    wire = ScriptedWire(said, clock=clock, interface="serial")
    on = TableLine(wire, name="rate_table", resource="script://", clock=clock, timeout_s=1.0)
    dialect = ConfigurableDialect(parse_profile(BYTES, "lab.toml"))
    assert dialect.angle_deg(on, soon(on)) == 5.0
    with pytest.raises(FramingError, match="got 'aa 03 00 00', which is no answer"):
        dialect.angle_deg(on, soon(on))


def test_stop_does_not_wait_for_resynchronisation() -> None:
    on = line(("S", "1.5,2.0\r\nOK"), ("R", "1.5,2.0"), ("R", "2.5,0.0"))
    on.dirty = True
    dialect = table()
    dialect.hold(on, soon(on))
    assert dialect.angle_deg(on, soon(on)) == 2.5


def test_table_may_answer_the_line_end_before_a_blind_stop() -> None:
    """It may call that a mistake, and so a message that broke off; a stop that it refuses is one all the same."""
    dialect = table(more='[refusals]\npattern = "NO.*"\n')
    on = line(("S", "NO 7\r\nOK"), ("R", "NO 7\r\n1.5,2.0"), ("R", "1.5,2.0"), ("S", "NO 8"), ("R", "NO 9"))
    on.dirty = True
    dialect.hold(on, soon(on))
    assert dialect.angle_deg(on, soon(on)) == 1.5
    with pytest.raises(InstrumentError, match=r"refused \(NO 8\)"):
        dialect.hold(on, soon(on))
    on.dirty = True
    with pytest.raises(OutOfSync, match=r"\(no answer but 'NO 9'\), the connection .* --trace FILE"):
        dialect.angle_deg(on, soon(on))


def test_an_echo_and_a_prompt() -> None:
    link = '[link]\necho = "always"\nprompt = ">"'
    on = line(("R", "R\r\n1.5,2.0\r\n>"), ("V1.000", "V1.000\r\n>"), ("V1.000", "V1.00\r\n>"))
    dialect = table(link, ack="")
    assert dialect.angle_deg(on, soon(on)) == 1.5
    dialect.perform(on, "start", soon(on), {"rate": 1.0})
    with pytest.raises(FramingError, match="expected the echo"):
        dialect.perform(on, "start", soon(on), {"rate": 1.0})


def test_an_echo_that_may_come() -> None:
    on = line(("R", "R\r\n1.5,2.0"), ("R", "1.5,2.0"))
    dialect = table('[link]\necho = "optional"')
    assert dialect.angle_deg(on, soon(on)) == dialect.angle_deg(on, soon(on)) == 1.5


def test_a_question_after_each_command_tells_refusals() -> None:
    more = '[refusals]\nquery = "TE?"\ngood = "0"\n'
    on = line(("S", None), ("TE?", "0"), ("S", None), ("TE?", "7"), ("TE?", "0"))
    dialect = table(ack="", more=more)
    dialect.hold(on, soon(on))
    with pytest.raises(InstrumentError, match="refused with 7, command 'S'"):
        dialect.hold(on, soon(on))


def test_a_refusal_says_which_line_was_sent() -> None:
    more = '[refusals]\nquery = "TE?"\ngood = "0"\n'
    on = line(("A20", None), ("TE?", "0"), ("V2.000", None), ("TE?", "6"), ("TE?", "0"))
    with pytest.raises(InstrumentError, match=r"refused with 6, command 'V2\.000'"):
        table(ack="", more=more).demand_rate(on, 12.0, 120.0, soon(on))


def test_flags_of_every_kind() -> None:
    flags = """[status]
high = { from = "read_all", group = "v", above = 3.0 }
low = { from = "read_all", item = 0, below = 2.0 }
one = { from = "read_all", group = "v", type = "hex", bit = 4, negate = true }
among = { from = "read_all", group = "p", in = [1.5, 2.5], type = "decimal" }
"""
    said = ("R", "1.5,12")
    on, dialect = line(*[said] * 4), table(more=flags)
    assert [dialect.flag(on, name, soon(on)) for name in ("high", "low", "one", "among")] == [True, True, False, True]


def test_an_axis_that_is_counted_from_0() -> None:
    units = "units = { rate_quantum = 0.001, rate_max = 100, axes = [1, 2, 3], first_axis = FIRST }"
    text = LEAST.replace("units = {", f"{units}#").replace("LINK", "").replace(" ACK", "")
    text = text.replace("V{rate", "A{axis}V{rate").replace('"S"', '"A{axis}S{on_2}"')
    for first, sent in ((0, "1"), (1, "2")):
        profile = parse_profile(text.replace("FIRST", str(first)), "lab.toml")
        dialect = ConfigurableDialect(profile, axis=2)
        assert dialect.message("A{axis}V{rate:.3f}", {"rate": 12.0}) == f"A{sent}V12.000\r\n".encode()
        assert dialect.stop_words(None)[-1].endswith(f"A{sent}S1\r\n".encode())
        on = line((f"A{sent}V12.000", None), ("R", "1.5,2.0"))
        dialect.demand_rate(on, 12.0, float("inf"), soon(on))


@pytest.mark.parametrize(
    ("flag", "true"),
    [
        ("mask = 0x30, value = 0x10", {0x10, 0x1F, 0x50}),
        ("mask = 0x30, value = 0x00", {0x00, 0x0F, 0x40}),
        ("mask = 0x30", {0x30, 0x3F, 0xFF}),
        ("mask = 0x30, negate = true", {0x00, 0x0F, 0x10, 0x1F, 0x20, 0x40, 0x50}),
        ("mask = 0x8000, value = 0x8000", set[int]()),
    ],
)
def test_a_flag_of_several_bits(flag: str, true: set[int]) -> None:
    words = (0x00, 0x0F, 0x10, 0x1F, 0x20, 0x30, 0x3F, 0x40, 0x50, 0xFF)
    more = f"[status]\nsteady = {{ from = 'read_all', group = 'v', type = 'hex', {flag} }}\n"
    dialect = ConfigurableDialect(
        parse_profile(LEAST.replace("LINK", "").replace(" ACK", "").replace("[-.0-9]+)", "[-.0-9A-F]+)") + more, "lab")
    )
    on = line(*(("R", f"1,{word:X}") for word in words))
    assert {word for word in words if dialect.flag(on, "steady", soon(on))} == true


def test_a_state_that_is_needed() -> None:
    more = '[status]\nidle = { from = "read_all", group = "v", in = [0], type = "decimal" }\n'
    on, dialect = line(("R", "0,3")), table(more=more + '[requires]\nstart = { flag = "idle" }\n')
    with pytest.raises(InterlockError, match="start needs the state 'idle', nothing was sent"):
        dialect.demand_rate(on, 1.0, 60.0, soon(on))
    on = line(("R", "0,3"), ("S", "OK"), ("R", "0,1"), ("R", "0,0"), ("A10", "OK"), ("R", "0,0"), ("V1.000", "OK"))
    dialect = table(more=more + '[requires]\nstart = { flag = "idle", by = "stop" }\n')
    dialect.demand_rate(on, 6.0, 60.0, soon(on))


def test_silence_may_be_answered_by_stopping() -> None:
    on = line(("A10", "OK"), ("V1.000", "OK"), ("R", None), ("S", "OK"))
    dialect = table(more='[safety]\non_silence = "stop"\n')
    dialect.demand_rate(on, 6.0, 60.0, soon(on))
    with pytest.raises(DeadlineExceeded):
        dialect.angle_deg(on, soon(on))


def test_limits_of_the_profile() -> None:
    on, dialect = line(), table(more="[safety]\nmax_rate_deg_s = 50.0\n")
    with pytest.raises(LimitError, match="beyond the 50 deg/s of its profile"):
        dialect.demand_rate(on, -50.1, 60.0, soon(on))


def test_no_word_for_clearing_a_fault() -> None:
    on = line()
    with pytest.raises(InstrumentError, match="cannot clear a fault"):
        table().clear_fault(on, soon(on))


FRAMES = [
    Frame(kind="fixed", header="DD", length=12, checksum="crc16_modbus"),
    Frame(kind="fixed", header="AA AA", length=16, checksum="sum8"),
    Frame(kind="length_field", header="55", length_at=1, length_extra=0, checksum="xor8"),
    Frame(kind="length_field", header="55 AA", length_at=2, length_type="u16", order="big", checksum="crc32"),
    Frame(kind="delimited", header="55 AA", trailer="C3 0D", checksum="neg_sum8"),
]


def received(data: bytes) -> TableLine:
    clock = VirtualClock()
    wire = ScriptedWire([(b"x", data)], clock=clock, interface="serial")
    on = TableLine(wire, name="t", resource="script://", clock=clock, timeout_s=1.0)
    on.send(b"x", soon(on))
    return on


@given(st.sampled_from(FRAMES), st.lists(st.integers(0, 0x50), min_size=4, max_size=4), st.binary(max_size=12))
def test_frames_are_found_among_noise(frame: Frame, payload: list[int], noise: bytes) -> None:
    """Noise that begins a frame of its own may swallow bytes, but the second of two frames is always found."""
    lengths = b"\0" * (0 if frame.length_at is None else 1 if frame.length_type == "u8" else 2)
    sent = frame_bytes(frame, lengths + bytes(payload))
    noise = noise.replace(b"\x55", b"").replace(b"\xaa", b"").replace(b"\xdd", b"")
    on = received(noise + sent + noise + sent)
    assert take_frame(frame, on, soon(on)) == sent
    assert take_frame(frame, on, soon(on)) == sent


def test_a_header_in_a_payload_costs_one_byte_only() -> None:
    frame = Frame(kind="fixed", header="DD", length=6, checksum="neg_sum8")
    sent = frame_bytes(frame, bytes.fromhex("DD DD 01"))
    on = received(b"\xdd\xdd" + sent)
    assert take_frame(frame, on, soon(on)) == sent


def test_a_message_that_is_too_long_for_its_frame() -> None:
    with pytest.raises(ValueError, match="do not fit into a frame of 6"):
        frame_bytes(Frame(kind="fixed", header="DD", length=6, checksum="sum8"), bytes(5))


@given(st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=20))
def test_lines_with_checksums_come_back(text: str) -> None:
    frame = Frame(start="$", checksum="nmea_xor_hex", checksum_mark="*")
    on = received(frame_text(frame, text, "\r\n"))
    assert take_text(frame, "\r\n", on, soon(on)) == text


@pytest.mark.parametrize("damaged", [b"$AS*00\r\n", b"AS*94\r\n", b"$AS94\r\n", b"$\r\n", b"$AS*9\r\n"])
def test_damaged_lines_are_refused(damaged: bytes) -> None:
    on = received(damaged)
    with pytest.raises(FramingError):
        take_text(Frame(start="$", checksum="sum_hex", checksum_mark="*"), "\r\n", on, soon(on))


def test_lines_with_an_end_of_their_own() -> None:
    on = received(b"1.5;2.5;")
    assert [take_text(Frame(), ";", on, soon(on)) for _ in range(2)] == ["1.5", "2.5"]
