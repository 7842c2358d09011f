"""A pseudo-terminal with the properties of RS-232: time, a small buffer, a handshake, a speed to agree on.

A pseudo-terminal has no pins and no parity. Its speed can be seen, and whether it heeds XON and XOFF; they are the
client's. The handshake is what such a terminal has: it is not read while the instrument's DTR is false, or after its
XOFF, so that the client's writing comes to a halt.
"""

from __future__ import annotations

from simrack.scpi import ScpiError
from simrack.serve.instrument import ServedInstrument
from simrack.serve.loop import Loop
from simrack.serve.raw import Pty
from simrack.wires.handshake_line import line_of
from simrack.wires.serial_line import CharacterFrame, LineEnd, ThreeWireLine

_USUAL_BAUD = 9600
_SLOW_BAUDS = (300, 600, 1200, 1800, 2400, 4800, _USUAL_BAUD, 19200, 38400)
_BAUDS = (*_SLOW_BAUDS, 57600, 115200, 230400, 460800, 921600)
"""Speeds that the instruments have, and those of clients that are wrong."""
_CHUNK = 1 << 16


class SerialPty(Pty):
    """A terminal with a real serial line behind it.

    Args:
        handshake: whether the cable has the pins for it; without, what does not fit into the instrument is lost.
    """

    def __init__(self, loop: Loop, instrument: ServedInstrument, *, handshake: bool) -> None:
        super().__init__(loop, instrument)
        self._handshake = handshake
        self._answers = bytearray()
        self._inside = False
        self._line = self._new_line()
        instrument.lines.append(self)

    @property
    def next_s(self) -> float:
        """The bench time at which the next character arrives, inf while none is on its way."""
        return self._line.next_s

    @property
    def awaited(self) -> bool:
        """True if anything waits to be sent, to arrive, or to be taken, and nobody says when time may go on."""
        return self._line.under_way and not self.heard

    def go_on(self) -> None:
        """Let bytes arrive that are due by now, at either end."""
        self._exchange(b"")

    def deliver(self, data: bytes, *, end: bool) -> None:
        """Take an answer, which the line will carry."""
        del end
        self._answers += data
        self.go_on()

    def relieved(self) -> None:
        """Do nothing: the line knows its free room."""

    def start_anew(self) -> None:
        """Forget the bytes on their way too."""
        self._answers.clear()
        self._line = self._new_line()
        self._held_back = False
        self._watch()
        super().start_anew()

    def take_answers(self) -> bytes:
        """Return the answers of the instrument."""
        answers = bytes(self._answers)
        self._answers.clear()
        return answers

    def _new_line(self) -> LineEnd:
        """Return the line to a SCPI instrument, or to a rate table, which has no handshake and no small buffer."""
        far, clock = _Far(self), self.instrument.clock
        if (engine := self.instrument.engine) is not None:
            return line_of(engine.dialect)(far, clock)
        return ThreeWireLine(far, clock, getattr(self.instrument.device, "frame", CharacterFrame(stop_bits=1.0)))

    def _received(self, data: bytes) -> None:
        self.taken += len(data)
        self._exchange(data)

    def _exchange(self, data: bytes) -> None:
        if self._inside:
            return
        self._inside = True
        import termios  # noqa: PLC0415  (there is none on Windows)

        # the client's settings, as far as a pseudo-terminal shows them
        settings = termios.tcgetattr(self._slave)
        speed = next((baud for baud in _BAUDS if getattr(termios, f"B{baud}", None) == settings[5]), _USUAL_BAUD)
        self._line.configure(
            CharacterFrame(float(speed), stop_bits=2.0 if settings[2] & termios.CSTOPB else 1.0),
            handshake=self._handshake,
            xonxoff=bool(settings[0] & termios.IXON),
        )
        if data:
            self._line.write(data)
        arrived, _ = self._line.read(_CHUNK)
        waiting = self._line.out_waiting
        self._inside = False
        if arrived:
            super().deliver(arrived, end=False)
        self._held_back = waiting > 0 and self._line.heeds
        self._watch()
        self.instrument.touched()


class _Far:
    """The instrument at the far end, which other connections may share."""

    def __init__(self, pty: SerialPty) -> None:
        self._pty = pty

    @property
    def engine(self) -> _Far:
        return self

    @property
    def busy(self) -> bool:
        instrument = self._pty.instrument
        return bool(self._pty.backlog) or instrument.busy or instrument.holder is not None

    def report(self, error: ScpiError) -> None:
        self._pty.instrument.complain(error.number)

    def write(self, data: bytes) -> None:
        self._pty.take(data)

    def read(self, limit: int) -> tuple[bytes, bool]:
        del limit
        return self._pty.take_answers(), False

    def wake_at(self) -> float | None:
        return None  # the server looks in on the instrument by itself

    def clear(self) -> None:
        self._pty.instrument.clear(self._pty)
