"""The seven ways a wire was seen to misbehave under PyVISA-py, and some more, over real sockets."""

from __future__ import annotations

import gc
import math
import select
import socket
import threading
import time
from typing import TYPE_CHECKING

import pytest
from simrack_tests.ports import BUSY_S, PLENTY_S

from tests.drivers.servers import IDENTITY, answering, nothing_special, serving
from vcfbench.clock import Deadline, WallClock, sleep
from vcfbench.drivers.session import Session, visa_resource
from vcfbench.drivers.visa_wire import SocketWire
from vcfbench.errors import (
    BenchError,
    ConnectFailed,
    DeadlineExceeded,
    FramingError,
    LinkLost,
    MeasurementError,
    OutOfSync,
)

if TYPE_CHECKING:
    from collections.abc import Callable

CLOCK = WallClock()


def soon() -> Deadline:
    """Return the deadline of what does not come."""
    return Deadline.after(CLOCK, 0.1)


def opened(resource: str, timeout_s: float = PLENTY_S) -> Session:
    connect = visa_resource(resource, "@py")
    session = Session.opened(connect, name="multimeter", resource=resource, clock=CLOCK, timeout_s=timeout_s)
    session.identify()
    return session


def wait_until_something_lies_there(session: Session) -> None:
    assert isinstance(session._wire, SocketWire)
    assert select.select([session._wire._socket], [], [], PLENTY_S)[0]


def timed(call: Callable[[], object]) -> tuple[BenchError, float, float]:
    """Return the error of `call`, the wall and the processor time it took."""
    processor_s, begin_s = time.thread_time(), CLOCK.now()
    with pytest.raises(BenchError) as caught:
        call()
    return caught.value, CLOCK.now() - begin_s, time.thread_time() - processor_s


def test_a_port_where_nobody_listens_fails_to_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(ConnectFailed, match=f"multimeter at TCPIP0::127.0.0.1::{port}::SOCKET: no instrument answers"):
        opened(f"TCPIP0::127.0.0.1::{port}::SOCKET", 0.2)


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_host_that_cannot_be_resolved_fails_to_open() -> None:
    with pytest.raises(ConnectFailed, match=r"multimeter at .*cannot be opened"):
        opened("TCPIP0::no-such-host.invalid::5025::SOCKET", 0.2)
    gc.collect()  # PyVISA-py leaves its socket to the collector, whose warning belongs to this test


def test_a_library_that_is_not_there_fails_to_open() -> None:
    connect = visa_resource("GPIB0::1::INSTR", "/no/such/visa.so")
    with pytest.raises(ConnectFailed, match="cannot be opened"):
        Session.opened(connect, name="x", resource="GPIB0::1::INSTR", clock=CLOCK, timeout_s=0.1)


def test_closed_peer_is_link_lost_at_once() -> None:
    def closing(connection: socket.socket, line: str) -> bool:
        if line == "READ?":
            connection.shutdown(socket.SHUT_RDWR)
        return line == "READ?"

    with serving(answering(closing)) as where, opened(where) as session:
        error, wall_s, processor_s = timed(lambda: session.query("READ?"))
        assert isinstance(error, LinkLost)
        assert "multimeter at TCPIP0" in str(error)
        assert "'READ?'" in str(error)
        assert wall_s < BUSY_S
        assert processor_s < 0.1
        assert session.closed
        with pytest.raises(LinkLost, match="is closed"):
            session.query("READ?")


def late(may_come: Callable[[socket.socket], object], question: str = "FIRST?") -> Callable[[socket.socket, str], bool]:
    """Answer the first asking of `question` too late: when `may_come`, told the connection, returns."""
    asked: list[str] = []

    def special(connection: socket.socket, line: str) -> bool:
        if line != question or asked:
            return False
        asked.append(line)
        may_come(connection)
        connection.sendall((IDENTITY if line == "*IDN?" else "LATE").encode() + b"\n")
        return True

    return special


def when_more_is_asked(connection: socket.socket) -> None:
    select.select([connection], [], [], PLENTY_S)


def test_a_late_answer_is_never_the_answer_to_another_question() -> None:
    given_up = threading.Event()
    with serving(answering(late(lambda _: given_up.wait(PLENTY_S)))) as where, opened(where) as session:
        error, wall_s, _ = timed(lambda: session.query("FIRST?", soon()))
        assert isinstance(error, DeadlineExceeded)
        assert 0.1 <= wall_s < 0.1 + BUSY_S
        assert session.dirty
        given_up.set()
        wait_until_something_lies_there(session)
        assert [session.query(f"Q{n}?") for n in range(5)] == [f"Q{n}" for n in range(5)]


def test_a_late_answer_that_comes_amid_resynchronising_is_dropped_too() -> None:
    with serving(answering(late(when_more_is_asked))) as where, opened(where) as session:
        with pytest.raises(DeadlineExceeded):
            session.query("FIRST?", soon())
        assert session.query("SECOND?") == "SECOND"
        assert session.query("THIRD?") == "THIRD"


