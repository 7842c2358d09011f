"""A man in the middle: passes on the messages of a program and its instrument, and spoils the replies as told.

It stands on a TCP connection or on a serial line (a pseudo-terminal) and knows nothing of what is said there. Commands
always reach the instrument as they are; only what comes back suffers::

    with faulty_wire("TCPIP0::127.0.0.1::5025::SOCKET") as wire:
        meter = manager.open_resource(wire.resource)     # instead of the instrument's own resource
        wire.begin(WireFault("late", count=1, delay_s=3.0))

A reply is what arrives from the instrument in one piece.
"""

from __future__ import annotations

import os
import re
import selectors
import socket
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from simrack.wires.faulty_wire import CHUNK, WIRE_FAULTS, FaultyWire, WireFault, WireLink, received

__all__ = ["WIRE_FAULTS", "FaultyWire", "WireFault", "faulty_wire"]

_DRAIN_S = 1.0
_QUICK_ACK: int | None = getattr(socket, "TCP_QUICKACK", None)


# --- TCP


class _SocketEnd:
    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)  # noqa: FBT003
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        data = self._socket.recv(CHUNK)
        if _QUICK_ACK is not None and data:  # a program that leaves Nagle's algorithm on would wait for it
            self._socket.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)
        return data

    def write(self, data: bytes) -> int:
        return self._socket.send(data)

    def finish(self) -> None:
        """Say that nothing more comes; bytes already sent still arrive."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        self._socket.close()


class _TcpWire(FaultyWire):
    def __init__(self, host: str, port: int, named: Callable[[int], str]) -> None:
        self._target = (host, port)
        self._server: socket.socket | None = socket.create_server(("127.0.0.1", 0))
        self._port = self._server.getsockname()[1]
        super().__init__(named(self._port))
        self._listen(self._server)

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        if self._server is not None:
            self._server.close()

    def _listen(self, server: socket.socket) -> None:
        server.setblocking(False)  # noqa: FBT003
        self._selector.register(server, selectors.EVENT_READ, self._accept)

    def _accept(self) -> None:
        assert self._server is not None  # noqa: S101  # else nobody would have come
        connection, _ = self._server.accept()
        try:
            far = socket.create_connection(self._target, timeout=_DRAIN_S)
        except OSError:
            connection.close()
            return
        self._join(_SocketEnd(connection), _SocketEnd(far))

    def _lose(self, link: WireLink, *, forever: bool) -> None:
        if forever and self._server is not None:
            self._selector.unregister(self._server)
            self._server.close()
            self._server = None
        self._forget(link.near)
        with suppress(OSError):
            link.near.close()
        self._program_left(link)

    def _restore(self) -> None:
        if self._server is None:
            self._server = socket.create_server(("127.0.0.1", self._port))
            self._listen(self._server)

    def _program_left(self, link: WireLink) -> None:
        """Let the instrument hear all that was said before it learns that nobody is there any more."""
        link.forget()
        self._forget(link.near)
        self._forget(link.far)
        far = link.far
        assert isinstance(far, _SocketEnd)  # noqa: S101  # this is TCP
        far.finish()
        self._selector.register(far, selectors.EVENT_READ, lambda: self._drained(link))

    def _drained(self, link: WireLink) -> None:
        if not received(link.far):
            self._drop(link)


# --- serial lines


class _TerminalEnd:
    """One end of a terminal: the master of our own, or the instrument's, opened as a program would."""

    def __init__(self, fd: int) -> None:
        os.set_blocking(fd, False)
        self._fd = fd

    def fileno(self) -> int:
        return self._fd

    def read(self) -> bytes:
        return os.read(self._fd, CHUNK)

    def write(self, data: bytes) -> int:
        return os.write(self._fd, data)

    def close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
        self._fd = -1


class _TerminalWire(FaultyWire):
    def __init__(self, path: str, named: Callable[[str], str]) -> None:
        import tty  # noqa: PLC0415  # there is none on Windows

        self._folder = tempfile.TemporaryDirectory(prefix="wire")
        self._path = Path(self._folder.name) / "tty"
        self._slave = -1
        super().__init__(named(str(self._path)))
        far = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(far)
        self._far = _TerminalEnd(far)
        self._link = self._join(self._new_terminal(), self._far)

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        if self._slave >= 0:
            os.close(self._slave)
        self._folder.cleanup()

    def _new_terminal(self) -> _TerminalEnd:
        """Make a terminal at our path; its own end is kept open, or it would hang up when a program leaves."""
        import tty  # noqa: PLC0415

        master, self._slave = os.openpty()
        tty.setraw(self._slave)
        fresh = self._path.with_name("new")
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self._path)
        return _TerminalEnd(master)

    def _heard(self, link: WireLink) -> None:
        self._same_speed()
        super()._heard(link)

    def _same_speed(self) -> None:
        """Give the instrument's line the speed that the program has chosen."""
        import termios  # noqa: PLC0415

        if self._slave < 0:
            return
        near, far = termios.tcgetattr(self._slave), termios.tcgetattr(self._far.fileno())
        if near[2:6] != far[2:6]:
            termios.tcsetattr(self._far.fileno(), termios.TCSANOW, [*far[:2], *near[2:6], far[6]])

    def _lose(self, link: WireLink, *, forever: bool) -> None:
        link.forget()
        self._forget(link.near)
        link.near.close()
        os.close(self._slave)
        self._slave = -1
        if forever:
            self._path.unlink()
        else:
            self._plug_in(link)

    def _plug_in(self, link: WireLink) -> None:
        link.near = self._new_terminal()
        self._selector.register(link.near, selectors.EVENT_READ, lambda: self._heard(link))

    def _restore(self) -> None:
        if self._slave < 0:
            self._plug_in(self._link)

    def _program_left(self, link: WireLink) -> None:
        """Do nothing: the terminal stays."""


_SOCKET = re.compile(r"TCPIP\d*::(?P<host>[^:]+)::(?P<port>\d+)::SOCKET", re.IGNORECASE)
_URL = re.compile(r"socket://(?P<host>[^:]+):(?P<port>\d+)")
_ASRL = re.compile(r"ASRL(?P<path>/.+?)(?:::INSTR)?", re.IGNORECASE)


@contextmanager
def faulty_wire(resource: str) -> Iterator[FaultyWire]:
    """Stand between a program and the instrument at `resource`; a program opens the yielded `resource`.

    Args:
        resource: ``TCPIP0::HOST::PORT::SOCKET``, ``socket://HOST:PORT``, ``ASRL/dev/...::INSTR`` or ``/dev/...``; the
            new one is of the same form.

    Raises:
        ValueError: it is none of these.
        OSError: there is no such line.
    """
    with _wire(resource) as wire:
        yield wire


def _wire(resource: str) -> FaultyWire:
    if match := _SOCKET.fullmatch(resource):
        return _TcpWire(match["host"], int(match["port"]), "TCPIP0::127.0.0.1::{}::SOCKET".format)
    if match := _URL.fullmatch(resource):
        return _TcpWire(match["host"], int(match["port"]), "socket://127.0.0.1:{}".format)
    if match := _ASRL.fullmatch(resource):
        return _TerminalWire(match["path"], "ASRL{}::INSTR".format)
    if resource.startswith("/"):
        return _TerminalWire(resource, str)
    raise ValueError(f"resource: expected a socket or a serial line, came {resource!r}")
