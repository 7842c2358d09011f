"""Small servers on real loopback sockets that answer, and misbehave, as told."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

Handler = Callable[[socket.socket], None]

IDENTITY = "HEWLETT-PACKARD,34401A,0,10-5-2"


@contextmanager
def serving(*handlers: Handler) -> Iterator[str]:
    """Serve one connection a handler, in order; yields the VISA resource string."""
    server = socket.create_server(("127.0.0.1", 0))

    def run() -> None:
        for handler in handlers:
            try:
                connection, _ = server.accept()
            except OSError:
                return
            with connection, suppress(OSError):
                handler(connection)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield f"TCPIP0::127.0.0.1::{server.getsockname()[1]}::SOCKET"
    finally:
        server.close()
        thread.join(0.05)


def lines(connection: socket.socket) -> Iterator[str]:
    received = b""
    while data := connection.recv(65536):
        *whole, received = (received + data).split(b"\n")
        yield from (line.decode() for line in whole)


def answering(special: Callable[[socket.socket, str], bool]) -> Handler:
    """Return a handler of an instrument that behaves, except where `special` has dealt with a message."""

    def handler(connection: socket.socket) -> None:
        for line in lines(connection):
            if not special(connection, line) and (answer := _standard(line)) is not None:
                connection.sendall(answer.encode() + b"\n")

    return handler


def _standard(line: str) -> str | None:
    known = {"*IDN?": IDENTITY, "*OPC?": "1", "SYST:ERR?": '+0,"No error"'}
    return known.get(line, line.removesuffix("?") if line.endswith("?") else None)


def nothing_special(connection: socket.socket, line: str) -> bool:
    del connection, line
    return False
