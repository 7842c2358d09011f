"""VXI-11, spoken by PyVISA-py and by calls written out by hand."""

from __future__ import annotations

import socket
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from pyvisa.constants import ResourceAttribute, StatusCode
from simrack.clock import WallClock
from simrack.serve import MAX_SPEED, ServerSettings
from simrack.serve.rpc import call_record

from simrack_tests.ports import BUSY_S, eventually
from simrack_tests.serve.lamp import IDENTITY, PICTURE, Served, served_lamp

if TYPE_CHECKING:
    from collections.abc import Iterator

CORE, ASYNC, INTERRUPTS = 0x0607AF, 0x0607B0, 0x0607B1
END, WAIT_LOCK, TERMINATOR = 8, 1, 128


class Caller:
    """A hand-written client of ONC remote procedure calls."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5.0)
        self.xid = 1000

    def post(self, procedure: int, arguments: bytes, program: int = CORE, version: int = 1) -> None:
        self.xid += 1
        record = struct.pack(">10I", self.xid, 0, 2, program, version, procedure, 0, 0, 0, 0) + arguments
        self.socket.sendall(struct.pack(">I", 0x80000000 | len(record)) + record)

    def reply(self) -> tuple[int, bytes]:
        """Return the acceptance and the result of the next reply."""
        (mark,) = struct.unpack(">I", self.exactly(4))
        record = self.exactly(mark & 0x7FFFFFFF)
        xid, kind, denied, _flavor, _size, acceptance = struct.unpack_from(">6I", record)
        assert (xid, kind, denied) == (self.xid, 1, 0)
        return acceptance, record[24:]

    def call(self, procedure: int, arguments: bytes, program: int = CORE) -> bytes:
        self.post(procedure, arguments, program)
        acceptance, result = self.reply()
        assert acceptance == 0
        return result

    def exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self.socket.recv(size - len(data))
            assert part, "the server hung up"
            data += part
        return data

    # --- the procedures

    def link(self, name: bytes = b"inst0", *, lock: bool = False, lock_ms: int = 0) -> tuple[int, int, int, int]:
        padded = name + bytes(-len(name) & 3)
        arguments = struct.pack(">iIII", 7, lock, lock_ms, len(name)) + padded
        error, link, port, size = struct.unpack(">iiII", self.call(10, arguments))
        return error, link, port, size

    def write(self, link: int, data: bytes, flags: int = END, lock_ms: int = 0) -> tuple[int, int]:
        arguments = struct.pack(">iIIiI", link, 1000, lock_ms, flags, len(data)) + data + bytes(-len(data) & 3)
        error, size = struct.unpack(">iI", self.call(11, arguments))
        return error, size

    def post_read(self, link: int, size: int = 1000, io_ms: int = 1000, terminator: int | None = None) -> None:
        flags = 0 if terminator is None else TERMINATOR
        self.post(12, struct.pack(">iIIIii", link, size, io_ms, 0, flags, terminator or 0))

    def read_reply(self) -> tuple[int, int, bytes]:
        acceptance, result = self.reply()
        assert acceptance == 0
        error, reason, size = struct.unpack_from(">iiI", result)
        return error, reason, result[12 : 12 + size]

    def read(
        self, link: int, size: int = 1000, io_ms: int = 1000, terminator: int | None = None
    ) -> tuple[int, int, bytes]:
        self.post_read(link, size, io_ms, terminator)
        return self.read_reply()

    def generic(self, procedure: int, link: int) -> tuple[int, ...]:
        result = self.call(procedure, struct.pack(">iiII", link, 0, 0, 1000))
        return struct.unpack(f">{len(result) // 4}i", result)

    def lock(self, link: int, flags: int = 0, lock_ms: int = 0) -> int:
        return int(struct.unpack(">i", self.call(18, struct.pack(">iiI", link, flags, lock_ms)))[0])

    def docmd(self, link: int) -> tuple[int, bytes]:
        arguments = struct.pack(">iiIIiiiI", link, 0, 1000, 0, 0x020001, 1, 2, 2) + b"\0\1\0\0"
        error, size = struct.unpack_from(">iI", result := self.call(22, arguments))
        return error, result[8 : 8 + size]

    def interrupts(self, port: int, *, program: int = INTERRUPTS, datagrams: bool = False) -> int:
        loopback = int.from_bytes(bytes([127, 0, 0, 1]))
        arguments = struct.pack(">4Ii", loopback, port, program, 1, datagrams)
        return int(struct.unpack(">i", self.call(25, arguments))[0])

    def enable(self, link: int, handle: bytes | None) -> int:
        said = handle or b""
        arguments = struct.pack(">iiI", link, handle is not None, len(said)) + said + bytes(-len(said) & 3)
        return int(struct.unpack(">i", self.call(20, arguments))[0])

    def simple(self, procedure: int, link: int, program: int = CORE) -> int:
        return int(struct.unpack(">i", self.call(procedure, struct.pack(">i", link), program))[0])


class Interrupted:
    """A client's interrupt program over TCP, written from RFC 5531: it takes calls and answers none."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(5.0)
        self.port = int(self.listener.getsockname()[1])
        self.peer: socket.socket | None = None

    def handle(self) -> bytes:
        """Return the handle of the next service request."""
        if self.peer is None:
            self.peer = self.listener.accept()[0]
            self.peer.settimeout(5.0)
        (mark,) = struct.unpack(">I", self.exactly(4))
        assert mark & 0x80000000
        return called_handle(self.exactly(mark & 0x7FFFFFFF))

    def silent(self) -> bool:
        assert self.peer is not None
        self.peer.settimeout(0.05)
        try:
            return self.peer.recv(1) == b"?"
        except TimeoutError:
            return True
        finally:
            self.peer.settimeout(5.0)

    def exactly(self, size: int) -> bytes:
        assert self.peer is not None
        data = b""
        while len(data) < size:
            data += (part := self.peer.recv(size - len(data)))
            assert part, "the instrument hung up"
        return data

    def close(self) -> None:
        self.listener.close()
        if self.peer is not None:
            self.peer.close()


