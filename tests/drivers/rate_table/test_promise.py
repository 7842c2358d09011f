"""The line's promise, as the session's: a reading is the one asked for, or there is none."""

from __future__ import annotations

import struct
from collections import deque
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack_tests.cells import few

from vcfbench.clock import VirtualClock, sleep
from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.dialect import TableSettings
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import DeadlineExceeded, TransportError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.clock import Deadline
    from vcfbench.drivers.rate_table.acl import Header
    from vcfbench.drivers.wire import Interface

IDENTITY = "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"


class SlowTable:
    """Answers in order, late, not always, not always whole; the n-th reading of the rate is n."""

    def __init__(self, clock: VirtualClock, moods: Sequence[tuple[float, str]], header: Header) -> None:
        self.interface: Interface = "serial"
        self.readings = 0
        self._clock = clock
        self._moods = deque(moods)
        self._header = header
        self._free_s = 0.0
        self._coming: deque[tuple[float, bytes]] = deque()

    def send(self, data: bytes, deadline: Deadline) -> None:
        del deadline
        delay_s, mood = self._moods.popleft() if self._moods else (0.0, "well")
        self._free_s = max(self._free_s, self._clock.now()) + delay_s
        answer = self._framed(self._answer(data.decode().strip()))
        shapes = {"well": answer, "lost": b"", "cut": answer[:-3], "twice": answer * 2}
        if shapes[mood]:
            self._coming.append((self._free_s, shapes[mood]))

    def _answer(self, question: str) -> str:
        if question == "*IDN?":
            return IDENTITY
        if question == ":Read:Rate? 1":
            self.readings += 1
            return f"{self.readings}.5"
        return "0"

    def _framed(self, text: str) -> bytes:
        body = text.encode() + b"\r\n"
        return body if self._header == "none" else struct.pack("<II", 0, len(body)) + body

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        if not self._coming or self._coming[0][0] > deadline.expires_s:
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        at_s, data = self._coming.popleft()
        self._clock.sleep_until(at_s)
        return data, False

    def pending(self) -> bytes:
        data = b""
        while self._coming and self._coming[0][0] <= self._clock.now():
            data += self._coming.popleft()[1]
        return data

    def clear(self, deadline: Deadline) -> None:
        del deadline

    def close(self) -> None: ...


MOODS = st.tuples(
    st.sampled_from([0.0, 0.0, 0.0, 0.4, 0.9, 1.1, 2.5]),
    st.sampled_from(["well", "well", "well", "lost", "cut", "twice"]),
)


@pytest.mark.parametrize("header", few(["none", "u32le2"], every=2))
@settings(max_examples=80)
@given(moods=st.lists(MOODS, max_size=12), count=st.integers(min_value=1, max_value=10))
def test_reading_is_of_its_query_or_error(header: Header, moods: list[tuple[float, str]], count: int) -> None:
    clock = VirtualClock()
    wire = SlowTable(clock, [(0.0, "well"), *moods], header)
    line = TableLine(wire, name="rate_table", resource="X", clock=clock, timeout_s=1.0)
    dialect = AclDialect(TableSettings())
    dialect.identify(line, line.deadline())
    for n in range(count):
        begin_s = clock.now()
        try:
            rate_deg_s = dialect.rate_deg_s(line, line.deadline())
        except TransportError:
            pass
        else:
            assert rate_deg_s == wire.readings + 0.5
        assert clock.now() - begin_s <= 1.0 + 1e-9
        if n % 3 == 2:
            sleep(clock, 3.0)
