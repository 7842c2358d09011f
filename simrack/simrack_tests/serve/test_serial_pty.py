"""A pseudo-terminal with a real serial line behind it, opened by pyserial."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
import pyvisa
import serial
from msgspec.structs import replace
from simrack.serve import MAX_SPEED, Rs232, ServedClock, ServerSettings

from simrack_tests.ports import eventually
from simrack_tests.serve.lamp import ALL, IDENTITY, Lamp, Served, served_lamp, serving

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")

CHARACTER_S = 11 / 9600
LINE = {"baudrate": 9600, "stopbits": 2, "timeout": 5.0}


@contextmanager
def served(rs232: Rs232, speed: float = MAX_SPEED) -> Iterator[Served]:
    with served_lamp(speed, ServerSettings(offers={"lamp": ALL}, rs232=rs232)) as lamp:
        yield lamp


@contextmanager
def opened(lamp: Served, baud: int = 9600) -> Iterator[serial.Serial]:
    device = lamp.resource("pty").removeprefix("ASRL").removesuffix("::INSTR")
    with serial.Serial(device, baud, timeout=5.0, stopbits=2) as port:
        yield port


def errors(lamp: Served) -> list[int]:
    queue = lamp.lamp.engine.errors
    return [queue.pop()[0] for _ in range(len(queue))]


@pytest.mark.parametrize("rs232", ["real", "three-wire"])
def test_an_exchange_takes_the_time_of_its_characters(rs232: Rs232) -> None:
    with served(rs232) as lamp, opened(lamp) as port:
        port.write(b"*IDN?\n")
        assert port.read_until(b"\n") == IDENTITY.replace(b"\n", b"\r\n")
        before = lamp.clock.now()
        port.write(b"TIME?\n")
        instant = float(port.read_until(b"\n"))
        assert instant - before >= 6 * CHARACTER_S * 0.999
        port.write(b"TIME?\n")
        later = float(port.read_until(b"\n"))
        assert later - instant >= (6 + 21) * CHARACTER_S * 0.999


def test_with_the_handshake_nothing_is_lost() -> None:
    with served("real") as lamp, opened(lamp) as port:
        port.write(b"SLOW 1\n" * 4 + b"LEV 2;" * 100 + b"LEV 3\nLEV?\n")
        assert port.read_until(b"\n") == b"+3.00000000E+00\r\n"
        assert errors(lamp) == []


def test_without_it_what_does_not_fit_is() -> None:
    with served("three-wire", speed=20.0) as lamp, opened(lamp) as port:
        port.write(b"SLOW 1\n" + b"LEV 2;" * 30 + b"LEV 3\n")
        eventually(lambda: not lamp.server.instruments["lamp"].busy and lamp.lamp.level_v == 1.0)
        eventually(lambda: len(lamp.lamp.engine.errors) > 0)
        assert errors(lamp) == [521]
        port.write(b"\nLEV?\n")
        assert port.read_until(b"\n") == b"+2.00000000E+00\r\n"


def test_xon_and_xoff_are_a_handshake_without_pins() -> None:
    clock = ServedClock(MAX_SPEED)
    lamp = Lamp(clock)
    lamp.engine.dialect = replace(lamp.engine.dialect, xonxoff=True)
    settings = ServerSettings(offers={"lamp": ALL}, rs232="three-wire")
    with serving({"lamp": lamp}, clock, settings) as served, opened(served) as port:
        port.xonxoff = True
        port.write(b"SLOW 1\n" * 6 + b"LEV 2;" * 600 + b"LEV 3\nLEV?\n")
        assert port.read_until(b"\n") == b"+3.00000000E+00\r\n"
        assert errors(served) == []
        port.timeout = 0.2
        port.set_input_flow_control(enable=False)  # sends XOFF
        port.write(b"LEV?\n")
        assert port.read(1) == b""
        port.set_input_flow_control(enable=True)
        assert port.read_until(b"\n") == b"+3.00000000E+00\r\n"
        port.xonxoff, port.timeout = False, 5.0
        port.write(b"SLOW 1\n" * 6 + b"LEV 2;" * 600 + b"LEV 4\nLEV?\n")
        assert port.read(1) == b"\x13"
        eventually(lambda: 521 in errors(served))


def test_the_wrong_speed_is_noise() -> None:
    with served("real") as lamp:
        with opened(lamp, baud=4800) as port:
            port.timeout = 0.2
            port.write(b"*IDN?\n")
            assert port.read(1) == b""
        assert 511 in errors(lamp)
        with opened(lamp) as port:
            port.write(b"*CLS\n*IDN?\n")
            assert port.read_until(b"\n").strip() == IDENTITY.strip()


def test_control_c_ends_what_runs() -> None:
    with served("real", speed=0.2) as lamp, opened(lamp) as port:
        port.write(b"READ?\n")
        eventually(lambda: lamp.server.instruments["lamp"].busy)
        port.write(b"\x03COUN?\n")
        assert port.read_until(b"\n") == b"+0\r\n"


def test_a_trigger_passes_and_others_share_the_instrument() -> None:
    with served("real") as lamp, opened(lamp) as port:
        manager = pyvisa.ResourceManager("@py")
        other = manager.open_resource(lamp.resource("tcp"), read_termination="\n", write_termination="\n")
        port.write(b"LEV 4\nLEV?\n")
        assert port.read_until(b"\n") == b"+4.00000000E+00\r\n"
        assert other.query("LEV?") == "+4.00000000E+00"  # type: ignore[attr-defined]
        port.write(b"WAIT?\n*TRG\n")
        assert port.read_until(b"\n") == b'"triggered 1"\r\n'
        other.close()
        manager.close()


def test_pyvisa_works_on_it_as_it_comes() -> None:
    with served("real") as lamp:
        manager = pyvisa.ResourceManager("@py")
        instrument = manager.open_resource(lamp.resource("pty"))
        assert instrument.query("*IDN?").strip().encode() == IDENTITY.strip()  # type: ignore[attr-defined]
        instrument.close()
        manager.close()
