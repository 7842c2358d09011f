"""A wire on which the leader of the clock tells that it waits."""

from __future__ import annotations

import os
import socket
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
import serial

from tests.sim.serve.lamp import Served, serving
from tests.sim.serve.test_tables import CONNECT, POSITION, WIRES, StillWorld
from vcfbench.sim.rate_tables.aaaa import AaaaTable
from vcfbench.sim.rate_tables.dd16 import Dd16Table, TableErrors
from vcfbench.sim.rate_tables.ruya import RuyaTable
from vcfbench.sim.serve import MAX_SPEED, Control, ControlError, RemoteClock, ServedClock
from vcfbench.sim.serve.lockstep_port import LockstepPort

if TYPE_CHECKING:
    from collections.abc import Iterator

STATUS = b"$1000%d000.0000\r\n"


@pytest.fixture(params=WIRES)
def wire(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def table_bench(kind: Any) -> Iterator[tuple[Served, Control]]:
    clock = ServedClock(MAX_SPEED)
    with (
        serving({"table": kind(StillWorld(clock), TableErrors.none())}, clock) as served,
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
    """Statuses come every 0.1 s, and take 1 ms and 18 characters at 115200 Bd to say."""
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
    """A frame each way of 16 bytes at 9600 Bd, and 5 ms; nothing jumps before somebody waits."""
    served, control = frames
    port = port_of(served, control, wire)
    port.write(CONNECT)
    port.write(POSITION)
    assert control.request("now") == 0.0
    assert port.wait(1.0)
    # a frame has no terminator; the twin counts one byte for the end of any message
    assert port.clock.now() == pytest.approx(0.005 + 33 * 10 / 9600)
    assert port.read(100)[0] == CONNECT
    assert port.wait(1.0)
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


def test_a_wire_that_is_none_and_one_that_has_gone_are_refused(talking: tuple[Served, Control]) -> None:
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


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_binary_status_on_a_terminal() -> None:
    for served, control in table_bench(AaaaTable):
        port = port_of(served, control, "pty")
        assert port.wait(control.request("now") + 1.0)
        data = port.read(100)[0]
        assert (data[:2], len(data) % 23) == (b"\xaa\xaa", 0)
        port.disconnect()
