"""Description of a stream of numbers in a bench file: its wire, its frames, and the kind of their numbers."""

import math
import re
from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta, Struct, field
from msgspec.structs import replace

from vcfbench.drivers.streams.checksums import CHECKSUMS, ChecksumName

Place = Annotated[int, Meta(ge=0, le=4095)]
_Signed = Literal["int8", "int16", "int24", "int32"]
_Unsigned = Literal["uint8", "uint16", "uint24", "uint32"]
NumberType = Literal[_Signed, _Unsigned, "float32", "float64"]
_Size = Annotated[float, Meta(ge=1e-12, le=1e12)]
_TO_DEG = {"deg/s": 1.0, "rad/s": math.degrees(1.0), "deg": 1.0, "rad": math.degrees(1.0), "LSB": 1.0}
_UNITS = {"rate": ("deg/s", "rad/s", "LSB"), "increment": ("deg", "rad", "LSB"), "angle": ("deg", "rad", "LSB")}


class _Table(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the bench file: frozen, strict."""


class FrameNumber(_Table, frozen=True, kw_only=True):
    """Place of a number: `at` bytes from the begin of a frame, or the `column` of a line, from 1.

    Of two 16-bit words the high one is there, and the low one `low_at` bytes from the begin.
    """

    at: Place | None = None
    low_at: Place | None = None
    column: Annotated[int, Meta(ge=1, le=256)] | None = None
    type: NumberType = "int16"

    @property
    def size(self) -> int:
        """Its bytes."""
        return int(re.sub("[a-z]", "", self.type)) // 8

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the largest number that it can say; of a float both are infinite."""
        if self.type.startswith("float"):
            return -math.inf, math.inf
        bits = 8 * self.size
        return (0, 2**bits - 1) if self.type.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)

    def misplaced(self, key: str, end: int) -> Iterator[tuple[str, str, object]]:
        """Yield the mistakes of its place in a frame whose numbers end at byte `end`, under its `key`."""
        if self.at is None:
            yield f"{key}.at", "bytes from the begin of the frame", None
        elif self.low_at is not None and self.type not in {"int32", "uint32"}:
            yield f"{key}.type", "int32 or uint32, of two words", self.type
        else:
            most = end - (self.size if self.low_at is None else 2)
            for name, at in (("at", self.at), ("low_at", self.low_at or 0)):
                if at > most:
                    yield f"{key}.{name}", f"at most {most}, for the number to end by byte {end}", at


class FrameQuantity(FrameNumber, frozen=True, kw_only=True):
    """A quantity: `scale` times the number, plus `offset`."""

    scale: Annotated[float, Meta(ge=-1e12, le=1e12)] = 1.0
    offset: Annotated[float, Meta(ge=-1e12, le=1e12)] = 0.0


class FrameCounter(FrameNumber, frozen=True, kw_only=True):
    """Number of a frame: one more each time, and 0 again at `modulus`, by default at the end of its type."""

    type: NumberType = "uint8"
    modulus: Annotated[int, Meta(ge=2, le=2**32)] | None = None

    @property
    def numbers(self) -> int:
        """Count of numbers before the counter wraps."""
        return self.modulus or int(self.ends[1]) + 1


class FrameStatus(FrameNumber, frozen=True, kw_only=True):
    """State of the device in a frame, which counts where the bits of `mask` are those of `ok`."""

    type: NumberType = "uint16"
    ok: Annotated[int, Meta(ge=0, le=2**32 - 1)] = 0
    mask: Annotated[int, Meta(ge=0, le=2**32 - 1)] = 2**32 - 1


class FrameCheck(_Table, frozen=True, kw_only=True):
    """Checksum of the bytes from `first` to itself, at the end of the frame; or its words are `at` and `low_at`."""

    name: ChecksumName
    first: Place = 0
    at: Place | None = None
    low_at: Place | None = None
    byte_order: Literal["big", "little"] | None = None
    """None: as in the frame."""


