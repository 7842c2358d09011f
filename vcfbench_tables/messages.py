"""Messages of a table language in TOML: templates, numbers in bytes, checksums, frames.

A template of text is in Python's format language: ``3{dir}{acc:04d}{abs_rate:09.4f}``. One of bytes is hexadecimal,
each place with its type and the factor to its whole numbers: ``01 0C {rate:i32*1e5} {acc:i32*1e5}``.
"""

import binascii
import math
import operator
import re
import string
import struct
import zlib
from collections.abc import Callable, Mapping
from functools import reduce
from types import MappingProxyType
from typing import Annotated, Final, Literal, get_args

from msgspec import Meta, Struct

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import FramingError

Value = float | int | str
Order = Literal["little", "big"]
BinaryType = Literal["u8", "i8", "u16", "i16", "u24", "i24sm", "u32", "i32", "f32"]
TextType = Literal["decimal", "hex"]
Wrap = Literal["continuous", "0..360", "+-180", "over 360 minus 720"]
"""Wrapping of an angle in a reply: none, within a turn either way, or negative angles as 720 more."""
Checksum = Literal[
    "sum8", "neg_sum8", "xor8", "lrc_hex", "sum_hex", "nmea_xor_hex", "crc8", "crc16_modbus", "crc16_ccitt", "crc32"
]
"""Checksums; those in ``_hex`` are two upper-case hexadecimal digits. `crc8` has the polynomial 07, `crc16_modbus` A001
reflected from FFFF, `crc16_ccitt` 1021 from FFFF, `crc32` is IEEE 802.3's."""
CHECKSUMS: Final = get_args(Checksum)

NAMES: Final = (
    *("rate", "abs_rate", "dir", "acc", "axis", "seq", "position", "travel_end"),
    *(f"rate_{slot}" for slot in range(1, 7)),
    *(f"on_{slot}" for slot in range(1, 7)),
)
"""rate, abs_rate, acc, position: in the table's units. dir: the direction's digit. axis: the bench's. seq: a counter.
travel_end: the end of travel that lies in the rate's direction. rate_1...: the rate of our axis, 0 for the others.
on_1...: 1 for our axis, 0 for the others."""


# --- templates ---

_HEX_BYTES = re.compile(r"(?:[0-9A-Fa-f]{2})+")
_FORM = re.compile(r"(?:.?[<>=^])?[+\- ]?#?0?[1-9]?\d?(?:\.[0-2]?\d)?[bdeEfFgGosxX]?", re.DOTALL)
"""Part of Python's format language that a table can want: at most 99 characters, 29 of them decimals."""
_PLACE = re.compile(r"\{(?P<name>\w+):(?P<kind>\w+)(?:\*(?P<factor>[0-9.eE+-]+))?\}")


def fill_text(template: str, values: Mapping[str, Value]) -> str:
    """Return a text template with its values.

    Raises:
        ValueError: it is no template, or asks for what there is not; the words say what.
    """
    parts = []
    for literal, name, form, conversion in string.Formatter().parse(template):
        parts.append(literal)
        if name is None:
            continue
        if conversion is not None:
            raise ValueError(f"conversion !{conversion} is not known here")
        value = _finite(name, values)
        if not _FORM.fullmatch(form or ""):
            raise ValueError(f"{(form or '')[:20]!r} is no form of at most 99 characters and 29 decimals")
        if isinstance(value, float):
            value += 0.0  # no table need know a negative zero
            if (form or "").endswith(("d", "x", "X")):
                value = round(value)
        parts.append(format(value, form or ""))
    return "".join(parts)


def _finite(name: str, values: Mapping[str, Value]) -> Value:
    if name not in NAMES:
        raise ValueError(f"unknown name {name!r}")
    if name not in values:
        raise ValueError(f"{name!r} has no value in this command")
    value = values[name]
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value} cannot be sent")
    return value


def fill_bytes(template: str, values: Mapping[str, Value], order: Order) -> bytes:
    """Return a template of bytes with its values; raises ValueError like :func:`fill_text`."""
    data = b""
    for token in template.split():
        if _HEX_BYTES.fullmatch(token):
            data += bytes.fromhex(token)
            continue
        place = _PLACE.fullmatch(token)
        if place is None:
            raise ValueError(f"{token!r} is neither hexadecimal bytes nor {{name:type}} or {{name:type*factor}}")
        if place["kind"] not in _SIZES:
            raise ValueError(f"unknown type {place['kind']!r}, there are {', '.join(_SIZES)}")
        factor = float(place["factor"] or 1.0)
        if not 1e-12 <= abs(factor) <= 1e12:
            raise ValueError(f"a factor is from 1e-12 to 1e12 either sign, not {place['factor']}")
        data += encode(place["kind"], float(_finite(place["name"], values)) * factor, order)
    return data


# --- numbers ---

_SIZES: Mapping[str, int] = MappingProxyType(dict(zip(get_args(BinaryType), (1, 1, 2, 2, 3, 3, 4, 4, 4), strict=True)))
"""Types by their bytes."""
_SIGNED = ("i8", "i16", "i32")
_SIGN = 1 << 23
_FLOATS: Mapping[Order, str] = MappingProxyType({"little": "<f", "big": ">f"})


