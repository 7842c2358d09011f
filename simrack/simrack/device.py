"""The interface between a simulated instrument and the wire that carries its bytes.

The VISA backend, the pyserial URL handler, TCP servers and ptys are all thin loops around a `Device`.
"""

from __future__ import annotations

from typing import Protocol


class Device(Protocol):
    """A simulated instrument, seen from its connector. Everything happens at `clock.now()`; nothing here waits."""

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller; `end` is the END message (EOI) with the last of them."""

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return at most `limit` output bytes that are ready now, and True if END comes with the last of them."""

    def wake_at(self) -> float | None:
        """Return the bench time of the next event without a message, or None.

        A transport that found nothing to read waits until then (or its own time-out) and reads again.
        """

    def clear(self) -> None:
        """Device clear: drop input, output and the running measurement; settings stay."""

    def status_byte(self) -> int:
        """Serial poll: the status byte with RQS, which it clears."""

    def trigger(self) -> None:
        """Group execute trigger."""
