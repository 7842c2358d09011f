"""The man in the middle: what is told arrives, what comes back suffers as asked, over TCP and a terminal."""

from __future__ import annotations

import os
import socket
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import pytest
import serial
from simrack.clock import WallClock
from simrack.faults import Kind
from simrack.wire_faults import WIRE_FAULTS, WireFault, faulty_wire

from simrack_tests.ports import PLENTY_S, eventually

if TYPE_CHECKING:
    from collections.abc import Iterator

CLOCK = WallClock()


def echo(connection: socket.socket, heard: list[bytes]) -> None:
    with connection:
        while data := connection.recv(4096):
            heard.append(data)
            connection.sendall(b"<" + data.strip() + b">\r\n")


@contextmanager
def instrument() -> Iterator[tuple[str, list[bytes]]]:
    """Serve an instrument that echoes; yield its resource and what it has heard."""
    heard: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                threading.Thread(target=echo, args=(connection, heard), daemon=True).start()

        threading.Thread(target=serve, daemon=True).start()
        yield f"socket://127.0.0.1:{server.getsockname()[1]}", heard
        server.shutdown(socket.SHUT_RDWR)


def asked(port: Any, question: bytes) -> bytes:
    """Return a reply with its end."""
    port.timeout = PLENTY_S
    port.write(question)
    return bytes(port.read_until(b"\r\n"))


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("silent", b""),
        ("truncated", b"<AB"),
        ("unended", b"<ABC>"),
        ("doubled", b"<ABC>\r\n<ABC>\r\n"),
        ("late", b"<ABC>\r\n"),
    ],
)
def test_a_reply_is_spoilt_once_and_the_next_is_whole(kind: Any, expected: bytes) -> None:
    with instrument() as (resource, heard), faulty_wire(resource) as wire, serial.serial_for_url(wire.resource) as port:
        assert asked(port, b"A\n") == b"<A>\r\n"
        wire.begin(WireFault(kind, count=1, delay_s=0.3))
        begin_s = CLOCK.now()
        port.write(b"ABC\n")
        eventually(lambda: wire.spoilt_s)
        port.write(b"D\n")
        assert port.read(len(expected)) == expected
        assert CLOCK.now() - begin_s >= (0.3 if kind == "late" else 0.0)
        assert port.read(len(b"<D>\r\n")) == b"<D>\r\n"
        assert b"".join(heard) == b"A\nABC\nD\n"
        assert bytes(wire.received) == b"ABC\nD\n"
        assert len(wire.spoilt_s) == 1


def test_random_bytes_come_from_the_seed() -> None:
    came = []
    for _ in range(2):
        with instrument() as (resource, _), faulty_wire(resource) as wire, serial.serial_for_url(wire.resource) as port:
            wire.begin(WireFault("replaced", seed=4))
            port.timeout = PLENTY_S
            port.write(b"ABCDEF\n")
            came.append(port.read(len(b"<ABCDEF>\r\n")))
    assert came[0] == came[1] != b"<ABCDEF>\r\n"
    assert len(came[0]) == len(b"<ABCDEF>\r\n")


def test_one_bit_is_flipped() -> None:
    with instrument() as (resource, _), faulty_wire(resource) as wire, serial.serial_for_url(wire.resource) as port:
        wire.begin(WireFault("flipped"))
        port.timeout = PLENTY_S
        port.write(b"ABC\n")
        came = port.read(len(b"<ABC>\r\n"))
    assert sum((one ^ other).bit_count() for one, other in zip(came, b"<ABC>\r\n", strict=True)) == 1


def test_a_trickle_comes_byte_by_byte() -> None:
    with instrument() as (resource, _), faulty_wire(resource) as wire, serial.serial_for_url(wire.resource) as port:
        wire.begin(WireFault("trickle", delay_s=0.2))
        begin_s = CLOCK.now()
        port.timeout = PLENTY_S
        port.write(b"A\n")
        assert port.read(5) == b"<A>\r\n"
        assert CLOCK.now() - begin_s >= 0.9


def test_an_endless_answer_goes_on_until_the_fault_ends() -> None:
    with instrument() as (resource, _), faulty_wire(resource) as wire, serial.serial_for_url(wire.resource) as port:
        wire.begin(WireFault("endless", count=1))
        port.timeout = PLENTY_S
        port.write(b"A\n")
        assert port.read(300_000).endswith(b"A" * 290_000)
        wire.end()


def test_command_before_dropped_connection_arrives_and_new_one_works() -> None:
    with instrument() as (resource, heard), faulty_wire(resource) as wire:
        wire.begin(WireFault("disconnect", count=1))
        with serial.serial_for_url(wire.resource) as port, pytest.raises(serial.SerialException):
            asked(port, b"A\n")
        with serial.serial_for_url(wire.resource) as port:
            assert asked(port, b"B\n") == b"<B>\r\n"
        assert b"".join(heard) == b"A\nB\n"


def test_cut_line_returns_when_fault_ends() -> None:
    with instrument() as (resource, _), faulty_wire(resource) as wire:
        wire.begin(WireFault("unreachable"))
        with serial.serial_for_url(wire.resource) as port, pytest.raises(serial.SerialException):
            asked(port, b"A\n")
        with pytest.raises(serial.SerialException):
            serial.serial_for_url(wire.resource)
        wire.end()
        with serial.serial_for_url(wire.resource) as port:
            assert asked(port, b"B\n") == b"<B>\r\n"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_dropped_serial_line_returns_at_same_path() -> None:
    import tty  # noqa: PLC0415  # there is none on Windows

    master, slave = os.openpty()
    tty.setraw(slave)
    with faulty_wire(os.ttyname(slave)) as wire:
        with serial.Serial(wire.resource, timeout=PLENTY_S) as port:
            port.write(b"A\n")
            assert os.read(master, 10) == b"A\n"
            os.write(master, b"one\n")
            assert port.read(4) == b"one\n"
            wire.begin(WireFault("disconnect", count=1))
            os.write(master, b"two\n")
            with pytest.raises(serial.SerialException):
                port.read(4)
        path = Path(wire.resource)
        eventually(path.exists)
        with serial.Serial(wire.resource, timeout=PLENTY_S) as port:
            port.write(b"B\n")
            assert os.read(master, 10) == b"B\n"
            os.write(master, b"three\n")
            assert port.read(6) == b"three\n"
        wire.begin(WireFault("unreachable"))
        os.write(master, b"four\n")
        eventually(lambda: not path.is_symlink())
        wire.end()
        assert path.is_symlink()
    os.close(master)
    os.close(slave)


def test_mistakes_are_refused() -> None:
    with pytest.raises(ValueError, match=", ".join(WIRE_FAULTS)):
        WireFault("no such thing")
    with pytest.raises(ValueError, match="expected a socket or a serial line"), faulty_wire("GPIB0::1::INSTR"):
        pass


def test_kinds_that_instruments_have_too_have_the_same_names() -> None:
    assert set(WIRE_FAULTS) - set(get_args(Kind)) == {"flipped", "replaced", "unended", "endless", "trickle", "doubled"}
