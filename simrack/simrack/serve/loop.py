"""One thread for all sockets: a readiness loop with timers, and the passing of bench time between its turns."""

from __future__ import annotations

import contextlib
import heapq
import math
import select
import selectors
import socket
import sys
import traceback
from collections.abc import Callable
from itertools import count
from typing import Protocol

from simrack.clock import WallClock

READ = 1
"""A file can be read, or has hung up. The values are those of epoll."""
WRITE = 4
"""A file can be written."""
_LONGEST_WAIT_S = 3600.0
_CROWDED = 256
"""Timers beyond which those that were cancelled are thrown out."""


class _Poller(Protocol):
    """The part of `select.epoll` that the loop uses."""

    def register(self, fd: int, eventmask: int = ..., /) -> None: ...
    def modify(self, fd: int, eventmask: int, /) -> None: ...
    def unregister(self, fd: int, /) -> None: ...
    def poll(self, timeout: float | None = ..., /) -> list[tuple[int, int]]: ...
    def close(self) -> None: ...


class _SelectorPoller:
    """Poller of other systems, in the shape of epoll.

    A selector cannot watch a file for hanging up alone: one from which nothing is to be received for now is forgotten.
    """

    def __init__(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector

    def register(self, fd: int, eventmask: int = READ, /) -> None:
        if eventmask:
            self._selector.register(fd, self._wanted(eventmask))

    def modify(self, fd: int, eventmask: int, /) -> None:
        self.unregister(fd)
        self.register(fd, eventmask)

    def unregister(self, fd: int, /) -> None:
        with contextlib.suppress(KeyError):
            self._selector.unregister(fd)

    def poll(self, timeout: float | None = None, /) -> list[tuple[int, int]]:
        return [(key.fd, self._found(mask)) for key, mask in self._selector.select(timeout)]

    def close(self) -> None:
        self._selector.close()

    @staticmethod
    def _wanted(mask: int) -> int:
        return (selectors.EVENT_READ if mask & READ else 0) | (selectors.EVENT_WRITE if mask & WRITE else 0)

    @staticmethod
    def _found(mask: int) -> int:
        return (READ if mask & selectors.EVENT_READ else 0) | (WRITE if mask & selectors.EVENT_WRITE else 0)


def _poller() -> _Poller:
    epoll = getattr(select, "epoll", None)
    return _SelectorPoller(selectors.DefaultSelector()) if epoll is None else epoll()


class Timer:
    """Something to be done later; :meth:`cancel` it when it is not wanted any more."""

    __slots__ = ("action",)

    def __init__(self, action: Callable[[], None]) -> None:
        self.action: Callable[[], None] | None = action

    def cancel(self) -> None:
        """Forget it."""
        self.action = None


class Passage(Protocol):
    """Passage of bench time between the turns of the loop."""

    def tick(self) -> None:
        """Bring bench time up to date."""

    def wait_s(self) -> float:
        """Return the wall seconds until bench time wants a turn; may let time jump, and then returns 0."""

    def idle(self) -> None:
        """Called after that time without a message."""


class Loop:
    """Calls the watchers of files that are ready, timers that are due, and lets bench time pass."""

    def __init__(self, wall: WallClock | None = None) -> None:
        self.wall = WallClock() if wall is None else wall
        self._poller = _poller()
        self._handlers: dict[int, Callable[[int], None]] = {}
        self._timers: list[tuple[float, int, Timer]] = []
        self._crowded = _CROWDED
        self._numbers = count()
        self._last: list[Callable[[], None]] = []
        self._slow: set[int] = set()
        self._running = True
        self._alarm, self._bell = socket.socketpair()
        for end in (self._alarm, self._bell):
            end.settimeout(0.0)
        self.watch(self._alarm.fileno(), self._woken)

    @property
    def wake_fd(self) -> int:
        """A file to write a byte to, so that the loop takes a turn (`signal.set_wakeup_fd`)."""
        return self._bell.fileno()

    @property
    def running(self) -> bool:
        """True until the loop is asked to stop."""
        return self._running

    def watch(self, fd: int, handler: Callable[[int], None], mask: int = READ) -> None:
        """Call `handler` with the events of `fd`."""
        self._handlers[fd] = handler
        self._poller.register(fd, mask)

    def change(self, fd: int, mask: int) -> None:
        """Watch `fd` for something else."""
        self._poller.modify(fd, mask)

    def look_at(self, fd: int) -> None:
        """Read `fd` before the calls that are done last, whether it says that it is ready or not.

        What is written to a pseudo-terminal arrives a little later; reading from it waits for what is on its way.
        """
        self._slow.add(fd)

    def unwatch(self, fd: int) -> None:
        """Forget `fd`, before it is closed."""
        self._slow.discard(fd)
        if self._handlers.pop(fd, None) is not None:
            with contextlib.suppress(OSError, KeyError):
                self._poller.unregister(fd)

    def call_later(self, seconds: float, action: Callable[[], None]) -> Timer:
        """Call `action` once `seconds` of wall time have passed."""
        if len(self._timers) > self._crowded:
            self._timers = [each for each in self._timers if each[2].action is not None]
            heapq.heapify(self._timers)
            self._crowded = _CROWDED + 2 * len(self._timers)
        timer = Timer(action)
        heapq.heappush(self._timers, (self.wall.now() + seconds, next(self._numbers), timer))
        return timer

    def call_last(self, action: Callable[[], None]) -> None:
        """Call `action` once everything that has been received by now is dealt with."""
        self._last.append(action)

    def stop(self) -> None:
        """End :meth:`run` soon; may be called from a signal handler or another thread."""
        self._running = False
        self.wake()

    def wake(self) -> None:
        """Have it take a turn; may be called from another thread."""
        with contextlib.suppress(OSError):
            self._bell.send(b"\0")

    def run(self, passage: Passage) -> None:
        """Serve until :meth:`stop`."""
        poll, handlers, tick, wait = self._poller.poll, self._handlers, passage.tick, passage.wait_s
        while self._running:
            seconds = wait()
            if self._timers:
                seconds = min(seconds, self._run_timers())
            if self._last:
                seconds = 0.0
            ready = poll(None if seconds > _LONGEST_WAIT_S else seconds)
            tick()
            if not ready and seconds > 0:
                passage.idle()
            for fd, mask in ready:
                handler = handlers.get(fd)
                if handler is None:
                    continue
                try:
                    handler(mask)
                except Exception:  # noqa: BLE001  (one instrument's mistake must not end the others' connections)
                    _drop(handler)
            if self._last:
                self._run_last()

    def close(self) -> None:
        """Give everything back to the system."""
        for fd in list(self._handlers):
            self.unwatch(fd)
        self._poller.close()
        self._alarm.close()
        self._bell.close()

    def _run_last(self) -> None:
        actions, self._last = self._last, []
        ready = dict(self._poller.poll(0))
        for fd in [*ready, *(self._slow - ready.keys())]:
            if fd in self._handlers:
                handler = self._handlers[fd]
                try:
                    handler(ready.get(fd, READ))
                except Exception:  # noqa: BLE001  (as in run)
                    _drop(handler)
        for action in actions:
            _done(action)

    def _run_timers(self) -> float:
        """Do everything due; return the seconds until the next."""
        while self._timers:
            remaining = self._timers[0][0] - self.wall.now()
            timer = self._timers[0][2]
            if timer.action is not None and remaining > 0:
                return remaining
            heapq.heappop(self._timers)
            if timer.action is not None:
                _done(timer.action)
        return math.inf

    def _woken(self, _mask: int) -> None:
        with contextlib.suppress(OSError):
            self._alarm.recv(4096)


def _done(action: Callable[[], None]) -> None:
    """Do `action`; an exception there is printed, and ends nothing."""
    try:
        action()
    except Exception:  # noqa: BLE001  (as in run)
        traceback.print_exc(file=sys.stderr)


def _drop(handler: Callable[[int], None]) -> None:
    """Tell of the exception being handled, and end the connection that met it."""
    traceback.print_exc(file=sys.stderr)
    owner = getattr(handler, "__self__", None)
    drop = getattr(owner, "dropped", None) or getattr(owner, "close", None)
    if drop is not None:
        _done(drop)  # what has gone wrong once may go wrong again
