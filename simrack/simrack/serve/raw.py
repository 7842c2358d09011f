"""SCPI, or a rate table's language, as it is: over TCP and over a pseudo-terminal."""

from __future__ import annotations

import os
import re
import socket
import sys
from collections.abc import Callable
from functools import partial

from simrack.scpi import RS232, Interface
from simrack.serve.embodied import SOCKET
from simrack.serve.instrument import Client, ServedInstrument
from simrack.serve.loop import READ, WRITE, Loop
from simrack.serve.wire import Outbox

_CHUNK = 1 << 16
_HELD_BACK = 64
_LINES_AT_ONCE = re.compile(rb"(?:[^\r\n]*+[\r\n]++){256}")
"""What of a connection is dealt with before the others have their turn: some milliseconds of work."""
_UNREAD = 1024
_LOOK_AGAIN_S = 0.01
_QUICK_ACK: int | None = getattr(socket, "TCP_QUICKACK", None)


class ByteStream(Client):
    """A byte stream to an instrument: answers are sent as soon as they are there."""

    def __init__(
        self,
        loop: Loop,
        instrument: ServedInstrument,
        interface: Interface,
        fd: int,
        *,
        receive: Callable[[int], bytes],
        send: Callable[[bytes | memoryview], int],
    ) -> None:
        super().__init__(instrument, interface)
        self._loop = loop
        self._fd = fd
        self._recv = receive
        self._send = send
        self._outbox = Outbox()
        self._held_back = False
        self._rest = b""
        self._mask = READ
        loop.watch(fd, self.on_ready)

    @property
    def blocked(self) -> bool:
        """True if the other side does not take its answers."""
        return self._outbox.size > 0

    def relieved(self) -> None:
        """Read on."""
        if self._held_back:
            self._held_back = False
            self._watch()

    def deliver(self, data: bytes, *, end: bool) -> None:
        """Send a response."""
        del end
        if self.closed:
            return
        self.said += len(data)
        try:
            if self._outbox.post(data, self._send):
                self._watch()
        except OSError:
            self.close()

    def on_ready(self, mask: int) -> None:
        """Receive, send the rest, or notice that the other side has gone."""
        if mask & WRITE:
            self._flush()
            if mask == WRITE or self.closed:
                return
        if self._rest:
            if mask & ~(READ | WRITE):  # nobody is there who could be answered
                self.close()
            return
        try:
            data = self._recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._received(data)
        else:
            self.close()

    def close(self) -> None:
        """End the connection."""
        if not self.closed:
            self.lost = True
            try:
                self._detach()
            finally:
                self._close()

    def start_anew(self) -> None:
        """Forget the message under way."""
        self._rest = b""
        super().start_anew()
        self._watch()

    def _detach(self) -> None:
        self._rest = b""
        self._loop.unwatch(self._fd)
        self.leave()

    def _received(self, data: bytes) -> None:
        self.taken += len(data)
        instrument = self.instrument
        asks = instrument.known.get(data)
        if asks is None or self.partial or self.overlong or instrument.engaged or self._outbox.size:
            self._take_apart(data)
            self._acknowledge()
        else:  # what nearly every message is: whole, alone, seen before, and the instrument is free
            instrument.execute(self, data, asks=asks)
            if not asks:
                self._acknowledge()

    def _take_apart(self, data: bytes) -> None:
        brk = self.interface.break_byte
        if brk and brk in data and not self.instrument.binary:
            self.instrument.clear(self)
            data = data.rpartition(brk)[2]
        self._take_lines(data)

    def _take_lines(self, data: bytes) -> None:
        """Deal with so many lines of `data`; the rest comes when the others have had their turn."""
        if (some := _LINES_AT_ONCE.match(data)) is not None and some.end() < len(data):
            data, self._rest = data[: some.end()], data[some.end() :]
            self.taken -= len(self._rest)
            self._loop.call_last(self._go_on)
        self.take(data)
        if len(self.backlog) > _HELD_BACK:
            self._held_back = True
        if self._held_back or self._rest:
            self._watch()

    def _go_on(self) -> None:
        if not self._rest:
            return
        if self._held_back or self._outbox.size:
            self._loop.call_later(_LOOK_AGAIN_S, self._go_on)
            return
        data, self._rest = self._rest, b""
        self.taken += len(data)
        self._take_lines(data)
        self._watch()

    def _acknowledge(self) -> None:
        """Tell the sender at once that a message without an answer has arrived, if the transport would wait with it."""

    def _flush(self) -> None:
        try:
            self._outbox.flush(self._send)
        except OSError:
            self.close()
            return
        if not self._outbox.size:
            self._watch()
            self.instrument.resume(self)

    def _watch(self) -> None:
        mask = WRITE if self._outbox.size else 0
        if not self._held_back and not self._outbox.size and not self._rest:
            mask = READ
        if mask != self._mask and not self.closed:
            self._mask = mask
            self._loop.change(self._fd, mask)

    def _close(self) -> None:
        raise NotImplementedError


