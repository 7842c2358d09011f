"""The interrupt channel of VXI-11: the instrument calls the client's `device_intr_srq` when it requests service.

The client serves the program and tells where; the server connects and calls. The call is one-way: a reply is neither
needed nor looked at.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from itertools import count
from typing import NamedTuple

from simrack.serve.loop import READ, WRITE, Loop
from simrack.serve.rpc import call_record, marked, opaque

_SERVICE_REQUEST = 30
_CONNECTING_S = 5.0
_UNDER_WAY = frozenset({0, errno.EINPROGRESS, errno.EWOULDBLOCK, getattr(errno, "WSAEWOULDBLOCK", 0)})


class Destination(NamedTuple):
    """Address of a client's interrupt program."""

    host: str
    port: int
    program: int
    version: int
    datagrams: bool
    """UDP instead of TCP."""


class InterruptChannel:
    """The server's end of an interrupt channel.

    Args:
        loop: who watches the socket.
        destination: the client's program.
        opened: called once with whether the client could be reached.
    """

    def __init__(self, loop: Loop, destination: Destination, opened: Callable[[bool], None]) -> None:
        self._loop = loop
        self._to = destination
        self._opened: Callable[[bool], None] | None = opened
        self._numbers = count(1)
        self._socket = socket.socket(type=socket.SOCK_DGRAM if destination.datagrams else socket.SOCK_STREAM)
        self._socket.settimeout(0.0)
        self.closed = False
        loop.watch(self._socket.fileno(), self._ready, WRITE)
        self._timer = loop.call_later(_CONNECTING_S, self.close)
        if self._connect() not in _UNDER_WAY:
            self.close()

    def request_service(self, handle: bytes) -> None:
        """Call `device_intr_srq` with the handle that the client gave the link."""
        if self.closed or self._opened is not None:
            return
        record = call_record(next(self._numbers), self._to.program, self._to.version, _SERVICE_REQUEST, opaque(handle))
        try:
            self._socket.send(record if self._to.datagrams else marked(record))
        except BlockingIOError:
            pass  # a client that does not take its interrupts loses them
        except OSError:
            if not self._to.datagrams:
                self.close()

    def close(self) -> None:
        """End the channel; waiters for its opening get an error."""
        if self.closed:
            return
        self.closed = True
        self._timer.cancel()
        self._loop.unwatch(self._socket.fileno())
        self._socket.close()
        self._tell(reached=False)

    def _connect(self) -> int:
        try:
            return self._socket.connect_ex((self._to.host, self._to.port))
        except (OSError, OverflowError):
            return -1

    def _ready(self, mask: int) -> None:
        if self._opened is not None:
            self._connected()
        elif mask & ~WRITE:
            self._discard()

    def _connected(self) -> None:
        if self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.close()
            return
        self._timer.cancel()
        self._loop.change(self._socket.fileno(), READ)
        self._tell(reached=True)

    def _discard(self) -> None:
        """Take replies and look at none."""
        try:
            alive = self._socket.recv(1 << 16) or self._to.datagrams
        except BlockingIOError:
            return
        except OSError:
            alive = self._to.datagrams
        if not alive:
            self.close()

    def _tell(self, *, reached: bool) -> None:
        opened, self._opened = self._opened, None
        if opened is not None:
            opened(reached)
