"""A wire on which the leader of the clock tells that it waits."""

from __future__ import annotations

import os
import socket
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
import serial
from simrack.rate_tables.aaaa import AaaaTable
from simrack.rate_tables.dd16 import Dd16Table, TableErrors
from simrack.rate_tables.ruya import RuyaTable
from simrack.serve import MAX_SPEED, Control, ControlError, RemoteClock, Rs232, ServedClock, ServerSettings
from simrack.serve.lockstep_port import LockstepPort
from simrack.wires.serial_line import CharacterFrame
from simrack_tests.serve.lamp import Served, serving

from tests.sim.serve.test_tables import CONNECT, POSITION, WIRES, StillWorld

if TYPE_CHECKING:
    from collections.abc import Iterator

STATUS = b"$1000%d000.0000\r\n"


@pytest.fixture(params=WIRES)
def wire(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def table_bench(kind: Any, rs232: Rs232 = "ideal") -> Iterator[tuple[Served, Control]]:
    clock = ServedClock(MAX_SPEED)
    device = kind(StillWorld(clock), TableErrors.none())
    with (
        serving({"table": device}, clock, ServerSettings(rs232=rs232)) as served,
        Control(served.server.control.port) as control,
    ):
        yield served, control


@pytest.fixture
def talking() -> Iterator[tuple[Served, Control]]:
    yield from table_bench(RuyaTable)


@pytest.fixture
def frames() -> Iterator[tuple[Served, Control]]:
    yield from table_bench(Dd16Table)


def port_of(served: Served, control: Control, wire: str) -> LockstepPort:
    clock = RemoteClock(control, awaits=True)
    return LockstepPort(control, clock, "table", served.resource(wire, "table")).connect()


def test_time_goes_to_the_next_status_and_no_further(talking: tuple[Served, Control], wire: str) -> None:
    """Statuses come every 0.1 s, 1 ms after their instant."""
    served, control = talking
    port = port_of(served, control, wire)
    port.read(100)
    before = control.request("now")
    said = []
    for _ in range(3):
        assert port.wait(before + 10.0)
        said.append((port.clock.now(), port.read(100)[0]))
    assert [len(data) for _, data in said] == [len(STATUS % 1)] * 3
    steps = [later - sooner for (sooner, _), (later, _) in pairwise(said)]
    assert steps == pytest.approx([0.1, 0.1])
    port.disconnect()


def test_what_is_written_is_taken_before_time_goes_on(frames: tuple[Served, Control], wire: str) -> None:
    """5 ms for each answer; nothing jumps before somebody waits."""
    served, control = frames
    port = port_of(served, control, wire)
    port.write(CONNECT)
    port.write(POSITION)
    assert control.request("now") == 0.0
    assert port.wait(1.0)
    assert port.clock.now() == pytest.approx(0.005)
    assert port.read(100)[0] == CONNECT
    assert port.wait(1.0)
    assert port.clock.now() == pytest.approx(0.010)
    assert port.read(100)[0][:3] == POSITION[:3]
    assert port.wait(1.0)
    assert (port.clock.now(), port.read(100)[0]) == (1.0, b"")
    assert not port.wait(1.0)
    port.disconnect()


def test_words_to_another_listener_are_not_lost(talking: tuple[Served, Control]) -> None:
    served, control = talking
    port = port_of(served, control, "tcp")
    with serial.serial_for_url(served.resource("tcp", "table"), timeout=5.0) as other:
        other.write(b"$1mo=1\r\n")
        control.request("sleep_until", instant_s=1.0)
        assert other.read(len(STATUS % 1)).startswith(b"$1")
    assert port.read(1000)[0].count(b"\r\n") >= 9
    port.disconnect()


def test_nobody_guesses_when_the_leader_tells(talking: tuple[Served, Control]) -> None:
    served, control = talking
    RemoteClock(control, awaits=True)
    before = control.request("now")
    with socket.create_connection(("127.0.0.1", int(served.resource("tcp", "table").rpartition(":")[2]))) as silent:
        silent.settimeout(0.1)
        with pytest.raises(TimeoutError):
            silent.recv(1)
    assert control.request("now") == before


def test_unknown_and_lost_wires_are_refused(talking: tuple[Served, Control]) -> None:
    served, control = talking
    port = port_of(served, control, "tcp")
    with pytest.raises(ControlError, match="no 'toaster'"):
        control.request("hear", instrument="toaster", address=1)
    control.request("fault", instrument="table", kind="disconnect")
    with pytest.raises(serial.SerialException, match="has ended"):
        port.wait(control.request("now") + 5.0)
    port.disconnect()


def test_only_the_leader_hears(talking: tuple[Served, Control]) -> None:
    served, control = talking
    port_of(served, control, "tcp").disconnect()
    with Control(served.server.control.port) as other, pytest.raises(ControlError, match="another connection leads"):
        other.request("hear", instrument="table", address=1)


ON_TERMINALS = pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")


@ON_TERMINALS
@pytest.mark.parametrize("rs232", ["real", "three-wire"])
def test_on_a_real_line_each_character_takes_its_time(rs232: Rs232) -> None:
    """16 bytes at 9600 Bd, 5 ms, and the first byte back; the second question comes after the first."""
    for served, control in table_bench(Dd16Table, rs232):
        port = port_of(served, control, "pty")
        port.configure(CharacterFrame(9600.0, stop_bits=1.0), handshake=False)
        port.write(CONNECT)
        port.write(POSITION)
        assert control.request("now") == 0.0
        assert port.wait(1.0)
        assert port.clock.now() == pytest.approx(0.005 + 17 * 10 / 9600)
        data = port.read(100)[0]
        while len(data) < 32:
            assert port.wait(1.0)
            data += port.read(100)[0]
        assert data.startswith(CONNECT + POSITION[:3])
        assert port.clock.now() == pytest.approx(0.005 + 48 * 10 / 9600)
        port.disconnect()


@ON_TERMINALS
def test_a_real_line_answers_at_its_own_speed_only() -> None:
    for served, control in table_bench(Dd16Table, "real"):
        port = port_of(served, control, "pty")
        for baud in (19200.0, 4800.0, 9600.0):
            port.configure(CharacterFrame(baud, stop_bits=1.0), handshake=False)
            port.write(CONNECT)
            until_s = port.clock.now() + 1.0
            data = b""
            while port.wait(until_s):
                data += port.read(100)[0]
            assert (CONNECT in data) is (baud == 9600.0)
        port.disconnect()


@ON_TERMINALS
def test_status_on_a_real_line_comes_at_its_pace() -> None:
    """A status of 23 bytes at 38 400 Bd every 0.1 s, after 1 ms of the controller's own."""
    for served, control in table_bench(AaaaTable, "real"):
        port = port_of(served, control, "pty")
        port.configure(CharacterFrame(38_400.0, stop_bits=1.0), handshake=False)
        control.request("sleep_until", instant_s=1.05)
        port.read(1000)
        ends = list[float]()
        data = b""
        while len(ends) < 3:
            assert port.wait(2.0)
            data += port.read(100)[0]
            if len(data) == 23 * (len(ends) + 1):
                ends.append(port.clock.now())
        assert ends == pytest.approx([instant + 0.001 + 23 * 10 / 38_400 for instant in (1.1, 1.2, 1.3)])
        port.disconnect()


@ON_TERMINALS
def test_binary_status_on_a_terminal() -> None:
    for served, control in table_bench(AaaaTable):
        port = port_of(served, control, "pty")
        assert port.wait(control.request("now") + 1.0)
        data = port.read(100)[0]
        assert (data[:2], len(data) % 23) == (b"\xaa\xaa", 0)
        port.disconnect()
