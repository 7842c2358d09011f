"""Wires below the session: what is done without PyVISA-py's socket, and serial lines."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import pytest
from simrack_tests.ports import BUSY_S, PLENTY_S

from tests.drivers.servers import IDENTITY, answering, nothing_special, serving
from vcfbench.clock import Deadline, WallClock
from vcfbench.drivers import visa_wire
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.session import Session, visa_resource
from vcfbench.drivers.wire import SerialLine
from vcfbench.errors import ConnectFailed, DeadlineExceeded, FramingError, LinkLost

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator

CLOCK = WallClock()
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="this system has no pseudo-terminals")
LINE = SerialLine(stop_bits=1, flow_control="none")


@pytest.fixture
def through_visa(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do as under a library whose socket cannot be reached."""
    monkeypatch.setattr(visa_wire, "_socket_beneath", lambda _: None)


def opened(resource: str, timeout_s: float = PLENTY_S, serial: SerialLine | None = None) -> Session:
    connect = visa_resource(resource, "@py", serial)
    session = Session.opened(connect, name="x", resource=resource, clock=CLOCK, timeout_s=timeout_s)
    session.identify()
    return session


def given_up_in_time(session: Session, question: str) -> None:
    """Ask in vain; the wire's own time-out was `PLENTY_S` before, the question's is 0.1 s."""
    begin_s = CLOCK.now()
    with pytest.raises(DeadlineExceeded):
        session.query(question, Deadline.after(CLOCK, 0.1))
    assert 0.09 <= CLOCK.now() - begin_s < 0.1 + BUSY_S


@pytest.mark.usefixtures("through_visa")
def test_queries_blocks_and_noise_through_viread() -> None:
    data = bytes(range(256)) * 500 + b"\n"

    def special(connection: socket.socket, line: str) -> bool:
        known = {"WAV?": f"#8{len(data):08d}".encode() + data + b"\n", "READ?": b"\xff\xfe\n"}
        if line in known:
            connection.sendall(known[line])
        return line in known

    with serving(answering(special)) as where, opened(where) as session:
        assert isinstance(session._wire, visa_wire.VisaWire)
        assert [session.query(f"Q{n}?") for n in range(3)] == ["Q0", "Q1", "Q2"]
        assert session.query_block("WAV?") == data
        with pytest.raises(FramingError):
            session.query("READ?")
        assert session.query("A?") == "A"


@pytest.mark.usefixtures("through_visa")
def test_a_late_answer_through_viread() -> None:
    given_up = threading.Event()

    def late(connection: socket.socket, line: str) -> bool:
        if line == "FIRST?":
            given_up.wait(PLENTY_S)
            connection.sendall(b"LATE\n")
        return line == "FIRST?"

    with serving(answering(late)) as where, opened(where) as session:
        given_up_in_time(session, "FIRST?")
        given_up.set()
        assert session.query("SECOND?") == "SECOND"
        assert session.query("THIRD?") == "THIRD"


def test_beneath_pyvisa_py_the_socket_itself_is_used() -> None:
    with serving(answering(nothing_special)) as where, opened(where) as session:
        assert isinstance(session._wire, visa_wire.SocketWire)


@contextmanager
def instrument_on_a_pseudo_terminal(*silent: str) -> Iterator[str]:
    import tty  # noqa: PLC0415 - POSIX only

    host, device = os.openpty()
    tty.setraw(device)
    instrument = threading.Thread(target=_serve, args=(host, silent), daemon=True)
    instrument.start()
    try:
        yield f"ASRL{os.ttyname(device)}::INSTR"
    finally:
        os.close(device)  # that ends the instrument, which alone closes its end: a number closed twice may be another's
        instrument.join(10.0)


def _serve(host: int, silent: tuple[str, ...]) -> None:
    known = {"*IDN?": IDENTITY, "*OPC?": "1", "SYST:ERR?": '+0,"No error"', "FETC?": "+1.25000000E+00"}
    received = b""
    with os.fdopen(host, "rb", buffering=0), suppress(OSError):
        while data := os.read(host, 1024):
            *whole, received = (received + data).replace(b"\x03", b"").split(b"\n")
            for line in whole:
                if line == b"HANG UP?":
                    return
                if line.decode() in known and line.decode() not in silent:
                    os.write(host, known[line.decode()].encode() + b"\r\n")


@POSIX
def test_an_instrument_on_a_serial_line() -> None:
    with instrument_on_a_pseudo_terminal() as where:
        connect = visa_resource(where, "@py", LINE)
        session = Session.opened(connect, name="meter", resource=where, clock=CLOCK, timeout_s=PLENTY_S)
        assert session.interface == "asrl"
        meter = Hp34401A(session)
        assert meter.read_voltage_v() == 1.25
        assert meter.make_safe(Deadline.after(CLOCK, PLENTY_S)).safe
        meter.close()


@POSIX
def test_a_silent_serial_line_is_a_deadline() -> None:
    with instrument_on_a_pseudo_terminal("READ?") as where, opened(where, serial=LINE) as session:
        given_up_in_time(session, "READ?")
        assert session.query("*OPC?") == "1"


@POSIX
def test_a_serial_line_whose_other_end_goes_away() -> None:
    with instrument_on_a_pseudo_terminal() as where, opened(where, serial=LINE) as session:
        begin_s = CLOCK.now()
        with pytest.raises(LinkLost):
            session.query("HANG UP?")
        assert CLOCK.now() - begin_s < BUSY_S


@POSIX
def test_a_line_that_the_port_cannot_do_fails_to_open() -> None:
    with instrument_on_a_pseudo_terminal() as where, pytest.raises(ConnectFailed, match="cannot be opened"):
        opened(where, serial=SerialLine(data_bits=7, parity="even", flow_control="none"))


def test_a_port_that_is_not_there_fails_to_open() -> None:
    with pytest.raises(ConnectFailed, match="x at ASRL/no/such/port::INSTR"):
        opened("ASRL/no/such/port::INSTR")
