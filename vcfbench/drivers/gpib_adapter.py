"""Instruments on GPIB behind a Prologix adapter, or an AR488, which speaks as one: on a socket or a serial line.

PyVISA-py's own support of them does not carry this program: its time-outs are not the interface's, an answer that
begins 50 ms late never comes, and two instruments behind one adapter lose each other's answers.

Everything goes to one stream, each write whole: words for one instrument never wait for the answer of another. A read
is ended by END, which the adapter marks by a character, or after `_POLL_S` without one; the adapter's version, asked
behind it, tells that it has ended. Until a deadline it is begun again and again.

Unverified with real adapters: that they keep what is said while they read, how long a message may be (an AR488 has
little memory), and how soon a GPIB-ETHERNET takes the next connection when a program was killed.
"""

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import Final

from vcfbench.clock import Deadline, WallClock, sleep
from vcfbench.drivers.serial_wire import Link, serial_port
from vcfbench.drivers.visa_wire import open_wire
from vcfbench.drivers.wire import Interface, Wire, left_s
from vcfbench.errors import ConnectFailed, DeadlineExceeded, LinkLost, TransportError

_POLL_S: Final = 0.2
"""How long the adapter waits for an instrument at a time, s: so long the others' words may have to wait in it."""
_GRACE_S: Final = 3.0
"""How long the adapter itself may be silent beyond that, s."""
_ASKED_AGAIN_S: Final = 0.5
_QUIET_S: Final = 0.1
_BAUD: Final = 115_200
"""An AR488's speed; a GPIB-USB has none."""
_END: Final = b"\x03"
_SET_UP: Final = b"++mode 1\n++auto 0\n++eoi 1\n++eos 3\n++eot_enable 1\n++eot_char %d\n" % _END[0]
_ESCAPED: Final = re.compile(rb"[\r\n\x1b+]")
_NAME: Final = re.compile(r"PRLGX-(TCPIP|ASRL)\d*::(.+?)(?:::(\d+))?::INTFC", re.IGNORECASE)
_ADDRESS: Final = re.compile(r"GPIB\d*::(\d+)(?:::(\d+))?(?:::INSTR)?", re.IGNORECASE)
_LEAST_SECONDARY: Final = 96
_ADDRESSES: Final = 31

_adapters: dict[str, "_Adapter"] = {}
_opening = threading.Lock()


def open_behind(adapter: str, resource: str, deadline: Deadline) -> "GpibWire":
    """Open the instrument `resource` behind an adapter, both by their VISA names; raises ConnectFailed.

    ``PRLGX-TCPIP0::192.168.1.9::1234::INTFC`` or ``PRLGX-ASRL0::/dev/ttyUSB0::INTFC``, and ``GPIB0::22::INSTR``.
    """
    found = _ADDRESS.fullmatch(resource.strip())
    if found is None:
        raise ConnectFailed(f"{resource} is no address behind {adapter}", hint="GPIB0::22::INSTR is one")
    secondary = None if found[2] is None else int(found[2]) % _LEAST_SECONDARY + _LEAST_SECONDARY
    address = found[1] if secondary is None else f"{found[1]} {secondary}"
    with _opening:
        opened = _adapters.get(adapter.upper())
        if opened is None or opened.closed:
            opened = _adapters[adapter.upper()] = _Adapter(_stream(adapter, deadline), deadline)
        opened.users += 1
    return GpibWire(opened, address.encode("ascii"))


def occupied(adapter: str, deadline: Deadline) -> list[int]:
    """Return the addresses behind an adapter that answer a serial poll, which moves no instrument."""
    with ExitStack() as stack:
        wires = [open_behind(adapter, f"GPIB0::{address}::INSTR", deadline) for address in range(_ADDRESSES)]
        for wire in wires:
            stack.callback(wire.close)
        return [address for address, wire in enumerate(wires) if wire.status_byte(deadline) is not None]


def _stream(adapter: str, deadline: Deadline) -> Wire:
    """Open the stream to an adapter; one that still holds the connection of a program that died is asked again."""
    found = _NAME.fullmatch(adapter.strip())
    if found is None:
        raise ConnectFailed(f"{adapter} is no adapter", hint="PRLGX-TCPIP0::192.168.1.9::1234::INTFC is one")
    connect: Callable[[Deadline], Wire]
    if found[1].upper() == "ASRL":
        connect = serial_port(found[2], Link(baud=_BAUD), WallClock(), deadline.remaining())
    else:
        connect = partial(open_wire, f"TCPIP0::{found[2]}::{found[3] or 1234}::SOCKET", "@py", serial=None)
    while True:
        try:
            return connect(deadline)
        except ConnectFailed:
            if deadline.remaining() < _ASKED_AGAIN_S:
                raise
            sleep(WallClock(), _QUIET_S)


