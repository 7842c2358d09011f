"""VXI-11 (TCP/IP Instrument Protocol, rev. 1.0, 1995): core, abort and interrupt channel.

The core and abort programs share one port, so that a client needs no port mapper:
``TCPIP0::127.0.0.1,PORT::inst0::INSTR`` in PyVISA-py. `device_docmd` is a gateway's to GPIB; instruments answer
*operation not supported*.
"""

from __future__ import annotations

import socket
import struct
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from typing import NamedTuple

from simrack.handlers import Handlers
from simrack.serve.embodied import VXI11
from simrack.serve.instrument import WHOLE_RESPONSE, Client, ServedInstrument
from simrack.serve.interrupts import Destination, InterruptChannel
from simrack.serve.loop import Loop, Timer
from simrack.serve.rpc import Call, RpcConnection, opaque
from simrack.serve.wire import Listener

CORE, ABORT = 0x0607AF, 0x0607B0
_WAIT_LOCK, _END, _TERMINATOR_SET = 1, 8, 128
_BY_COUNT, _BY_TERMINATOR, _BY_END = 1, 2, 4
_NO_ERROR, _NOT_ACCESSIBLE, _BAD_LINK, _PARAMETER, _NO_CHANNEL, _UNSUPPORTED = 0, 3, 4, 5, 6, 8
_NO_RESOURCES, _LOCKED, _NOT_LOCKED, _TIMEOUT, _ABORTED, _HAS_CHANNEL = 9, 11, 12, 15, 23, 29
_MAX_RECEIVE = 16384
"""Most bytes of a device_write: a DSO6014A's (public trace), sibling of the DSO7104B; the 33220A's is unverified."""
_LONGEST_HANDLE = 40
_UDP = 1
_LONGEST_BACKLOG = 1024
_MOST_LINKS = 256
"""Links of a connection; those of the real instruments are fewer, how many is not known."""

_INT = struct.Struct(">i")
_CREATE = struct.Struct(">iII")
_CREATED = struct.Struct(">iiII")
_WRITE = struct.Struct(">iIIi")
_READ = struct.Struct(">iIIIii")
_READ_REPLY = struct.Struct(">ii")
_GENERIC = struct.Struct(">iiII")
_LOCK = struct.Struct(">iiI")
_PAIR = struct.Struct(">iI")
_REMOTE = struct.Struct(">4Ii")
_ENABLE = struct.Struct(">iI")


class _Request(NamedTuple):
    """A device_read under way."""

    xid: int
    size: int
    terminator: int | None
    timer: Timer


class _Link(Client):
    """A link: answers stay in the instrument until they are read, or somebody else needs it."""

    pushes = False

    def __init__(self, connection: _Core, instrument: ServedInstrument, number: int) -> None:
        super().__init__(instrument, VXI11)
        self.number = number
        self.connection = connection
        self.request: _Request | None = None
        self.stop_waiting: Callable[[int], None] | None = None
        self.handle: bytes | None = None
        """What the client wants to be told when the instrument requests service; None: nothing."""
        self._aside: deque[tuple[bytes, bool]] = deque()
        self._offset = 0

    @property
    def awaits(self) -> bool:
        """True if a read is under way."""
        return self.request is not None

    @property
    def unread(self) -> bool:
        """True if an answer was put aside for it."""
        return bool(self._aside)

    def deliver(self, data: bytes, *, end: bool) -> None:
        """Keep an answer that the instrument had no more room for."""
        self._aside.append((data, end))

    def start_anew(self) -> None:
        """Forget the message under way; a read that waits goes on waiting."""
        super().start_anew()
        self.drop()

    def drop(self) -> None:
        """Forget unread bytes."""
        self._aside.clear()
        self._offset = 0

    def fetch(self, size: int) -> tuple[bytes, bool]:
        """Return at most `size` bytes of the response and True if it ends there."""
        if not self._aside:
            return self.instrument.collect(self, size)
        data, end = self._aside[0]
        part = data[self._offset : self._offset + size]
        self._offset += len(part)
        if self._offset < len(data):
            return part, False
        self._aside.popleft()
        self._offset = 0
        return part, end

    def put_back(self, data: bytes, *, end: bool) -> None:
        """Keep the bytes after a termination character for the next read."""
        if self._offset:
            kept, kept_end = self._aside[0]
            self._aside[0] = (kept[self._offset :], kept_end)
            self._offset = 0
            self._aside[0] = (data + self._aside[0][0], self._aside[0][1])
        else:
            self._aside.appendleft((data, end))

    def cut(self) -> None:
        """Lose the connection."""
        self.connection.close()

    def freeze(self) -> list[socket.socket]:
        """Serve the connection, with all its links, no more, but leave it open."""
        connection = self.connection
        if connection.closed:
            return []
        dead = connection.detach()
        connection.gone()
        return [dead]

    def refill(self) -> None:
        """Try a waiting read again."""
        self.connection.try_read(self)

    def service_requested(self) -> None:
        """Send the client a service request on its interrupt channel, if enabled."""
        if self.handle is not None and self.connection.interrupts is not None:
            self.connection.interrupts.request_service(self.handle)