def called_handle(record: bytes) -> bytes:
    """Return the handle in the record of a call of device_intr_srq."""
    _xid, kind, rpc, program, version, procedure = struct.unpack_from(">6I", record)
    assert (kind, rpc, program, version, procedure) == (0, 2, INTERRUPTS, 1, 30)
    assert record[24:40] == bytes(16)
    (size,) = struct.unpack_from(">I", record, 40)
    assert len(record) == 44 + size + (-size & 3)
    return record[44 : 44 + size]


@contextmanager
def callers(port: int, count: int = 1) -> Iterator[list[Caller]]:
    made = [Caller(port) for _ in range(count)]
    try:
        yield made
    finally:
        for caller in made:
            caller.socket.close()


@pytest.fixture
def served() -> Iterator[Served]:
    with served_lamp(MAX_SPEED) as lamp:
        yield lamp


@pytest.fixture
def caller(served: Served) -> Iterator[Caller]:
    with callers(served.port("vxi11")) as (one,):
        yield one


@pytest.fixture
def visa(served: Served) -> Iterator[Any]:
    manager = pyvisa.ResourceManager("@py")
    instrument: Any = manager.open_resource(served.resource("vxi11"))
    yield instrument
    instrument.close()
    manager.close()


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
    assert visa.read_stb() == 16
    assert visa.read().encode() == IDENTITY
    assert visa.read_stb() == 0


def test_pyvisa_polls_a_service_request_once(visa: Any) -> None:
    visa.write("*SRE 32;*ESE 32;NONSENSE")
    assert visa.read_stb() == 64 | 32
    assert visa.read_stb() == 32


def test_pyvisa_triggers(served: Served, visa: Any) -> None:
    visa.assert_trigger()
    assert served.lamp.triggers == 1


def test_pyvisa_clears_what_was_not_read(visa: Any) -> None:
    visa.write("*IDN?")
    visa.clear()
    assert visa.query("LEV?") == "+0.00000000E+00\n"
    assert visa.query("SYST:ERR?").startswith("+0")


def test_pyvisa_times_out_where_there_is_nothing_to_read(visa: Any) -> None:
    visa.timeout = 50
    with pytest.raises(pyvisa.errors.VisaIOError) as caught:
        visa.read()
    assert caught.value.error_code == StatusCode.error_timeout
    assert visa.query("SYST:ERR?").startswith("-420")


