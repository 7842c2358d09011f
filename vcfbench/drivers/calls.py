"""The calls on wires that are under way, and until when each may take: one that never returns is found from outside.

Every call has a deadline, and libraries keep it as a rule. One that does not would keep its program for ever, and the
bench live. Whoever opens instruments asks for this (:func:`attended`); else nothing stands in between.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from vcfbench.clock import Clock, Deadline, WallClock
from vcfbench.drivers.trace import BEHIND, Connect
from vcfbench.drivers.wire import Interface, Wire

_T = TypeVar("_T")


class Calls:
    """The calls under way on the wires of one bench; any thread may ask."""

    def __init__(self) -> None:
        self._clock = WallClock()
        self._due: dict[object, tuple[str, float]] = {}
        self.spoken: set[str] = set()
        """Instruments that were sent anything."""

    def call(self, what: str, deadline: Deadline, act: Callable[[], _T]) -> _T:
        """Call `act`, and note that it must return before `deadline`."""
        key = object()
        self._due[key] = (what, self._clock.now() + deadline.expires_s - deadline.started_s)
        try:
            return act()
        finally:
            del self._due[key]

    def overdue(self) -> str | None:
        """Return the call that is beyond its deadline, or None."""
        now_s = self._clock.now()
        return next((what for what, due_s in tuple(self._due.values()) if due_s < now_s), None)


@contextmanager
def attended(calls: Calls) -> Iterator[None]:
    """Note in `calls` the calls on the wires that are opened in here, as long as they are used."""

    def attendant(name: str, _resource: str, _clock: Clock, connect: Connect) -> Connect:
        def reach(deadline: Deadline) -> Wire:
            wire = calls.call(f"{name}: connecting", deadline, lambda: connect(deadline))
            return AttendedWire(wire, calls, name)

        return reach

    token = BEHIND.set((*BEHIND.get(), attendant))
    try:
        yield
    finally:
        BEHIND.reset(token)


class AttendedWire:
    """A wire that notes the beginning and end of each call."""

    def __init__(self, wire: Wire, calls: Calls, name: str) -> None:
        self.interface: Interface = wire.interface
        self.pending = wire.pending  # it waits for nothing
        self.close = wire.close
        self._wire = wire
        self._calls = calls
        self._name = name

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""
        self._calls.spoken.add(self._name)
        self._calls.call(f"{self._name}: sending", deadline, lambda: self._wire.send(data, deadline))

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return at least one byte, and True if the instrument marked the last one as the end of its message."""
        return self._calls.call(f"{self._name}: receiving", deadline, lambda: self._wire.receive(deadline))

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear."""
        self._calls.call(f"{self._name}: clearing", deadline, lambda: self._wire.clear(deadline))
