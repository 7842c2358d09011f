"""A pseudo-terminal with the serial personality, opened by pyserial and PyVISA-py."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
import serial
from simrack.rate_tables.acl import AclTable, TableErrors
from simrack.serve import MAX_SPEED, ServedClock

from simrack_tests.ports import eventually
from simrack_tests.rate_tables.ideal import IdealMotion
from simrack_tests.serve.lamp import IDENTITY, PICTURE, Served, served_lamp, serving

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def served() -> Iterator[Served]:
    with served_lamp(MAX_SPEED) as lamp:
        yield lamp


def device(resource: str) -> str:
    return resource.removeprefix("ASRL").removesuffix("::INSTR")


@pytest.fixture
def port(served: Served) -> Iterator[serial.Serial]:
    with serial.Serial(device(served.resource("pty")), 9600, timeout=5.0, stopbits=2, dsrdtr=True) as line:
        yield line


def test_answers_end_as_on_a_serial_line(port: serial.Serial) -> None:
    for _ in range(10):
        port.write(b"*IDN?\n")
        assert port.read_until(b"\r\n") == IDENTITY.replace(b"\n", b"\r\n")


def test_every_byte_value_passes(port: serial.Serial) -> None:
    port.write(b"PICT?\r\n")
    header = b"#6%d" % len(PICTURE)
    assert port.read(len(header) + len(PICTURE) + 2) == header + PICTURE + b"\r\n"


def test_line_of_a_megabyte_is_refused(served: Served, port: serial.Serial) -> None:
    port.write(b"LEV " + b"1" * 1_000_000 + b"\nSYST:ERR?\n")
    assert int(port.read_until(b"\n").split(b",")[0]) == served.lamp.engine.dialect.input_overflow
    port.write(b"SYST:ERR?\n")
    assert port.read_until(b"\n").startswith(b"+0")


def test_control_c_is_device_clear() -> None:
    with served_lamp(speed=0.01) as served, serial.Serial(device(served.resource("pty")), timeout=5.0) as port:
        port.write(b"READ?\n")
        eventually(lambda: served.server.instruments["lamp"].busy)
        port.write(b"\x03COUN?\n")
        assert port.read_until(b"\n") == b"+0\r\n"


def test_control_c_drops_what_waits_behind_a_question() -> None:
    with served_lamp(speed=0.01) as served, serial.Serial(device(served.resource("pty")), timeout=5.0) as port:
        instrument = served.server.instruments["lamp"]
        port.write(b"WAIT?\n")
        eventually(lambda: instrument.busy)
        port.write(b"*IDN?\n")
        eventually(lambda: bool(instrument.waiting))
        port.write(b"\x03COUN?\n")
        assert port.read_until(b"\n") == b"+0\r\n"


def test_a_line_can_be_closed_and_opened_again(served: Served) -> None:
    for _ in range(5):
        with serial.Serial(device(served.resource("pty")), timeout=5.0) as port:
            port.write(b"*IDN?\n")
            assert port.read_until(b"\n").strip() == IDENTITY.strip()


def test_pyvisa_opens_it(served: Served) -> None:
    manager = pyvisa.ResourceManager("@py")
    instrument: Any = manager.open_resource(served.resource("pty"))
    try:
        instrument.baud_rate = 9600
        assert instrument.query("*IDN?").strip().encode() == IDENTITY.strip()
        instrument.write("LEV 3")
        assert float(instrument.query("READ?")) == 3.0
    finally:
        instrument.close()
        manager.close()


class TurningWorld:
    def __init__(self, clock: ServedClock) -> None:
        self.clock = clock
        self.table = IdealMotion(clock)  # type: ignore[arg-type]  # any clock will do


@pytest.fixture
def table() -> Iterator[Served]:
    clock = ServedClock(MAX_SPEED)
    with serving({"table": AclTable(TurningWorld(clock), TableErrors.none())}, clock) as served:
        yield served


def test_a_rate_table_has_a_terminal_and_a_socket(table: Served) -> None:
    wires = table.server.wires["table"]
    assert wires.pty is not None
    assert wires.tcp is not None
    for url in (wires.pty, wires.tcp):
        with serial.serial_for_url(url, timeout=5.0) as port:
            port.write(b":Mode? 1\r\n")
            assert port.read_until(b"\n") == b"Off\r\n"
