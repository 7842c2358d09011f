"""A simulated gyroscope that speaks numbers: frames of an analogue output, at its own clock.

The frame is stated by nested tables, as bench files have them; its encoder shares nothing with what reads it.
"""

from __future__ import annotations

import binascii
import math
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial, reduce
from operator import xor
from random import Random
from typing import TYPE_CHECKING, Any

from msgspec import Struct
from msgspec.structs import replace

from simrack.adjustment import Adjustment, number
from simrack.leads import Leads

if TYPE_CHECKING:
    import numpy as np

_KEPT = 16_384
"""Bytes that the computer at the other end keeps when nobody reads."""
_AHEAD_S = 0.05
"""How far ahead frames are foreseen: real time passes between two looks at the clock."""
VOLTS_PER_DEG_S = -0.0125
"""What a deg/s is on the analogue output, of which the numbers are made."""
_IDLE_S = 0.1
"""Time after the last read from which nobody listens: frames are counted then and not made."""


class StreamErrors(Struct, frozen=True):
    """Imperfections of the stream; zero switches each off.

    Raises:
        ValueError: a share is none, or a time is negative.
    """

    clock_ppm: float = 0.0
    """By how much its clock is fast."""
    latency_s: float = 0.0
    """Time from the end of a frame's span to its first bit."""
    dropped: float = 0.0
    """Share of the frames that are missing."""
    flipped: float = 0.0
    """Share of the frames with a wrong bit."""
    repeated: float = 0.0
    """Share of the frames that come twice."""
    garbage: float = 0.0
    """Share of the frames with bytes before them that belong to none."""
    silent: float = 0.0
    """Switch, 1 is on: nothing comes."""
    stuck: float = 0.0
    """Switch, 1 is on: the counter goes on, the number does not."""
    frozen: float = 0.0
    """Switch, 1 is on: the same frame again and again."""
    saturated: float = 0.0
    """Switch, 1 is on: the number is at its end."""
    status: float = 0.0
    """Switch, 1 is on: the status is not well."""
    lsb_per_deg_s: float = 100.0
    """Steps a deg/s of a stream in LSB."""

    def __post_init__(self) -> None:
        """Refuse values beyond the bounds."""
        for name in ("dropped", "flipped", "repeated", "garbage", "silent", "stuck", "frozen", "saturated", "status"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: a share, from 0 to 1")
        if not 0.0 <= self.latency_s <= 1.0 or abs(self.clock_ppm) > 1e5 or not self.lsb_per_deg_s:
            raise ValueError("latency_s: 0 to 1; clock_ppm: at most 1e5; lsb_per_deg_s: not 0")

    @classmethod
    def none(cls) -> StreamErrors:
        """Return those of an ideal device."""
        return cls()

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> StreamErrors:
        """Return a specimen: its clock and its delay."""
        return cls(clock_ppm=float(rng.uniform(-50.0, 50.0)), latency_s=float(rng.uniform(0.001, 0.01)))


class StreamTwin:
    """A gyroscope that speaks numbers: `world` has one input, its analogue output, `stream` the tables of the frame.

    `axes` are further outputs that its frames have, each with the table of its place.
    """

    errors_class = StreamErrors

    def __init__(
        self,
        world: Leads,
        *,
        errors: StreamErrors,
        stream: Mapping[str, Any],
        volts_per_deg_s: float = VOLTS_PER_DEG_S,
        noise_seed: int = 0,
        axes: Iterable[tuple[Leads, Mapping[str, Any]]] = (),
    ) -> None:
        further = list(axes)
        self._outputs = {"value": world} | {f"value-{number}": each for number, (each, _) in enumerate(further, 2)}
        stream = {**stream, **{f"value-{number}": place for number, (_, place) in enumerate(further, 2)}}
        self._clock = world.clock
        self._errors = errors
        self._frame_of = stream
        self._volts_per_deg_s = volts_per_deg_s
        self._random = Random(noise_seed)  # noqa: S311  (no secret)
        self._output = bytearray()
        self._coming: deque[tuple[float, bytes]] = deque()
        self._windows: deque[tuple[float, dict[str, Any]]] = deque()
        """Frames that are under way or to come: the end of each, and the means of it."""
        self._count = 0
        self._angles = dict.fromkeys(self._outputs, 0.0)
        self._last: bytes = b""
        self._held: dict[str, float] = {}
        self._heard_s = self._clock.now()
        self._begin_s = self._over_s = self._clock.now()

    # --- the seam: simrack.device.Device -------------------------------------------------------------

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take no commands."""

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return the bytes that have arrived by now."""
        self._heard_s = self._clock.now()
        self._make()
        part = bytes(self._output[:limit])
        del self._output[:limit]
        return part, False

    def wake_at(self) -> float | None:
        """Return the instant of the end or arrival of the next frame; None without a listener.

        Whoever listens next hears the frames of one latency ago, so a device with a long one makes them all.
        """
        if self._errors.latency_s <= _IDLE_S and self._clock.now() > self._heard_s + _IDLE_S + 2.0 * self._period_s:
            return None
        self._make()
        return min(each[0][0] for each in (self._windows, self._coming) if each)

    def clear(self) -> None:
        """Drop the bytes that have arrived."""
        self._output.clear()

    def status_byte(self) -> int:
        """Return 0: there is none."""
        return 0

    def trigger(self) -> None:
        """Do nothing."""

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments of a served stream: its imperfections."""
        for name in StreamErrors.__struct_fields__:
            yield Adjustment(
                *(f"stream.{name}", "", name.replace("_", " "), partial(getattr, self._errors, name)),
                partial(self._adjust, name),
            )

    def _adjust(self, name: str, value: Any) -> None:
        self._errors = replace(self._errors, **{name: number(value)})

    @property
    def _period_s(self) -> float:
        return 1.0 / (float(self._frame_of["sample_rate_hz"]) * (1.0 + 1e-6 * self._errors.clock_ppm))

    def _make(self) -> None:
        """Make the frames that are over by now, and look ahead: nothing can be averaged that has begun."""
        now, period_s = self._clock.now(), self._period_s
        while self._windows and self._windows[0][0] <= now:
            self._over_s, windows = self._windows.popleft()
            self._count += 1
            self._send({key: each.mean_v() / self._volts_per_deg_s for key, each in windows.items()})
        if not self._windows:  # nobody listened
            gone = max(0, math.ceil((now - self._over_s) / period_s))
            self._count += gone
            self._begin_s = self._over_s + gone * period_s
            if gone:  # what comes has no gap: the frames before one are not heard either
                self._coming = deque(each for each in self._coming if each[0] <= now)
        while self._begin_s <= now + max(_AHEAD_S, period_s):
            end_s = self._begin_s + period_s
            windows = {key: each.window("input", self._begin_s, end_s) for key, each in self._outputs.items()}
            self._windows.append((end_s, windows))
            self._begin_s = end_s
        while self._coming and self._coming[0][0] <= now:
            self._output += self._coming.popleft()[1]
        del self._output[_KEPT:]

    def _send(self, rates_deg_s: Mapping[str, float]) -> None:
        """Put a frame on the line, with its faults."""
        errors, random = self._errors, self._random
        data = self._frame(rates_deg_s)
        if errors.frozen and self._last:
            data = self._last
        self._last = data
        if errors.silent or random.random() < errors.dropped:
            return
        if random.random() < errors.flipped:
            place = random.randrange(8 * len(data))
            spoilt = bytearray(data)
            spoilt[place // 8] ^= 1 << place % 8
            data = bytes(spoilt)
        if random.random() < errors.repeated:
            data += data
        if random.random() < errors.garbage:
            data = random.randbytes(random.randrange(1, 8)) + data
        bits = 10 + (self._frame_of["parity"] != "none") + (self._frame_of["stop_bits"] - 1)
        arrived_s = self._over_s + errors.latency_s + len(data) * bits / self._frame_of["baud_rate"]
        if self._coming:
            arrived_s = max(arrived_s, self._coming[-1][0])
        self._coming.append((arrived_s, data))

    def _value(self, key: str, rate_deg_s: float) -> float:
        """Return the number of an output in a frame, by the device's own second."""
        stated = self._frame_of
        of_unit = {"deg/s": 1.0, "deg": 1.0, "LSB": self._errors.lsb_per_deg_s}.get(stated["unit"], math.pi / 180.0)
        value = rate_deg_s * of_unit
        if stated["kind"] != "rate":
            value *= self._period_s
        if stated["kind"] == "angle":
            self._angles[key] = value = self._angles[key] + value
        return self._held.setdefault(key, value) if self._errors.stuck else value

    def _frame(self, rates_deg_s: Mapping[str, float]) -> bytes:
        stated = self._frame_of
        values = {key: self._value(key, rate) for key, rate in rates_deg_s.items()}
        numbers: dict[str, float] = {**values, "counter": self._count, "temperature": 25.0}
        if stated.get("status") is not None:
            numbers["status"] = stated["status"]["ok"] ^ (stated["status"]["mask"] & 0x1 if self._errors.status else 0)
        numbers = {key: each for key, each in numbers.items() if stated.get(key) is not None}
        return self._bytes(numbers) if stated.get("length") else self._line(numbers)

    def _line(self, numbers: Mapping[str, float]) -> bytes:
        stated = self._frame_of
        cells = [stated["header"], *["0"] * (stated["columns"] - 1)]
        step = stated["resolution"]
        digits = max(0, -math.floor(math.log10(step)))
        if self._errors.saturated:
            numbers = dict(numbers) | dict.fromkeys(self._outputs, stated.get("full_scale") or 1e6)
        for key, each in numbers.items():
            if key == "counter":
                said = str(int(each) % (stated[key].get("modulus") or 256))
            elif key == "status":
                said = str(int(each))
            else:
                raw = (each - stated[key]["offset"]) / stated[key]["scale"]
                said = f"{round(raw / step) * step if key == 'value' else raw:.{digits}f}"
            place = stated[key]["column"] - 1
            cells[place] = said if place else stated["header"] + said
        text: str = stated["separator"].join(cells)
        kind = stated["checksum"]["name"]
        if kind != "none":
            covered = text[stated["checksum"]["first"] :].encode()
            text += f"*{_CHECKS[kind](covered):02X}"
        return text.encode() + b"\r\n"

    def _bytes(self, numbers: Mapping[str, float]) -> bytes:
        stated = self._frame_of
        header, order = bytes.fromhex(stated["header"]), stated["byte_order"]
        frame = bytearray(stated["length"])
        frame[: len(header)] = header
        for key, each in numbers.items():
            place = stated[key]
            raw = (each - place.get("offset", 0.0)) / place.get("scale", 1.0)
            if key in self._outputs and self._errors.saturated:
                raw = math.copysign(1e30, raw)
            _put(
                frame, place, raw, order, wraps=key == "counter" or (key in self._outputs and stated["kind"] == "angle")
            )
        check = stated["checksum"]
        kind, by = check["name"], check.get("byte_order") or order
        if kind != "none":
            size = 4 if kind.startswith("crc32") else 1 if kind.endswith("8") else 2
            places = (check.get("at"), check.get("low_at"))
            end = len(frame) - size if places[0] is None else min(places)
            found = _CHECKS[kind](bytes(frame[check["first"] : end]))
            if places[0] is not None:
                for at, word in zip(places, (found >> 16, found & 0xFFFF), strict=True):
                    frame[at : at + 2] = word.to_bytes(2, by)
            else:
                frame[end:] = found.to_bytes(size, by)
        return bytes(frame)


def _put(frame: bytearray, place: Mapping[str, Any], raw: float, order: Any, *, wraps: bool) -> None:
    """Write a number at its place; one too large is at its end, or begins anew where it `wraps`."""
    kind, at = place["type"], place["at"]
    if kind.startswith("float"):
        form = {"float32": "f", "float64": "d"}[kind]
        data = struct.pack(f"{'<' if order == 'little' else '>'}{form}", raw)
        frame[at : at + len(data)] = data
        return
    bits = int(kind.lstrip("uint"))
    low, high = (0, (1 << bits) - 1) if kind.startswith("u") else (-(1 << bits - 1), (1 << bits - 1) - 1)
    whole = round(max(-1e20, min(raw, 1e20)))
    if wraps:
        span = place.get("modulus") or high - low + 1
        whole = (whole - low) % span + low
    data = (max(low, min(whole, high)) & ((1 << bits) - 1)).to_bytes(bits // 8, order)
    if (low_at := place.get("low_at")) is not None:
        high_word, low_word = (data[:2], data[2:]) if order == "big" else (data[2:], data[:2])
        frame[at : at + 2], frame[low_at : low_at + 2] = high_word, low_word
    else:
        frame[at : at + len(data)] = data


def _crc(data: bytes, poly: int, found: int, width: int = 0) -> int:
    """Return a CRC bit by bit: of so many bits with the highest first, or the lowest first where `width` is 0."""
    top, mask = 1 << max(0, width - 1), (1 << width) - 1
    for each in data:
        found ^= each << max(0, width - 8)
        for _ in range(8):
            found = (found << 1 ^ (poly if found & top else 0)) & mask if width else found >> 1 ^ poly * (found & 1)
    return found


_CHECKS: Mapping[str, Callable[[bytes], int]] = {
    "sum8": lambda data: sum(data) % 256,
    "sum16": lambda data: sum(data) % 65536,
    "xor8": lambda data: reduce(xor, data, 0),
    "crc16-ccitt-false": lambda data: binascii.crc_hqx(data, 0xFFFF),
    "crc16-xmodem": lambda data: binascii.crc_hqx(data, 0),
    "crc16-kermit": lambda data: _crc(data, 0x8408, 0),
    "crc16-modbus": lambda data: _crc(data, 0xA001, 0xFFFF),
    "crc32": zlib.crc32,
    "crc32-mpeg2": lambda data: _crc(data, 0x04C11DB7, 0xFFFFFFFF, 32),
}
