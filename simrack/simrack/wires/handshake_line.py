"""RS-232 of SCPI instruments: a small input buffer, and a handshake by pins or by characters.

The User's Guides of 34401A and E3631A (their chapters on the remote interface) say the same. The instrument is a DTE
with DTR and DSR. Its input buffer holds about 100 characters. It drops DTR while that is full, and while it has an
answer to a line that has ended; a controller has to stop within 10 characters. It sends while its DSR is true. Ctrl-C
is device clear.

*Unverified*: that a character with an error is not taken; that what does not fit is error 521 (512, an overrun, is what
the receiver's circuit would find), once until there is room again; that a break is a framing error.
"""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from simrack.clock import Clock
from simrack.scpi import Dialect, ScpiError
from simrack.wires.serial_line import CharacterFrame, FarTable, LineEnd, ReceivedCharacter, heard

BUFFER = 100
"""Characters waiting from which on DTR is false."""
MARGIN = 10
"""Characters that still fit then."""
_OVERFLOW = 521
_CLEAR = 3
_XON, _XOFF = 0x11, 0x13
_SIGNALS = frozenset({_XON, _XOFF})


def line_of(dialect: Dialect) -> type[HandshakeLine]:
    """Return the kind of line that a model has."""
    return XonXoffLine if dialect.xonxoff else HandshakeLine


class _Engine(Protocol):
    """The message exchange of an instrument."""

    @property
    def busy(self) -> bool: ...
    def report(self, error: ScpiError) -> None: ...


class FarInstrument(FarTable, Protocol):
    """Device at the far end: every simulated SCPI instrument."""

    @property
    def engine(self) -> _Engine:
        """Its message exchange."""


class HandshakeLine(LineEnd):
    """The line of a SCPI instrument with the personality RS232: with its small buffer and its handshake."""

    holds: ClassVar[int] = BUFFER + MARGIN
    """Characters that fit."""

    def __init__(
        self, instrument: FarInstrument, clock: Clock, frame: CharacterFrame | None = None, *, by_message: bool = False
    ) -> None:
        super().__init__(instrument, clock, frame, by_message=by_message)
        self.instrument = instrument
        self._buffer = bytearray()
        self._lost = False

    @property
    def under_way(self) -> bool:
        """True if anything waits to be sent, to arrive, or to be taken by the parser."""
        return super().under_way or bool(self._buffer)

    @property
    def heeds(self) -> bool:
        """True if the controller looks at the pin."""
        return self._handshake

    @property
    def _takes(self) -> bool:
        """The instrument's DTR."""
        return len(self._buffer) < BUFFER and not self._to_controller

    @property
    def _sends(self) -> bool:
        """True if the instrument may send."""
        return self._dtr

    def _receive(self, character: ReceivedCharacter) -> None:
        """Take a character into the input buffer."""
        if character.error:
            self._complain(character.error)
        elif character.byte == _CLEAR:
            self._clear()
        elif len(self._buffer) < self.holds:
            self._lost = False
            self._buffer.append(character.byte)
        elif not self._lost:
            self._lost = True
            self._complain(_OVERFLOW)

    def _complain(self, number: int) -> None:
        self.instrument.engine.report(ScpiError(number))

    def _clear(self) -> None:
        self._buffer.clear()
        super()._clear()

    def _go_on(self, now_s: float) -> None:
        """Hand the parser all that it can take, the line its replies, and let both ends send on."""
        self._fetch()
        while self._buffer and (message := self._next_message()):
            del self._buffer[: len(message)]
            self._tell(message)
            self._fetch()
        if self._sends:
            self._to_controller.go_on(now_s)
        if self._takes or not self.heeds:
            self._to_instrument.go_on(now_s)

    def _next_message(self) -> bytes:
        """Return the message, or the part of one, that the parser takes now: while it is busy only a trigger."""
        size = self._buffer.find(b"\n") + 1
        if self._to_controller:
            return b""
        if self.instrument.engine.busy and self._buffer[:size].strip().upper() != b"*TRG":
            return b""
        return bytes(self._buffer[:size] if size else self._buffer)

    def _fetch(self) -> None:
        if not self._to_controller:
            self._answer()


class XonXoffLine(HandshakeLine):
    """The line of a Keithley 2000, set to XonXoFF: no pins, but characters that say when to stop, either way.

    XOFF is sent when the input queue is more than three quarters full, XON when it is less than half (User's Manuals of
    2000, 2700 and 2750, their sections on signal handshaking). *Unverified*: the size of the queue, which is a 6517B's.
    """

    holds: ClassVar[int] = 2048

    def __init__(self, *line: Any, **more: Any) -> None:
        self._full = self._held = self._halted = False
        super().__init__(*line, **more)

    @property
    def heeds(self) -> bool:
        """True if the controller knows the characters."""
        return self._xonxoff

    @property
    def _takes(self) -> bool:
        """True if the controller was not told to stop."""
        return not self._halted

    @property
    def _sends(self) -> bool:
        """True if the instrument was not told to stop; its own XON and XOFF it sends all the same."""
        return not self._held or self._to_controller.first in _SIGNALS

    def _arrive(self, byte: int) -> None:
        if self._xonxoff and byte in _SIGNALS:
            self._halted = byte == _XOFF
        else:
            super()._arrive(byte)

    def _receive(self, character: ReceivedCharacter) -> None:
        if character.byte in _SIGNALS and not character.error:
            self._held = character.byte == _XOFF
        else:
            super()._receive(character)

    def _clear(self) -> None:
        self._full = self._held = self._halted = False
        super()._clear()

    def _go_on(self, now_s: float) -> None:
        """Say when to stop, and when to go on."""
        filled = len(self._buffer)  # which does not shrink before an XOFF has left, for the parser waits for the line
        if filled < self.holds // 2 if self._full else filled > 3 * self.holds // 4:
            self._full = not self._full
            said = heard(bytes([_XOFF if self._full else _XON]), self.frame, self._controller)
            self._to_controller.put_first(said, self.frame.character_s)
        super()._go_on(now_s)
