"""Common base of the protocols on sockets: listening, and sending without waiting."""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from collections.abc import Callable, Iterable
from itertools import islice
from typing import Protocol

from simrack.serve.loop import READ, WRITE, Loop

_SENDMSG = hasattr(socket.socket, "sendmsg")
_TOGETHER = 64
"""Parts sent at once; systems take some hundreds."""
_BREATH_S = 0.1
"""Wall time until the next try when the system has no more descriptors."""


def family_of(address: tuple[str, int]) -> socket.AddressFamily:
    """Return the family of an address."""
    return socket.AF_INET6 if ":" in address[0] else socket.AF_INET


class Bound:
    """A bound socket that accepts connections."""

    def __init__(self, loop: Loop, bound: socket.socket) -> None:
        self._loop = loop
        self._socket = bound
        bound.settimeout(0.0)
        loop.watch(bound.fileno(), self._ready)

    def close(self) -> None:
        """Stop listening."""
        if self._socket.fileno() >= 0:
            self._loop.unwatch(self._socket.fileno())
            self._socket.close()

    def dropped(self) -> None:
        """Go on: an error of one caller does not end the others."""

    def _ready(self, mask: int) -> None:
        raise NotImplementedError


class Listener(Bound):
    """A listening socket; `accept` is called with every connection."""

    def __init__(self, loop: Loop, address: tuple[str, int], accept: Callable[[socket.socket], object]) -> None:
        super().__init__(loop, socket.create_server(address, family=family_of(address), backlog=1024))
        self._accept = accept
        self.port = int(self._socket.getsockname()[1])
        self.refusing = False

    def _ready(self, _mask: int) -> None:
        while True:
            try:
                connection = self._socket.accept()[0]
            except (BlockingIOError, ConnectionError):
                return
            except OSError:
                # Listen again a little later: without descriptors left the socket would be ready all the time,
                # for nothing
                self._loop.unwatch(self._socket.fileno())
                self._loop.call_later(_BREATH_S, self._listen_again)
                return
            self._welcome(connection)

    def _welcome(self, connection: socket.socket) -> None:
        if self.refusing:
            connection.close()
            return
        try:
            connection.settimeout(0.0)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._accept(connection)
        except OSError:  # it has gone already
            connection.close()

    def _listen_again(self) -> None:
        if self._socket.fileno() >= 0:
            self._loop.watch(self._socket.fileno(), self._ready)


class Outbox:
    """Bytes that a file did not take at once."""

    __slots__ = ("_parts", "size")

    def __init__(self) -> None:
        self._parts: deque[memoryview] = deque()
        self.size = 0

    def add(self, data: bytes | memoryview) -> None:
        """Keep `data`."""
        self._parts.append(memoryview(data))
        self.size += len(data)

    def post(self, data: bytes, send: Callable[[bytes], int]) -> bool:
        """Send `data` after what waits, at once as far as `send` takes it; return True if from now on something waits.

        Raises OSError when the other side has gone.
        """
        waited, sent = self.size > 0, 0
        if not waited:
            try:  # noqa: SIM105  (of every answer)
                sent = send(data)
            except BlockingIOError:
                pass
        if sent < len(data):
            self.add(memoryview(data)[sent:])
        return not waited and self.size > 0

    def flush(self, send: Callable[[memoryview], int]) -> None:
        """Send as much as `send` takes; raises OSError when the other side has gone."""
        with contextlib.suppress(BlockingIOError):
            while self._parts:
                if not self._drop(send(self._parts[0])):
                    return

    def flush_together(self, send: Callable[[list[memoryview]], int]) -> None:
        """Send as much as `send` takes of several parts at once; raises OSError when the other side has gone."""
        with contextlib.suppress(BlockingIOError):
            while self._parts:
                if not self._drop(send(list(islice(self._parts, _TOGETHER)))):
                    return

    def _drop(self, sent: int) -> bool:
        """Forget sent bytes; return True if those were whole parts."""
        self.size -= sent
        while self._parts and sent >= len(self._parts[0]):
            sent -= len(self._parts[0])
            self._parts.popleft()
        if sent:
            self._parts[0] = self._parts[0][sent:]
        return not sent


class Connection:
    """A client's connection; subclasses make sense of the received bytes.

    While the client does not take what it is sent, nothing more is received from it.
    """

    chunk = 1 << 18

    def __init__(self, loop: Loop, connection: socket.socket) -> None:
        self.loop = loop
        self.closed = False
        self._socket = connection
        self._fd = connection.fileno()
        self._outbox = Outbox()
        self._held = False
        loop.watch(self._fd, self.on_ready)

    @property
    def blocked(self) -> bool:
        """True if the client does not take its bytes."""
        return self._outbox.size > 0

    def on_ready(self, mask: int) -> None:
        """Receive, send the rest, or notice that the other side has gone."""
        if mask & WRITE:
            self._flush()
        if self.closed or not mask & ~WRITE:
            return
        if not self._held:
            self.receive()
        elif mask & ~(READ | WRITE):
            self.close()

    @property
    def held(self) -> bool:
        """True if nothing is received for now."""
        return self._held

    def hold(self, *, held: bool) -> None:
        """Receive nothing for now, or again."""
        if held is not self._held and not self.closed:
            self._held = held
            if not self._outbox.size:
                self.loop.change(self._fd, 0 if held else READ)

    def receive(self) -> None:
        """Deal with received bytes."""
        try:
            data = self._socket.recv(self.chunk)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.received(data)
        else:
            self.close()

    def send(self, data: bytes) -> None:
        """Send `data`, now or as soon as the client takes it."""
        if self.closed:
            return
        try:
            if self._outbox.post(data, self._socket.send):
                self.loop.change(self._fd, WRITE)
        except OSError:
            self.close()

    def send_parts(self, parts: Iterable[bytes | memoryview]) -> None:
        """Send `parts` one after the other without putting them together: waveforms are not copied."""
        waiting = self._outbox.size > 0
        for part in parts:
            self._outbox.add(part)
        if waiting or self.closed:
            return
        self.loop.change(self._fd, WRITE)
        self._flush()

    def close(self) -> None:
        """End the connection."""
        if not self.closed:
            self.detach().close()
            self.gone()

    def detach(self) -> socket.socket:
        """Serve the socket no more, but leave it open: the other side learns of nothing; :meth:`gone` is not called."""
        self.closed = True
        self.loop.unwatch(self._fd)
        return self._socket

    def received(self, data: bytes) -> None:
        """Make sense of received bytes."""
        raise NotImplementedError

    def relieved(self) -> None:
        """Called when the client has read all output."""

    def gone(self) -> None:
        """Called once the connection has ended."""

    def _flush(self) -> None:
        try:
            if _SENDMSG:
                self._outbox.flush_together(self._socket.sendmsg)
            else:
                self._outbox.flush(self._socket.send)
        except OSError:
            self.close()
            return
        if not self._outbox.size:
            self.loop.change(self._fd, 0 if self._held else READ)
            self.relieved()


class DelayingWire(Protocol):
    """A wire on which something is on its way for a while."""

    @property
    def next_s(self) -> float:
        """Instant at which something arrives next, inf for never."""

    @property
    def awaited(self) -> bool:
        """True if a client may wait for something under way, so that time may jump there."""

    def go_on(self) -> None:
        """Let bytes arrive that are due by now."""
