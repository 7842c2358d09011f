"""Faults on the wires of a served instrument, and the reset of a bench."""

from __future__ import annotations

import sys
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Literal

import pytest
import serial
from simrack.faults import Fault, FaultScript
from simrack.serve import MAX_SPEED, BenchServer, Control, ControlError, ServedBench, ServedClock, ServerSettings

from simrack_tests.ports import eventually
from simrack_tests.serve.lamp import ALL, IDENTITY, Lamp, Served, serving
from simrack_tests.serve.test_hislip import DATA_END, sessions
from simrack_tests.serve.test_pty import device
from simrack_tests.serve.test_raw import Wire, wires
from simrack_tests.serve.test_vxi11 import callers

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def lamp(
    speed: float = 1.0, faults: tuple[Fault, ...] = (), rs232: Literal["ideal", "real"] = "ideal"
) -> Iterator[tuple[Served, Control]]:
    """Serve a lamp that can be built anew."""
    clock = ServedClock(speed)
    settings = ServerSettings(offers={"lamp": ALL}, faults=FaultScript(faults), rs232=rs232)
    with serving({"lamp": Lamp(clock)}, clock, settings) as served:
        served.server.bench = rebuilt(served.server, clock)
        served.server._first = (7, speed)
        with Control(served.server.control.port) as control:
            yield served, control


def rebuilt(server: BenchServer, clock: ServedClock) -> ServedBench:
    def rebuild(seed: int | None) -> ServedBench:
        world: Any = None
        return ServedBench(world, {"lamp": Lamp(clock)}, {"lamp": "lamp"}, seed, rebuild)

    bench = server.bench
    return ServedBench(bench.world, bench.devices, bench.models, 7, rebuild)


@pytest.fixture
def both() -> Iterator[tuple[Served, Control]]:
    with lamp() as started:
        yield started


# --- answers ---------------------------------------------------------------------------------------------------


def test_as_many_answers_are_lost_as_are_said(both: tuple[Served, Control]) -> None:
    served, control = both
    with wires(served) as (wire,):
        control.request("fault", instrument="lamp", kind="silent", count=2)
        wire.send(b"*IDN?\n*IDN?\nLEV?\n")
        assert wire.line() == b"+0.00000000E+00\n"
    assert control.request("status")["instruments"]["lamp"]["faults"] == []


def test_an_answer_read_in_pieces_counts_once(both: tuple[Served, Control]) -> None:
    served, control = both
    with callers(served.port("vxi11")) as (caller,):
        link = caller.link()[1]
        control.request("fault", instrument="lamp", kind="garbled", count=1)
        caller.write(link, b"*IDN?")
        pieces = b"".join(caller.read(link, 5)[2] for _ in range(4))
        assert len(pieces) == len(IDENTITY)
        caller.write(link, b"*IDN?")
        assert caller.read(link)[2] == IDENTITY


def test_only_what_spoils_answers_can_be_counted(both: tuple[Served, Control]) -> None:
    for kind, count in (("disconnect", 1), ("silent", 0)):
        with pytest.raises(ControlError, match="expected a number of damaged answers"):
            both[1].request("fault", instrument="lamp", kind=kind, count=count)


# --- connections -----------------------------------------------------------------------------------------------


def test_half_open_connections_hang_and_new_ones_work(both: tuple[Served, Control]) -> None:
    served, control = both
    with wires(served) as (raw,), callers(served.port("vxi11")) as (caller,), sessions(served) as (session,):
        session.open()
        link = caller.link(lock=True)[1]
        assert raw.ask(b"*IDN?\n") == IDENTITY
        control.request("fault", instrument="lamp", kind="half_open")
        raw.send(b"LEV 9\n*IDN?\n")
        caller.post(11, b"")
        session.post(session.sync, DATA_END, 0, 2, b"LEV 9;*IDN?")
        for dead in (raw.socket, caller.socket, session.sync, session.later):
            dead.settimeout(0.03)
            with pytest.raises(TimeoutError):
                dead.recv(1)
        with wires(served) as (new,), callers(served.port("vxi11")) as (other,):
            assert new.ask(b"LEV?\n") == b"+0.00000000E+00\n"
            again = other.link()[1]
            assert other.write(again, b"*IDN?") == (0, 5)  # the lock went with its connection
            assert other.read(again)[2] == IDENTITY
            control.request("clear_faults")
            assert new.ask(b"*IDN?\n") == IDENTITY
        raw.socket.settimeout(5.0)
        with pytest.raises(ConnectionResetError):
            raw.socket.recv(1)
        assert link


def test_half_open_connections_end_with_the_server() -> None:
    with lamp() as (served, control):
        wire = Wire(served.port("tcp"))
        assert wire.ask(b"*IDN?\n") == IDENTITY
        control.request("fault", instrument="lamp", kind="half_open")
    assert wire.line() == b""
    wire.close()


