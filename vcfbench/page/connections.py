"""Connections to the page, few and short: the run that serves it needs file descriptors for its instruments."""

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol

_MOST: Final = 64  # Connections at a time: 32 browsers that follow a run, and the files they load besides
_ASKING_S: Final = 5.0  # Within which a new connection must have put its first request, wall time


class BoundedConnection(H11Protocol):
    """A connection that is refused where too many are open, and closed where it asks nothing."""

    _unasked: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Take the connection, or close it at once."""
        if len(self.connections) >= _MOST:
            self.transport = transport
            transport.abort()
            return
        super().connection_made(transport)
        self._unasked = asyncio.get_running_loop().call_later(
            _ASKING_S, lambda: self.cycle is None and transport.close()
        )

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        if self._unasked is not None:
            self._unasked.cancel()
        super().connection_lost(exc)