def test_pyvisa_stops_at_a_termination_character(visa: Any) -> None:
    visa.set_visa_attribute(ResourceAttribute.termchar, ord(","))
    visa.set_visa_attribute(ResourceAttribute.termchar_enabled, pyvisa.constants.VI_TRUE)
    visa.write("*IDN?")
    assert [visa.read_raw() for _ in range(4)] == [b"Nobody,", b"Lamp,", b"0,", b"1.0\n"]


def test_an_unread_answer_is_lost_to_the_next_message(visa: Any) -> None:
    visa.write("*IDN?")
    assert visa.query("LEV?") == "+0.00000000E+00\n"
    assert visa.query("SYST:ERR?").startswith("-410")


# --- by hand ---------------------------------------------------------------------------------------------------


def test_a_link_is_made_and_destroyed(served: Served, caller: Caller) -> None:
    error, link, abort_port, size = caller.link()
    assert (error, abort_port) == (0, served.port("vxi11"))
    assert size >= 1024
    assert caller.write(link, b"*IDN?") == (0, 5)
    assert caller.read(link) == (0, 4, IDENTITY)
    assert caller.simple(23, link) == 0
    assert caller.simple(23, link) == 4
    assert caller.write(link, b"*IDN?") == (4, 0)


def test_an_unknown_device_is_not_accessible(caller: Caller) -> None:
    assert caller.link(b"inst7")[0] == 3


def test_a_device_answers_to_its_role(caller: Caller) -> None:
    assert caller.link(b"lamp")[0] == 0


def test_why_a_read_ends(caller: Caller) -> None:
    link = caller.link()[1]
    caller.write(link, b"*IDN?")
    assert caller.read(link, 6) == (0, 1, b"Nobody")
    assert caller.read(link, 100, terminator=ord(",")) == (0, 2, b",")
    assert caller.read(link, 5, terminator=ord(",")) == (0, 3, b"Lamp,")
    assert caller.read(link, 100) == (0, 4, b"0,1.0\n")
    caller.write(link, b"*IDN?")
    assert caller.read(link, len(IDENTITY), terminator=10) == (0, 7, IDENTITY)


def test_what_lies_behind_a_terminator_comes_in_order(caller: Caller) -> None:
    link = caller.link()[1]
    caller.write(link, b"LEV?;*IDN?")
    assert caller.read(link, 3) == (0, 1, b"+0.")
    assert caller.read(link, terminator=ord(";")) == (0, 2, b"00000000E+00;")
    assert caller.read(link, 2, terminator=ord(",")) == (0, 1, b"No")
    assert caller.read(link, terminator=ord(",")) == (0, 2, b"body,")
    assert caller.read(link) == (0, 4, b"Lamp,0,1.0\n")


def test_a_message_ends_with_end(caller: Caller) -> None:
    link = caller.link()[1]
    assert caller.write(link, b"*ID", flags=0) == (0, 3)
    assert caller.write(link, b"N?") == (0, 2)
    assert caller.read(link)[2] == IDENTITY


def test_an_unread_answer_survives_what_others_ask(served: Served) -> None:
    with callers(served.port("vxi11"), 2) as (first, second):
        one, two = first.link()[1], second.link()[1]
        first.write(one, b"LEV 2;LEV?")
        second.write(two, b"*IDN?")
        assert second.read(two)[2] == IDENTITY
        assert first.generic(13, one) == (0, 16)
        assert first.read(one) == (0, 4, b"+2.00000000E+00\n")


def test_unread_answer_is_lost_to_next_message(served: Served) -> None:
    with callers(served.port("vxi11"), 2) as (first, second):
        one, two = first.link()[1], second.link()[1]
        first.write(one, b"LEV?")
        second.write(two, b"*IDN?")
        assert second.read(two)[2] == IDENTITY
        first.write(one, b"SYST:ERR?")
        assert first.read(one)[2].startswith(b"-410")