def test_switched_off_instrument_restarts_with_power_on_state(both: tuple[Served, Control]) -> None:
    served, control = both
    with wires(served) as (wire,):
        wire.ask(b"*CLS;*SRE 4;*ESE 60;LEV 5;LEV?;NONSENSE\n")
        control.request("fault", instrument="lamp", kind="power_cycle")
        assert wire.line() == b""
    with wires(served) as (wire,):
        assert wire.ask(b"LEV?;*SRE?;*ESE?;*ESR?;SYST:ERR?\n") == b'+0.00000000E+00;+0;+0;+128;+0,"No error"\n'
        wire.ask(b"*PSC 0;*SRE 4;*ESR?\n")
        control.request("fault", instrument="lamp", kind="power_cycle")
    with wires(served) as (wire,):
        assert wire.ask(b"*SRE?\n") == b"+4\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_nothing_is_taken_while_the_power_is_off(both: tuple[Served, Control]) -> None:
    served, control = both
    control.request("pause")
    control.request("fault", instrument="lamp", kind="power_cycle", duration_s=20.0)
    with wires(served) as (refused,), serial.Serial(device(served.resource("pty")), timeout=0.05) as line:
        assert refused.line() == b""
        line.write(b"LEV 3;LEV?\n")  # a cable stays where it is, but nobody is at its other end
        assert line.read(1) == b""
        control.request("advance", seconds=20.0)
        line.write(b"LEV?\n")
        assert line.read_until(b"\n") == b"+0.00000000E+00\r\n"
    with wires(served) as (wire,):
        assert wire.ask(b"LEV?\n") == b"+0.00000000E+00\n"


def test_somebody_has_exchanged_the_instrument(both: tuple[Served, Control]) -> None:
    served, control = both
    with wires(served) as (wire,):
        control.request("fault", instrument="lamp", kind="identity", identity="ACME,Candle,1,0")
        assert wire.ask(b"*IDN?\n") == b"ACME,Candle,1,0\n"
        control.request("clear_faults")
        assert wire.ask(b"*IDN?\n") == IDENTITY


# --- reset -----------------------------------------------------------------------------------------------------


def test_a_reset_bench_is_as_it_was_first(both: tuple[Served, Control]) -> None:
    served, control = both
    with wires(served) as (wire,), callers(served.port("vxi11")) as (caller,):
        link = caller.link(lock=True)[1]
        caller.write(link, b"LEV?")
        assert wire.ask(b"LEV 5;LEV?;NONSENSE\n") == b"+5.00000000E+00\n"
        wire.send(b"LEV ")
        control.request("advance", seconds=100.0)
        control.request("speed", value=50)
        control.request("pause")
        control.request("fault", instrument="lamp", kind="silent")
        control.request("fault", instrument="lamp", kind="silent", at_s=300.0)
        assert control.request("reset") == 0.0
        status = control.request("status")
        assert (status["speed"], status["paused"], status["seed"]) == (1.0, False, 7)
        assert status["instruments"]["lamp"]["faults"] == []
        assert wire.ask(b"LEV?;SYST:ERR?\n") == b'+0.00000000E+00;+0,"No error"\n'
        assert float(wire.ask(b"TIME?\n")) < 50.0
        caller.write(link, b"*IDN?")  # the link is there, and so is its lock
        assert caller.read(link)[2] == IDENTITY
        control.request("advance", seconds=400.0)
        assert wire.ask(b"*IDN?\n") == IDENTITY


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_nothing_is_left_on_a_serial_line_after_a_reset() -> None:
    with ExitStack() as stack:
        served, control = stack.enter_context(lamp(rs232="real"))
        line = stack.enter_context(serial.Serial(device(served.resource("pty")), 9600, stopbits=2, timeout=5.0))
        control.request("advance", seconds=100.0)
        line.write(b"LEV?;*IDN?\n")
        eventually(lambda: served.server.instruments["lamp"].awaited)
        control.request("reset")
        control.request("speed", value="max")
        line.reset_input_buffer()
        line.write(b"*IDN?\n")
        assert line.read_until(b"\n").strip() == IDENTITY.strip()
        assert control.request("now") < 50.0


def test_time_stands_at_0_until_somebody_comes(both: tuple[Served, Control]) -> None:
    _, control = both
    control.request("advance", seconds=100.0)
    control.request("reset")
    assert [control.request("now") for _ in range(5)] == [0.0] * 5


def test_the_faults_of_the_file_come_again() -> None:
    with lamp(MAX_SPEED, (Fault("lamp", "silent", at_s=5.0),)) as (_, control):
        for _ in range(2):
            control.request("advance", seconds=4.0)
            assert control.request("status")["instruments"]["lamp"]["faults"] == []
            control.request("advance", seconds=2.0)
            assert control.request("status")["instruments"]["lamp"]["faults"] == ["silent"]
            control.request("reset")


def test_another_seed_is_told(both: tuple[Served, Control]) -> None:
    _, control = both
    control.request("reset", seed=11)
    assert control.request("status")["seed"] == 11
    for seed in (-1, "x", 1.5):
        with pytest.raises(ControlError, match="a seed is a whole number"):
            control.request("reset", seed=seed)


def test_who_does_not_lead_does_not_reset(both: tuple[Served, Control]) -> None:
    served, control = both
    with Control(served.server.control.port) as leader:
        leader.request("lead")
        with pytest.raises(ControlError, match="leads the clock"):
            control.request("reset")
        leader.request("sleep_until", instant_s=9.0)
        assert leader.request("reset") == 0.0
        leader.request("sleep_until", instant_s=1.0)
        assert control.request("now") == 1.0


def test_a_bench_that_cannot_be_built_anew_says_so() -> None:
    clock = ServedClock()
    with (
        serving({"lamp": Lamp(clock)}, clock) as served,
        Control(served.server.control.port) as control,
        pytest.raises(ControlError, match="cannot be reset"),
    ):
        control.request("reset")
