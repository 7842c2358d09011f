"""A man in the middle: passes on the messages of a program and its instrument, and damages replies.

It stands on a TCP connection or on a serial line (a pseudo-terminal) and does not interpret the messages. Commands
always reach the instrument as they are; only what comes back suffers::

    with faulty_wire("TCPIP0::127.0.0.1::5025::SOCKET") as wire:
        meter = manager.open_resource(wire.resource)     # instead of the instrument's own resource
        wire.begin(WireFault("late", count=1, delay_s=3.0))

A reply is what arrives from the instrument in one piece.
"""

from __future__ import annotations

import math
import os
import re
import socket
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Self

from simrack.clock import WallClock
from simrack.serve.loop import Loop
from simrack.serve.wire import Connection, Listener

__all__ = ["WIRE_FAULTS", "FaultyWire", "WireFault", "faulty_wire"]

WIRE_FAULTS: dict[str, str] = {
    "silent": "replies are lost",
    "late": "replies come `delay_s` later, in their order",
    "truncated": "the second half of each reply is missing",
    "flipped": "one bit of each reply is the other way round",
    "replaced": "random bytes come instead of each reply",
    "unended": "line ends are missing; of a reply without one, its last byte",
    "endless": "a reply is followed by letters without end",
    "trickle": "replies come byte by byte, one every `delay_s`",
    "doubled": "each reply comes twice",
    "disconnect": "the connection is lost with each reply; a new one works until the next",
    "unreachable": "the connection is lost with the next reply; there is no new one until the fault ends",
    "garbage": "random bytes come before each reply, and between",
}
"""Effect of each kind; kinds of :mod:`simrack.faults` have their names from there."""
_FLOOD = b"A" * (1 << 16)
_NOISE_S = 0.1
_BURST = 12
_REACHING_S = 1.0
_QUICK_ACK: int | None = getattr(socket, "TCP_QUICKACK", None)


@dataclass(frozen=True, slots=True)
class WireFault:
    """Fault of replies.

    Args:
        kind: one of `WIRE_FAULTS`.
        count: how many replies are spoilt; None: all, until the fault is ended.
        delay_s: how much later ``late`` replies come, and bytes of ``trickle``, s; 1 s if not given.
        seed: of random bytes and places.

    Raises:
        ValueError: there is no such kind.
    """

    kind: str
    count: int | None = None
    delay_s: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in WIRE_FAULTS:
            raise ValueError(f"kind: expected one of {', '.join(WIRE_FAULTS)}, got {self.kind!r}")


class _Near(Connection):
    """The program's end of a link, and the replies on their way to it."""

    far: _Far

    def __init__(self, wire: FaultyWire, connection: Any) -> None:
        self.wire = wire
        self.flood = False
        self._latest_s = -math.inf
        self._waiting: deque[bytes] = deque()
        super().__init__(wire.loop, connection)

    def send_at(self, data: bytes, due_s: float) -> None:
        """Send `data` at `due_s`, not before any sent earlier."""
        self._latest_s = max(due_s, self._latest_s)
        later_s = self._latest_s - self.wire.clock.now()
        if later_s > 0.0 or self._waiting:
            self._waiting.append(data)
            self.loop.call_later(later_s, lambda: self.send(self._waiting.popleft()))
        elif data:
            self.send(data)

    def received(self, data: bytes) -> None:
        """Pass on the program's bytes."""
        if _QUICK_ACK is not None and isinstance(self._socket, socket.socket):
            self._socket.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)  # a program with Nagle's algorithm waits for it
        self.wire.pass_on(self, data)

    def gone(self) -> None:
        """Deliver all sent bytes to the instrument before it sees the end of the connection."""
        self.far.finish()


class _Far(Connection):
    """The instrument's end of a link."""

    near: _Near | None = None

    def received(self, data: bytes) -> None:
        """Take a reply."""
        if self.near is not None:
            self.near.wire.take_reply(self.near, data)

    def finish(self) -> None:
        """Say that nothing more comes; bytes already sent still arrive."""
        self.near = None
        self.relieved()

    def relieved(self) -> None:
        """Say it once everything is sent."""
        if self.near is None and not self.blocked and isinstance(self._socket, socket.socket):
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_WR)

    def gone(self) -> None:
        """End the program's end too."""
        if self.near is not None:
            self.near.close()


