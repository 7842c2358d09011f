"""Wires that move bytes: the seam below sessions and rate-table lines."""

import re
from typing import Literal, Protocol

from msgspec import Struct

from vcfbench.clock import Deadline
from vcfbench.errors import DeadlineExceeded

_ADAPTER = re.compile(r"PRLGX-[A-Z]+(\d*)::", re.IGNORECASE)
_BOARD = re.compile(r"GPIB(\d*)::", re.IGNORECASE)
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
    """Return the rest of `deadline`, s; raises DeadlineExceeded after it."""
    left = deadline.expires_s - deadline.clock.now()
    if left <= 0.0:
        raise DeadlineExceeded("the time is up")
    return left


def adapters(library: str) -> dict[str, str]:
    """Return the GPIB adapters in the name of a VISA library, by the number of their interface.

    ``PRLGX-TCPIP0::192.168.1.9::1234::INTFC@py`` has that of GPIB0, by PyVISA's name for it; several have commas
    between them.
    """
    named = (each.strip() for each in library.partition("@")[0].split(","))
    return {found[1] or "0": each for each in named if (found := _ADAPTER.match(each))}


def behind(resource: str, library: str) -> tuple[str | None, str]:
    """Return the GPIB adapter that `resource` is behind, None for none, and the VISA library without its adapters."""
    known, board = adapters(library), _BOARD.match(resource.strip())
    through = None if board is None else known.get(board[1] or "0")
    return through, f"@{library.partition('@')[2] or 'py'}" if known else library


def is_simulated(opened: str) -> bool:
    """Return True for a VISA library of simulated instruments (ours, PyVISA-sim), and for a simulated serial port."""
    return opened.endswith(("@vcfbench", "@simrack", "@sim")) or opened.lower().startswith("sim://")


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
        """Return unasked bytes of a stream without waiting; none if the interface cannot."""

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear where the interface has one, and drop received bytes."""

    def close(self) -> None:
        """Give the connection back."""
