"""What tests ask of the machine: TCP ports that are free, and time."""

from __future__ import annotations

import socket

BUSY_S = 2.0
"""What a busy machine may add to a wait of tenths of a second. PyVISA's own time-out is as long again."""


def free_port() -> int:
    """Return a port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])
