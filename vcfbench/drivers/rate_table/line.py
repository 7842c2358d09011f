"""The line to a rate table: whatever pyserial opens by URL, with deadlines."""

from __future__ import annotations

import re
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, Struct

from vcfbench.clock import Deadline, WallClock, sleep, within
from vcfbench.drivers.trace import tapping
from vcfbench.errors import ConnectFailed, DeadlineExceeded, FramingError, LinkLost, OutOfSync, TransportError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

    import serial

    from vcfbench.clock import Clock
    from vcfbench.drivers.wire import Interface, Wire

_LINE_END = re.compile(rb"\r\n|\r|\n")
_BLIND_S = 0.3
"""Wall time that sending words blind may take."""

_LONGEST_LINE = 32_768
_LOST = "the answers no longer belong to the questions"
"""The longest message of any table's language known so far (ACL manual, section 2)."""


Pause = Annotated[float, Meta(ge=0.0, le=60.0)]
"""A wait that a profile may ask for, s."""


class Link(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Set-up of a serial line, and the ends of text lines on it."""

    baud: Annotated[int, Meta(ge=300, le=921_600)] = 9600
    data_bits: Literal[7, 8] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1
    flow: Literal["none", "rts_cts", "dsr_dtr", "xon_xoff"] = "none"
    dtr: bool | None = None
    rts: bool | None = None
    open_delay_s: Pause = 0.0
    gap_s: Pause = 0.0
    tx_end: str = "\r\n"
    rx_end: Annotated[str, Meta(min_length=1)] = "\r\n"
    echo: Literal["none", "optional", "always"] = "none"
    prompt: str | None = None


def open_line(url: str, *, clock: Clock, name: str, timeout_s: float, baud_rate: int = 9600) -> TableLine:
    """Open a serial port by its name or URL (``/dev/ttyUSB0``, ``COM3``, ``socket://host:port``), 8N1.

    Raises:
        ConnectFailed: there is no such port, it is in use, or nobody answers there.
    """
    tap = tapping(name, url, clock)

    def connect(_: Deadline) -> Wire:
        import serial  # noqa: PLC0415 - loaded when first needed

        try:
            port = serial.serial_for_url(url, do_not_open=True, timeout=timeout_s, write_timeout=timeout_s)
            port.baudrate = baud_rate
            if isinstance(port, serial.Serial):
                port.exclusive = True  # one owner a connection; only real ports know how
            port.open()
        except Exception as error:  # termios.error is no OSError, and the handler of a URL is anyone's code
            raise ConnectFailed(f"cannot be opened ({' '.join(str(error).split())})") from error
        return tap(SerialWire(port))

    try:
        wire = connect(Deadline.after(clock, timeout_s))
    except TransportError as error:
        error.instrument, error.resource = name, url
        raise
    return TableLine(wire, name=name, resource=url, clock=clock, timeout_s=timeout_s, reconnect=connect)


class SerialWire:
    """A wire over an open pyserial port."""

    interface: Interface = "serial"

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`."""
        import serial  # noqa: PLC0415

        try:
            self._port.write_timeout = _left(deadline)
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise DeadlineExceeded("the table does not take the command") from error
        except OSError as error:
            raise _lost(error) from error

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the received bytes, waiting for the first."""
        try:
            self._port.timeout = _left(deadline)
            first = self._port.read(1)
            data = first + self._port.read(self._port.in_waiting) if first else first
        except OSError as error:
            raise _lost(error) from error
        if not data:
            raise DeadlineExceeded("no answer")
        return data, False

    def pending(self) -> bytes:
        """Take unasked bytes; a port on a socket never says that more than one byte waits."""
        data = b""
        try:
            while len(data) < _LONGEST_LINE and (waiting := self._port.in_waiting):
                data += self._port.read(waiting)
        except OSError as error:
            raise _lost(error) from error
        return data

    def clear(self, deadline: Deadline) -> None:
        """Drop received bytes; tables know no device clear."""
        while not deadline.expired() and self.pending():
            pass

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def _left(deadline: Deadline) -> float:
    left = deadline.remaining()
    if left <= 0.0:
        raise DeadlineExceeded("the time is up")
    return left


def _lost(error: OSError) -> LinkLost:
    return LinkLost(f"the connection broke ({' '.join(str(error).split()) or type(error).__name__})")


class TableLine:
    """Exchanges that dialects are built on: bytes, lines and counted replies, each before a deadline."""

    def __init__(
        self,
        wire: Wire,
        *,
        name: str,
        resource: str,
        clock: Clock,
        timeout_s: float,
        reconnect: Callable[[Deadline], Wire] | None = None,
    ) -> None:
        self.name = name
        self.resource = resource
        self.clock = clock
        self.timeout_s = timeout_s
        self._wire = wire
        self._reconnect = reconnect
        self._received = b""
        self._lock = threading.RLock()
        self._closed = False
        self.dirty = False
        """Whether an exchange broke off: the dialect must find its place again before it asks anything."""

    @property
    def closed(self) -> bool:
        """Tell whether the connection has been given back or given up."""
        return self._closed

    def exclusive(self) -> AbstractContextManager[bool]:
        """Keep other threads out for the length of an exchange."""
        return self._lock

    def deadline(self, seconds: float | None = None) -> Deadline:
        """Return a deadline `seconds` from now, by default the line's time-out."""
        return Deadline.after(self.clock, self.timeout_s if seconds is None else seconds)

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""
        self._require_open()
        self._wire.send(data, deadline)

    def _require_open(self) -> None:
        if self._closed:
            raise LinkLost("the connection is closed", instrument=self.name, resource=self.resource)

    def take_line(self, deadline: Deadline) -> bytes:
        """Return the bytes up to the next line end (CR, LF or both), without it; empty lines are lines."""
        searched = 0  # what never ends comes byte by byte, and shall not take ever longer
        while (found := _LINE_END.search(self._received, searched)) is None:
            searched = len(self._received)
            self._fill(deadline)
        line, self._received = self._received[: found.start()], self._received[found.end() :]
        return line

    def take(self, count: int, deadline: Deadline) -> bytes:
        """Return exactly `count` bytes."""
        while len(self._received) < count:
            self._fill(deadline)
        data, self._received = self._received[:count], self._received[count:]
        return data

    def put_back(self, data: bytes) -> None:
        """Let `data` be the next that is taken."""
        self._received = data + self._received

    def take_through(self, known: bytes, deadline: Deadline) -> None:
        """Drop everything up to and including `known`."""
        searched = 0
        while (found := self._received.find(known, searched)) < 0:
            searched = max(0, len(self._received) - len(known) + 1)
            self._fill(deadline)
        self._received = self._received[found + len(known) :]

    @contextmanager
    def exchange(self, command: str, deadline: Deadline) -> Iterator[None]:
        """Keep other threads out for one exchange; an error of the line in it tells where it happened."""
        with self._lock:
            try:
                yield
            except TransportError as error:
                raise self.locate(error, command, deadline)  # noqa: B904 - the same error, now knowing where

    @contextmanager
    def resynchronising(self, question: str, deadline: Deadline, lost: str = _LOST) -> Iterator[None]:
        """Find the place again by `question`; where that fails the error is OutOfSync, or LinkLost."""
        try:
            yield
        except LinkLost as error:
            raise self.locate(error, question, deadline)  # noqa: B904 - the same error, now knowing where
        except TransportError as error:
            raise self.locate(OutOfSync(f"{lost}, the connection was closed"), question, deadline) from error
        self.dirty = False

    def locate(self, error: TransportError, command: str, deadline: Deadline) -> TransportError:
        """Tell `error` where it happened; a lost connection is closed."""
        error.instrument = error.instrument or self.name
        error.resource = error.resource or self.resource
        error.command = error.command or command
        error.elapsed_s = deadline.elapsed() if error.elapsed_s is None else error.elapsed_s
        if isinstance(error, (LinkLost, OutOfSync)):
            self.give_up()
        return error

    def take_unasked(self) -> bytes:
        """Return the unasked bytes, and forget them."""
        self._require_open()
        data, self._received = self._received + self._wire.pending(), b""
        return data

    def _fill(self, deadline: Deadline) -> None:
        if len(self._received) > _LONGEST_LINE:
            raise FramingError(f"{len(self._received)} bytes came without an end")
        self._received += self._wire.receive(deadline)[0]

    def say_blind(self, words: Sequence[bytes], gap_s: float = 0.0) -> bool:
        """Send `words` at once and tell whether the wire took them; nothing is waited for, nothing raised.

        Nor is the lock waited for: another thread may hang in an exchange. A connection that is closed is made anew.
        The line is dirty afterwards, for the words may be answered. `gap_s` is left between them if that is short.
        """
        taken: list[bool] = []  # the latest that is known when the time is up
        within(_BLIND_S, lambda: self._speak_blind(words, gap_s, taken))
        return bool(taken and taken[-1])

    def _speak_blind(self, words: Sequence[bytes], gap_s: float, taken: list[bool]) -> None:
        with suppress(Exception):  # a port is anyone's code, and the other instruments must hear their words
            try:
                self._require_open()
                self.dirty = True
                self._send_all(words, gap_s)
                taken.append(True)
                self._wire.pending()  # finds out that the other end has gone, which sending did not
            except LinkLost:
                taken.append(False)
                # Whoever holds the lock meanwhile is connecting anew already
                if self._reconnect is None or not self._lock.acquire(blocking=False):
                    return
                try:
                    self.give_up()
                    self.revive(Deadline.after(WallClock(), _BLIND_S), words, gap_s)
                    taken.append(True)
                finally:
                    self._lock.release()

    def _send_all(self, words: Sequence[bytes], gap_s: float) -> None:
        wall = WallClock()
        deadline = Deadline.after(wall, _BLIND_S)  # the bench's clock may be what hangs
        for number, message in enumerate(words):
            if number:
                sleep(wall, min(gap_s, _BLIND_S / 2.0 / len(words)))
            self._wire.send(message, deadline)

    def revive(self, deadline: Deadline, words: Sequence[bytes] = (), gap_s: float = 0.0) -> None:
        """Connect anew if the connection is closed; `words` are the first that is said there."""
        with self._lock:
            if self._closed and self._reconnect is not None:
                self._wire = self._reconnect(deadline)
                self._received, self._closed, self.dirty = b"", False, True
                self._send_all(words, gap_s)

    def give_up(self) -> None:
        """Close the connection; `revive` may make another."""
        if not self._closed:
            self._closed = True
            self._wire.close()

    close = give_up
