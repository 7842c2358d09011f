"""Clumsy and malicious clients: whatever they send, the server lives, the others are answered, nothing is left open."""

from __future__ import annotations

import json
import os
import random
import socket
import struct
import sys
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from simrack.rate_tables.ruya import RuyaTable, TableErrors
from simrack.serve import MAX_SPEED, Control, ControlError, ServedClock, ServerSettings
from simrack_tests.cells import few
from simrack_tests.ports import eventually
from simrack_tests.serve.lamp import ALL, IDENTITY, Lamp, Served, serving

from tests.sim.serve.test_tables import StillWorld
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Iterator

KINDS = ["tcp", "vxi11", "hislip", "control"]
LOCK_WAIT = struct.Struct(">iiI")


@pytest.fixture
def served() -> Iterator[Served]:
    clock = ServedClock(MAX_SPEED)
    world = World(clock, ideal_bench(), seed=1)
    devices = {"lamp": Lamp(clock), "table": RuyaTable(StillWorld(clock), TableErrors.none())}
    with serving(devices, clock, ServerSettings(offers={"lamp": ALL}), world) as lamp:
        yield lamp


def port_of(served: Served, kind: str) -> int:
    return served.server.control.port if kind == "control" else served.port(kind)


@contextmanager
def caller(served: Served, kind: str) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port_of(served, kind)), timeout=10.0) as connection:
        yield connection


def require_well(served: Served) -> None:
    """Everybody else is answered."""
    with caller(served, "tcp") as connection:
        connection.sendall(b"*IDN?\n")
        assert connection.recv(100) == IDENTITY
    with Control(served.server.control.port, timeout_s=10.0) as control:
        control.request("now")


def sent(connection: socket.socket, data: bytes) -> None:
    """Send what the server takes."""
    with suppress(OSError):
        connection.sendall(data)


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def fragment(data: bytes, *, last: bool = True) -> bytes:
    return struct.pack(">I", len(data) | (0x8000_0000 if last else 0)) + data


def call(number: int, procedure: int, arguments: bytes) -> bytes:
    return fragment(struct.pack(">6I", number, 0, 2, 0x0607AF, 1, procedure) + bytes(16) + arguments)


def created(connection: socket.socket) -> int:
    """Open a link; return its number."""
    connection.sendall(call(1, 10, struct.pack(">iII", 0, 0, 0) + struct.pack(">I", 5) + b"inst0\0\0\0"))
    reply = connection.recv(4 + 24 + 16, socket.MSG_WAITALL)
    assert reply[28:32] == bytes(4)
    return int.from_bytes(reply[32:36], "big")


@pytest.mark.parametrize("kind", KINDS)
def test_noise(served: Served, kind: str) -> None:
    noise = random.Random(kind)  # noqa: S311  # no secrets
    starts = {"hislip": b"HS", "vxi11": struct.pack(">I", 0x8000_0028), "control": b'{"do":', "tcp": b"#"}
    for _ in range(20):
        with caller(served, kind) as connection:
            sent(connection, starts[kind] * noise.randrange(2) + noise.randbytes(noise.randrange(1, 3000)) + b"\n")
    require_well(served)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_noise_on_a_terminal(served: Served) -> None:
    path = served.resource("pty").removeprefix("ASRL").removesuffix("::INSTR")
    noise = random.Random(1)  # noqa: S311  # no secrets
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    os.set_blocking(line, False)
    for _ in range(200):
        with suppress(BlockingIOError):
            os.write(line, noise.randbytes(300))
        with suppress(BlockingIOError):
            os.read(line, 4096)
    os.set_blocking(line, True)
    os.write(line, b"\x03")
    os.close(line)
    require_well(served)


ODD_REQUESTS = [
    b"[" * 30000,
    b'{"a":' * 10000,
    b'{"do": "now", "id": ' + b"[" * 500 + b"]" * 500 + b"}",
    b'{"do": "set", "name": "ambient_c", "value": NaN}',
    b'{"do": "set", "name": "applied_rate_deg_s", "value": 1e999}',
    b'{"do": "set", "name": "ambient_c", "value": "warm"}',
    b'{"do": "set", "name": {}, "value": []}',
    b'{"do": ["now"]}',
    b'{"do": null}',
    b'{"do": "sleep_until", "instant_s": 1e300}',
    b'{"do": "sleep_until", "instant_s": "soon"}',
    b'{"do": "advance", "seconds": ' + b"9" * 5000 + b"}",
    b'{"do": "speed", "value": NaN}',
    b'{"do": "reset", "seed": 1e3}',
    b'{"do": "fault", "instrument": "toaster", "kind": "silent"}',
    b'{"do": "fault", "instrument": "lamp", "kind": [], "at_s": {}}',
    b'{"do": "await", "instrument": "table", "address": {}, "taken": -1, "said": "x", "until_s": null}',
    b'{"do": "hear", "instrument": [], "address": 1}',
    b"\xff\xfe{}",
    b"",
    b"null",
    b"3",
]


