"""The man in the middle of a wire: passes on what comes, spoils replies; TCP and serial lines are its subclasses."""

from __future__ import annotations

import selectors
import socket
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from random import Random
from typing import Protocol, Self

from simrack.clock import WallClock

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


@dataclass(frozen=True, slots=True)
class WireFault:
    """Fault of replies.

    Args:
        kind: one of `WIRE_FAULTS`.
        count: how many replies are spoilt; None: all, until the fault is ended.
        delay_s: how much later ``late`` replies come, s; the time from byte to byte of ``trickle``, s.
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
            raise ValueError(f"kind: expected one of {', '.join(WIRE_FAULTS)}, came {self.kind!r}")


CHUNK = 1 << 16
_TICK_S, _IDLE_S = 0.02, 0.5
_BURST = 12


class WireEnd(Protocol):
    """One end of a connection, never blocking: `read` raises OSError or returns b"" when it is lost."""

    def fileno(self) -> int:
        """Return the descriptor."""

    def read(self) -> bytes:
        """Return what has arrived."""

    def write(self, data: bytes) -> int:
        """Send what goes, and return how much that was."""

    def close(self) -> None:
        """Close this end."""


class FaultyWire:
    """The wire as a program sees it; made by :func:`faulty_wire`.

    `resource` is what the program opens. `spoilt_s` holds the instants (of `clock`) at which replies were spoilt,
    `told` what the program has sent since the fault began, `answered` the whole replies that were passed on since.
    """

    def __init__(self, resource: str) -> None:
        self.resource = resource
        self.clock = WallClock()
        self.spoilt_s: list[float] = []
        self.received = bytearray()
        self.answered = 0
        self._fault: WireFault | None = None
        self._left: int | None = 0
        self._random = Random(0)  # noqa: S311  # noise, no secret
        self._lock = threading.RLock()
        self._selector = selectors.DefaultSelector()
        self._links: list[WireLink] = []
        self._wake, self._waked = socket.socketpair()
        self._waked.setblocking(False)  # noqa: FBT003
        self._running = True
        self._selector.register(self._waked, selectors.EVENT_READ, lambda: self._waked.recv(CHUNK))
        self._thread = threading.Thread(target=self._run, daemon=True)

    # --- what tests say

    def begin(self, fault: WireFault) -> None:
        """Spoil replies from now on."""
        with self._lock:
            self._fault, self._left, self._random = fault, fault.count, Random(fault.seed)  # noqa: S311
            self.spoilt_s.clear()
            self.received.clear()
            self.answered = 0
        self._nudge()

    def end(self) -> None:
        """Pass on everything again; replies on their way come as they were to come."""
        with self._lock:
            self._fault, self._left = None, 0
            for link in self._links:
                link.flood = False
            self._restore()
        self._nudge()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._nudge()
        self._thread.join(5.0)
        for link in self._links:
            link.close()
        self._selector.close()
        self._wake.close()
        self._waked.close()

    # --- what happens to a reply

    def _reply(self, link: WireLink, data: bytes) -> None:
        fault = self._spoiling()
        if fault is None:
            self.answered += 1
            link.send(data, self.clock.now())
            return
        self.spoilt_s.append(self.clock.now())
        if self._left is not None:
            self._left -= 1
        if fault.kind in {"disconnect", "unreachable"}:
            self._lose(link, forever=fault.kind == "unreachable")
        elif fault.kind == "late":
            link.send(data, self.clock.now() + fault.delay_s)
        elif fault.kind == "trickle":
            for number in range(len(data)):
                link.send(data[number : number + 1], self.clock.now() + (number + 1) * fault.delay_s)
        else:
            link.send(_ALTERED[fault.kind](data, self._random), self.clock.now())
            link.flood = fault.kind == "endless"

    def _spoiling(self) -> WireFault | None:
        return self._fault if self._left is None or self._left > 0 else None

    def _noise(self) -> None:
        """Put a burst of noise on the wire unasked, as long as there is noise on it."""
        fault = self._spoiling()
        if fault is not None and fault.kind == "garbage" and self._left is None:
            for link in self._links:
                link.send(self._random.randbytes(_BURST), self.clock.now())

    # --- the loop

    def _run(self) -> None:
        while self._running:
            for key, _ in self._selector.select(self._pause_s()):
                with self._lock, suppress(OSError):
                    key.data()
            with self._lock:
                for link in list(self._links):
                    link.pump(self.clock.now())
                self._noise()

    def _pause_s(self) -> float:
        if any(link.pending for link in self._links):
            return _TICK_S
        fault = self._spoiling()
        return 5.0 * _TICK_S if fault is not None and fault.kind == "garbage" else _IDLE_S

    def _nudge(self) -> None:
        with suppress(OSError):
            self._wake.send(b"!")

    def _join(self, near: WireEnd, far: WireEnd) -> WireLink:
        link = WireLink(self, near, far)
        self._links.append(link)
        self._selector.register(near, selectors.EVENT_READ, lambda: self._heard(link))
        self._selector.register(far, selectors.EVENT_READ, lambda: self._said(link))
        return link

    def _heard(self, link: WireLink) -> None:
        """Pass on the program's bytes."""
        data = received(link.near)
        if not data:
            self._program_left(link)
            return
        self.received += data
        link.tell(data)

    def _said(self, link: WireLink) -> None:
        """Pass on the instrument's bytes."""
        data = received(link.far)
        if data:
            self._reply(link, data)
        else:
            self._drop(link)

    def _drop(self, link: WireLink) -> None:
        for end in (link.near, link.far):
            self._forget(end)
        if link in self._links:
            self._links.remove(link)
        link.close()

    def _forget(self, end: WireEnd) -> None:
        with suppress(KeyError, ValueError):
            self._selector.unregister(end)

    # --- what TCP and serial lines do each in their way

    def _lose(self, link: WireLink, *, forever: bool) -> None:
        raise NotImplementedError

    def _restore(self) -> None:
        raise NotImplementedError

    def _program_left(self, link: WireLink) -> None:
        raise NotImplementedError