def test_an_error_within_a_message_is_not_an_unterminated_query(caller: Caller) -> None:
    link = caller.link()[1]
    caller.write(link, b"NONSENSE?")
    caller.write(link, b"SYST:ERR?")
    assert caller.read(link)[2].startswith(b"-113")


def test_device_clear_ends_a_reading_that_is_under_way() -> None:
    with served_lamp(speed=0.01) as served, callers(served.port("vxi11"), 2) as (first, second):
        one, two = first.link()[1], second.link()[1]
        first.write(one, b"READ?")
        first.post_read(one, io_ms=200)
        eventually(lambda: served.server.instruments["lamp"].busy)
        assert second.generic(15, two) == (0,)
        assert first.read_reply()[0] == 15
        second.write(two, b"COUNT?")
        assert second.read(two)[2] == b"+0\n"


def test_a_read_in_vain_takes_its_time_out() -> None:
    wall = WallClock()
    with served_lamp() as served, callers(served.port("vxi11")) as (caller,):
        link = caller.link()[1]
        caller.write(link, b"WAIT?")
        start = wall.now()
        assert caller.read(link, io_ms=80) == (15, 0, b"")
        assert 0.07 < wall.now() - start < 0.07 + BUSY_S
        assert caller.generic(14, link) == (0,)
        assert caller.read(link)[2] == b'"triggered 1"\n'


def test_the_abort_channel_ends_a_read(served: Served) -> None:
    with callers(served.port("vxi11"), 2) as (reader, aborter):
        link = reader.link()[1]
        reader.write(link, b"WAIT?")
        reader.post_read(link, io_ms=60_000)
        eventually(lambda: served.server.instruments["lamp"].awaited)
        assert aborter.simple(1, link, ASYNC) == 0
        assert reader.read_reply() == (23, 0, b"")
        assert aborter.simple(1, 999, ASYNC) == 4


def test_a_lock_keeps_others_out(served: Served) -> None:
    with callers(served.port("vxi11"), 2) as (first, second):
        one, two = first.link(lock=True)[1], second.link()[1]
        assert second.write(two, b"LEV 1") == (11, 0)
        assert second.lock(two) == 11
        assert second.generic(13, two) == (11, 0)
        assert second.simple(19, two) == 12
        assert first.write(one, b"LEV 1") == (0, 5)
        assert first.simple(19, one) == 0
        assert second.lock(two) == 0
        assert first.lock(one, WAIT_LOCK, 30) == 11


def test_a_lock_is_waited_for(served: Served) -> None:
    with callers(served.port("vxi11"), 2) as (first, second):
        one, two = first.link(lock=True)[1], second.link()[1]
        second.post(18, struct.pack(">iiI", two, WAIT_LOCK, 5000))
        eventually(lambda: bool(served.server.instruments["lamp"].lock_waiters))
        assert first.simple(19, one) == 0
        assert second.reply() == (0, struct.pack(">i", 0))
        assert first.write(one, b"LEV 1") == (11, 0)


def test_a_lock_goes_with_its_connection(served: Served) -> None:
    with callers(served.port("vxi11")) as (first,):
        first.link(lock=True)
    with callers(served.port("vxi11")) as (second,):
        link = second.link()[1]
        eventually(lambda: second.lock(link) == 0)
        assert second.write(link, b"LEV 1") == (0, 5)


def test_remote_and_local_are_accepted(caller: Caller) -> None:
    link = caller.link()[1]
    assert caller.generic(16, link) == (0,)
    assert caller.generic(17, link) == (0,)
    assert caller.generic(14, 999) == (4,)


def test_what_is_not_offered_is_said_to_be_so(caller: Caller) -> None:
    link = caller.link()[1]
    assert caller.docmd(link) == (8, b"")
    assert caller.docmd(999) == (4, b"")
    caller.post(99, b"")
    assert caller.reply() == (3, b"")
    caller.post(10, b"", program=4711)
    assert caller.reply() == (1, b"")
    caller.post(10, b"", version=9)
    assert caller.reply() == (2, struct.pack(">2I", 1, 1))
    caller.post(10, b"abc")
    assert caller.reply() == (4, b"")
    caller.post(0, b"")
    assert caller.reply() == (0, b"")


@pytest.fixture
def interrupted() -> Iterator[Interrupted]:
    program = Interrupted()
    yield program
    program.close()