def test_an_odd_request_is_refused_and_the_next_is_answered(served: Served) -> None:
    for request in ODD_REQUESTS:
        with caller(served, "control") as connection:
            connection.sendall(request + b'\n{"do": "now", "id": 7}\n')
            received = b""
            while received.count(b"\n") < 2:
                part = connection.recv(65536)
                assert part, request
                received += part
        refused, answered = map(json.loads, received.splitlines())
        assert refused["ok"] is False, request
        assert refused["error"], request
        assert (answered["ok"], answered["id"]) == (True, 7), request
    require_well(served)


def test_a_request_without_end_is_cut_off(served: Served) -> None:
    with caller(served, "control") as connection:
        sent(connection, b"x" * (1 << 20))
        with suppress(ConnectionError):
            assert connection.recv(1) == b""
    require_well(served)


def test_a_jump_of_years_lets_the_others_have_their_turns(served: Served) -> None:
    with caller(served, "control") as connection:
        connection.sendall(b'{"do": "advance", "seconds": 9e8}\n')
        for _ in range(3):
            require_well(served)


def test_a_client_that_takes_no_replies_costs_no_memory(served: Served) -> None:
    with caller(served, "control") as connection:
        connection.settimeout(0.2)
        sent(connection, b'{"do": "list"}\n' * 30000)
        require_well(served)
        sizes = [each._outbox.size for each in tuple(served.server.control.connections)]
        assert max(sizes) < 1 << 22


@pytest.mark.exhaustive
def test_fragments_of_no_length_and_of_one_byte(served: Served) -> None:
    with caller(served, "vxi11") as connection:
        sent(connection, fragment(b"", last=False) * 100_000)
        sent(connection, b"".join(fragment(b"x", last=False) for _ in range(300_000)))
        require_well(served)


def test_a_fragment_of_two_to_the_31(served: Served) -> None:
    with caller(served, "vxi11") as connection:
        sent(connection, b"\xff\xff\xff\xff" + bytes(100))
        with suppress(ConnectionError):
            assert connection.recv(1) == b""
    require_well(served)


def test_an_opaque_longer_than_its_call_is_garbage(served: Served) -> None:
    with caller(served, "vxi11") as connection:
        connection.sendall(call(5, 10, struct.pack(">iII", 0, 0, 0) + b"\xff\xff\xff\xff"))
        reply = connection.recv(28, socket.MSG_WAITALL)
        assert struct.unpack(">7I", reply)[1::5] == (5, 4)
    require_well(served)


def test_flood_of_calls_behind_waiting_call_is_refused(served: Served) -> None:
    with caller(served, "vxi11") as connection:
        number = created(connection)
        connection.sendall(call(2, 12, struct.pack(">iIIIii", number, 100, 600_000, 0, 0, 0)))
        connection.settimeout(0.5)
        flood = call(3, 0, b"") * 400_000
        with pytest.raises(TimeoutError):
            connection.sendall(flood)
        require_well(served)


def test_links_without_end_are_refused(served: Served) -> None:
    with caller(served, "vxi11") as connection:
        numbers = [created(connection) for _ in range(256)]
        assert len(set(numbers)) == 256
        with pytest.raises(AssertionError):
            created(connection)
    require_well(served)


def test_dead_link_never_gets_a_lock(served: Served) -> None:
    with caller(served, "vxi11") as holder:
        number = created(holder)
        holder.sendall(call(2, 18, LOCK_WAIT.pack(number, 0, 0)))
        assert holder.recv(32, socket.MSG_WAITALL)[28:] == bytes(4)
        with caller(served, "vxi11") as waiter:
            waiter.sendall(call(2, 18, LOCK_WAIT.pack(created(waiter), 1, 600_000)))
            eventually(lambda: bool(served.server.instruments["lamp"].lock_waiters))
        eventually(lambda: not served.server.instruments["lamp"].lock_waiters)
    eventually(lambda: served.server.instruments["lamp"].lock is None)


