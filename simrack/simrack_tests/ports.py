"""What tests ask of the machine: TCP ports that are free, and time."""

from __future__ import annotations

import random
import socket
from contextlib import suppress
from typing import TYPE_CHECKING

from simrack.clock import WallClock, sleep

if TYPE_CHECKING:
    from collections.abc import Callable

BUSY_S = 10.0
"""What a busy machine may add to a wait of tenths of a second."""

PLENTY_S = 30.0
"""What is granted to that which comes; waiting for it is no failure of a machine that is busy."""


def free_port() -> int:
    """Return a port that is free now, and is not one of those that the system gives to whoever asks."""
    while True:
        port = random.randrange(10_000, 30_000)  # noqa: S311 - two tests at once shall not have the same
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port


def eventually(condition: Callable[[], object]) -> None:
    """Wait until `condition` holds, which another thread or process brings about."""
    clock = WallClock()
    while not condition():
        assert clock.now() < PLENTY_S, "it did not happen"
        sleep(clock, 0.002)