REQUESTS = b"*CLS;*SRE 32;*ESE 32"


def test_a_service_request_comes_on_the_interrupt_channel(caller: Caller, interrupted: Interrupted) -> None:
    link = caller.link()[1]
    assert caller.interrupts(interrupted.port) == 0
    assert caller.enable(link, b"lamp 1") == 0
    caller.write(link, REQUESTS)
    caller.write(link, b"NONSENSE")
    assert interrupted.handle() == b"lamp 1"
    assert caller.generic(13, link) == (0, 64 | 32)
    assert caller.generic(13, link) == (0, 32)
    caller.write(link, b"NONSENSE")
    assert interrupted.silent()  # the same reason: it is requested once
    caller.write(link, REQUESTS)
    caller.write(link, b"NONSENSE")
    assert interrupted.handle() == b"lamp 1"


def test_service_is_requested_when_the_answer_is_there(interrupted: Interrupted) -> None:
    with served_lamp(speed=10.0) as served, callers(served.port("vxi11")) as (caller,):
        link = caller.link()[1]
        caller.interrupts(interrupted.port)
        caller.enable(link, b"")
        caller.write(link, b"*SRE 16")
        caller.write(link, b"READ?")
        assert interrupted.handle() == b""
        assert caller.generic(13, link) == (0, 64 | 16)
        assert caller.read(link, io_ms=0)[2] == b"+0.00000000E+00\n"


def test_only_subscribed_links_get_service_request(served: Served, interrupted: Interrupted) -> None:
    with callers(served.port("vxi11"), 2) as (interrupted_client, other):
        first, second, third = (interrupted_client.link()[1] for _ in range(3))
        interrupted_client.interrupts(interrupted.port)
        for link, handle in ((first, b"a"), (second, b"bcdef"), (third, b"x")):
            interrupted_client.enable(link, handle)
        interrupted_client.enable(third, None)
        fourth = other.link()[1]
        other.enable(fourth, b"has no channel")
        other.write(fourth, REQUESTS)
        other.write(fourth, b"NONSENSE")
        assert {interrupted.handle(), interrupted.handle()} == {b"a", b"bcdef"}
        assert interrupted.silent()


def test_an_interrupt_channel_over_udp(caller: Caller) -> None:
    link = caller.link()[1]
    with socket.socket(type=socket.SOCK_DGRAM) as program:
        program.bind(("127.0.0.1", 0))
        program.settimeout(5.0)
        assert caller.interrupts(program.getsockname()[1], datagrams=True) == 0
        assert caller.enable(link, bytes(40)) == 0
        caller.write(link, REQUESTS)
        caller.write(link, b"NONSENSE")
        assert called_handle(program.recv(1000)) == bytes(40)


def test_an_interrupt_channel_is_made_once_and_ended(caller: Caller, interrupted: Interrupted) -> None:
    link = caller.link()[1]
    assert struct.unpack(">i", caller.call(26, b"")) == (6,)
    assert caller.interrupts(interrupted.port) == 0
    assert caller.interrupts(interrupted.port) == 29
    assert struct.unpack(">i", caller.call(26, b"")) == (0,)
    assert caller.interrupts(_free_port()) == 6
    assert caller.enable(999, b"") == 4
    assert caller.enable(link, bytes(41)) == 5
    assert caller.interrupts(interrupted.port) == 0


def test_an_interrupt_channel_goes_with_its_connection(served: Served, interrupted: Interrupted) -> None:
    with callers(served.port("vxi11")) as (caller,):
        caller.enable(caller.link()[1], b"gone")
        caller.interrupts(interrupted.port)
        interrupted.peer = interrupted.listener.accept()[0]
    assert interrupted.peer.recv(1) == b""
    with callers(served.port("vxi11")) as (other,):
        link = other.link()[1]
        other.write(link, REQUESTS)
        assert other.write(link, b"NONSENSE") == (0, 8)


