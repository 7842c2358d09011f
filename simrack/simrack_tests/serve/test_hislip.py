"""HiSLIP, spoken by PyVISA-py and by messages written out by hand."""

from __future__ import annotations

import socket
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from pyvisa_py.protocols import hislip  # type: ignore[import-untyped]
from simrack.serve import MAX_SPEED

from simrack_tests.ports import eventually
from simrack_tests.serve.lamp import IDENTITY, PICTURE, Served, served_lamp

if TYPE_CHECKING:
    from collections.abc import Iterator

DATA, DATA_END = 6, 7


class Session:
    """Both channels of a session, written out by hand."""

    def __init__(self, port: int) -> None:
        self.sync = socket.create_connection(("127.0.0.1", port), timeout=5.0)
        self.later = socket.create_connection(("127.0.0.1", port), timeout=5.0)

    def open(self, version: int = 0x0100) -> int:
        self.post(self.sync, 0, 0, version << 16 | 0x5858, b"hislip0")
        kind, overlapped, parameter, _ = self.message(self.sync)
        assert (kind, overlapped, parameter >> 16) == (1, 0, 0x0100)
        self.post(self.later, 17, 0, parameter & 0xFFFF)
        assert self.message(self.later)[0] == 18
        return parameter & 0xFFFF

    @staticmethod
    def post(channel: socket.socket, kind: int, control: int = 0, parameter: int = 0, payload: bytes = b"") -> None:
        channel.sendall(struct.pack("!2sBBIQ", b"HS", kind, control, parameter, len(payload)) + payload)

    @staticmethod
    def message(channel: socket.socket) -> tuple[int, int, int, bytes]:
        header = exactly(channel, 16)
        prologue, kind, control, parameter, size = struct.unpack("!2sBBIQ", header)
        assert prologue == b"HS"
        return kind, control, parameter, exactly(channel, size)

    def close(self) -> None:
        self.sync.close()
        self.later.close()