class Vxi11Server:
    """Offers instruments by device name; every name leads to one when only one is offered under `inst0`."""

    def __init__(self, loop: Loop, address: tuple[str, int], instruments: Mapping[str, ServedInstrument]) -> None:
        self.loop = loop
        self.instruments = {name.lower(): each for name, each in instruments.items()}
        self.links: dict[int, _Link] = {}
        self.numbers = count(1)
        self._connections: set[_Core] = set()
        self.listener = Listener(loop, address, lambda connection: self._connections.add(_Core(self, connection)))
        self.port = self.listener.port

    def close(self) -> None:
        """Stop listening and end the connections."""
        self.listener.close()
        for connection in tuple(self._connections):
            connection.close()

    def forget(self, connection: _Core) -> None:
        """Remove a connection that has ended."""
        self._connections.discard(connection)


class _Core(RpcConnection):
    """A connection to the core or abort program."""

    _CORE = Handlers()

    def __init__(self, server: Vxi11Server, connection: socket.socket) -> None:
        super().__init__(server.loop, connection)
        self._server = server
        self._own: dict[int, _Link] = {}
        self.interrupts: InterruptChannel | None = None
        core = {
            **self._CORE.bound(self),
            13: partial(self._generic, _read_status, _PAIR),
            14: partial(self._generic, _trigger, _INT),
            15: partial(self._generic, _clear, _INT),
            16: partial(self._generic, _accept_quietly, _INT),
            17: partial(self._generic, _accept_quietly, _INT),
        }
        self.programs = {(CORE, 1): core, (ABORT, 1): {1: self._abort}}

    def gone(self) -> None:
        """Destroy the links of the connection."""
        for link in tuple(self._own.values()):
            self._destroy(link)
        if self.interrupts is not None:
            self.interrupts.close()
        self._server.forget(self)

    # --- procedures ---------------------------------------------------------------------------------------

    @_CORE.of(10)
    def _create_link(self, call: Call) -> bytes | None:
        _client, lock, lock_timeout_ms = call.arguments.words(_CREATE)
        name = call.arguments.opaque().decode("latin-1").lower()
        instrument = self._server.instruments.get(name)
        if instrument is None or len(self._own) >= _MOST_LINKS:
            return _CREATED.pack(_NOT_ACCESSIBLE if instrument is None else _NO_RESOURCES, 0, 0, 0)
        link = _Link(self, instrument, next(self._server.numbers))
        self._own[link.number] = self._server.links[link.number] = link
        created = _CREATED.pack(_NO_ERROR, link.number, self._server.port, _MAX_RECEIVE)
        if not lock:
            return created

        def locked(error: int) -> bytes:
            if error:
                self._destroy(link)
                return _CREATED.pack(error, 0, 0, 0)
            instrument.lock = link
            return created

        return self._when_free(call, link, lock_timeout_ms, locked)

    @_CORE.of(11)
    def _write(self, call: Call) -> bytes | None:
        number, _io_ms, lock_ms, flags = call.arguments.words(_WRITE)
        data = call.arguments.opaque()
        link = self._own.get(number)
        if link is None:
            return _PAIR.pack(_BAD_LINK, 0)
        if len(data) > _MAX_RECEIVE:
            return _PAIR.pack(_PARAMETER, 0)

        def write(error: int) -> bytes:
            if error or len(link.backlog) > _LONGEST_BACKLOG:
                return _PAIR.pack(error or _TIMEOUT, 0)
            if link.unread:
                link.drop()  # it was put aside for another's sake: to its owner it is lost as if it still lay there
                link.instrument.complain(-410)
            link.take(data, end=bool(flags & _END))
            return _PAIR.pack(_NO_ERROR, len(data))

        return self._when_free(call, link, lock_ms if flags & _WAIT_LOCK else 0, write)

    @_CORE.of(12)
    def _read(self, call: Call) -> bytes | None:
        number, size, io_ms, lock_ms, flags, character = call.arguments.words(_READ)
        link = self._own.get(number)
        if link is None:
            return _READ_REPLY.pack(_BAD_LINK, 0) + opaque(b"")
        terminator = character & 0xFF if flags & _TERMINATOR_SET else None

        def read(error: int) -> bytes | None:
            if error:
                return _READ_REPLY.pack(error, 0) + opaque(b"")
            timer = self.loop.call_later(io_ms / 1e3, lambda: self._end_read(link, _TIMEOUT))
            link.request = _Request(call.xid, min(size, WHOLE_RESPONSE), terminator, timer)
            self.try_read(link)
            return None

        return self._when_free(call, link, lock_ms if flags & _WAIT_LOCK else 0, read)

    def _generic(self, action: Callable[[_Link], bytes], refused: struct.Struct, call: Call) -> bytes | None:
        number, flags, lock_ms, _io_ms = call.arguments.words(_GENERIC)
        link = self._own.get(number)
        if link is None:
            return _refusal(refused, _BAD_LINK)
        return self._when_free(
            call,
            link,
            lock_ms if flags & _WAIT_LOCK else 0,
            lambda error: _refusal(refused, error) if error else action(link),
        )

    @_CORE.of(18)
    def _lock(self, call: Call) -> bytes | None:
        number, flags, lock_ms = call.arguments.words(_LOCK)
        link = self._own.get(number)
        if link is None:
            return _INT.pack(_BAD_LINK)
        if link.instrument.lock is link:
            return _INT.pack(_LOCKED)

        def lock(error: int) -> bytes:
            if not error:
                link.instrument.lock = link
            return _INT.pack(error)

        return self._when_free(call, link, lock_ms if flags & _WAIT_LOCK else 0, lock)

    @_CORE.of(19)
    def _unlock(self, call: Call) -> bytes:
        link = self._own.get(call.arguments.words(_INT)[0])
        if link is None:
            return _INT.pack(_BAD_LINK)
        if link.instrument.lock is not link:
            return _INT.pack(_NOT_LOCKED)
        link.instrument.unlock()
        return _INT.pack(_NO_ERROR)

    @_CORE.of(23)
    def _destroy_link(self, call: Call) -> bytes:
        link = self._own.get(call.arguments.words(_INT)[0])
        if link is None:
            return _INT.pack(_BAD_LINK)
        self._destroy(link)
        return _INT.pack(_NO_ERROR)

    def _abort(self, call: Call) -> bytes:
        """End the call that is under way on a link, from the abort channel."""
        link = self._server.links.get(call.arguments.words(_INT)[0])
        if link is None:
            return _INT.pack(_BAD_LINK)
        if link.stop_waiting is not None:
            link.stop_waiting(_ABORTED)
        elif link.request is not None:
            link.connection._end_read(link, _ABORTED)  # noqa: SLF001  (of the same class)
        return _INT.pack(_NO_ERROR)

    # --- service requests -----------------------------------------------------------------------------------

    @_CORE.of(25)
    def _create_interrupts(self, call: Call) -> bytes | None:
        """Connect to the program that the client serves for its interrupts."""
        address, port, program, version, family = call.arguments.words(_REMOTE)
        if self.interrupts is not None and not self.interrupts.closed:
            return _INT.pack(_HAS_CHANNEL)

        def opened(reached: bool) -> None:  # noqa: FBT001  (of a callback)
            self.answer(call.xid, _INT.pack(_NO_ERROR if reached else _NO_CHANNEL))

        host = socket.inet_ntoa(struct.pack(">I", address))
        self.interrupts = InterruptChannel(self.loop, Destination(host, port, program, version, family == _UDP), opened)
        return None

    @_CORE.of(26)
    def _destroy_interrupts(self, _call: Call) -> bytes:
        if self.interrupts is None or self.interrupts.closed:
            return _INT.pack(_NO_CHANNEL)
        self.interrupts.close()
        return _INT.pack(_NO_ERROR)

    @_CORE.of(20)
    def _enable_service_requests(self, call: Call) -> bytes:
        number, enable = call.arguments.words(_ENABLE)
        handle = call.arguments.opaque()
        link = self._own.get(number)
        if link is None:
            return _INT.pack(_BAD_LINK)
        if len(handle) > _LONGEST_HANDLE:
            return _INT.pack(_PARAMETER)
        link.handle = handle if enable else None
        link.instrument.watches_service = True
        link.instrument.touched()
        return _INT.pack(_NO_ERROR)

    @_CORE.of(22)
    def _command_bus(self, call: Call) -> bytes:
        known = call.arguments.words(_INT)[0] in self._own
        return _INT.pack(_UNSUPPORTED if known else _BAD_LINK) + opaque(b"")

    # --- reading ------------------------------------------------------------------------------------------

    def try_read(self, link: _Link) -> None:
        """Answer a waiting read if there is something to answer."""
        request = link.request
        if request is None:
            return
        data, end = link.fetch(request.size)
        if not data:
            return
        reason = _BY_END if end else 0
        found = -1 if request.terminator is None else data.find(request.terminator)
        if found >= 0:
            reason |= _BY_TERMINATOR
            if found + 1 < len(data):
                link.put_back(data[found + 1 :], end=end)
                data, reason = data[: found + 1], _BY_TERMINATOR
        if len(data) == request.size:
            reason |= _BY_COUNT
        self._end_read(link, _NO_ERROR, reason, data)

    def _end_read(self, link: _Link, error: int, reason: int = 0, data: bytes = b"") -> None:
        request, link.request = link.request, None
        if request is not None:
            request.timer.cancel()
            self.answer(request.xid, _READ_REPLY.pack(error, reason) + opaque(data))

    # --- links and locks ----------------------------------------------------------------------------------

    def _when_free(self, call: Call, link: _Link, lock_ms: int, action: Callable[[int], bytes | None]) -> bytes | None:
        """Do `action` unless another holds the lock: then once it is given up, or with the error when it is not."""
        instrument = link.instrument
        if instrument.lock in (None, link):
            return action(_NO_ERROR)
        if not lock_ms:
            return action(_LOCKED)

        def go_on(error: int) -> None:
            link.stop_waiting = None
            timer.cancel()
            if retry in instrument.lock_waiters:
                instrument.lock_waiters.remove(retry)
            result = action(error)
            if result is not None:
                self.answer(call.xid, result)

        def retry() -> None:
            if instrument.lock is None:
                go_on(_NO_ERROR)
            else:
                instrument.lock_waiters.append(retry)

        timer = self.loop.call_later(lock_ms / 1e3, lambda: go_on(_LOCKED))
        link.stop_waiting = go_on
        instrument.lock_waiters.append(retry)
        return None

    def _destroy(self, link: _Link) -> None:
        self._own.pop(link.number, None)
        self._server.links.pop(link.number, None)
        if link.stop_waiting is not None:
            link.stop_waiting(_ABORTED)  # else it would have the lock once it is free, and nobody could give it back
        if link.request is not None:
            link.request.timer.cancel()
            link.request = None
        link.drop()
        link.leave()


def _refusal(layout: struct.Struct, error: int) -> bytes:
    """Return a result that is an error and nothing else."""
    return layout.pack(error, 0) if layout is _PAIR else layout.pack(error)


def _read_status(link: _Link) -> bytes:
    byte = link.instrument.status_byte()
    return _PAIR.pack(_NO_ERROR, byte | 16 if link.unread else byte)


def _trigger(link: _Link) -> bytes:
    link.instrument.trigger(link)
    return _INT.pack(_NO_ERROR)


def _clear(link: _Link) -> bytes:
    link.drop()
    link.instrument.clear(link)
    return _INT.pack(_NO_ERROR)


def _accept_quietly(_link: _Link) -> bytes:
    """device_remote, device_local: the simulated front panels have no keys to lock."""
    return _INT.pack(_NO_ERROR)
