from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import serial
from simrack.rate_tables.acl import AclTable, TableErrors
from simrack.wires import serial_backend

from simrack_tests.rate_tables.ideal import IdealWorld

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def world() -> Iterator[IdealWorld]:
    world = IdealWorld()
    serial_backend.register("table-1", AclTable(world, TableErrors.none()), world.clock)
    yield world
    serial_backend.unregister("table-1")


def port(timeout: float | None = 1.0) -> serial.SerialBase:
    return serial.serial_for_url("sim://table-1", baudrate=9600, timeout=timeout)


def test_a_line_goes_round(world: IdealWorld) -> None:
    with port() as line:
        assert line.write(b":Mode? 1\r\n") == 10
        assert line.read_until(b"\n") == b"Off\r\n"
        assert 0.0 < world.clock.now() < 0.1


def test_a_time_out_takes_simulated_time(world: IdealWorld) -> None:
    with port(timeout=30.0) as line:
        assert line.read(1) == b""
    assert world.clock.now() == 30.0


def test_short_time_out_leaves_reply_for_next_read(world: IdealWorld) -> None:
    with port(timeout=0.001) as line:
        line.write(b"*IDN?\n")
        assert line.read(4) == b""
        assert world.clock.now() == 0.001
        line.timeout = 1.0
        assert line.read(4) == b"Acut"


def test_a_zero_time_out_does_not_wait(world: IdealWorld) -> None:
    with port(timeout=0) as line:
        line.write(b"*IDN?\n")
        assert line.read(100) == b""
    assert world.clock.now() == 0.0


@pytest.mark.usefixtures("world")
def test_a_read_that_could_never_end_is_refused() -> None:
    with port(timeout=None) as line, pytest.raises(serial.SerialException, match="would never end"):
        line.read(1)


def test_waiting_bytes_are_counted_and_can_be_thrown_away(world: IdealWorld) -> None:
    with port() as line:
        line.write(b":Mode? 1\n:Mode? 1\n")
        assert line.in_waiting == 0
        world.clock.sleep_until(1.0)
        assert line.in_waiting == 10
        line.reset_input_buffer()
        assert line.in_waiting == 0


@pytest.mark.usefixtures("world")
def test_line_settings_and_control_lines_are_accepted() -> None:
    with port() as line:
        line.dtr = False
        line.rts = True
        line.write_timeout = 0.5
        line.baudrate = 115200
        line.flush()
        line.reset_output_buffer()
        assert line.out_waiting == 0
        assert (line.cts, line.dsr, line.cd, line.ri) == (True, True, True, False)


def test_bytes_that_are_not_text_pass(world: IdealWorld) -> None:
    class Echo:
        def __init__(self) -> None:
            self.held = b""

        def write(self, data: bytes, *, end: bool = False) -> None:  # noqa: ARG002 - the seam has it
            self.held += data

        def read(self, limit: int) -> tuple[bytes, bool]:
            data, self.held = self.held[:limit], self.held[limit:]
            return data, not self.held

        def wake_at(self) -> float | None:
            return None

        def clear(self) -> None:
            self.held = b""

        def status_byte(self) -> int:
            return 0

        def trigger(self) -> None:
            pass

    serial_backend.register("echo", Echo(), world.clock)
    with serial.serial_for_url("sim://echo", timeout=0.1) as line:
        line.write(bytes(range(256)))
        assert line.read(256) == bytes(range(256))
    serial_backend.unregister("echo")


def test_an_unknown_handle_cannot_be_opened() -> None:
    with pytest.raises(serial.SerialException, match="no simulated port"):
        serial.serial_for_url("sim://nobody")


@pytest.mark.usefixtures("world")
def test_a_closed_port_refuses() -> None:
    line = port()
    line.close()
    with pytest.raises(serial.PortNotOpenError):
        line.read(1)
    line.open()
    with pytest.raises(serial.SerialException, match="already open"):
        line.open()
    line.close()
