"""User at the other end of a local connection: TCP has no permissions, but Linux reports a socket's owner."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_ESTABLISHED = "01"
_NOBODY = -1
"""Whose socket was closed already is not told: it could be anybody's."""


def is_welcome(connection: socket.socket) -> bool:
    """Return True if the user at the other end may control the server; where it cannot be known, they may.

    Welcome are the user who serves, root, and who has become root by sudo to serve.
    """
    user = user_of(connection)
    return user is None or user in welcome_users()


def welcome_users() -> frozenset[int]:
    """Return the users with permission to control the server."""
    users = {0, os.geteuid()} if hasattr(os, "geteuid") else set()
    if users == {0} and os.environ.get("SUDO_UID", "").isdecimal():
        users.add(int(os.environ["SUDO_UID"]))
    return frozenset(users)


def user_of(connection: socket.socket) -> int | None:
    """Return the number of the user whose socket is at the other end, or None if the system does not report it."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        there, here = _key(connection.getpeername()), _key(connection.getsockname())
        rows = [row for table in _TABLES if table.exists() for row in table.read_text("ascii").splitlines()[1:]]
    except (OSError, ValueError):
        return None
    found = {(_port(row[1]), _port(row[2])): row for row in map(str.split, rows) if len(row) > 7}
    if (here, there) not in found:  # our own end is not there either: the table does not show what is
        return None
    row = found.get((there, here))
    if row is None:
        return _NOBODY
    return int(row[7]) if row[3] == _ESTABLISHED or int(row[7]) else _NOBODY


def _key(address: tuple[object, ...]) -> int:
    """Return the port of an address; within a host two ports name a connection well enough."""
    port = address[1]
    if not isinstance(port, int):
        raise ValueError(f"no address of TCP: {address}")  # noqa: TRY004  # as for other addresses that are none
    return port


def _port(column: str) -> int:
    return int(column.rpartition(":")[2], 16)
