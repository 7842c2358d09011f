"""Profiles as files: every mistake one line that names file and key; checksums, fields and templates."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.errors import ConfigError, FramingError
from vcfbench_tables.messages import (
    CHECKSUMS,
    checksum,
    checksum_length,
    decode,
    encode,
    fill_bytes,
    fill_text,
    text_value,
    unwrapped,
)
from vcfbench_tables.profile import load_profile, parse_profile

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench_tables.messages import Order, Wrap

LEAST = """
title = "a table"
evidence = "none"
units = { rate_quantum = 0.001, rate_max = 100 }
[commands]
start = [{ send = "V{rate:.3f}" }]
stop = [{ send = "S" }]
read_all = [{ send = "R", expect = "both" }]
[replies]
both = { pattern = "(?P<p>.*),(?P<v>.*)" }
[fields]
position = { from = "read_all", group = "p" }
rate = { from = "read_all", group = "v" }
"""


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_profile(text, "lab.toml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_least_profile() -> None:
    profile = parse_profile(LEAST, "lab.toml")
    assert (profile.link.baud, profile.binary, profile.twin) == (9600, False, None)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_max = 100", "rate_max = 0", "lab.toml: units.rate_max: expected a number at least 1e-12 and at most 1"),
        ("rate_max = 100", "rate_max = 'x'", "lab.toml: units.rate_max: expected a number at least"),
        (", rate_max = 100", "", "lab.toml: units.rate_max: expected a number at least"),
        ('title = "a table"', 'tittle = "a"', "lab.toml: tittle: expected a known key ('title'?), got an unknown key"),
        ('send = "S"', 'send = "S\u00e9"', "commands.stop[0].send: expected a template ('ascii' codec can't encode"),
        ("[fields]", "[link]\nrx_end = '\u00e9'\n[fields]", "link.rx_end: expected ASCII characters alone, got"),
        ('send = "S"', 'sned = "S"', "commands.stop[0].sned: expected a known key ('send'?), got an unknown key"),
        (
            'send = "S"',
            'send = "S", repeat = 0',
            "lab.toml: commands.stop[0].repeat: expected a whole number at least 1 and at most 10, got 0",
        ),
        (
            'from = "read_all", group = "p"',
            'from = "read", group = "p"',
            "fields.position.from: expected one of read_all",
        ),
        (', group = "p"', "", "fields.position.group: expected a named group of the reply's pattern"),
        ('group = "p"', 'group = "q"', "fields.position.group: expected a named group of the reply's pattern"),
        ('group = "v"', 'group = "p"', "fields.rate: expected another number than the position, got 'read_all, p'"),
        ("{rate:.3f}", "{speed}", "commands.start[0].send: expected a template (unknown name 'speed'), got"),
        ("{rate:.3f}", "{rate!r}", "commands.start[0].send: expected a template (conversion !r"),
        ("{rate:.3f}", "{rate.real}", "commands.start[0].send: expected a template (unknown name 'rate.real'"),
        ("{rate:.3f}", "{rate", "commands.start[0].send: expected a template"),
        ('expect = "both"', 'expect = "all"', "commands.read_all[0].expect: expected one of [replies], got 'all'"),
        ('send = "S"', 'send = "S", until = "rest"', "commands.stop[0].until: expected one of [status], got 'rest'"),
        ('"V{rate:.3f}"', '"V{rate:.3f}", retry = 1', "commands.start[0].retry: expected 0: only questions are asked"),
        ('"V{rate:.3f}"', '"V{rate:.3f}", repeat = 2', "commands.start[0].repeat: expected 1: only stopping"),
        ("(?P<p>.*)", "(?P<p>.*", "replies.both.pattern: expected a regular expression"),
        ("stop =", "halt =", "commands.halt: expected one of identify"),
        (
            "read_all =",
            "status =",
            "commands.identify: expected a question that the table answers (its status will do)",
        ),
        ('stop = [{ send = "S" }]', "stop = []", "commands.stop: expected at least one step, got nothing"),
        ("[fields]", "[frame]\nkind = 'fixed'\n[fields]", "frame.header: expected hexadecimal bytes"),
        ("[fields]", "[frame]\nchecksum = 'sum8'\n[fields]", "frame.checksum: expected for lines one of lrc_hex"),
        ("[fields]", "[safety]\nstop = ['halt']\n[fields]", "safety.stop: expected names of [commands], got 'halt'"),
        (
            'send = "S"',
            'send = "V{rate:.3f}"',
            "safety.stop: expected commands that need no rate, acceleration or position ('rate' has no value",
        ),
        ('{ send = "S" }', '{ expect = "both" }', "safety.stop: expected commands that send something, got ['stop']"),
        (
            "[fields]",
            "[status]\nfault = {from='read_all', item=0}\n[fields]",
            "fault: expected one of bit, mask",
        ),
        (
            "[fields]",
            "[status]\nfault = {from='read_all', item=0, mask=6, value=5}\n[fields]",
            "status.fault.value: expected bits of mask, 0x6, got '0x5'",
        ),
        (
            "[fields]",
            "[status]\nfault = {from='read_all', item=0, bit=1, value=1}\n[fields]",
            "status.fault.value: expected bits of mask, 0x0, got '0x1'",
        ),
        ("[fields]", "[requires]\nstart = {flag='idle'}\n[fields]", "requires.start.flag: expected one of [status]"),
        ("[fields]", "[fields", "lab.toml: expected TOML: "),
        ("rate_max = 100", "rate_max = inf", "lab.toml: units.rate_max: expected a finite number, got inf"),
        ("rate_quantum = 0.001", "rate_quantum = 1e-300", "lab.toml: units.rate_quantum: expected a number at least"),
        ("rate_quantum = 0.001", "rate_quantum = 101", "units.rate_quantum: expected at most rate_max, 100, got 101"),
        (
            "{rate:.3f}",
            "{rate:2000000000.3f}",
            "commands.start[0].send: expected a template ('2000000000.3f' is no form",
        ),
        ("{rate:.3f}", "{rate:.300f}", "commands.start[0].send: expected a template ('.300f' is no form"),
        ("{rate:.3f}", "{rate:{axis}}", "commands.start[0].send: expected a template ('{axis}' is no form"),
        ("(?P<p>.*)", "(?P<p>[[a])", "replies.both.pattern: expected a regular expression (Possible nested set"),
        ("(?P<p>.*)", "(?P<p>.{4294967296})", "replies.both.pattern: expected a regular expression"),
        ("(?P<p>.*)", "(?P<p>" + "(" * 3000 + ")" * 3000 + ")", "replies.both.pattern: expected a regular expression"),
    ],
)
def test_every_mistake_is_one_line_that_names_its_key(old: str, new: str, words: str) -> None:
    assert old in LEAST
    assert words in refusal(LEAST.replace(old, new, 1))


_STATE = """
[status]
on = { from = "status", group = "p", in = [1] }
still = { from = "read_all", group = "v", in = [0] }
"""


@pytest.mark.parametrize(
    ("commands", "rest", "words"),
    [
        (
            'status = [{ send = "T", expect = "both", until = "on" }]',
            "",
            "commands.status[0].until: CIRCLE status itself (status -> status), got 'on'",
        ),
        (
            'status = [{ send = "T", expect = "both" }]',
            '[requires.status]\nflag = "on"',
            "requires.status.flag: CIRCLE status itself (status -> status), got 'on'",
        ),
        (
            'status = [{ send = "T", expect = "both", until = "still" }]',
            '[requires.read_all]\nflag = "on"',
            "commands.status[0].until: CIRCLE status itself (read_all -> status -> read_all), got 'still'",
        ),
        (
            'status = [{ send = "T", expect = "both" }]\nenable = [{ send = "E" }]',
            '[requires.enable]\nflag = "on"\nby = "enable"',
            "requires.enable.by: CIRCLE enable itself (enable -> enable), got 'enable'",
        ),
        (
            'status = [{ send = "T", expect = "both" }]\nenable = [{ send = "E" }]\npower_on = [{ send = "P" }]',
            '[requires.enable]\nflag = "on"\nby = "power_on"\n[requires.power_on]\nflag = "on"\nby = "enable"',
            "requires.power_on.by: CIRCLE power_on itself (enable -> power_on -> enable), got 'enable'",
        ),
    ],
)
def test_a_command_that_needs_itself_is_refused(commands: str, rest: str, words: str) -> None:
    text = LEAST.replace("[replies]", f"{commands}\n[replies]") + _STATE + rest
    assert refusal(text) == f"lab.toml: {words.replace('CIRCLE', 'expected what does not need')}"


def test_commands_that_need_others_are_taken() -> None:
    commands = 'status = [{ send = "T", expect = "both" }]\nenable = [{ send = "E", until = "on" }]'
    rest = '[requires.start]\nflag = "on"\nby = "enable"\n[requires.stop]\nflag = "on"'
    parse_profile(LEAST.replace("[replies]", f"{commands}\n[replies]") + _STATE + rest, "lab.toml")


def test_a_profile_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: expected a profile of a rate table, there is no such file"):
        load_profile(str(tmp_path / "none.toml"))


@pytest.mark.parametrize(
    ("name", "check"),
    [
        ("sum8", "DD"),
        ("neg_sum8", "23"),
        ("xor8", "31"),
        ("crc8", "F4"),
        ("crc16_modbus", "37 4B"),
        ("crc16_ccitt", "B1 29"),
        ("crc32", "26 39 F4 CB"),
    ],
)
def test_checksums_of_the_digits_one_to_nine(name: str, check: str) -> None:
    assert checksum(name, b"123456789") == bytes.fromhex(check)


@pytest.mark.parametrize(("name", "check"), [("sum_hex", b"DD"), ("lrc_hex", b"23"), ("nmea_xor_hex", b"31")])
def test_checksums_in_hexadecimal_digits(name: str, check: bytes) -> None:
    assert checksum(name, b"123456789") == check


@given(st.sampled_from(CHECKSUMS), st.binary(max_size=20), st.integers(0, 19), st.integers(1, 255))
def test_every_checksum_sees_a_changed_byte(name: str, data: bytes, at: int, change: int) -> None:
    if at < len(data):
        damaged = data[:at] + bytes([data[at] ^ change]) + data[at + 1 :]
        assert len(checksum(name, data)) == checksum_length(name)
        assert checksum(name, data) != checksum(name, damaged)


@given(st.sampled_from([("i24sm", 2**23 - 1), ("i32", 2**31 - 1), ("i16", 2**15 - 1), ("i8", 127)]), st.data())
def test_signed_numbers_come_back(kind: tuple[str, int], data: st.DataObject) -> None:
    name, largest = kind
    value = data.draw(st.integers(-largest, largest))
    order: Order = data.draw(st.sampled_from(["little", "big"]))
    assert decode(name, b"\xdd" + encode(name, value, order), 1, order) == value
    with pytest.raises(ValueError, match="does not fit"):
        encode(name, 2 * largest + 2, order)


def test_sign_and_magnitude_is_no_complement() -> None:
    assert encode("i24sm", -1, "little") == b"\x01\x00\x80"
    assert encode("f32", 1.5, "big") == struct.pack(">f", 1.5)


@pytest.mark.parametrize(
    ("wrap", "read_deg", "meant"),
    [
        ("continuous", 725.0, 725.0),
        ("0..360", 725.0, 5.0),
        ("+-180", 270.0, -90.0),
        ("over 360 minus 720", 630.0, -90.0),
        ("over 360 minus 720", 360.0, 360.0),
    ],
)
def test_wrapped_angles(wrap: Wrap, read_deg: float, meant: float) -> None:
    assert unwrapped(read_deg, wrap) == meant


def test_what_is_no_number_is_an_error_and_not_zero() -> None:
    for kind, text in (("decimal", ""), ("decimal", "1.2.3"), ("hex", "0xg"), ("decimal", "nan")):
        with pytest.raises(FramingError):
            text_value(kind, text)  # type: ignore[arg-type]
    with pytest.raises(FramingError, match="no i32 at byte 3"):
        decode("i32", b"\x00" * 5, 3, "little")


def test_templates() -> None:
    assert (
        fill_text("3{dir}{acc:04d}{abs_rate:09.4f}", {"dir": "1", "acc": 10.0, "abs_rate": 20.0}) == "3100100020.0000"
    )
    assert fill_text("{rate:.2f}", {"rate": -0.0}) == "0.00"
    assert fill_bytes("01 0C {rate:i32*1e5}", {"rate": -10.0}, "little") == bytes.fromhex("01 0C C0 BD F0 FF")
    for template in ("0", "{rate:u64}", "{rate}", "{nothing:u8}"):
        with pytest.raises(ValueError, match=r"neither|unknown"):
            fill_bytes(template, {"rate": 1.0}, "little")
    with pytest.raises(ValueError, match="nan cannot be sent"):
        fill_text("{rate}", {"rate": float("nan")})


@pytest.mark.parametrize(
    ("template", "words"),
    [
        ("{rate:i32*1e400}", "a factor is from 1e-12 to 1e12"),
        ("{rate:i32*0}", "a factor is from 1e-12 to 1e12"),
        ("{rate:i32*..}", "could not convert"),
        ("{rate:f32}", "does not fit into f32"),
        ("{rate:i32}", "does not fit into i32"),
    ],
)
def test_bytes_that_cannot_be_are_refused(template: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fill_bytes(template, {"rate": 1e300}, "little")
