"""Raw SCPI over TCP, spoken by plain sockets."""

from __future__ import annotations

import socket
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from simrack.clock import WallClock
from simrack.serve import MAX_SPEED
from simrack.serve.raw import TcpStream

from simrack_tests.ports import BUSY_S, eventually
from simrack_tests.serve.lamp import IDENTITY, PICTURE, Served, served_lamp

if TYPE_CHECKING:
    from collections.abc import Iterator


class Wire:
    """A plain socket that reads lines."""

    def __init__(self, port: int, timeout_s: float = 5.0) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout_s)
        self.file = self.socket.makefile("rb")

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def line(self) -> bytes:
        return self.file.readline()

    def ask(self, message: bytes) -> bytes:
        self.send(message)
        return self.line()

    def silent(self, seconds: float = 0.1) -> bool:
        """Whether nothing comes for a while."""
        self.socket.settimeout(seconds)
        try:
            return self.socket.recv(1) == b"?"
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(5.0)

    def reset(self) -> None:
        """Leave without a word: RST instead of FIN."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()

    def close(self) -> None:
        self.file.close()
        self.socket.close()


@contextmanager
def wires(served: Served, count: int = 1) -> Iterator[list[Wire]]:
    made = [Wire(served.port("tcp")) for _ in range(count)]
    try:
        yield made
    finally:
        for wire in made:
            wire.close()


@pytest.fixture
def served() -> Iterator[Served]:
    with served_lamp() as lamp:
        yield lamp


@pytest.fixture
def wire(served: Served) -> Iterator[Wire]:
    with wires(served) as (one,):
        yield one


def test_a_query_is_answered_again_and_again(wire: Wire) -> None:
    assert [wire.ask(b"*IDN?\n") for _ in range(50)] == [IDENTITY] * 50


def test_carriage_returns_are_accepted(wire: Wire) -> None:
    assert wire.ask(b"*IDN?\r\n") == IDENTITY


def test_a_message_may_come_in_pieces(wire: Wire) -> None:
    for piece in (b"LEV", b"EL 2.5", b"\nLEVe", b"l?\n"):
        wire.send(piece)
    assert wire.line() == b"+2.50000000E+00\n"


def test_many_messages_may_come_at_once(wire: Wire) -> None:
    wire.send(b"".join(b"LEV %d\nLEV?\n" % (number % 10) for number in range(500)))
    assert [float(wire.line()) for _ in range(500)] == [number % 10 for number in range(500)]


def test_a_socket_has_no_message_exchange_rules(wire: Wire) -> None:
    wire.send(b"NONSENSE?\n")
    assert wire.silent(0.05)
    assert wire.ask(b"SYST:ERR?\n").startswith(b"-113")
    assert wire.ask(b"SYST:ERR?\n") == b'+0,"No error"\n'


def test_answers_go_to_whoever_asked(served: Served) -> None:
    with wires(served, 64) as all_of_them:
        for number, each in enumerate(all_of_them):
            each.send(b"*IDN?;LEV %d;LEV?\n" % (number % 10) if number % 2 else b"*IDN?\nTIME?;*IDN?\n")
        for number, each in enumerate(all_of_them):
            assert each.line().startswith(IDENTITY.strip())
            assert number % 2 or each.line().endswith(b";" + IDENTITY)


def test_the_instrument_executes_one_message_at_a_time(served: Served) -> None:
    served.clock.speed = 10.0
    with wires(served, 3) as (first, second, third):
        first.send(b"READ?\n")
        eventually(lambda: served.lamp.engine.status_now() == 0)
        second.send(b"LEV 3;LEV?\n")
        third.send(b"*IDN?\n")
        assert first.line() == b"+0.00000000E+00\n"
        assert second.line() == b"+3.00000000E+00\n"
        assert third.line() == IDENTITY


def test_a_wrong_query_of_one_takes_no_answer_from_another(served: Served) -> None:
    with wires(served, 2) as (wrong, right):
        for _ in range(20):
            wrong.send(b"NONSENSE?\n")
            assert right.ask(b"*IDN?\n") == IDENTITY
        assert wrong.silent(0.05)


def test_another_connection_can_trigger_what_waits_for_it(served: Served) -> None:
    with wires(served, 2) as (waiting, triggering):
        waiting.send(b"WAIT?\n")
        assert waiting.silent(0.05)
        triggering.send(b"*TRG\n")
        assert waiting.line() == b'"triggered 1"\n'


def test_a_client_that_left_is_owed_nothing(served: Served) -> None:
    served.clock.speed = 5.0
    with wires(served, 2) as (leaver, stayer):
        leaver.send(b"READ?\nLEV 9\n")
        eventually(lambda: served.server.instruments["lamp"].holder is not None)
        leaver.reset()
        assert stayer.ask(b"*IDN?\n") == IDENTITY
        assert stayer.ask(b"COUNT?\n") == b"+1\n"


def test_clients_come_and_go_and_leave_nothing_behind(served: Served) -> None:
    instrument = served.server.instruments["lamp"]
    before = len(instrument.clients)
    for number in range(200):
        wire = Wire(served.port("tcp"))
        wire.send(b"*IDN?\n" if number % 2 else b"LEV 1;LEV")
        wire.reset()
    eventually(lambda: len(instrument.clients) == before)
    with wires(served) as (wire,):
        assert wire.ask(b"*IDN?\n") == IDENTITY


def test_too_long_line_is_refused_once_and_next_accepted(served: Served, wire: Wire) -> None:
    wire.send(b"LEV " + b"1" * 1_000_000 + b"\nLEV?\n")
    assert wire.line() == b"+0.00000000E+00\n"
    assert int(wire.ask(b"SYST:ERR?\n").split(b",")[0]) == served.lamp.engine.dialect.input_overflow
    assert wire.ask(b"SYST:ERR?\n").startswith(b"+0")


def test_an_endless_line_takes_no_memory(served: Served, wire: Wire) -> None:
    for _ in range(64):
        wire.send(b"x" * 65536)
    instrument = served.server.instruments["lamp"]
    with wires(served) as (other,):
        assert other.ask(b"*IDN?\n") == IDENTITY
    kept = [len(client.partial) + len(client.overlong) for client in instrument.clients]
    assert max(kept) <= 2 * served.lamp.engine.dialect.input_limit


def test_newlines_within_a_block_are_data(wire: Wire) -> None:
    wire.send(b"PICT?\n")
    header = b"#6%d" % len(PICTURE)
    received = wire.file.read(len(header) + len(PICTURE) + 1)
    assert received == header + PICTURE + b"\n"
    assert wire.ask(b"*IDN?\n") == IDENTITY


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


def test_time_passes_at_the_speed_asked_for() -> None:
    wall = WallClock()
    with served_lamp(speed=20.0) as served, wires(served) as (wire,):
        start = wall.now()
        assert wire.ask(b"READ?\n") == b"+0.00000000E+00\n"
        assert 0.045 < wall.now() - start < 0.045 + BUSY_S


def test_at_max_time_jumps_to_what_is_waited_for() -> None:
    wall = WallClock()
    with served_lamp(MAX_SPEED) as served, wires(served) as (wire,):
        start = wall.now()
        for _ in range(100):
            wire.ask(b"READ?\n")
        assert wall.now() - start < 5.0
        assert float(wire.ask(b"TIME?\n")) >= 100.0


def test_instrument_acts_at_its_instant_unasked() -> None:
    with served_lamp(speed=50.0) as served, wires(served) as (wire,):
        start = float(wire.ask(b"TIME?;DIM 1\n"))
        eventually(lambda: bool(served.lamp.dimmed_at_s))
        assert served.lamp.dimmed_at_s == [pytest.approx(start + 1.0, abs=1e-9)]


def test_a_setting_that_takes_time_holds_up_the_next_message() -> None:
    with served_lamp(MAX_SPEED) as served, wires(served) as (wire,):
        begin, level, end = wire.ask(b"TIME?;SLOW 4;LEV?;TIME?\n").split(b";")
        assert float(level) == 4.0
        assert float(end) - float(begin) == pytest.approx(0.5, abs=1e-6)


def test_what_follows_a_setting_waits_for_it_whoever_sends_it() -> None:
    with served_lamp(MAX_SPEED) as served, wires(served, 2) as (setter, reader):
        setter.send(b"SLOW 4\n")
        eventually(lambda: served.server.instruments["lamp"].busy or served.lamp.level_v > 0)
        assert reader.ask(b"LEV?\n") == b"+4.00000000E+00\n"


def test_a_flood_of_empty_lines_is_no_work(served: Served, wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    executed: list[bytes] = []
    monkeypatch.setattr(served.server.instruments["lamp"], "asks", lambda message: executed.append(message) or True)
    wire.send(b"\n" * 1_000_000 + b"\r\n" * 100_000)
    assert wire.ask(b"*IDN?\n") == IDENTITY
    assert executed == [b"*IDN?\n"]


def test_simultaneous_input_is_processed_in_order_and_parts(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    most: list[int] = []
    taken = TcpStream.take

    def take(self: TcpStream, data: bytes, **how: Any) -> None:
        most.append(data.count(b"\n"))
        taken(self, data, **how)

    monkeypatch.setattr(TcpStream, "take", take)
    wire.send(b"".join(b"LEV %d\nLEV?\n" % (number % 10) for number in range(2_000)))
    assert [float(wire.line()) for _ in range(2_000)] == [number % 10 for number in range(2_000)]
    assert sum(most) <= 4_000
    assert max(most) <= 256


def test_what_a_client_sent_that_broke_off_is_dropped(served: Served) -> None:
    with wires(served, 1) as (wire,):
        wire.send(b"LEV 1;LEV?\n" * 5_000)
        wire.reset()
    eventually(lambda: sum(client.comes_and_goes for client in served.server.instruments["lamp"].clients) == 0)
    with wires(served, 1) as (wire,):
        assert wire.ask(b"*IDN?\n") == IDENTITY
