"""Frames without a counter: those that are missing are told by the time that the others take."""

from __future__ import annotations

import math
from random import Random
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.streams.description import FrameCheck, FrameCounter, FrameQuantity, Stream
from vcfbench.drivers.streams.reader import StreamReader

if TYPE_CHECKING:
    from vcfbench.drivers.wire import Interface

HZ = 50.0
LINES = Stream(resource="sim", sample_rate_hz=HZ, columns=1, value=FrameQuantity(column=1), resolution=1e-6)


class Lines:
    """A device that sends lines, of which a share is missing, each up to `late_s` late."""

    interface: Interface = "serial"

    def __init__(self, clock: VirtualClock, missing: float, late_s: float, seed: int) -> None:
        self.clock, self.missing, self.late_s, self.random = clock, missing, late_s, Random(seed)  # noqa: S311
        self.number = 0

    def connect(self, _: Deadline) -> Lines:
        return self

    def receive(self, _: Deadline) -> tuple[bytes, bool]:
        while True:
            self.number += 1
            if self.random.random() >= self.missing:
                break
        arrives_s = self.number / HZ + self.random.uniform(0.0, self.late_s)
        self.clock.sleep_until(max(arrives_s, self.clock.now()))
        return f"{self.random.gauss(0.0, 1.0):.6f}\r\n".encode(), False

    def clear(self, _: Deadline) -> None:
        self.number = max(self.number, math.ceil(self.clock.now() * HZ))

    def send(self, data: bytes, _: Deadline) -> None:
        raise AssertionError(data)

    def pending(self) -> bytes:
        return b""

    def close(self) -> None:
        pass


@pytest.mark.parametrize("late_s", few([0.0, 0.016], every=3))
@pytest.mark.parametrize("missing", [0.0, 0.01, 0.05])
def test_missing_lines_are_told_by_time(missing: float, late_s: float) -> None:
    clock = VirtualClock()
    line = Lines(clock, missing, late_s, seed=3)
    reader = StreamReader("stream", "sim", line.connect, LINES, clock)
    readings = 200
    for number in range(readings):
        clock.sleep_until(number * 1.0)
        reader.read_voltage_v()
    seen = reader.health()
    between = readings * (round(LINES.aperture_s * HZ) - 1)
    due = between * missing / (1.0 - missing)
    assert seen["u_dropped"] < 0.004 * between
    assert abs(seen["dropped"] - due) <= 3.0 * seen["u_dropped"] + 0.5
    assert (seen["u_dropped"] > 0.0) == (bool(missing) or bool(late_s))


class Frames(Lines):
    """The same in bytes, with a number each; the first bytes after a wait are the end of a frame."""

    def __init__(self, clock: VirtualClock, missing: float, stream: Stream, seed: int) -> None:
        super().__init__(clock, missing, 0.0, seed)
        self.stream, self.fresh = stream, True

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        super().receive(deadline)
        body = bytes.fromhex(self.stream.header) + bytes([self.number % 256]) + self.random.randbytes(2)
        sent = body + bytes([sum(body) & 0xFF if self.stream.checksum.name == "sum8" else 0])
        first, self.fresh = self.fresh, False
        return (sent[3:] if first else sent), False

    def clear(self, deadline: Deadline) -> None:
        super().clear(deadline)
        self.fresh = True


@pytest.mark.parametrize("header", few(["A5 5A", "5A"], every=6))
@pytest.mark.parametrize("checksum", ["none", "sum8"])
@pytest.mark.parametrize("missing", [0.0, 0.02, 0.05])
def test_clock_is_on_time_behind_missing_frames(missing: float, checksum: str, header: str) -> None:
    first = len(bytes.fromhex(header))
    stream = Stream(
        resource="sim",
        sample_rate_hz=HZ,
        header=header,
        length=first + 4,
        checksum=FrameCheck(name=checksum),
        counter=FrameCounter(at=first, type="uint8"),
        value=FrameQuantity(at=first + 1),
        clock_ppm=0.0,
    )
    for seed in range(20):
        clock = VirtualClock()
        reader = StreamReader("stream", "sim", Frames(clock, missing, stream, seed).connect, stream, clock)
        for number in range(4):
            clock.sleep_until(1.0 + number)
            reader.read_voltage_v()
            off_ppm = reader.health()["clock_ppm"]
            assert off_ppm is None or abs(off_ppm) < 1.0  # no frame is late