def test_late_answer_may_end_resynchronising() -> None:
    with serving(answering(nothing_special), answering(late(when_more_is_asked, "*IDN?"))) as where:
        with opened(where) as first:
            first.query("A?")
        connect = visa_resource(where, "@py")
        session = Session.opened(connect, name="multimeter", resource=where, clock=CLOCK, timeout_s=PLENTY_S)
        session._identity = IDENTITY  # as learnt before
        with session:
            with pytest.raises(DeadlineExceeded):
                session.query("*IDN?", soon())
            assert session.query("NEXT?") == "NEXT"
            assert [session.query(f"Q{n}?") for n in range(3)] == ["Q0", "Q1", "Q2"]


def test_answers_that_stay_away_close_the_session() -> None:
    def dumb(connection: socket.socket, line: str) -> bool:
        del connection
        if line == "READ?":
            dumbed.set()
        return dumbed.is_set()

    dumbed = threading.Event()
    with serving(answering(dumb)) as where, opened(where) as session:
        with pytest.raises(DeadlineExceeded):
            session.query("READ?", soon())
        error, wall_s, _ = timed(lambda: session.query("A?", Deadline.after(CLOCK, 0.5)))
        assert isinstance(error, OutOfSync)
        assert wall_s < BUSY_S
        assert session.closed


def test_a_second_answer_to_one_question_is_dropped() -> None:
    def twice(connection: socket.socket, line: str) -> bool:
        if line == "A?":
            connection.sendall(b"A\nA\n")
        return line == "A?"

    with serving(answering(twice)) as where, opened(where) as session:
        assert session.query("A?") == "A"
        assert session.query("B?") == "B"
        assert session.query("C?") == "C"


def test_something_said_unasked_is_dropped() -> None:
    answered = threading.Event()

    def chatty(connection: socket.socket, line: str) -> bool:
        if line == "A?":
            connection.sendall(b"A\n")
            answered.wait(PLENTY_S)
            connection.sendall(b"welcome\n")
        return line == "A?"

    with serving(answering(chatty)) as where, opened(where) as session:
        assert session.query("A?") == "A"
        answered.set()
        wait_until_something_lies_there(session)
        assert session.query("B?") == "B"


@pytest.mark.parametrize("noise", [b"\xff\xfe1.5\n", b"1.2a3\n", b"\n", b"nan\n", b"1_0\n", b"+1.0,\n", b"\x001.5\n"])
def test_noise_is_framing_error_and_next_answer_right(noise: bytes) -> None:
    def noisy(connection: socket.socket, line: str) -> bool:
        if line == "READ?":
            connection.sendall(noise)
        return line == "READ?"

    with serving(answering(noisy)) as where, opened(where) as session:
        with pytest.raises(FramingError, match=r"multimeter at .*'READ\?'"):
            session.query_reading("READ?")
        assert session.query("B?") == "B"


def test_overload_is_no_number_and_no_reason_to_resynchronise() -> None:
    def overloaded(connection: socket.socket, line: str) -> bool:
        if line == "READ?":
            connection.sendall(b"+9.90000000E+37\n")
        return line == "READ?"

    with serving(answering(overloaded)) as where, opened(where) as session:
        with pytest.raises(MeasurementError, match="overload"):
            session.query_reading("READ?")
        assert not session.dirty
        assert session.query_ohms("READ?") == math.inf


def test_two_threads_get_their_own_answers() -> None:
    wrong: list[str] = []

    def ask(session: Session, name: str) -> None:
        wrong.extend(name for _ in range(300) if session.query(f"{name}?") != name)

    with serving(answering(nothing_special)) as where, opened(where) as session:
        threads = [threading.Thread(target=ask, args=(session, name)) for name in ("ALPHA", "BETA", "GAMMA")]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PLENTY_S)
        assert not any(thread.is_alive() for thread in threads)
        assert wrong == []


def test_peer_that_does_not_read_ends_at_deadline() -> None:
    done = threading.Event()

    def deaf(connection: socket.socket, line: str) -> bool:
        del connection, line
        done.wait(PLENTY_S)
        return True

    with serving(answering(deaf)) as where:
        connect = visa_resource(where, "@py")
        session = Session.opened(connect, name="generator", resource=where, clock=CLOCK, timeout_s=PLENTY_S)
        data = "DATA " + "0," * 10_000_000
        error, wall_s, _ = timed(lambda: session.write(data, deadline=Deadline.after(CLOCK, 1.0)))
        done.set()
        session.close()
    assert isinstance(error, DeadlineExceeded)
    assert "does not take the command" in str(error)
    assert len(str(error)) < 400
    assert 1.0 <= wall_s < 1.0 + BUSY_S