def encode(kind: str, value: float, order: Order) -> bytes:
    """Return `value` as the bytes of a type; whole-number types round to the nearest; ValueError: it does not fit."""
    try:
        if kind == "f32":
            return struct.pack(_FLOATS[order], value)
        whole = round(value)
        if kind == "i24sm":  # sign and magnitude; what is too large has no three bytes either
            whole = abs(whole) | (_SIGN if whole < 0 else 0) if abs(whole) < _SIGN else -1
        return whole.to_bytes(_SIZES[kind], order, signed=kind in _SIGNED)
    except OverflowError as error:
        raise ValueError(f"{value:.15g} does not fit into {kind}") from error


def decode(kind: str, data: bytes, at: int, order: Order) -> float:
    """Return the number of a type that begins at byte `at`; raises FramingError when it is not wholly there."""
    raw = data[at : at + _SIZES[kind]]
    if at < 0 or len(raw) != _SIZES[kind]:
        raise FramingError(f"a frame of {len(data)} bytes has no {kind} at byte {at}")
    if kind == "f32":
        value = float(struct.unpack(_FLOATS[order], raw)[0])
        if not -replies.OVERLOAD < value < replies.OVERLOAD:
            raise FramingError(f"expected a number, got {raw.hex(' ')}, {value:g}")
        return value
    word = int.from_bytes(raw, order, signed=kind in _SIGNED)
    return float(-(word ^ _SIGN) if kind == "i24sm" and word & _SIGN else word)


def text_value(kind: TextType, text: str) -> float:
    """Return the number that a piece of text says; raises FramingError when it is none."""
    if kind == "decimal":
        return replies.number(text.strip())
    try:
        return float(int(text, 16))
    except (ValueError, OverflowError):
        raise FramingError(f"expected a hexadecimal number, got {text[:60]!r}") from None


def unwrapped(angle: float, wrap: Wrap) -> float:
    """Return the angle within one turn for a reported angle that wraps, deg."""
    match wrap:
        case "0..360":
            return angle % 360.0
        case "+-180":
            return (angle + 180.0) % 360.0 - 180.0
        case "over 360 minus 720":
            return angle - 720.0 if angle > 360.0 else angle
        case "continuous":
            return angle


# --- checksums ---


def _crc(data: bytes, value: int, shifted: Callable[[int], int]) -> int:
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = shifted(value)
    return value


_SUMS: Mapping[str, tuple[int, Callable[[bytes], int]]] = MappingProxyType(
    {
        "sum8": (1, sum),
        "neg_sum8": (1, lambda data: -sum(data)),
        "xor8": (1, lambda data: reduce(operator.xor, data, 0)),
        "sum_hex": (2, sum),
        "lrc_hex": (2, lambda data: -sum(data)),
        "nmea_xor_hex": (2, lambda data: reduce(operator.xor, data, 0)),
        "crc8": (1, lambda data: _crc(data, 0, lambda value: value << 1 ^ 0x107 * (value >> 7))),
        "crc16_modbus": (2, lambda data: _crc(data, 0xFFFF, lambda value: value >> 1 ^ 0xA001 * (value & 1))),
        "crc16_ccitt": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
        "crc32": (4, zlib.crc32),
    }
)
"""Length as sent and value, whose lowest bits count."""


def checksum_length(name: str | None) -> int:
    """Return the number of bytes that the checksum `name` takes as sent; None takes none."""
    return 0 if name is None else _SUMS[name][0]


def checksum(name: str, data: bytes, *, order: str = "little") -> bytes:
    """Return the checksum `name` of `data` as sent; `order` is that of checksums of several bytes."""
    length, summed = _SUMS[name]
    if name.endswith("_hex"):
        return f"{summed(data) % 256:02X}".encode("ascii")
    return int(summed(data) % 256**length).to_bytes(length, "big" if order == "big" else "little")


# --- frames ---

_LINE_ENDS = ("\r\n", "\r", "\n")

HexBytes = Annotated[str, Meta(pattern=r"\A(?:[0-9A-Fa-f]{2} ?)*\Z")]
ByteValue = Annotated[int, Meta(ge=0, le=255)]
Place = Annotated[int, Meta(ge=0, le=4096)]
"""Place in a message, in bytes."""


