"""RS-232 between a controller and a simulated device: characters that take time, settings that may not agree.

SCPI instruments have a small buffer and a handshake too (:mod:`simrack.wires.handshake_line`). A rate table has none of
that: its line (:class:`ThreeWireLine`) has three wires, and each character that comes whole is taken.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from typing import Literal, NamedTuple, Protocol

from msgspec import Struct

from simrack.clock import Clock

Parity = Literal["none", "even", "odd"]

_FRAMING = 511
_PARITY = 513
_PRINTABLE = 32
_WHOLE = 1 << 25


class CharacterFrame(Struct, frozen=True):
    """Frame of characters at an end of the line."""

    baud: float = 9600.0
    """Bits a second, start and stop bits counted."""
    data_bits: int = 8
    parity: Parity = "none"
    stop_bits: float = 2.0

    @property
    def character_s(self) -> float:
        """Time that a character takes, s."""
        return (1 + self.data_bits + (self.parity != "none") + self.stop_bits) / self.baud

    def bits(self, byte: int) -> list[int]:
        """Return the bits of `byte` on the line before the stop bits, start bit first."""
        data = [byte >> place & 1 for place in range(self.data_bits)]
        return [0, *data, *self._parity(data)]

    def _parity(self, data: list[int]) -> list[int]:
        return [] if self.parity == "none" else [sum(data) % 2 ^ (self.parity == "odd")]

    def received(self, bits: list[int]) -> ReceivedCharacter:
        """Return the character of `bits`, without start bit and with one stop bit."""
        data, rest = bits[: self.data_bits], bits[self.data_bits :]
        byte = sum(bit << place for place, bit in enumerate(data))
        if not rest[-1]:
            return ReceivedCharacter(byte, _FRAMING)
        return ReceivedCharacter(byte, 0 if rest[:-1] == self._parity(data) else _PARITY)


class ReceivedCharacter(NamedTuple):
    """A character as it came, and its error: 511 framing, 513 parity, 0 none."""

    byte: int
    error: int


def heard(data: bytes, sender: CharacterFrame, receiver: CharacterFrame) -> list[ReceivedCharacter]:
    """Return `data`, sent without a pause, as `receiver` reads it: it samples each bit in its middle, by its own clock.

    A second stop bit is not looked at, as in every receiver.
    """
    if sender == receiver:
        mask = (1 << receiver.data_bits) - 1
        return [ReceivedCharacter(byte & mask, 0) for byte in data]
    edges = _edges(data, sender)
    found: list[ReceivedCharacter] = []
    start_s = _falling(edges, -1.0)
    while not math.isinf(start_s):
        length = receiver.data_bits + (receiver.parity != "none") + 1
        samples = [_level(edges, start_s + (place + 1.5) / receiver.baud) for place in range(length)]
        found.append(receiver.received(samples))
        start_s = _falling(edges, start_s + (length + 0.5) / receiver.baud)
    return found


def _edges(data: bytes, sender: CharacterFrame) -> list[tuple[float, int]]:
    """Return the instants at which the line changes, and its new levels; it is high before and after."""
    edges: list[tuple[float, int]] = []
    for index, byte in enumerate(data):
        start_s = index * sender.character_s
        levels = [*sender.bits(byte), 1]
        for place, level in enumerate(levels):
            if level != (edges[-1][1] if edges else 1):
                edges.append((start_s + place / sender.baud, level))
    return edges


def _level(edges: list[tuple[float, int]], instant_s: float) -> int:
    index = bisect.bisect_right(edges, (instant_s, 2)) - 1
    return edges[index][1] if index >= 0 else 1


def _falling(edges: list[tuple[float, int]], after_s: float) -> float:
    """Return when the line next goes low, inf for never."""
    index = bisect.bisect_left(edges, (after_s, 0))
    return next((instant for instant, level in edges[index : index + 2] if not level), math.inf)


class _Traffic:
    """Characters on their way in one direction, one after the other."""

    __slots__ = ("_waiting", "next_s")

    def __init__(self) -> None:
        self._waiting: deque[tuple[ReceivedCharacter, float, bool]] = deque()
        """Characters, the time that each takes, and whether a program may act on it."""
        self.next_s = math.inf
        """When the one that is being sent will be there; inf while none is."""

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def first(self) -> int:
        """The character that is sent next, -1 for none."""
        return self._waiting[0][0].byte if self._waiting else -1

    @property
    def mark_s(self) -> float:
        """Instant of the next character that a program may act on: a control character, or the last of a message."""
        instant_s = self.next_s
        for place, (_, duration_s, marks) in enumerate(self._waiting):
            instant_s += duration_s if place else 0.0
            if marks:
                break
        return instant_s

    def add(self, characters: list[ReceivedCharacter], duration_s: float) -> None:
        """Have `characters`, a message, sent within `duration_s`."""
        last = len(characters) - 1
        for place, each in enumerate(characters):
            marks = place == last or bool(each.error) or each.byte < _PRINTABLE
            self._waiting.append((each, duration_s / len(characters), marks))

    def put_first(self, characters: list[ReceivedCharacter], duration_s: float) -> None:
        """Have `characters` sent before all that waits, behind the one that is being sent."""
        place = 0 if math.isinf(self.next_s) else 1
        for each in characters:
            self._waiting.insert(place, (each, duration_s, True))

    def go_on(self, now_s: float) -> None:
        """Begin with the next, unless one is being sent."""
        if self._waiting and math.isinf(self.next_s):
            self.next_s = now_s + self._waiting[0][1]

    def take(self) -> ReceivedCharacter:
        """Return the one that is there now."""
        self.next_s = math.inf
        return self._waiting.popleft()[0]

    def drop(self) -> None:
        """Forget everything."""
        self._waiting.clear()
        self.next_s = math.inf


class FarEnd(Protocol):
    """What a port is written to and read from: a `Device`, or the part of it that a port needs."""

    def write(self, data: bytes, /) -> None:
        """Take bytes."""

    def read(self, limit: int, /) -> tuple[bytes, bool]:
        """Return at most `limit` bytes that have come by now, and whether a message ends with them."""

    def wake_at(self) -> float | None:
        """Return when something happens next by itself, None for never."""


class FarTable(FarEnd, Protocol):
    """Device at the far end of a plain line: every simulated rate table."""

    def clear(self) -> None:
        """Drop input and output."""


class LineEnd:
    """A :class:`~simrack.device.Device` at the end of a serial line, seen from the controller.

    Args:
        instrument: what is there.
        clock: bench time.
        frame: what its port is set to; the controller's is the same until it is configured.
        by_message: whether bench time stops only where a message may end, at its last or a control character, which is
            cheaper. Each character arrives at its own instant, but nothing that waits for one wakes before that.
    """

    def __init__(
        self, instrument: FarTable, clock: Clock, frame: CharacterFrame | None = None, *, by_message: bool = False
    ) -> None:
        self._by_message = by_message
        self.frame = CharacterFrame() if frame is None else frame
        self._far = instrument
        self._clock = clock
        self._controller = self.frame
        self._handshake = True
        self._xonxoff = False
        self._dtr = True
        self._to_instrument = _Traffic()
        self._to_controller = _Traffic()
        self._arrived = bytearray()
        self._cut: ConnectionResetError | None = None

    # --- the controller's end -----------------------------------------------------------------------------

    def configure(self, frame: CharacterFrame, *, handshake: bool, xonxoff: bool = False) -> None:
        """Set the controller's end; with `handshake` it sends only while the instrument's DTR is true.

        With `xonxoff` it stops at an XOFF and goes on at an XON, which its program does not see.
        """
        self._advance()
        self._controller = frame
        self._handshake, self._xonxoff = handshake, xonxoff
        self._advance()

    @property
    def heeds(self) -> bool:
        """True if the controller stops when the instrument says so in its way."""
        return False

    @property
    def dtr(self) -> bool:
        """The controller's DTR, which the instrument has as its DSR: false holds its answers back."""
        return self._dtr

    @dtr.setter
    def dtr(self, state: bool) -> None:
        self._advance()
        self._dtr = state
        self._advance()

    @property
    def dsr(self) -> bool:
        """The controller's DSR, which is the instrument's DTR: whether it takes characters."""
        self._advance()
        return self._takes

    @property
    def next_s(self) -> float:
        """Instant at which the next character arrives at either end, inf while none is on its way."""
        return min(self._to_instrument.next_s, self._to_controller.next_s)

    @property
    def under_way(self) -> bool:
        """True if anything waits to be sent, or to arrive."""
        return bool(self._to_instrument or self._to_controller)

    @property
    def out_waiting(self) -> int:
        """Characters that the controller has not sent yet."""
        self._advance()
        return len(self._to_instrument)

    def drop_output(self) -> None:
        """Forget the controller's unsent bytes."""
        self._advance()
        self._to_instrument.drop()

    def send_break(self) -> None:
        """Hold the line low for longer than a character."""
        self._advance()
        self._receive(ReceivedCharacter(0, _FRAMING))

    # --- the seam: simrack.device.Device -------------------------------------------------------------

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Send bytes; a serial line has no END."""
        del end
        self._advance()
        sent = heard(data, self._controller, self.frame)
        if sent:
            self._to_instrument.add(sent, len(data) * self._controller.character_s)
        self._advance()
        self._require_link()

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return the bytes that have arrived by now; they never have an END."""
        self._advance()
        self._require_link()
        part = bytes(self._arrived[:limit])
        del self._arrived[:limit]
        return part, False

    def wake_at(self) -> float | None:
        """Return when the next character arrives at either end, or the instrument goes on."""
        self._advance()
        own, soonest = self._far.wake_at(), self._stop_s
        if own is not None and own > self._clock.now():
            soonest = min(soonest, own)
        return None if math.isinf(soonest) else soonest

    @property
    def _stop_s(self) -> float:
        """Next instant at which time has to stop for the line."""
        return min(self._to_instrument.mark_s, self._to_controller.mark_s) if self._by_message else self.next_s

    def clear(self) -> None:
        """Drop the bytes on their way and those that have arrived, and have the instrument drop its own."""
        self._clear()
        self._to_instrument.drop()
        self._arrived.clear()

    def status_byte(self) -> int:
        """Return 0: a serial line has no serial poll."""
        return 0

    def trigger(self) -> None:
        """Do nothing: a serial line has no group execute trigger."""

    # --- what goes on -------------------------------------------------------------------------------------

    def _require_link(self) -> None:
        """Tell the controller of a link that was lost: nobody else waiting when it is noticed."""
        error, self._cut = self._cut, None
        if error is not None:
            raise error

    def _tell(self, data: bytes) -> None:
        """Give the instrument the bytes that have arrived; without a link they are lost."""
        try:
            self._far.write(data)
        except ConnectionResetError as error:
            self._cut = error

    def _advance(self) -> None:
        """Let everything arrive that has by now."""
        now = self._clock.now()
        self._go_on(now)
        while (instant := self.next_s) <= now:
            if self._to_controller.next_s == instant:
                self._arrive(self._to_controller.take().byte)
            else:
                self._receive(self._to_instrument.take())
            self._go_on(instant)

    def _arrive(self, byte: int) -> None:
        """Take a character that has arrived at the controller."""
        self._arrived.append(byte)

    def _answer(self) -> None:
        """Put an answer that is ready on the line."""
        try:
            answer, _ = self._far.read(_WHOLE)
        except ConnectionResetError as error:
            self._cut = error
            return
        sent = heard(answer, self.frame, self._controller) if answer else []
        if sent:
            self._to_controller.add(sent, len(answer) * self.frame.character_s)

    def _clear(self) -> None:
        self._to_controller.drop()
        try:
            self._far.clear()
        except ConnectionResetError as error:
            self._cut = error

    @property
    def _takes(self) -> bool:
        """The instrument's DTR."""
        raise NotImplementedError

    def _receive(self, character: ReceivedCharacter) -> None:
        """Take a character that has arrived at the instrument."""
        raise NotImplementedError

    def _go_on(self, now_s: float) -> None:
        """Let both ends begin to send."""
        raise NotImplementedError


class ThreeWireLine(LineEnd):
    """Three wires to a device that takes every character as it comes, also while it sends: a rate table.

    A character with an error is dropped (unverified of every table).
    """

    @property
    def _takes(self) -> bool:
        return True

    def _receive(self, character: ReceivedCharacter) -> None:
        if not character.error:
            self._tell(bytes([character.byte]))

    def _go_on(self, now_s: float) -> None:
        self._answer()
        self._to_controller.go_on(now_s)
        self._to_instrument.go_on(now_s)