def exactly(channel: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        part = channel.recv(size - len(data))
        assert part, "the server hung up"
        data += part
    return data


@contextmanager
def sessions(served: Served, count: int = 1) -> Iterator[list[Session]]:
    made = [Session(served.port("hislip")) for _ in range(count)]
    try:
        yield made
    finally:
        for each in made:
            each.close()


@pytest.fixture
def served() -> Iterator[Served]:
    with served_lamp(MAX_SPEED) as lamp:
        yield lamp


@pytest.fixture
def session(served: Served) -> Iterator[Session]:
    with sessions(served) as (one,):
        one.open()
        yield one


@pytest.fixture
def visa(served: Served) -> Iterator[Any]:
    manager = pyvisa.ResourceManager("@py")
    instrument: Any = manager.open_resource(served.resource("hislip"))
    yield instrument
    instrument.close()
    manager.close()


def test_with_a_client_that_knows_2_it_is_1(served: Served) -> None:
    with sessions(served) as (session,):
        session.open(version=0x0200)
        session.post(session.sync, DATA_END, 0, 0xFFFF_FF00, b"*IDN?\n")
        assert session.message(session.sync) == (DATA_END, 0, 0xFFFF_FF00, IDENTITY)
        session.post(session.sync, 26)  # GetDescriptors
        assert session.message(session.sync)[:2] == (3, 1)
        session.post(session.later, 29)  # AsyncStartTLS
        assert session.message(session.later)[:2] == (3, 1)


# --- PyVISA-py -------------------------------------------------------------------------------------------------


def test_pyvisa_asks(visa: Any) -> None:
    assert [visa.query("*IDN?").encode() for _ in range(10)] == [IDENTITY] * 10


def test_pyvisa_waits_for_a_reading(visa: Any) -> None:
    visa.write("LEV 3")
    assert float(visa.query("READ?")) == 3.0


def test_pyvisa_reads_a_block(visa: Any) -> None:
    assert bytes(visa.query_binary_values("PICT?", datatype="B", container=bytes)) == PICTURE


def test_pyvisa_polls_the_status_byte(visa: Any) -> None:
    assert visa.read_stb() == 0
    visa.write("*IDN?")
    visa.read_raw()
    assert visa.read_stb() == 0


def test_pyvisa_clears_and_goes_on(visa: Any) -> None:
    visa.write("LEV 2")
    visa.clear()
    assert float(visa.query("LEV?")) == 2.0
    assert visa.query("SYST:ERR?").startswith("+0")


def test_a_client_sets_the_longest_message(served: Served) -> None:
    client = hislip.Instrument("127.0.0.1", port=served.port("hislip"))
    client.max_msg_size = 4096
    client.send(b"PICT?\n")
    header = b"#6%d" % len(PICTURE)
    assert client.receive(1 << 20) == header + PICTURE + b"\n"
    client.close()


def test_a_client_triggers_and_goes_to_remote(served: Served) -> None:
    client = hislip.Instrument("127.0.0.1", port=served.port("hislip"))
    client.trigger()
    eventually(lambda: served.lamp.triggers == 1)
    client.async_remote_local_control("enableAndLockoutLocal")
    assert client.async_lock_info() == 0
    assert client.async_lock_request(0.0) == "success"
    assert client.async_lock_info() == 1
    assert client.async_lock_release() == "success"
    client.close()


# --- by hand ---------------------------------------------------------------------------------------------------


def test_an_answer_carries_the_number_of_its_question(session: Session) -> None:
    session.post(session.sync, DATA_END, 0, 0xFFFFFF00, b"LEV 1")
    session.post(session.sync, DATA, 0, 0xFFFFFF02, b"*ID")
    session.post(session.sync, DATA_END, 0, 0xFFFFFF04, b"N?")
    assert session.message(session.sync) == (DATA_END, 0, 0xFFFFFF04, IDENTITY)


def test_the_message_available_bit_knows_what_was_read(session: Session) -> None:
    session.post(session.sync, DATA_END, 0, 2, b"*IDN?")
    session.message(session.sync)
    session.post(session.later, 21, 0, 2)
    assert session.message(session.later)[:2] == (22, 16)
    session.post(session.later, 21, 1, 2)
    assert session.message(session.later)[:2] == (22, 0)


def test_the_next_message_interrupts_an_unread_answer(session: Session) -> None:
    session.post(session.sync, DATA_END, 0, 2, b"*IDN?")
    session.message(session.sync)
    session.post(session.sync, DATA_END, 0, 4, b"SYST:ERR?")
    assert session.message(session.sync)[:3] == (13, 0, 4)
    assert session.message(session.later)[:3] == (14, 0, 4)
    assert session.message(session.sync)[3].startswith(b"-410")


def test_in_overlapped_mode_answers_queue_up_and_are_counted(session: Session) -> None:
    session.post(session.later, 19)
    assert session.message(session.later)[0] == 23
    session.post(session.sync, DATA_END, 0, 2, b"*IDN?")  # on its way when the clear began: dropped
    session.post(session.sync, 8, 1)
    assert session.message(session.sync)[:2] == (9, 1)
    for _ in range(3):
        session.post(session.sync, DATA_END, 0, 2, b"LEV?")
    answers = [session.message(session.sync) for _ in range(3)]
    assert [number for _, _, number, _ in answers] == [0xFFFFFF00, 0xFFFFFF02, 0xFFFFFF04]


def test_device_clear_ends_a_reading_that_is_under_way() -> None:
    with served_lamp(speed=0.01) as served, sessions(served) as (session,):
        session.open()
        session.post(session.sync, DATA_END, 0, 2, b"READ?")
        eventually(lambda: served.server.instruments["lamp"].busy)
        session.post(session.later, 19)
        assert session.message(session.later)[0] == 23
        session.post(session.sync, 8)
        assert session.message(session.sync)[0] == 9
        session.post(session.sync, DATA_END, 0, 2, b"COUN?")
        assert session.message(session.sync)[3] == b"+0\n"


def test_a_service_request_is_announced(session: Session) -> None:
    session.post(session.sync, DATA_END, 0, 2, b"*SRE 32;*ESE 32;NONSENSE")
    assert session.message(session.later)[:2] == (20, 64 | 32)
    session.post(session.later, 21, 0, 2)
    assert session.message(session.later)[:2] == (22, 64 | 32)


def test_an_exclusive_lock_holds_others_back(served: Served) -> None:
    with sessions(served, 2) as (first, second):
        first.open()
        second.open()
        first.post(first.later, 4, 1, 0)
        assert first.message(first.later)[:2] == (5, 1)
        second.post(second.later, 4, 1, 20)
        assert second.message(second.later)[:2] == (5, 0)
        second.post(second.sync, DATA_END, 0, 2, b"*IDN?")
        first.post(first.sync, DATA_END, 0, 2, b"LEV?")
        assert first.message(first.sync)[0] == DATA_END
        first.post(first.later, 4, 0, 2)
        assert first.message(first.later)[:2] == (5, 1)
        assert second.message(second.sync)[3] == IDENTITY


def test_a_shared_lock_is_shared_by_key(served: Served) -> None:
    with sessions(served, 3) as (first, second, third):
        for each in (first, second, third):
            each.open()
        for each, key, outcome in ((first, b"key", 1), (second, b"key", 1), (third, b"other", 0), (third, b"", 0)):
            each.post(each.later, 4, 1, 0, key)
            assert each.message(each.later)[:2] == (5, outcome)
        third.post(third.later, 24)
        assert third.message(third.later)[:3] == (25, 0, 2)
        for each in (first, second):
            each.post(each.later, 4, 0, 0)
            assert each.message(each.later)[:2] == (5, 2)
        third.post(third.later, 4, 1, 0)
        assert third.message(third.later)[:2] == (5, 1)


def test_holder_of_shared_lock_may_take_exclusive_lock(served: Served) -> None:
    with sessions(served, 2) as (first, second):
        for each in (first, second):
            each.open()
            each.post(each.later, 4, 1, 0, b"key")
            assert each.message(each.later)[:2] == (5, 1)
        first.post(first.later, 4, 1, 0)
        assert first.message(first.later)[:2] == (5, 1)
        second.post(second.sync, DATA_END, 0, 2, b"*IDN?")
        second.post(second.later, 4, 1, 0)
        assert second.message(second.later)[:2] == (5, 0)
        first.post(first.later, 4, 0, 0)
        assert first.message(first.later)[:2] == (5, 1)
        assert second.message(second.sync)[3] == IDENTITY
        first.post(first.later, 4, 0, 0)
        assert first.message(first.later)[:2] == (5, 2)


def test_a_lock_is_waited_for(served: Served) -> None:
    with sessions(served, 2) as (first, second):
        first.open()
        second.open()
        first.post(first.later, 4, 1, 0)
        first.message(first.later)
        second.post(second.later, 4, 1, 5000)
        eventually(lambda: bool(served.server.instruments["lamp"].lock_waiters))
        first.close()
        assert second.message(second.later)[:2] == (5, 1)


def test_line_of_a_megabyte_is_refused(served: Served, visa: Any) -> None:
    visa.write("LEV " + "1" * 1_000_000)
    assert int(visa.query("SYST:ERR?").split(",")[0]) == served.lamp.engine.dialect.input_overflow
    assert visa.query("SYST:ERR?").startswith("+0")


def test_a_message_that_is_too_large_is_dropped_whole(session: Session) -> None:
    session.post(session.sync, DATA_END, 0, 2, b"x" * (3 << 20))
    assert session.message(session.sync)[:2] == (3, 4)
    session.post(session.sync, DATA_END, 0, 4, b"*IDN?")
    assert session.message(session.sync)[3] == IDENTITY


def test_an_unknown_message_type_is_an_error(session: Session) -> None:
    session.post(session.sync, 99)
    assert session.message(session.sync)[:2] == (3, 1)
    session.post(session.later, 99)
    assert session.message(session.later)[:2] == (3, 1)


def test_what_breaks_the_protocol_is_fatal(served: Served) -> None:
    with sessions(served, 3) as (noisy, hasty, lost):
        noisy.sync.sendall(b"GET / HTTP/1.1\r\n")
        assert noisy.message(noisy.sync)[:2] == (2, 1)
        hasty.post(hasty.sync, 0, 0, 0x0100_5858, b"hislip0")
        hasty.message(hasty.sync)
        hasty.post(hasty.sync, DATA_END, 0, 2, b"*IDN?")
        assert hasty.message(hasty.sync)[:2] == (2, 2)
        lost.post(lost.later, 17, 0, 4711)
        assert lost.message(lost.later)[:2] == (2, 3)
        lost.post(lost.sync, 0, 0, 0x0100_5858, b"hislip9")
        assert lost.message(lost.sync)[:2] == (2, 3)


def test_sessions_go_with_either_channel(served: Served) -> None:
    instrument = served.server.instruments["lamp"]
    before = len(instrument.clients)
    with sessions(served, 10) as all_of_them:
        for each in all_of_them:
            each.open()
            each.post(each.sync, DATA_END, 0, 2, b"WAIT?")
            each.later.close()
        eventually(lambda: len(instrument.clients) == before)
