"""Common base of the simulated tables' wires: messages cut at a terminator, replies in the table's own time.

What characters take is the wire's: nothing on a socket, and on a serial line what
:class:`~simrack.wires.serial_line.ThreeWireLine` makes of it.
"""

from __future__ import annotations

import math
import re
from collections import deque

from msgspec import Struct

from simrack.rate_tables.axis import TableWorld
from simrack.wires.serial_line import CharacterFrame


class SerialTiming(Struct, frozen=True):
    """Settings of a table's serial port, and the controller's own time."""

    baud: float
    """Line speed, Bd (8N1)."""
    processing_s: float
    """Time from the last byte of a message to the first of its reply, s (unverified for every table)."""

    @property
    def frame(self) -> CharacterFrame:
        """The port's characters: 8 data bits, no parity, 1 stop bit."""
        return CharacterFrame(self.baud, stop_bits=1.0)


class LineDevice:
    """A `Device` that answers lines.

    A message acts when its terminator is handed over, which is when it has arrived. Its reply comes after the
    controller's own time. Replies keep their order.
    """

    _quiet_until_s = -math.inf
    """Up to when nothing happens by itself, unless the device or its table is told something."""

    def __init__(self, world: TableWorld, timing: SerialTiming, *, terminators: bytes, longest: int) -> None:
        self._clock = world.clock
        self._table = world.table
        self._commands_known = 0
        self._timing = timing
        self._terminators = terminators
        self._message_end = re.compile(b"[%b]" % re.escape(terminators) if terminators else b"(?!)")
        self._longest = longest
        self._input = bytearray()
        self._overflowed = False
        self._output: deque[tuple[float, bytearray]] = deque()

    @property
    def frame(self) -> CharacterFrame:
        """Character frame of its serial port."""
        return self._timing.frame

    @property
    def terminators(self) -> bytes:
        """Ends of a message; with nothing before it, an end does nothing."""
        return self._terminators

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller; `end` terminates a message like its terminator."""
        self._up_to_now()
        if not self._only_asks(data):
            self._quiet_until_s = -math.inf
        begun = 0
        for stop in self._message_end.finditer(data):
            self._take(data[begun : stop.start()])
            self._finish_message()
            begun = stop.end()
        self._take(data[begun:])
        if end:
            self._finish_message()

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return at most `limit` bytes of the replies that are complete by now, and whether a reply ends there."""
        now = self._up_to_now()
        if not self._output or self._output[0][0] > now:
            return b"", False
        reply = self._output[0][1]
        part = bytes(reply[:limit])
        del reply[:limit]
        if not reply:
            self._output.popleft()
        return part, not reply

    def wake_at(self) -> float | None:
        """Do everything due; return when the next reply is complete or something happens by itself, None for never.

        A reply that is complete and not read yet must not hide what happens later.
        """
        now = self._clock.now()
        if now >= self._quiet_until_s or self._table.commands != self._commands_known:
            self._advance()
            self._quiet_until_s = min(self._own_events_s(), default=math.inf)
            self._commands_known = self._table.commands
        next_s = self._quiet_until_s
        for ready_s, _ in self._output:
            if now < ready_s < next_s:
                next_s = ready_s
        if next_s < math.inf:
            return next_s
        return self._output[0][0] if self._output else None

    def _up_to_now(self) -> float:
        """Do what is due, unless nothing can have happened since it was last looked at; return the time."""
        now = self._clock.now()
        if now >= self._quiet_until_s or self._table.commands != self._commands_known:
            self._advance()
        return now

    @property
    def answering(self) -> bool:
        """True if a reply is under way or waits to be read; motion by itself does not count."""
        return bool(self._output)

    def clear(self) -> None:
        """Drop input and output; settings and motion stay."""
        self._input.clear()
        self._output.clear()
        self._overflowed = False

    def status_byte(self) -> int:
        """Return 0: a serial line has no serial poll."""
        return 0

    def trigger(self) -> None:
        """Do nothing: a serial line has no group execute trigger."""

    def _take(self, part: bytes) -> None:
        """Take as much of a part of a message as fits."""
        room = self._longest - len(self._input)
        self._input += part[:room]
        self._overflowed = self._overflowed or len(part) > room

    def _finish_message(self) -> None:
        message, overflowed = bytes(self._input), self._overflowed
        self._input.clear()
        self._overflowed = False
        if overflowed:
            self._send(self._overflow())
        elif message:
            self._send(self._answer(message))

    def _send(self, reply: bytes | None, late_s: float = 0.0) -> None:
        """Say `reply` after the controller's own time, and `late_s`; none overtakes another."""
        if not reply:
            return
        now = self._clock.now() + late_s
        started = self._output[-1][0] if self._output else now
        self._output.append((max(now, started) + self._timing.processing_s, bytearray(reply)))

    def _advance(self) -> None:
        """Bring everything that happens by itself up to now; changes from outside forget the quiet first."""

    def _only_asks(self, data: bytes) -> bool:
        """Return True if bytes are sure to change nothing that happens by itself: a whole message that asks."""
        del data
        return False

    def _own_events_s(self) -> tuple[float, ...]:
        """Return the future instants at which :meth:`_advance` will have something to do, as far as known."""
        return ()

    def _answer(self, message: bytes) -> bytes | None:
        """Act on one message; return the reply as sent, terminator included, or None."""
        raise NotImplementedError

    def _overflow(self) -> bytes | None:
        """Return the reply to a message that was too long and is lost."""
        return None