class WireLink:
    """Link of the program (`near`) with the instrument (`far`), and the replies on their way to the program."""

    def __init__(self, wire: FaultyWire, near: WireEnd, far: WireEnd) -> None:
        self.wire, self.near, self.far = wire, near, far
        self.flood = False
        self._queue: deque[tuple[float, bytes]] = deque()

    @property
    def pending(self) -> bool:
        """Tell whether anything is to be sent to the program."""
        return self.flood or bool(self._queue)

    def send(self, data: bytes, due_s: float) -> None:
        """Send `data` to the program at `due_s`, not before any sent earlier."""
        if data:
            latest_s = self._queue[-1][0] if self._queue else due_s
            self._queue.append((max(due_s, latest_s), data))
            self.pump(self.wire.clock.now())

    def tell(self, data: bytes) -> None:
        """Send `data` to the instrument."""
        while data:
            try:
                data = data[self.far.write(data) :]
            except BlockingIOError:
                with selectors.DefaultSelector() as ready:
                    ready.register(self.far, selectors.EVENT_WRITE)
                    if not ready.select(_IDLE_S):
                        return  # the instrument takes nothing: as on a real line, it is lost

    def pump(self, now_s: float) -> None:
        """Send the program the due replies, as far as it takes them."""
        if self.flood and not self._queue:
            self._queue.append((now_s, b"A" * CHUNK))
        with suppress(OSError):
            while self._queue and self._queue[0][0] <= now_s:
                due_s, data = self._queue[0]
                sent = self.near.write(data)
                self._queue.popleft()
                if sent < len(data):
                    self._queue.appendleft((due_s, data[sent:]))
                    return

    def forget(self) -> None:
        """Lose the replies on their way."""
        self.flood = False
        self._queue.clear()

    def close(self) -> None:
        """Close both ends."""
        self.forget()
        for end in (self.near, self.far):
            with suppress(OSError):
                end.close()


def received(end: WireEnd) -> bytes:
    """Return what has arrived at an end, nothing when it is lost; BlockingIOError when nothing has."""
    try:
        return end.read()
    except BlockingIOError:
        raise
    except OSError:
        return b""


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
