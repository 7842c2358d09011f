"""Frames out of bytes: their begin, their checks, their numbers."""

import math
import re
import struct
from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.drivers.streams.checksums import CHECKSUMS
from vcfbench.drivers.streams.description import FrameNumber, FrameQuantity, Stream

_LONGEST_LINE = 4096
_PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_WEAK = {"none", "sum8", "xor8"}
"""Checksums that one of 256 spoilt frames passes: out of step a frame counts only where another one follows it."""


class Sample(Struct, frozen=True):
    """One frame: its output in `unit` of the stream, its number, its state."""

    value: float
    counter: int | None
    temperature_c: float | None
    saturated: bool
    status: int | None
    """The status, where it is not as it should be."""
    late: bool = False
    """Whether its last byte came earlier, and only what followed shows that it is a frame."""


class Decoder:
    """Takes bytes as they come and gives the frames in them; `bad` are those that were spoilt."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._buffer = bytearray()
        self._in_step = False
        self._lines = stream.length is None
        self._header = stream.header.encode() if self._lines else bytes.fromhex(stream.header)
        order = stream.byte_order
        self._readers = {} if self._lines else {key: _reader(each, order) for key, each in stream.in_frame.items()}
        self.bad = 0

    def reset(self) -> None:
        """Forget the received bytes; the next is in the middle of a frame."""
        self._buffer.clear()
        self._in_step = False

    def feed(self, data: bytes) -> list[Sample]:
        """Take bytes and return the frames that are whole now."""
        before = len(self._buffer)
        self._buffer += data
        return self._of_lines() if self._lines else self._of_bytes(before)

    def _of_bytes(self, before: int) -> list[Sample]:
        found, buffer, header, length = [], self._buffer, self._header, self._stream.length or 0
        weak, begin = self._stream.checksum.name in _WEAK, 0
        while len(buffer) - begin >= length:
            if not buffer.startswith(header, begin):
                self._lost_step()
                begin = buffer.find(header, begin + 1)
                if begin < 0:
                    begin = max(0, len(buffer) - len(header) + 1)
                    break
                continue
            frame = bytes(buffer[begin : begin + length])
            if not self._in_step and weak:
                if len(buffer) - begin < length + len(header):
                    break
                follows = buffer.startswith(header, begin + length)
            else:
                follows = True
            sample = None
            if follows and self._sums(frame):
                sample = self._made({key: read(frame) for key, read in self._readers.items()})
            if sample is None:
                self._lost_step()
                begin += 1
                continue
            self._in_step = True
            begin += length
            found.append(replace(sample, late=begin <= before))
        del buffer[:begin]
        return found

    def _lost_step(self) -> None:
        self.bad += self._in_step
        self._in_step = False

    def _sums(self, frame: bytes) -> bool:
        check = self._stream.checksum
        kind, order = CHECKSUMS[check.name], check.byte_order or self._stream.byte_order
        if check.at is None:
            end = len(frame) - kind.size
            said = int.from_bytes(frame[end:], order)
        else:
            places = check.at, check.low_at or 0
            end = min(places)
            high, low = (int.from_bytes(frame[at : at + 2], order) for at in places)
            said = high << 16 | low
        return kind.of(frame[check.first : end]) == said

    def _of_lines(self) -> list[Sample]:
        found = []
        *lines, rest = self._buffer.split(b"\n")
        if len(rest) > _LONGEST_LINE:
            self._lost_step()
            rest = bytearray()
        self._buffer = bytearray(rest)
        for line in lines:
            if not self._in_step:  # it may have lost its begin
                self._in_step = True
                continue
            if text := line.strip().decode("latin-1"):
                sample = self._line(text)
                self.bad += sample is None
                if sample is not None:
                    found.append(sample)
        return found

    def _line(self, text: str) -> Sample | None:
        stream = self._stream
        if not text.startswith(stream.header):
            return None
        check = CHECKSUMS[stream.checksum.name]
        if check.size:
            text, star, said = text.rpartition("*")
            covered = text[stream.checksum.first :].encode("latin-1")
            if not star or not re.fullmatch("[0-9A-Fa-f]{2}", said) or int(said, 16) != check.of(covered):
                return None
        cells = [cell.strip() for cell in text.split(stream.separator)]
        if len(cells) != stream.columns:
            return None
        cells[0] = cells[0].removeprefix(stream.header)
        numbers = {key: cells[(each.column or 1) - 1] for key, each in stream.in_frame.items()}
        if not all(map(_PLAIN.fullmatch, numbers.values())):
            return None
        return self._made({key: float(each) for key, each in numbers.items()})

    def _made(self, raw: dict[str, float]) -> Sample | None:
        stream = self._stream
        if not all(map(math.isfinite, raw.values())):
            return None
        value, (low, high) = _scaled(stream.value, raw["value"]), stream.value.ends
        at_end = not self._lines and stream.kind != "angle" and not low < raw["value"] < high
        beyond = stream.full_scale is not None and abs(value) >= stream.full_scale
        ill = None
        if stream.status is not None and (int(raw["status"]) ^ stream.status.ok) & stream.status.mask:
            ill = int(raw["status"])
        return Sample(
            value,
            int(raw["counter"]) if stream.counter is not None else None,
            None if stream.temperature is None else _scaled(stream.temperature, raw["temperature"]),
            at_end or beyond,
            ill,
        )


def _scaled(by: FrameQuantity, raw: float) -> float:
    return raw * by.scale + by.offset


def _reader(number: FrameNumber, order: str) -> Callable[[bytes], float]:
    """Return the function that reads a number out of a frame."""
    at, low_at, size, signed = number.at or 0, number.low_at, number.size, not number.type.startswith("u")
    little = order == "little"
    if low_at is not None:
        words = struct.Struct("<H" if little else ">H")
        turn = 1 << 32 if signed else 0

        def joined(frame: bytes) -> float:
            found: int = words.unpack_from(frame, at)[0] << 16 | words.unpack_from(frame, low_at)[0]
            return found - turn if found >> 31 else found

        return joined
    if number.type.startswith("float"):
        form = struct.Struct(("<" if little else ">") + ("f" if size == 4 else "d"))
        return lambda frame: float(form.unpack_from(frame, at)[0])
    return lambda frame: int.from_bytes(frame[at : at + size], "little" if little else "big", signed=signed)