class Stream(_Table, frozen=True, kw_only=True):
    """The output of a gyroscope that speaks numbers.

    `resource` is a serial port, ``socket://HOST:PORT``, or ``file:PATH`` of a file that grows. A frame has `length`
    bytes, or is a line. It begins with `header`: bytes in hex, or the first characters of a line.

    `value` is the output, of a `kind`: a rate, the increment of an angle since the last frame, or an angle. Readings
    are means over `aperture_s`. `clock_ppm` is the most by which the device's clock is off, `latency_s` the age of a
    number when it has come, `full_scale` the output at which it saturates before its type does,
    `table_readback_s` the most by which the table's read-back is old, where the latency is measured by it (0.05 is
    chosen), `full_turn` that at which an angle begins anew before its type does. A `quiet` device may
    say the same number over a whole reading.
    """

    resource: Annotated[str, Meta(min_length=1, max_length=200, pattern="^[^\\r\\n]*$")]
    name: Annotated[str, Meta(min_length=1, max_length=60)] = "stream"
    kind: Literal["rate", "increment", "angle"] = "rate"
    unit: Literal["deg/s", "rad/s", "deg", "rad", "LSB"] = "deg/s"
    sample_rate_hz: Annotated[float, Meta(ge=1.0, le=10_000.0)]
    value: FrameQuantity
    counter: FrameCounter | None = None
    temperature: FrameQuantity | None = None
    status: FrameStatus | None = None
    header: Annotated[str, Meta(max_length=64)] = ""
    length: Annotated[int, Meta(ge=2, le=4096)] | None = None
    columns: Annotated[int, Meta(ge=1, le=256)] | None = None
    separator: Annotated[str, Meta(min_length=1, max_length=4)] = ","
    byte_order: Literal["big", "little"] = "big"
    checksum: FrameCheck = field(default_factory=lambda: FrameCheck(name="none"))
    full_scale: _Size | None = None
    resolution: _Size | None = None
    full_turn: _Size | None = None
    aperture_s: Annotated[float, Meta(ge=0.01, le=60.0)] = 0.5
    clock_ppm: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 200.0
    latency_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    table_readback_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.05
    quiet: bool = False
    baud_rate: Annotated[int, Meta(ge=300, le=3_000_000)] = 115_200
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1
    timeout_s: Annotated[float, Meta(ge=0.01, le=60.0)] = 2.0

    @property
    def in_frame(self) -> dict[str, FrameNumber]:
        """The numbers of a frame by their keys."""
        found = {key: getattr(self, key) for key in ("value", "counter", "temperature", "status")}
        return {key: each for key, each in found.items() if each is not None}

    @property
    def frame(self) -> "Stream":
        """The description without its value; streams with equal frames are fields of one."""
        return replace(self, value=FrameQuantity())

    @property
    def output_unit(self) -> str:
        """Unit of the output as a rate: ``deg/s``, or ``LSB``, of increments ``LSB/s``."""
        if self.unit != "LSB":
            return "deg/s"
        return "LSB" if self.kind == "rate" else "LSB/s"

    @property
    def per_unit(self) -> float:
        """Output as a rate per `unit` of a frame."""
        return _TO_DEG[self.unit] * (1.0 if self.kind == "rate" else self.sample_rate_hz)

    @property
    def last_digit(self) -> float:
        """Step of a reading in the unit of the output: one of the number, of an angle over the aperture."""
        step = abs(self.resolution or self.value.scale) * self.per_unit
        if self.kind == "angle":
            return step / max(1.0, self.aperture_s * self.sample_rate_hz)
        return step

    @property
    def largest(self) -> float:
        """Largest output, either way, before it saturates, in the unit of the output; infinite if nothing tells."""
        if self.kind == "angle":
            return math.inf
        ends = () if self.length is None else self.value.ends
        reached = [abs(self.value.scale * end + self.value.offset) for end in ends]
        return min([*reached, self.full_scale or math.inf]) * self.per_unit

    @property
    def reading_s(self) -> float:
        """Time that a reading may take: its frames, those that are skipped before it, and some that are lost."""
        return self.latency_s + 1.2 * self.aperture_s + 4.0 / self.sample_rate_hz

    @property
    def turn(self) -> float:
        """Angle at which the number wraps; 0 without a wrap."""
        low, high = self.value.ends
        return self.full_turn or (0.0 if math.isinf(high) else abs(self.value.scale) * (high - low + 1.0))

    @property
    def clock_share(self) -> float:
        """Largest relative error of the output by the device's clock; a rate does not depend on a clock."""
        return 0.0 if self.kind == "rate" else 1e-6 * self.clock_ppm

    def contradictions(self) -> Iterator[tuple[str, str, object]]:
        """Yield the mistakes: key, expected value, and given value."""
        if self.unit not in _UNITS[self.kind]:
            yield "unit", f"of {self.kind}: one of {', '.join(_UNITS[self.kind])}", self.unit
        if not self.value.scale:
            yield "value.scale", "a number that is not 0", 0.0
        if self.kind != "rate" and self.counter is None:
            yield "counter", f"a counter: of {self.kind}s the device's clock and dropped frames are errors", None
        if self.value.type.startswith("float") and self.resolution is None:
            yield "resolution", f"the step of the last digit, {self.unit}: a float does not show it", None
        if self.counter is not None and self.counter.type.startswith("float"):
            yield "counter.type", "a whole number", self.counter.type
        yield from self.mistakes_of_bytes() if self.length is not None else self.mistakes_of_lines()

    def mistakes_of_bytes(self) -> Iterator[tuple[str, str, object]]:
        """Yield those of a frame of bytes."""
        length, check = self.length or 0, CHECKSUMS[self.checksum.name]
        try:
            header = len(bytes.fromhex(self.header))
        except ValueError:
            header = 0
        if not 0 < header < length:
            yield "header", 'the bytes in hex that a frame begins with, "A5 5A"', self.header
        end = length - check.size
        if self.checksum.at is not None:
            end = length
            ends = self.checksum.at, self.checksum.low_at
            if check.size != 4 or None in ends or max(each or 0 for each in ends) > length - 2:
                yield "checksum.at", "with low_at, the two words of a CRC-32 within the frame", self.checksum.at
        for key, number in self.in_frame.items():
            yield from number.misplaced(key, end)
        least = length * (9 + self.stop_bits + (self.parity != "none")) * self.sample_rate_hz
        if self.baud_rate < least and "://" not in self.resource and not self.resource.startswith("file:"):
            yield "baud_rate", f"at least {least:.0f}, for {self.sample_rate_hz:g} frames a second", self.baud_rate

    def mistakes_of_lines(self) -> Iterator[tuple[str, str, object]]:
        """Yield those of a line."""
        if self.columns is None:
            yield "columns", "how many columns a line has (of bytes: length)", None
        for key, number in self.in_frame.items():
            if number.column is None or number.column > (self.columns or 256):
                yield f"{key}.column", f"a column from 1 to {self.columns}", number.column
        if self.checksum.name not in {"none", "xor8", "sum8"}:
            yield "checksum.name", "of a line: none, xor8 or sum8, two hex digits behind a *", self.checksum.name
        if self.value.column is not None and self.resolution is None:
            yield "resolution", f"the step of the last digit in a line, {self.unit}", None
