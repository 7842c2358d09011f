"""Whose a connection within this host is, where the system tells."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from simrack.serve import peer

from simrack_tests.serve.lamp import served_lamp

if TYPE_CHECKING:
    from collections.abc import Iterator

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux tells whose a socket is")


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as client:
        accepted, _ = server.accept()
        with accepted:
            yield accepted, client


@linux
def test_our_own_connections_are_ours(ends: tuple[socket.socket, socket.socket]) -> None:
    assert peer.user_of(ends[0]) == os.geteuid()
    assert peer.is_welcome(ends[0])


@linux
def test_a_connection_that_was_closed_already_is_nobodys(
    ends: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    ends[1].close()
    assert peer.user_of(ends[0]) in {None, -1, os.getuid()}
    assert os.getuid() or not peer.is_welcome(ends[0])


def test_where_the_system_does_not_tell_everybody_is_welcome(
    ends: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peer, "_TABLES", ())
    assert peer.user_of(ends[0]) is None
    assert peer.is_welcome(ends[0])


def test_who_became_root_to_serve_is_welcome(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setenv("SUDO_UID", "1000")
    assert peer.welcome_users() == {0, 1000}
    monkeypatch.setattr(os, "geteuid", lambda: 1001)
    assert peer.welcome_users() == {0, 1001}


ASK = """
import os, socket, sys
socket.getaddrinfo("127.0.0.1", 1)  # what it imports may be out of another user's reach
os.setuid(54321)
with socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=5) as port:
    try:
        port.sendall(b'{"do": "stop", "id": 1}\\n')
        print(port.recv(1000).decode())
    except ConnectionError:
        print("served by another user")  # it was closed before it could ask
"""


@linux
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can be another user")
def test_another_user_cannot_stop_the_bench() -> None:
    with served_lamp() as served:
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-I", "-c", ASK, str(served.server.control.port)],
            capture_output=True,
            text=True,
            check=True,
        )
        assert "served by another user" in done.stdout
        assert served.server.loop.running