class _Adapter:
    """An open adapter, of all its instruments."""

    def __init__(self, stream: Wire, deadline: Deadline) -> None:
        self.closed = False
        self.users = 0
        self._stream = stream
        self._writing, self._reading = threading.Lock(), threading.Lock()
        self._received = bytearray()
        self._owed = 0
        """Answers to its version that nobody has waited for: a deadline came before."""
        try:
            self._mark = self._version(deadline)
            # The settings are this connection's, they are not to wear the memory out; an AR488 would keep them at that
            kept = b"++savecfg 0\n" if b"prologix" in self._mark.lower() else b""
            self.say(kept + _SET_UP, deadline)
            self.ask(b"", deadline)
        except BaseException:
            self.give_up()
            raise

    def _version(self, deadline: Deadline) -> bytes:
        """Return what it says it is; an AR488 begins anew when its port is opened, and is asked again."""
        while True:
            self.say(b"\n++ver\n", deadline)
            heard = bytearray()
            with suppress(DeadlineExceeded):
                while not heard.endswith(b"\n"):
                    heard += self._stream.receive(deadline.within(_ASKED_AGAIN_S))[0]
                while True:  # until nothing more comes: what it said first, and what was asked twice
                    heard += self._stream.receive(deadline.within(_QUIET_S))[0]
            if heard.endswith(b"\n"):
                return bytes(heard).splitlines(keepends=True)[-1]
            if deadline.expired():
                raise ConnectFailed("no GPIB adapter answers there (++ver)", elapsed_s=deadline.elapsed())

    def say(self, words: bytes, deadline: Deadline) -> None:
        """Write all of `words` without bytes of other threads between them."""
        if self.closed:
            raise LinkLost("the connection to the adapter is closed")
        if not self._writing.acquire(timeout=left_s(deadline)):
            raise DeadlineExceeded("the adapter does not take the command")
        try:
            self._stream.send(words, deadline)
        except TransportError:  # half a line may be there
            self.give_up()
            raise
        finally:
            self._writing.release()

    def ask(self, words: bytes, deadline: Deadline, wait_s: float = 0.0) -> bytes:
        """Send `words` and return the reply; the adapter waits at most `wait_s` for each byte."""
        with self._alone(deadline):
            self.say(words + b"++ver\n", deadline)
            self._owed += 1
            while True:
                answer = self._answered(deadline, wait_s + _GRACE_S)
                if not self._owed:
                    return answer

    @contextmanager
    def _alone(self, deadline: Deadline) -> Iterator[None]:
        if not self._reading.acquire(timeout=left_s(deadline)):
            raise DeadlineExceeded("the adapter is waiting for another instrument")
        try:
            yield
        finally:
            self._reading.release()

    def _answered(self, deadline: Deadline, silent_s: float) -> bytes:
        """Return what comes before the next version."""
        at = 0
        limit = Deadline.after(WallClock(), silent_s)
        while (found := self._received.find(self._mark, at)) < 0:
            at = max(0, len(self._received) - len(self._mark))
            try:
                self._received += self._stream.receive(limit.within(_POLL_S))[0]
                limit = Deadline.after(WallClock(), silent_s)
            except DeadlineExceeded:
                if limit.expired():
                    self.give_up()
                    raise LinkLost("the adapter does not answer") from None
            except LinkLost:
                self.give_up()
                raise
            if deadline.expired() and not self._received:
                raise DeadlineExceeded("no answer")
        answer = bytes(self._received[:found])
        del self._received[: found + len(self._mark)]
        self._owed -= 1
        return answer

    def give_up(self) -> None:
        """Close the stream; its next use opens it again."""
        self.closed = True
        self._stream.close()

    def leave(self) -> None:
        """Take one user off; the last closes it."""
        with _opening:
            self.users -= 1
            if self.users <= 0 and not self.closed:
                self.give_up()


class GpibWire:
    """A wire to one address behind an adapter."""

    interface: Interface = "gpib"

    def __init__(self, adapter: _Adapter, address: bytes) -> None:
        self._adapter: _Adapter | None = adapter
        self._to = b"++addr %s\n" % address

    @property
    def _open(self) -> _Adapter:
        if self._adapter is None:
            raise LinkLost("the connection is closed")
        return self._adapter

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data` as one message, the adapter's own signs escaped; END comes with the last byte."""
        self._open.say(self._to + _ESCAPED.sub(lambda sign: b"\x1b" + sign[0], data) + b"\n", deadline)

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the next part of an answer, and True if it was its end."""
        while (wait_s := min(_POLL_S, deadline.remaining())) > 0.0:
            read = b"++read_tmo_ms %d\n++read eoi\n" % max(1, round(wait_s * 1e3))
            if data := self._open.ask(self._to + read, deadline, wait_s):
                end = data.endswith(_END)
                return data[: len(data) - end], end
        raise DeadlineExceeded("no answer")

    def status_byte(self, deadline: Deadline) -> int | None:
        """Return the status byte by a serial poll, which ends a request for service; None without an instrument."""
        polled = self._open.ask(self._to + b"++spoll\n", deadline).strip()
        return int(polled) if polled.isdigit() else None

    def pending(self) -> bytes:
        """Return no bytes: on GPIB an instrument speaks only when it is addressed."""
        return b""

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear (SDC)."""
        self._open.say(self._to + b"++clr\n", deadline)

    def close(self) -> None:
        """Give the connection back; with the last instrument's the adapter's too."""
        adapter, self._adapter = self._adapter, None
        if adapter is not None:
            adapter.leave()
