"""A connection that several readers share: each gets all bytes, and drops its own alone."""

from __future__ import annotations

import pytest

from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.streams.shared import sharing
from vcfbench.drivers.wire import Interface
from vcfbench.errors import DeadlineExceeded


class Port:
    interface: Interface = "serial"

    def __init__(self) -> None:
        self.coming: list[bytes] = []
        self.opened = self.closed = 0

    def connect(self, _: Deadline) -> Port:
        self.opened += 1
        return self

    def send(self, data: bytes, _: Deadline) -> None:
        self.coming.append(data)

    def receive(self, _: Deadline) -> tuple[bytes, bool]:
        if not self.coming:
            raise DeadlineExceeded("no answer")
        return self.coming.pop(0), False

    def pending(self) -> bytes:
        return self.coming.pop(0) if self.coming else b""

    def clear(self, _: Deadline) -> None:
        self.coming.clear()

    def close(self) -> None:
        self.closed += 1


def test_bytes_that_one_reader_receives_are_there_for_the_others() -> None:
    port, share, deadline = Port(), sharing(), Deadline.after(VirtualClock(), 1.0)
    one, other = (share("COM3", port.connect)(deadline) for _ in range(2))
    port.coming = [b"ab", b"cd"]
    assert one.receive(deadline) == (b"ab", False)
    assert one.receive(deadline) == (b"cd", False)
    assert other.receive(deadline) == (b"abcd", False)
    with pytest.raises(DeadlineExceeded):
        other.receive(deadline)
    assert port.opened == 1


def test_a_reader_drops_its_own_bytes_alone() -> None:
    port, share, deadline = Port(), sharing(), Deadline.after(VirtualClock(), 1.0)
    one, other = (share("COM3", port.connect)(deadline) for _ in range(2))
    port.coming = [b"ab"]
    one.clear(deadline)
    assert one.pending() == b""
    assert other.pending() == b"ab"


def test_the_connection_is_closed_with_its_last_reader() -> None:
    port, share, deadline = Port(), sharing(), Deadline.after(VirtualClock(), 1.0)
    ends = [share("COM3", port.connect)(deadline) for _ in range(2)]
    ends[0].close()
    assert port.closed == 0
    ends[1].close()
    ends[1].close()
    assert port.closed == 1
