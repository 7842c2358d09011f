"""Connections to the page, few and short: the run that serves it needs file descriptors for its instruments."""

import asyncio
from itertools import count
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol

_MOST: Final = 64
"""Connections at a time: 32 browsers that follow a run, and the files they load besides.

Beyond, the one goes that has asked nothing for longest, so that who stops the run is heard in any flood.
"""
_ASKING_S: Final = 5.0  # Within which a new connection must have put its first request, wall time


class BoundedConnection(H11Protocol):
    """A connection that is refused if too many are busy, and closed if it sends no request."""

    _unasked: asyncio.TimerHandle | None = None
    _made = count()
    number = 0

    def connection_made(self, transport: Any) -> None:
        """Take the connection, or close it at once."""
        self.number = next(self._made)
        if len(self.connections) >= _MOST:
            connections: set[Any] = self.connections
            idle = [each for each in connections if each.cycle is None or each.cycle.response_complete]
            if not idle:
                self.transport = transport
                transport.abort()
                return
            last = min(idle, key=lambda each: (each.cycle is not None, each.number))
            connections.discard(last)
            last.transport.abort()
        super().connection_made(transport)
        self._unasked = asyncio.get_running_loop().call_later(
            _ASKING_S, lambda: self.cycle is None and transport.close()
        )

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        if self._unasked is not None:
            self._unasked.cancel()
        super().connection_lost(exc)
