"""A device for a server: ends of its messages, pending work, unasked output."""

from __future__ import annotations

from simrack.device import Device
from simrack.rate_tables.line import LineDevice
from simrack.scpi import Interface, ScpiError, ScpiTwin
from simrack.serve.clock import ServedClock
from simrack.serve.framing import answer_of, empty_messages, message_sizes, no_answer

SOCKET = Interface("lan", message_exchange=False)
CONVERTER = Interface("converter", message_exchange=False, break_byte=b"\x03")
"""The socket of a converter, behind which a GPIB or serial instrument is: both have a device clear."""
HISLIP = Interface("hislip", message_exchange=False)
VXI11 = Interface("vxi11")

_KNOWN_MESSAGES = 2048
_KNOWN_LENGTH = 256
_LONGEST_LINE = 1 << 16
_NEVER_KNOWN = (b"#", b"\x03", b"++")
"""What is in messages that must be looked at each time: blocks, breaks, words to a converter."""


class EmbodiedDevice:
    """A device at its place on the bench, where another specimen may be put."""

    def __init__(self, role: str, device: Device, clock: ServedClock) -> None:
        self.role = role
        self.clock = clock
        self.known: dict[bytes, bool] = {}
        """Whole messages seen before: whether they ask something."""
        self._embody(device)

    def _embody(self, device: Device) -> None:
        """Be `device` from now on."""
        self.device = device
        self.engine = device.engine if isinstance(device, ScpiTwin) else None
        limit = _LONGEST_LINE if self.engine is None else self.engine.dialect.input_limit
        self.longest = limit + 8
        self.message_size, self.line_size = message_sizes(device)
        self.binary = isinstance(device, LineDevice) and not device.terminators
        """Whether every byte may be part of a message: none means a break."""
        self.blank = empty_messages(device)
        """Finds the ends of messages without anything before them, which mean nothing."""
        self._wake_at = device.wake_at
        self.power(on=True)
        self.speaks = self.engine is None and device.wake_at() is not None
        """Whether it says something unasked, so that a client may wait for it without a word."""

    def power(self, *, on: bool) -> None:
        """Set whether the instrument takes and sends messages."""
        if on:
            self._write, self._read, self._answer = self.device.write, self.device.read, answer_of(self.device)
        else:
            self._write, self._read = (lambda _data, **_end: None), (lambda limit: (b"", False))  # noqa: ARG005
            self._answer = no_answer

    def asks(self, message: bytes) -> bool:
        """True if `message` may be answered; remembers messages, which are mostly the same few."""
        if self.engine is None:
            return True
        asks = b"?" in message
        if len(message) <= _KNOWN_LENGTH and message not in self.known and message.endswith(b"\n"):
            if len(self.known) >= _KNOWN_MESSAGES:
                self.known.clear()
            if message.count(b"\n") == 1 and not any(mark in message for mark in _NEVER_KNOWN):
                self.known[message] = asks
        return asks

    def complain(self, number: int) -> None:
        """Queue an error of the message exchange that the transport has seen."""
        if self.engine is not None:
            self.engine.report(ScpiError(number))

    @property
    def busy(self) -> bool:
        """True if the device works on a message."""
        if self.engine is not None:
            return self.engine.busy
        if self.speaks:
            return False
        if isinstance(self.device, LineDevice):
            return self.device.answering  # not merely turning
        return self.device.wake_at() is not None