def test_a_client_that_ends_its_interrupt_program_is_not_missed(caller: Caller, interrupted: Interrupted) -> None:
    link = caller.link()[1]
    caller.interrupts(interrupted.port)
    caller.enable(link, b"gone")
    interrupted.listener.accept()[0].close()
    eventually(lambda: caller.interrupts(interrupted.port) == 0)
    caller.write(link, REQUESTS)
    caller.write(link, b"NONSENSE")
    assert interrupted.handle() == b"gone"


def test_more_than_was_announced_is_refused(caller: Caller) -> None:
    _, link, _, most = caller.link()
    assert most == 16384  # what the oscilloscope's sibling announces
    assert caller.write(link, b"x" * (most + 1)) == (5, 0)
    assert caller.write(link, b"LEV 1" + b" " * (most - 5), flags=0) == (0, most)


def test_line_of_a_megabyte_is_refused(served: Served, visa: Any) -> None:
    visa.write("LEV " + "1" * 1_000_000)
    assert int(visa.query("SYST:ERR?").split(",")[0]) == served.lamp.engine.dialect.input_overflow
    assert visa.query("SYST:ERR?").startswith("+0")


def test_a_call_may_come_in_fragments(caller: Caller) -> None:
    caller.xid += 1
    name = struct.pack(">iIII", 7, 0, 0, 5) + b"inst0\0\0\0"
    record = struct.pack(">10I", caller.xid, 0, 2, CORE, 1, 10, 0, 0, 0, 0) + name
    for start in range(0, len(record), 16):
        part = record[start : start + 16]
        last = 0x80000000 if start + 16 >= len(record) else 0
        caller.socket.sendall(struct.pack(">I", last | len(part)) + part)
    assert caller.reply()[1][:4] == bytes(4)


@pytest.mark.parametrize("noise", [b"GET / HTTP/1.1\r\n\r\n", b"\x80\0\0\x04abcd", b"\xff" * 100])
def test_what_is_no_call_ends_the_connection_only(served: Served, caller: Caller, noise: bytes) -> None:
    with callers(served.port("vxi11")) as (other,):
        other.socket.sendall(noise)
        other.socket.shutdown(socket.SHUT_WR)
        assert other.socket.recv(100) == b""
    assert caller.link()[0] == 0


def test_links_go_with_their_connection(served: Served) -> None:
    instrument = served.server.instruments["lamp"]
    before = len(instrument.clients)
    with callers(served.port("vxi11"), 20) as all_of_them:
        for each in all_of_them:
            each.write(each.link()[1], b"READ?")
    eventually(lambda: len(instrument.clients) == before)


def test_the_port_mapper_answers_by_datagram_and_lists_all() -> None:
    with served_lamp(
        settings=ServerSettings(offers={"lamp": frozenset({"vxi11"})}, port_mapper=_free_port())
    ) as served:
        port = served.server.settings.port_mapper
        assert port is not None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            asking.settimeout(10.0)
            asking.sendto(call_record(7, 100000, 2, 3, struct.pack(">4I", CORE, 1, 6, 0)), ("127.0.0.1", port))
            answer = asking.recv(4096)
            asking.sendto(call_record(8, 100000, 2, 4, b""), ("127.0.0.1", port))
            listed = asking.recv(4096)
        gateway = struct.unpack(">I", answer[24:])[0]
        assert answer[:4] == struct.pack(">I", 7)
        entries = [struct.unpack(">4I", listed[at + 4 : at + 20]) for at in range(24, len(listed) - 4, 20)]
        assert (CORE, 1, 6, gateway) in entries
        assert (100000, 2, 17, port) in entries
        assert listed[-4:] == bytes(4)


def test_a_port_mapper_leads_to_every_instrument() -> None:
    with served_lamp(
        settings=ServerSettings(offers={"lamp": frozenset({"vxi11"})}, port_mapper=_free_port())
    ) as served:
        assert served.server.settings.port_mapper is not None
        with callers(served.server.settings.port_mapper) as (mapper,):
            mapper.post(3, struct.pack(">4I", CORE, 1, 6, 0), program=100000, version=2)
            acceptance, result = mapper.reply()
        assert acceptance == 0
        with callers(struct.unpack(">I", result)[0]) as (caller,):
            link = caller.link(b"inst0")[1]
            caller.write(link, b"*IDN?")
            assert caller.read(link)[2] == IDENTITY


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])
