"""Wires that move bytes: the seam below sessions and rate-table lines."""

from typing import Literal, Protocol

from msgspec import Struct

from vcfbench.clock import Deadline
from vcfbench.errors import DeadlineExceeded

Interface = Literal["gpib", "usb", "instr", "socket", "asrl", "serial"]


class SerialLine(Struct, frozen=True):
    """The line of an instrument on a serial port, by default the E3631A's as shipped (guide p. 66).

    Any object with these fields serves.
    """

    baud_rate: int = 9600
    data_bits: int = 8
    parity: str = "none"
    stop_bits: int = 2
    flow_control: str = "dtr_dsr"


def left_s(deadline: Deadline) -> float:
    """Return the rest of `deadline`, s; raises DeadlineExceeded if there is none."""
    left = deadline.expires_s - deadline.clock.now()
    if left <= 0.0:
        raise DeadlineExceeded("the time is up")
    return left


class Wire(Protocol):
    """An open connection to one instrument.

    Every method raises a :class:`~vcfbench.errors.TransportError`: `DeadlineExceeded` when the time is up,
    `LinkLost` when the connection broke. The callers add who and where.
    """

    @property
    def interface(self) -> Interface:
        """Kind of the connection (``instr``: VXI-11 or HiSLIP)."""

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return at least one byte, and True if the instrument marked the last one as the end of its message."""

    def pending(self) -> bytes:
        """Take unasked bytes of a stream, without waiting; empty where the interface cannot tell."""

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear where the interface has one, and drop received bytes."""

    def close(self) -> None:
        """Give the connection back."""