class FaultyWire:
    """The wire as a program sees it; made by :func:`faulty_wire`. TCP and serial lines are its subclasses.

    `resource` is what the program opens. `spoilt_s` holds the instants (of `clock`) at which replies were spoilt,
    `received` what the program has sent since the fault began, `answered` the whole replies that were passed on since.
    """

    def __init__(self, resource: str) -> None:
        self.resource = resource
        self.clock = WallClock()
        self.spoilt_s: list[float] = []
        self.received = bytearray()
        self.answered = 0
        self.loop = Loop(self.clock)
        self.links: list[_Near] = []
        self._fault: WireFault | None = None
        self._left: int | None = 0
        self._noise_s = 0.0
        self._random = Random(0)  # noqa: S311  # noise, no secret
        self._lock = threading.RLock()
        self._thread = threading.Thread(target=self.loop.run, args=(self,), daemon=True)

    # --- what tests say

    def begin(self, fault: WireFault) -> None:
        """Spoil replies from now on."""
        with self._lock:
            self._fault, self._left, self._random = fault, fault.count, Random(fault.seed)  # noqa: S311
            self.spoilt_s.clear()
            self.received.clear()
            self.answered = 0
        self.loop.wake()

    def end(self) -> None:
        """End the fault; replies already on their way stay damaged."""
        with self._lock:
            self._fault, self._left = None, 0
            for near in self.links:
                near.flood = False
            self._restore()
        self.loop.wake()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.loop.stop()
        self._thread.join(5.0)
        for near in self.links:
            for each in (near, near.far):
                if not each.closed:
                    each.detach().close()
        self.loop.close()

    # --- what happens to a message

    def join(self, near: _Near, far: _Far) -> None:
        """Make a link of two ends."""
        near.far, far.near = far, near
        self.links = [*(each for each in self.links if not (each.closed and each.far.closed)), near]

    def pass_on(self, near: _Near, data: bytes) -> None:
        """Send a program's bytes to the instrument."""
        with self._lock:
            self.received += data
            near.far.send(data)

    def take_reply(self, near: _Near, data: bytes) -> None:
        """Send a reply to the program, or its spoilt form."""
        with self._lock:
            fault, now_s = self._spoiling(), self.clock.now()
            if fault is None:
                self.answered += 1
                near.send_at(data, now_s)
                return
            self.spoilt_s.append(now_s)
            if self._left is not None:
                self._left -= 1
            if fault.kind in {"disconnect", "unreachable"}:
                self._lose(near, forever=fault.kind == "unreachable")
            elif fault.kind == "late":
                near.send_at(data, now_s + fault.delay_s)
            elif fault.kind == "trickle":
                for number in range(len(data)):
                    near.send_at(data[number : number + 1], now_s + (number + 1) * fault.delay_s)
            else:
                near.send_at(_ALTERED[fault.kind](data, self._random), now_s)
                near.flood = fault.kind == "endless"

    def _spoiling(self) -> WireFault | None:
        return self._fault if self._left is None or self._left > 0 else None

    def _noisy(self) -> bool:
        """True if there is noise on the wire unasked."""
        return self._left is None and self._fault is not None and self._fault.kind == "garbage"

    # --- between the turns of the loop

    def tick(self) -> None:
        """Put the chosen burst of noise, or endless letters, on the wire."""
        with self._lock:
            noisy = self._noisy() and self.clock.now() >= self._noise_s
            if noisy:
                self._noise_s = self.clock.now() + _NOISE_S
            for near in self.links:
                if noisy:
                    near.send_at(self._random.randbytes(_BURST), self.clock.now())
                if near.flood and not near.blocked:
                    near.send(_FLOOD)

    def wait_s(self) -> float:
        """Return the time until the next burst; letters follow each other as the program takes them."""
        if any(near.flood and not near.blocked for near in self.links):
            return 0.0
        return _NOISE_S if self._noisy() else math.inf

    def idle(self) -> None:
        """Do nothing."""

    # --- what TCP and serial lines do each in their way

    def _lose(self, near: _Near, *, forever: bool) -> None:
        raise NotImplementedError

    def _restore(self) -> None:
        raise NotImplementedError