class Frame(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frame of a message: text lines, or binary frames found by header, length and checksum."""

    kind: Literal["line", "fixed", "length_field", "delimited"] = "line"  # how a message is delimited
    start: str = ""  # text at which lines begin
    header: HexBytes = ""  # bytes, hexadecimal
    trailer: HexBytes = ""  # bytes, hexadecimal
    length: Annotated[int, Meta(ge=2, le=4096)] | None = None  # of a fixed frame, bytes
    pad: ByteValue = 0  # byte that fills up a fixed frame
    length_at: Place | None = None  # place of the length field
    length_type: Literal["u8", "u16"] = "u8"  # type of the length field
    length_extra: Annotated[int, Meta(ge=-64, le=64)] = 0  # length of the frame minus the number in it
    longest: Annotated[int, Meta(ge=2, le=4096)] = 256  # longest possible length
    checksum: Checksum | None = None  # of lines: `sum_hex`, `lrc_hex`, `nmea_xor_hex`; comes before a trailer
    checksum_from: Place = 0  # first byte that counts
    checksum_mark: str = ""  # character before the checksum of a line
    order: Order = "little"  # byte order


def frame_text(frame: Frame, text: str, end: str) -> bytes:
    """Return a line as sent: start, text, checksum, end."""
    body = text.encode("ascii")
    if frame.checksum is not None:
        body += frame.checksum_mark.encode("ascii") + checksum(frame.checksum, body)
    return frame.start.encode("ascii") + body + end.encode("ascii")


def take_text(frame: Frame, end: str, line: TableLine, deadline: Deadline) -> str:
    """Return the next line that is not empty, without start, checksum and end; raises FramingError if it is damaged."""
    text = ""
    while not text:
        raw = line.take_line(deadline) if end in _LINE_ENDS else line.take_through(end.encode("ascii"), deadline)
        text = replies.text(raw).strip()
    if not text.startswith(frame.start):
        raise FramingError(f"expected a line that begins with {frame.start!r}, got {text[:60]!r}")
    body = text.removeprefix(frame.start)
    if frame.checksum is None:
        return body
    cut = max(len(body) - checksum_length(frame.checksum), 0)
    marked, check = body[:cut], body[cut:]
    payload = marked.removesuffix(frame.checksum_mark)
    known = checksum(frame.checksum, payload.encode("ascii")).decode("latin-1")
    if not marked.endswith(frame.checksum_mark) or known != check.upper():
        raise FramingError(f"a line with a wrong checksum came, {text[:60]!r}")
    return payload


def frame_bytes(frame: Frame, data: bytes) -> bytes:
    """Return a frame as sent: header, data, padding, length, checksum, trailer.

    Raises:
        ValueError: the data are too long for the frame.
    """
    trailer = bytes.fromhex(frame.trailer)
    behind = checksum_length(frame.checksum) + len(trailer)
    body = bytes.fromhex(frame.header) + data
    if frame.length is not None:
        room = frame.length - behind
        if len(body) > room:
            raise ValueError(f"{len(data)} bytes do not fit into a frame of {frame.length}")
        body = body.ljust(room, bytes([frame.pad]))
    if frame.length_at is not None:
        part = encode(frame.length_type, len(body) + behind - frame.length_extra, frame.order)
        body = body[: frame.length_at] + part + body[frame.length_at + len(part) :]
    return body + _check(frame, body) + trailer


def torn_end(frame: Frame, end: str) -> bytes:
    """Return the end of a message that broke off, so that it does not swallow the next.

    A line ends with its `end`. A frame of bytes that lacks some is filled up with what begins none; it then fails its
    check, or is done: a stop comes after it.
    """
    if frame.kind == "line":
        return end.encode("ascii")
    if frame.kind == "delimited":
        return bytes.fromhex(frame.trailer)
    filling = b"\xff" if bytes.fromhex(frame.header).startswith(b"\0") else b"\0"
    return filling * ((frame.length or frame.longest) - 1)


def _check(frame: Frame, body: bytes) -> bytes:
    if frame.checksum is None:
        return b""
    return checksum(frame.checksum, body[frame.checksum_from :], order=frame.order)


def take_frame(frame: Frame, line: TableLine, deadline: Deadline) -> bytes:
    """Return the next whole frame.

    Header, then length, then checksum are looked for; when one fails the search goes on one byte further, because
    what follows a header may be the middle of another frame.
    """
    header, trailer = bytes.fromhex(frame.header), bytes.fromhex(frame.trailer)
    while True:
        data = line.take(len(header), deadline)
        if data == header:
            data, whole = _rest(frame, data, line, deadline)
            body = data.removesuffix(trailer)
            cut = max(len(body) - checksum_length(frame.checksum), 0)
            if whole and data.endswith(trailer) and body[cut:] == _check(frame, body[:cut]):
                return data
        line.put_back(data[1:])


def _rest(frame: Frame, begun: bytes, line: TableLine, deadline: Deadline) -> tuple[bytes, bool]:
    """Take the rest of a frame whose header has come; return it, and True if its length is possible."""
    if frame.kind == "delimited":
        trailer = bytes.fromhex(frame.trailer)
        return begun + line.take_through(trailer, deadline) + trailer, True
    size = frame.length or len(begun)
    if frame.length_at is not None:
        width = 1 if frame.length_type == "u8" else 2
        begun += line.take(max(0, frame.length_at + width - len(begun)), deadline)
        size = int(decode(frame.length_type, begun, frame.length_at, frame.order)) + frame.length_extra
        if not len(begun) <= size <= frame.longest:
            return begun, False
    return begun + line.take(size - len(begun), deadline), True