def test_an_answer_that_never_ends_is_ended_by_the_deadline() -> None:
    def babbling(connection: socket.socket, line: str) -> bool:
        while line == "READ?":
            connection.sendall(b"x")
            sleep(CLOCK, 0.005)
        return False

    with serving(answering(babbling)) as where, opened(where) as session:
        error, wall_s, _ = timed(lambda: session.query("READ?", soon()))
    assert isinstance(error, DeadlineExceeded)
    assert 0.1 <= wall_s < 0.1 + BUSY_S


def test_a_block_may_hold_newlines_and_come_in_pieces() -> None:
    data = bytes(range(256)) * 40 + b"\n"

    def sending(connection: socket.socket, line: str) -> bool:
        if line == ":WAV:DATA?":
            message = f"#8{len(data):08d}".encode() + data + b"\n"
            for begin in range(0, len(message), 997):
                connection.sendall(message[begin : begin + 997])
        return line == ":WAV:DATA?"

    with serving(answering(sending)) as where, opened(where) as session:
        assert session.query_block(":WAV:DATA?") == data
        assert session.query("B?") == "B"


@pytest.mark.parametrize("answer", [b"+1.0\n", b"#0abc\n", b"#8000\n", b"#3010abc\n", b"#15abcdefgh\n", b"#1\n"])
def test_a_block_that_is_none_leaves_the_next_answer_right(answer: bytes) -> None:
    """Also that a failed block leaves the terminators as they were."""

    def sending(connection: socket.socket, line: str) -> bool:
        if line == ":WAV:DATA?":
            connection.sendall(answer)
        return line == ":WAV:DATA?"

    with serving(answering(sending)) as where, opened(where) as session:
        with pytest.raises((FramingError, DeadlineExceeded)):
            session.query_block(":WAV:DATA?", soon())
        assert session.query("B?") == "B"
        assert session.query("C?") == "C"


def test_an_interrupt_amid_an_exchange_leaves_the_session_dirty() -> None:
    with serving(answering(nothing_special)) as where, opened(where) as session:
        receive = session._wire.receive

        def interrupted(deadline: Deadline) -> tuple[bytes, bool]:
            del deadline
            session._wire.receive = receive  # type: ignore[method-assign]
            raise KeyboardInterrupt

        session._wire.receive = interrupted  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            session.query("A?")
        assert session.dirty
        assert session.query("B?") == "B"


def test_revive_connects_anew_to_the_same_instrument() -> None:
    def closing(connection: socket.socket, line: str) -> bool:
        if line == "READ?":
            connection.shutdown(socket.SHUT_RDWR)
        return line == "READ?"

    with serving(answering(closing), answering(nothing_special)) as where, opened(where) as session:
        with pytest.raises(LinkLost):
            session.query("READ?")
        session.revive()
        assert session.query("A?") == "A"


def test_revive_refuses_another_instrument() -> None:
    def closing(connection: socket.socket, line: str) -> bool:
        if line == "READ?":
            connection.shutdown(socket.SHUT_RDWR)
        return line == "READ?"

    def other(connection: socket.socket, line: str) -> bool:
        if line == "*IDN?":
            connection.sendall(b"ACME,123,0,1\n")
        return line == "*IDN?"

    with serving(answering(closing), answering(other)) as where, opened(where) as session:
        with pytest.raises(LinkLost):
            session.query("READ?")
        with pytest.raises(OutOfSync):
            session.revive(Deadline.after(CLOCK, 0.5))


def test_a_connection_cut_amid_resynchronising_is_said_to_be_lost() -> None:
    """Which is what lets `revive` connect anew."""
    given_up = threading.Event()

    def cut(connection: socket.socket, line: str) -> bool:
        if line == "READ?":
            given_up.wait(PLENTY_S)
        elif given_up.is_set():
            connection.shutdown(socket.SHUT_RDWR)
        return line == "READ?" or given_up.is_set()

    with serving(answering(cut), answering(nothing_special)) as where, opened(where) as session:
        with pytest.raises(DeadlineExceeded):
            session.query("READ?", soon())
        given_up.set()
        with pytest.raises(LinkLost, match=r"\*IDN\?"):
            session.resync(Deadline.after(CLOCK, PLENTY_S))
        assert session.closed
        session.revive()
        assert session.query("A?") == "A"


def test_a_dead_connection_leaves_time_for_a_new_one() -> None:
    """Half of what is left is given to the old one."""

    def silent(_connection: socket.socket, line: str) -> bool:
        return line != "*IDN?" or bool(asked) or bool(asked.append(line))

    asked: list[str] = []
    with serving(answering(silent), answering(nothing_special)) as where, opened(where) as session:
        with pytest.raises(DeadlineExceeded):
            session.query("READ?", soon())
        begin_s = CLOCK.now()
        session.revive(Deadline.after(CLOCK, 1.0))
        assert 0.4 < CLOCK.now() - begin_s < 1.0
        assert session.query("A?") == "A"
