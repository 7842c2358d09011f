"""Frames of streams: what an encoder of the test's own writes is read, whatever stands between; else nothing is."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vcfbench.drivers.streams.checksums import CHECKSUMS
from vcfbench.drivers.streams.decoder import Decoder
from vcfbench.drivers.streams.description import Stream
from vcfbench.typed import typed

CHECK_VALUES = {  # catalogue of parametrised CRC algorithms: of "123456789"
    "crc16-ccitt-false": 0x29B1,
    "crc16-xmodem": 0x31C3,
    "crc16-kermit": 0x2189,
    "crc16-modbus": 0x4B37,
    "crc32": 0xCBF43926,
    "crc32-mpeg2": 0x0376E6E7,
}
FORMS = {"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d", "int8": "b"}
SIZES = {"none": 0, "sum8": 1, "sum16": 2, "xor8": 1, "crc32": 4, "crc32-mpeg2": 4}


def crc_by_bits(name: str, data: bytes) -> int:
    """Return a CRC by dividing bit by bit, from the numbers of the catalogue."""
    width, poly, found, turned, end = {
        "crc16-ccitt-false": (16, 0x1021, 0xFFFF, False, 0),
        "crc16-xmodem": (16, 0x1021, 0, False, 0),
        "crc16-kermit": (16, 0x1021, 0, True, 0),
        "crc16-modbus": (16, 0x8005, 0xFFFF, True, 0),
        "crc32": (32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF),
        "crc32-mpeg2": (32, 0x04C11DB7, 0xFFFFFFFF, False, 0),
    }[name]
    for byte in data:
        for place in range(8):
            bit = byte >> (place if turned else 7 - place) & 1
            top = found >> width - 1 & 1
            found = found << 1 & (1 << width) - 1
            found ^= poly if top ^ bit else 0
    return (int(f"{found:0{width}b}"[::-1], 2) if turned else found) ^ end


def checked(name: str, data: bytes) -> int:
    match name:
        case "none":
            return 0
        case "xor8":
            total = 0
            for byte in data:
                total ^= byte
            return total
        case "sum8" | "sum16":
            return sum(data) & (0xFF if name == "sum8" else 0xFFFF)
    return crc_by_bits(name, data)


@st.composite
def frames(draw: st.DrawFn) -> tuple[dict[str, Any], list[bytes], list[tuple[float, int]]]:
    """Return a description, frames by it, and the value and the number of each."""
    order, kind = draw(st.sampled_from(["big", "little"])), draw(st.sampled_from(sorted(FORMS)))
    name = draw(st.sampled_from(sorted(CHECKSUMS)))
    size, mark = SIZES.get(name, 2), "<" if order == "little" else ">"
    lead = draw(st.integers(0, 3))
    length = 2 + 2 + lead + struct.calcsize(FORMS[kind]) + size
    stated = {
        "resource": "x",
        "sample_rate_hz": 10.0,
        "header": "A5 5A",
        "length": length,
        "byte_order": order,
        "checksum": {"name": name},
        "value": {"at": 4 + lead, "type": kind, "scale": 0.5, "offset": 1.0},
        "counter": {"at": 2, "type": "uint16"},
        "resolution": 1.0,
    }
    whole = st.integers(-100, 100) if not kind.startswith("u") else st.integers(1, 200)
    raws = draw(st.lists(whole.map(float) if kind.startswith("f") else whole, min_size=3, max_size=6))
    made = []
    for number, raw in enumerate(raws):
        body = b"\xa5\x5a" + struct.pack(f"{mark}H", number) + bytes(lead) + struct.pack(f"{mark}{FORMS[kind]}", raw)
        made.append(body + checked(name, body).to_bytes(size, "big" if mark == ">" else "little") if size else body)
    return stated, made, [(0.5 * raw + 1.0, number) for number, raw in enumerate(raws)]


def decoder(stated: dict[str, Any]) -> Decoder:
    stream = typed(stated, Stream)
    assert list(stream.contradictions()) == []
    return Decoder(stream)


def seen(of: Decoder, data: bytes, pieces: int) -> list[tuple[float, int | None]]:
    found = [each for at in range(0, len(data), pieces) for each in of.feed(data[at : at + pieces])]
    return [(each.value, each.counter) for each in found]


@pytest.mark.parametrize("name", CHECK_VALUES)
def test_a_checksum_is_that_of_the_catalogue(name: str) -> None:
    assert CHECKSUMS[name].of(b"123456789") == CHECK_VALUES[name] == crc_by_bits(name, b"123456789")


@settings(deadline=None, max_examples=60)
@given(frames(), st.integers(1, 50))
def test_frames_are_read_in_whatever_pieces_they_come(drawn: Any, pieces: int) -> None:
    stated, made, expected = drawn
    found = seen(decoder(stated), b"".join(made) + b"\xa5\x5a", pieces)
    assert found == expected


@pytest.mark.exhaustive
@settings(deadline=None, max_examples=60)
@given(frames(), st.lists(st.binary(max_size=9), min_size=6, max_size=6), st.integers(1, 50))
def test_garbage_between_frames_costs_frames_and_makes_none(drawn: Any, garbage: list[bytes], pieces: int) -> None:
    stated, made, expected = drawn
    if stated["checksum"]["name"] in {"none", "sum8", "sum16", "xor8"}:  # one of 256 spoilt frames passes these
        return
    found = seen(decoder(stated), b"".join(g + f for g, f in zip(garbage, made, strict=False)) + bytes(50), pieces)
    assert found == expected


@settings(deadline=None, max_examples=60)
@given(frames(), st.integers(0, 5), st.integers(0, 10_000))
def test_a_flipped_bit_is_no_number(drawn: Any, which: int, bit: int) -> None:
    stated, made, expected = drawn
    if stated["checksum"]["name"] == "none":
        return
    which %= len(made)
    spoilt = bytearray(made[which])
    bit %= 8 * len(spoilt)
    spoilt[bit // 8] ^= 1 << bit % 8
    found = seen(decoder(stated), b"".join([*made[:which], bytes(spoilt), *made[which + 1 :]]) + b"\xa5\x5a", 7)
    assert set(found) <= {each for number, each in enumerate(expected) if number != which}


def test_two_separate_words_make_one_signed_number() -> None:
    stated = {
        "resource": "x",
        "sample_rate_hz": 10.0,
        "header": "A5 5A",
        "length": 8,
        "value": {"at": 6, "low_at": 2, "type": "int32"},
    }
    low, high = struct.unpack(">HH", struct.pack("<i", -123_456)[1::-1] + struct.pack("<i", -123_456)[:1:-1])
    frame = b"\xa5\x5a" + struct.pack(">HHH", low, 0, high)
    assert seen(decoder(stated), 3 * frame, 100)[0] == (-123_456.0, None)


LINES = {
    "resource": "x",
    "sample_rate_hz": 10.0,
    "header": "$G",
    "columns": 4,
    "resolution": 1e-3,
    "checksum": {"name": "xor8", "first": 1},
    "value": {"column": 3, "scale": 2.0},
    "counter": {"column": 2},
    "temperature": {"column": 4},
}


def line(text: str) -> bytes:
    return f"{text}*{checked('xor8', text[1:].encode()):02X}\r\n".encode()


def test_incomplete_first_line_is_dropped() -> None:
    assert seen(decoder(LINES), line("$G,1,-0.5,25") + line("$G,2,+1.5e0,25"), 3) == [(3.0, 2)]


@pytest.mark.parametrize(
    "spoilt",
    [b"$G,1,0.5,25*00\r\n", b"$G,1,0.5\r\n", line("$G,1,0.5"), line("$G,1,0x5,25"), line("$G,1,nan,25"), b"\xff\n"],
)
def test_incomplete_line_is_counted_without_number(spoilt: bytes) -> None:
    read = decoder(LINES)
    assert seen(read, line("$G,0,1,25") + spoilt + line("$G,2,1,25"), 5) == [(2.0, 2)]
    assert read.bad == 1


@pytest.mark.parametrize("kind", ["rate", "increment", "angle"])
@pytest.mark.parametrize("form", sorted(set(FORMS) - {"float32", "float64"}))
@pytest.mark.parametrize("end", [0, 1])
def test_end_of_the_type_saturates_all_but_angles(kind: str, form: str, end: int) -> None:
    stated = {"resource": "x", "sample_rate_hz": 10.0, "header": "A5 5A", "length": 10, "kind": kind, "unit": "LSB"}
    stated["byte_order"] = "big"
    read = decoder({**stated, "value": {"at": 2, "type": form}, "counter": {"at": 6}, "checksum": {"name": "sum16"}})
    bits = 8 * struct.calcsize(FORMS[form])
    low = 0 if form.startswith("u") else -(1 << bits - 1)
    body = b"\xa5\x5a" + struct.pack(f">{FORMS[form]}", low + end * ((1 << bits) - 1)).ljust(6, b"\0")
    (sample,) = read.feed(body + checked("sum16", body).to_bytes(2, "big"))
    assert sample.saturated == (kind != "angle")
