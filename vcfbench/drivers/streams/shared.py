"""A wire that several readers share: the frames of one port, of which each takes a field of its own."""

from collections.abc import Callable

from vcfbench.clock import Deadline
from vcfbench.drivers.trace import Connect
from vcfbench.drivers.wire import Interface, Wire


class _Shared:
    """The end of a shared wire for one reader: bytes that another has received are here too."""

    interface: Interface = "serial"

    def __init__(self, of: "SharedConnection", wire: Wire) -> None:
        self._of = of
        self._wire = wire
        self._kept = bytearray()

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""
        self._wire.send(data, deadline)

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the received bytes, waiting for the first one."""
        if not self._kept:
            data, _ = self._wire.receive(deadline)
            self._of.hand_out(data)
        return self.pending(), False

    def pending(self) -> bytes:
        """Return the received bytes, without waiting."""
        data = bytes(self._kept)
        self._kept.clear()
        return data

    def clear(self, deadline: Deadline) -> None:
        """Discard the received bytes for this reader."""
        while not deadline.expired() and (data := self._wire.pending()):
            self._of.hand_out(data)
        self._kept.clear()

    def keep(self, data: bytes) -> None:
        """Keep received bytes."""
        self._kept += data

    def close(self) -> None:
        """Give the connection back with its last reader."""
        self._of.leave(self)


class SharedConnection:
    """One connection for all readers of a resource."""

    def __init__(self, connect: Connect) -> None:
        self._connect = connect
        self._wire: Wire | None = None
        self._ends: list[_Shared] = []

    def connect(self, deadline: Deadline) -> Wire:
        """Return the end of the wire for one more reader."""
        if self._wire is None:
            self._wire = self._connect(deadline)
        self._ends.append(_Shared(self, self._wire))
        return self._ends[-1]

    def hand_out(self, data: bytes) -> None:
        """Give all readers the received bytes."""
        for each in self._ends:
            each.keep(data)

    def leave(self, end: _Shared) -> None:
        """Close one reader's end."""
        if end in self._ends:
            self._ends.remove(end)
            if not self._ends and self._wire is not None:
                self._wire.close()
                self._wire = None


Sharing = Callable[[str, Connect], Connect]
"""Returns for a resource how it is connected to, told how it would be alone."""


def sharing() -> Sharing:
    """Return the function that has the readers of one resource share its connection."""
    known: dict[str, SharedConnection] = {}

    def connected(resource: str, connect: Connect) -> Connect:
        return known.setdefault(resource, SharedConnection(connect)).connect

    return connected