@pytest.mark.parametrize(
    "header",
    [
        struct.pack("!2sBBIQ", b"XX", 0, 0, 0, 0),
        struct.pack("!2sBBIQ", b"HS", 0, 0, 0, 1 << 63),
        struct.pack("!2sBBIQ", b"HS", 255, 255, 0xFFFFFFFF, (1 << 64) - 1),
        struct.pack("!2sBBIQ", b"HS", 17, 0, 12345, 0),
        struct.pack("!2sBBIQ", b"HS", 6, 0, 0, 4) + b"abcd",
        struct.pack("!2sBBIQ", b"HS", 0, 0, 0, 7) + b"toaster",
    ],
)
def test_wrong_headers(served: Served, header: bytes) -> None:
    with caller(served, "hislip") as connection:
        sent(connection, header + bytes(1000))
        require_well(served)
    require_well(served)


def hislip(kind: int, parameter: int = 0, payload: bytes = b"") -> bytes:
    return struct.pack("!2sBBIQ", b"HS", kind, 0, parameter, len(payload)) + payload


def test_second_channel_survives_and_waveforms_are_not_bytewise(served: Served) -> None:
    with caller(served, "hislip") as first, caller(served, "hislip") as second, caller(served, "hislip") as third:
        first.sendall(hislip(0, 0, b"hislip0"))
        session = int.from_bytes(first.recv(16, socket.MSG_WAITALL)[6:8], "big")
        second.sendall(hislip(17, session))
        assert second.recv(16, socket.MSG_WAITALL)[2] == 18
        third.sendall(hislip(17, session))
        assert third.recv(16, socket.MSG_WAITALL)[2] == 2
        second.sendall(hislip(15, 0, struct.pack("!Q", 0)))
        assert second.recv(24, socket.MSG_WAITALL)[2] == 16
        first.sendall(hislip(7, 1, b"PICT?\n"))
        assert int.from_bytes(first.recv(16, socket.MSG_WAITALL)[8:], "big") == 16
        require_well(served)


@pytest.mark.skipif(sys.platform != "linux", reason="counts descriptors in /proc")
@pytest.mark.parametrize("kind", few(KINDS, "hislip"))
def test_a_thousand_connections_leave_nothing_open(served: Served, kind: str) -> None:
    require_well(served)
    eventually(lambda: not any(client.comes_and_goes for client in served.server.instruments["lamp"].clients))
    eventually(lambda: not served.server.control.connections)
    before = descriptors()
    for turn in range(1000):
        with caller(served, kind) as connection:
            if turn % 3 == 1:
                connection.shutdown(socket.SHUT_WR)
            elif turn % 3 == 2:  # abortive: the server meets a reset
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    require_well(served)
    eventually(lambda: descriptors() <= before)


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of descriptors is this process's")
def test_connections_wait_for_free_descriptors(served: Served) -> None:
    import resource  # noqa: PLC0415

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:
        callers = [stack.enter_context(socket.socket()) for _ in range(8)]
        resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors(), hard))
        try:
            for each in callers:
                each.settimeout(5.0)
                each.connect(("127.0.0.1", port_of(served, "tcp")))
            callers[0].settimeout(0.3)
            with pytest.raises(TimeoutError):
                callers[0].recv(1)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        callers[-1].sendall(b"*IDN?\n")
        assert callers[-1].recv(100) == IDENTITY
    require_well(served)


def test_slow_readers_do_not_hold_up_the_others(served: Served) -> None:
    with ExitStack() as stack:
        for _ in range(20):
            slow = stack.enter_context(caller(served, "tcp"))
            slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            slow.sendall(b"PICT?\n" * 50)
        require_well(served)


def test_mistake_of_an_instrument_spares_server_and_terminal(
    served: Served, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def mistaken() -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(served.lamp, "service", mistaken)
    with caller(served, "tcp") as connection:
        sent(connection, b"DIM 0.01\n")
        with suppress(ConnectionError):
            connection.recv(1)
    monkeypatch.undo()
    require_well(served)
    with Control(served.server.control.port) as control, suppress(ControlError):
        control.request("advance", seconds=1.0)
    assert "ZeroDivisionError" in capfd.readouterr().err