class TcpStream(ByteStream):
    """A client's TCP connection."""

    def __init__(
        self, loop: Loop, instrument: ServedInstrument, connection: socket.socket, interface: Interface = SOCKET
    ) -> None:
        self._socket = connection
        self.address = _peer_port(connection)
        super().__init__(
            loop, instrument, interface, connection.fileno(), receive=connection.recv, send=connection.send
        )

    def _close(self) -> None:
        self._socket.close()

    def _acknowledge(self) -> None:
        # else a client that leaves Nagle's algorithm on, as PyVISA-py does, waits 40 ms between a setting and a query
        if _QUICK_ACK is not None and not self.closed:
            self._socket.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)

    def cut(self) -> None:
        """Lose the connection."""
        self.close()

    def freeze(self) -> list[socket.socket]:
        """Serve the connection no more, but leave it open."""
        if self.closed:
            return []
        self._detach()
        return [self._socket]


class Pty(ByteStream):
    """A pseudo-terminal with the serial personality; a client opens `path`.

    The server keeps the client's end open too: a terminal whose last user has left would hang up for good.
    """

    comes_and_goes = False

    def dropped(self) -> None:
        """Go on after an error, because a terminal cannot be reopened."""
        self.instrument.clear(self)

    def __init__(self, loop: Loop, instrument: ServedInstrument) -> None:
        import tty  # noqa: PLC0415  (there is none on Windows)

        if instrument.speaks:
            instrument.clock.run_ahead()  # who opens the line may listen before saying anything
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = self.address = os.ttyname(self._slave)
        super().__init__(
            loop, instrument, RS232, self._master, receive=self._read, send=partial(os.write, self._master)
        )
        loop.look_at(self._master)

    @property
    def listens(self) -> bool:
        """True if the line has a reader; without one, unasked messages must not pile up."""
        return super().listens and self._unread() < _UNREAD

    def _unread(self) -> int:
        """Return the bytes that the client has not read."""
        import fcntl  # noqa: PLC0415  (there is none on Windows)
        import termios  # noqa: PLC0415

        waiting = fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4))
        return int.from_bytes(waiting, sys.byteorder)

    def on_ready(self, mask: int) -> None:
        """Receive, unless nothing is to be received for now: the loop looks whatever it was told."""
        if mask != READ or self._mask == READ:
            super().on_ready(mask)

    def _read(self, size: int) -> bytes:
        data = os.read(self._master, size)
        self.instrument.clock.start()
        return data

    def _close(self) -> None:
        os.close(self._master)
        os.close(self._slave)


def _peer_port(connection: socket.socket) -> int | None:
    """Return the port that a client connected from, None if it has gone already."""
    try:
        return int(connection.getpeername()[1])
    except OSError:
        return None


def has_ptys() -> bool:
    """True if this system has pseudo-terminals."""
    return hasattr(os, "openpty")
