"""The loop on every way of waiting that systems have: what epoll does, select and poll must do too."""

from __future__ import annotations

import selectors
import socket
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
import serial
from simrack.clock import WallClock
from simrack.serve import Control, loop
from simrack.serve.loop import READ, WRITE, Loop

from simrack_tests.ports import PLENTY_S, eventually
from simrack_tests.serve.lamp import IDENTITY, PICTURE, Served, served_lamp
from simrack_tests.serve.test_hislip import DATA_END, sessions
from simrack_tests.serve.test_pty import device
from simrack_tests.serve.test_raw import Wire, wires
from simrack_tests.serve.test_vxi11 import callers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

WAYS = [
    name for name in ("EpollSelector", "PollSelector", "SelectSelector", "KqueueSelector") if hasattr(selectors, name)
]


@pytest.fixture(params=["its own", *WAYS])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Have every loop of the test wait that way."""
    name = str(request.param)
    if name != "its own":
        kind: Callable[[], Any] = getattr(selectors, name)
        monkeypatch.setattr(loop, "_poller", lambda: loop._SelectorPoller(kind()))
    return name


@pytest.fixture
def served(way: str) -> Iterator[Served]:
    del way
    with served_lamp() as lamp:
        yield lamp


class Still:
    """Bench time that asks for no turns."""

    def __init__(self, wait_s: float = 10.0) -> None:
        self.seconds = wait_s
        self.idled = 0

    def tick(self) -> None:
        pass

    def wait_s(self) -> float:
        return self.seconds

    def idle(self) -> None:
        self.idled += 1


@pytest.fixture
def bare(way: str) -> Iterator[Loop]:
    del way
    made = Loop()
    yield made
    made.close()


def test_a_file_is_watched_for_what_is_asked(bare: Loop) -> None:
    ours, theirs = socket.socketpair()
    seen: list[int] = []

    def note(mask: int) -> None:
        seen.append(mask)
        bare.stop()

    def turn(*, within_s: float) -> None:
        bare._running = True
        timer = bare.call_later(within_s, bare.stop)
        bare.run(Still())
        timer.cancel()

    with ours, theirs:
        bare.watch(ours.fileno(), note)
        turn(within_s=0.02)
        assert seen == []
        theirs.send(b"x")
        turn(within_s=5.0)
        assert seen == [READ]
        bare.change(ours.fileno(), 0)
        turn(within_s=0.02)
        assert seen == [READ]
        bare.change(ours.fileno(), WRITE)
        turn(within_s=5.0)
        assert seen == [READ, WRITE]
        bare.change(ours.fileno(), 0)
        bare.unwatch(ours.fileno())
        turn(within_s=0.02)
        assert seen == [READ, WRITE]


def test_timers_come_in_their_order_and_not_when_cancelled(bare: Loop) -> None:
    wall, done = WallClock(), list[str]()
    bare.call_later(0.03, bare.stop)
    bare.call_later(0.02, lambda: done.append("second"))
    bare.call_later(0.01, lambda: done.append("first"))
    bare.call_later(0.015, lambda: done.append("never")).cancel()
    bare.run(Still())
    assert done == ["first", "second"]
    assert 0.025 < wall.now() < 2.0


def test_it_is_woken_from_another_thread(bare: Loop) -> None:
    threading.Timer(0.05, bare.stop).start()
    passage = Still()
    bare.run(passage)
    assert passage.idled == 0


def test_nobody_saying_anything_is_noticed(bare: Loop) -> None:
    class Quiet(Still):
        def idle(self) -> None:
            super().idle()
            if self.idled == 3:
                bare.stop()

    passage = Quiet(0.005)
    bare.call_later(PLENTY_S, bare.stop)
    bare.run(passage)
    assert passage.idled == 3


def test_every_wire_answers(served: Served) -> None:
    with wires(served, 30) as raw, callers(served.port("vxi11")) as (caller,), sessions(served) as (session,):
        session.open()
        link = caller.link()[1]
        for _ in range(5):
            assert [wire.ask(b"*IDN?\n") for wire in raw] == [IDENTITY] * 30
            caller.write(link, b"*IDN?")
            assert caller.read(link)[2] == IDENTITY
            session.post(session.sync, DATA_END, 1, 2, b"*IDN?")
            assert session.message(session.sync)[3] == IDENTITY
        with Control(served.server.control.port) as control:
            assert control.request("status")["instruments"]["lamp"]["clients"] == 32
    if served.server.wires["lamp"].pty is not None:
        with serial.Serial(device(served.resource("pty")), timeout=5.0) as line:
            line.write(b"*IDN?\n")
            assert line.read_until(b"\n").strip() == IDENTITY.strip()


def test_a_client_that_does_not_read_stops_itself_only(served: Served) -> None:
    with wires(served, 2) as (deaf, other):
        deaf.send(b"PICT?\n" * 200)
        instrument = served.server.instruments["lamp"]
        eventually(lambda: any(client.blocked for client in instrument.clients))
        assert other.ask(b"*IDN?\n") == IDENTITY
        size = len(b"#6%d" % len(PICTURE)) + len(PICTURE) + 1
        for _ in range(200):
            assert deaf.file.read(size)[-1:] == b"\n"
        assert deaf.ask(b"*IDN?\n") == IDENTITY


def fill(connection: socket.socket) -> None:
    """Send settings until no more are taken."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 16)
    connection.settimeout(0.05)
    with suppress(TimeoutError):
        while True:
            connection.sendall(b"LEV 1\n" * 1000)


def test_client_faster_than_replies_is_paused(served: Served) -> None:
    served.clock.speed = 1e-6
    with wires(served, 2) as (hasty, other):
        hasty.send(b"READ?\n")
        eventually(lambda: served.server.instruments["lamp"].busy)
        fill(hasty.socket)
        backlogs = [len(client.backlog) for client in served.server.instruments["lamp"].clients]
        assert max(backlogs) < 100_000
        hasty.reset()
        served.clock.speed = 100.0
        assert other.ask(b"*IDN?\n") == IDENTITY


def test_clients_come_and_go_and_leave_nothing_behind(served: Served) -> None:
    instrument = served.server.instruments["lamp"]
    before = len(instrument.clients)
    for number in range(100):
        wire = Wire(served.port("tcp"))
        wire.send(b"*IDN?\n" if number % 2 else b"LEV 1;LEV")
        wire.reset()
    eventually(lambda: len(instrument.clients) == before)
    with wires(served) as (wire,):
        assert wire.ask(b"*IDN?\n") == IDENTITY