class _TcpWire(FaultyWire):
    def __init__(self, host: str, port: int, named: Callable[[int], str]) -> None:
        self._target = (host, port)
        self._port = 0
        super().__init__("")
        self._listener: Listener | None = None
        self._restore()
        self.resource = named(self._port)

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        if self._listener is not None:
            self._listener.close()

    def _accept(self, connection: socket.socket) -> None:
        far = socket.create_connection(self._target, timeout=_REACHING_S)
        far.settimeout(0.0)
        far.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.join(_Near(self, connection), _Far(self.loop, far))

    def _lose(self, near: _Near, *, forever: bool) -> None:
        if forever and self._listener is not None:
            self._listener.close()
            self._listener = None
        near.detach().close()
        near.far.finish()

    def _restore(self) -> None:
        if self._listener is None:
            self._listener = Listener(self.loop, ("127.0.0.1", self._port), self._accept)
            self._port = self._listener.port


class _Terminal:
    """One end of a terminal in the shape of a socket: the master of our own, or the instrument's, as a program's."""

    def __init__(self, fd: int) -> None:
        os.set_blocking(fd, False)
        self.fileno = lambda: fd
        self.recv, self.send = partial(os.read, fd), partial(os.write, fd)
        self.sendmsg, self.close = partial(os.writev, fd), partial(os.close, fd)


class _TerminalWire(FaultyWire):
    def __init__(self, path: str, named: Callable[[str], str]) -> None:
        import tty  # noqa: PLC0415  # there is none on Windows

        self._folder = tempfile.TemporaryDirectory(prefix="wire")
        self._path = Path(self._folder.name) / "tty"
        self._slave = -1
        super().__init__(named(str(self._path)))
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._fd)
        far: Any = _Terminal(self._fd)
        self._far = _Far(self.loop, far)
        self._restore()

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        if self._slave >= 0:
            os.close(self._slave)
        self._folder.cleanup()

    def pass_on(self, near: _Near, data: bytes) -> None:
        """Send on, at the speed that the program has chosen."""
        import termios  # noqa: PLC0415

        if self._slave >= 0:
            chosen, own = termios.tcgetattr(self._slave), termios.tcgetattr(self._fd)
            if chosen[2:6] != own[2:6]:
                termios.tcsetattr(self._fd, termios.TCSANOW, [*own[:2], *chosen[2:6], own[6]])
        super().pass_on(near, data)

    def _lose(self, near: _Near, *, forever: bool) -> None:
        near.detach().close()
        os.close(self._slave)
        self._slave = -1
        if forever:
            self._path.unlink()
        else:
            self._restore()

    def _restore(self) -> None:
        """Make a terminal at our path; its own end is kept open, or it would hang up when a program leaves."""
        import tty  # noqa: PLC0415

        if self._slave >= 0:
            return
        master, self._slave = os.openpty()
        tty.setraw(self._slave)
        fresh = self._path.with_name("new")
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self._path)
        self.links.clear()
        self.join(_Near(self, _Terminal(master)), self._far)


def _flipped(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << random.randrange(7)]) + data[at + 1 :]


_ALTERED: dict[str, Callable[[bytes, Random], bytes]] = {
    "silent": lambda _data, _random: b"",
    "truncated": lambda data, _: data[: len(data) // 2],
    "flipped": _flipped,
    "replaced": lambda data, random: random.randbytes(len(data)),
    "unended": lambda data, _: data.rstrip(b"\r\n") if data.endswith((b"\r", b"\n")) else data[:-1],
    "endless": lambda data, _: data.rstrip(b"\r\n"),
    "doubled": lambda data, _: data * 2,
    "garbage": lambda data, random: random.randbytes(_BURST) + data,
}


_SOCKET = re.compile(r"TCPIP\d*::(?P<host>[^:]+)::(?P<port>\d+)::SOCKET", re.IGNORECASE)
_URL = re.compile(r"socket://(?P<host>[^:]+):(?P<port>\d+)")
_ASRL = re.compile(r"ASRL(?P<path>/.+?)(?:::INSTR)?", re.IGNORECASE)


@contextmanager
def faulty_wire(resource: str) -> Iterator[FaultyWire]:
    """Put a faulty wire between a program and the instrument at `resource`; the program opens the yielded one.

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
    raise ValueError(f"resource: expected a socket or a serial line, got {resource!r}")
