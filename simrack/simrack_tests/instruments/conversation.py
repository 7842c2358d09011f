"""A controller in a few lines: writes, waits in bench time, reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simrack.clock import Clock
    from simrack.device import Device


class Conversation:
    """Talks to one device over END-terminated messages."""

    def __init__(self, device: Device, clock: Clock) -> None:
        self.device = device
        self.clock = clock

    def write(self, message: str) -> None:
        self.device.write(message.encode("latin-1") + b"\n", end=True)

    def read(self, timeout_s: float = 600.0) -> str | None:
        """The next response without its terminator, None when nothing comes in time."""
        deadline = self.clock.now() + timeout_s
        while True:
            data, _ = self.device.read(1 << 20)
            if data:
                return data.decode("latin-1").rstrip("\r\n")
            wake = self.device.wake_at()
            if wake is None or wake > deadline:
                self.clock.sleep_until(deadline)
                return None
            self.clock.sleep_until(wake)

    def ask(self, message: str) -> str | None:
        self.write(message)
        return self.read()

    def settle(self) -> None:
        """Wait until nothing happens by itself any more."""
        while (wake := self.device.wake_at()) is not None:
            self.clock.sleep_until(wake)

    def errors(self) -> list[int]:
        """Empty the error queue."""
        self.settle()
        numbers: list[int] = []
        while (entry := self.ask("SYST:ERR?") or "") != '+0,"No error"':
            numbers.append(int(entry.partition(",")[0]))
        return numbers

    def refusals(self, message: str) -> list[int]:
        """Send a message that should be refused and return the error numbers."""
        self.write(message)
        return self.errors()
