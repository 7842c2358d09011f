"""Frames of a configured table language: framing a message, and finding messages in received bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, Struct

from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.checksums import checksum, checksum_length
from vcfbench.drivers.rate_table.fields import Order, decode, encode
from vcfbench.errors import FramingError

if TYPE_CHECKING:
    from vcfbench.clock import Deadline
    from vcfbench.drivers.rate_table.line import TableLine

_LINE_ENDS = ("\r\n", "\r", "\n")


HexBytes = Annotated[str, Meta(pattern=r"\A(?:[0-9A-Fa-f]{2} ?)*\Z")]
ByteValue = Annotated[int, Meta(ge=0, le=255)]
Place = Annotated[int, Meta(ge=0, le=4096)]
"""Place in a message, in bytes."""


class Frame(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frame of a message: text lines, or binary frames found by header, length and checksum."""

    kind: Literal["line", "fixed", "length_field", "delimited"] = "line"
    start: str = ""
    header: HexBytes = ""
    trailer: HexBytes = ""
    length: Annotated[int, Meta(ge=2, le=4096)] | None = None
    pad: ByteValue = 0
    length_at: Place | None = None
    length_type: Literal["u8", "u16"] = "u8"
    length_extra: Annotated[int, Meta(ge=-64, le=64)] = 0
    longest: Annotated[int, Meta(ge=2, le=4096)] = 256
    checksum: (
        Literal[
            "sum8",
            "neg_sum8",
            "xor8",
            "lrc_hex",
            "sum_hex",
            "nmea_xor_hex",
            "crc8",
            "crc16_modbus",
            "crc16_ccitt",
            "crc32",
        ]
        | None
    ) = None
    checksum_from: Place = 0
    checksum_mark: str = ""
    order: Order = "little"


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
        raw = line.take_line(deadline) if end in _LINE_ENDS else _take_until(line, end.encode("ascii"), deadline)
        text = replies.text(raw).strip()
    if not text.startswith(frame.start):
        raise FramingError(f"expected a line that begins with {frame.start!r}, came {text[:60]!r}")
    body = text.removeprefix(frame.start)
    if frame.checksum is None:
        return body
    cut = len(body) - checksum_length(frame.checksum)
    payload, check = body[: max(cut, 0)].removesuffix(frame.checksum_mark), body[max(cut, 0) :]
    marked = body[: max(cut, 0)].endswith(frame.checksum_mark)
    if not marked or checksum(frame.checksum, payload.encode("ascii")).decode("latin-1") != check.upper():
        raise FramingError(f"a line with a wrong checksum came, {text[:60]!r}")
    return payload


def _take_until(line: TableLine, end: bytes, deadline: Deadline) -> bytes:
    data = b""
    while not data.endswith(end):
        data += line.take(1, deadline)
    return data.removesuffix(end)


def frame_bytes(frame: Frame, data: bytes) -> bytes:
    """Return a frame as sent: header, data, padding, length, checksum, trailer.

    Raises:
        ValueError: the data are too long for the frame.
    """
    header, trailer = bytes.fromhex(frame.header), bytes.fromhex(frame.trailer)
    check = 0 if frame.checksum is None else checksum_length(frame.checksum)
    body = header + data
    if frame.length is not None:
        room = frame.length - check - len(trailer)
        if len(body) > room:
            raise ValueError(f"{len(data)} bytes do not fit into a frame of {frame.length}")
        body = body.ljust(room, bytes([frame.pad]))
    if frame.length_at is not None:
        size = len(body) + check + len(trailer) - frame.length_extra
        part = encode(frame.length_type, size, frame.order)
        body = body[: frame.length_at] + part + body[frame.length_at + len(part) :]
    return body + _check(frame, body) + trailer


def _check(frame: Frame, body: bytes) -> bytes:
    if frame.checksum is None:
        return b""
    return checksum(frame.checksum, body[frame.checksum_from :], order=frame.order)


def take_frame(frame: Frame, line: TableLine, deadline: Deadline) -> bytes:
    """Return the next whole frame.

    Header, then length, then checksum are looked for; when one fails the search goes on one byte further, because
    what follows a header may be the middle of another frame.
    """
    header = bytes.fromhex(frame.header)
    while True:
        first = line.take(len(header), deadline)
        if first != header:
            line.put_back(first[1:])
            continue
        found = _rest(frame, first, line, deadline)
        if found is not None:
            return found


def _rest(frame: Frame, begun: bytes, line: TableLine, deadline: Deadline) -> bytes | None:
    """Take the rest of a frame whose header has come; put all but one byte back when it is none."""
    if frame.kind == "delimited":
        data = begun + _take_until(line, bytes.fromhex(frame.trailer), deadline) + bytes.fromhex(frame.trailer)
    else:
        whole = _whole_length(frame, begun, line, deadline)
        if whole is None:
            return None
        data = whole[0] + line.take(whole[1] - len(whole[0]), deadline)
    if _intact(frame, data):
        return data
    line.put_back(data[1:])
    return None


def _whole_length(frame: Frame, begun: bytes, line: TableLine, deadline: Deadline) -> tuple[bytes, int] | None:
    """Return the bytes taken and the frame's length; None, and all but a byte put back, if it cannot be one."""
    if frame.length_at is None:
        return begun, frame.length or len(begun)
    width = 1 if frame.length_type == "u8" else 2
    begun += line.take(max(0, frame.length_at + width - len(begun)), deadline)
    size = int(decode(frame.length_type, begun, frame.length_at, frame.order)) + frame.length_extra
    if len(begun) <= size <= frame.longest:
        return begun, size
    line.put_back(begun[1:])
    return None


def _intact(frame: Frame, data: bytes) -> bool:
    trailer = bytes.fromhex(frame.trailer)
    if not data.endswith(trailer):
        return False
    body = data.removesuffix(trailer)
    check = b"" if frame.checksum is None else body[-checksum_length(frame.checksum) :]
    return _check(frame, body[: len(body) - len(check)]) == check
