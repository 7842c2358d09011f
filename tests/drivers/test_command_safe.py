"""The safe words go out first, blind and on whatever is left of the wire, to every instrument in every language."""

from __future__ import annotations

import os
import select
import socket
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.ports import BUSY_S, PLENTY_S, eventually

from tests.drivers.openings import NO_ERROR, OFF_BLIND, opening
from tests.drivers.servers import answering, lines, nothing_special, serving
from vcfbench.clock import Deadline, VirtualClock, WallClock
from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.drivers.e3631a import E3631A
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.session import Session, visa_resource
from vcfbench.errors import ConnectFailed, LinkLost
from vcfbench.testing import Exchange, ScriptedWire, expected_exchange, over_visa

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.drivers.scpi_instrument import ScpiInstrument

CLOCK = WallClock()
SUPPLY, GENERATOR = "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0", "Agilent Technologies,33220A,MY44008868,2.00-2.00-22-2"
DRIVING = pytest.mark.parametrize(("driver", "identity"), [(E3631A, SUPPLY), (Agilent33220A, GENERATOR)])


def opened(where: str) -> Session:
    return Session.opened(visa_resource(where, "@py"), name="power", resource=where, clock=CLOCK, timeout_s=PLENTY_S)


def session_on(wire: ScriptedWire, clock: VirtualClock) -> Session:
    return Session(wire, name="power", resource="SCRIPT", clock=clock, timeout_s=1.0)


@DRIVING
def test_it_is_told_to_switch_off_without_being_asked_anything(driver: type[ScpiInstrument], identity: str) -> None:
    with expected_exchange(over_visa(driver), [*opening(identity), OFF_BLIND]) as instrument:
        outcome = instrument.command_safe()
        assert str(outcome) == "told to switch off, not proved; its state was never read back"
        assert not instrument.session.dirty


@DRIVING
def test_what_was_last_read_back_is_told_with_its_age(driver: type[ScpiInstrument], identity: str) -> None:
    exchanges: list[Exchange] = [("OUTP?", "1"), OFF_BLIND]
    with expected_exchange(over_visa(driver), [*opening(identity), *exchanges]) as instrument:
        asked = getattr(instrument, "outputs_enabled", None) or instrument.output_enabled  # type: ignore[attr-defined]
        assert asked()
        instrument.clock.sleep_until(3.0)
        outcome = instrument.command_safe()
        assert (outcome.sent, outcome.last_read, outcome.age_s) == (
            True,
            f"output{'s' if driver is E3631A else ''} on",
            3.0,
        )
        assert str(outcome).endswith("on 3 s ago")


def test_the_words_wait_for_no_other_exchange() -> None:
    """A thread that hangs in one holds the session."""
    with expected_exchange(over_visa(E3631A), [*opening(SUPPLY), OFF_BLIND]) as supply:
        holding, over = threading.Event(), threading.Event()

        def hang() -> None:
            with supply.session.exclusive():
                holding.set()
                over.wait(10.0)

        thread = threading.Thread(target=hang)
        thread.start()
        holding.wait(10.0)
        try:
            assert supply.command_safe().sent
        finally:
            over.set()
            thread.join()


def test_supply_in_local_is_told_again_on_rs232() -> None:
    blind: Exchange = (b"\nOUTP OFF\nSYST:REM\nOUTP OFF\n", None)
    exchanges: list[Exchange] = [("SYST:REM", None), *opening(SUPPLY), blind]
    with expected_exchange(over_visa(E3631A), exchanges, interface="asrl") as supply:
        assert supply.command_safe().sent


def test_one_that_drives_nothing_is_told_nothing() -> None:
    with expected_exchange(over_visa(Hp34401A), opening("HEWLETT-PACKARD,34401A,0,10-5-2")) as meter:
        outcome = meter.command_safe()
    assert (outcome.words, outcome.sent) == ("", True)


def test_wire_that_raises_anything_is_skipped_without_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = VirtualClock()
    wire = ScriptedWire(opening(SUPPLY), clock=clock)
    supply = E3631A(session_on(wire, clock))

    def broken(data: bytes, deadline: Deadline) -> None:
        raise ZeroDivisionError(data, deadline)

    monkeypatch.setattr(wire, "send", broken)
    outcome = supply.command_safe()
    assert not outcome.sent
    assert str(outcome) == "could not be told to switch off; its state was never read back"


def test_a_wire_that_hangs_costs_some_tenths_of_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = VirtualClock()
    wire, over = ScriptedWire(opening(SUPPLY), clock=clock), threading.Event()
    supply = E3631A(session_on(wire, clock))

    def hang(data: bytes, deadline: Deadline) -> None:
        del data, deadline
        over.wait(PLENTY_S)

    monkeypatch.setattr(wire, "send", hang)
    begin_s = CLOCK.now()
    try:
        assert not supply.command_safe().sent
        assert CLOCK.now() - begin_s < BUSY_S
    finally:
        over.set()


def test_failed_proof_sends_safe_words_once_more() -> None:
    """Nothing is answered any more; the supply still hears."""
    clock = VirtualClock()

    class Dumb(ScriptedWire):
        def __init__(self) -> None:
            super().__init__([], clock=clock)
            self.sent: list[bytes] = []

        def send(self, data: bytes, deadline: Deadline) -> None:
            del deadline
            self.sent.append(data)

    dumb = Dumb()
    first = ScriptedWire([*opening(SUPPLY), ("OUTP?", "1"), OFF_BLIND, ("*IDN?", None)], clock=clock)
    session = Session(
        first, name="power", resource="SCRIPT", clock=clock, timeout_s=1.0, reconnect=lambda _deadline: dumb
    )
    supply = E3631A(session)
    supply.outputs_enabled()
    session.dirty = True
    report = supply.make_safe(Deadline.after(clock, 20.0))
    assert dumb.sent[0] == dumb.sent[-1] == OFF_BLIND[0]
    assert b"*IDN?\n" in dumb.sent[1:]
    assert not report.safe
    assert report.unproved is not None
    assert (report.unproved.sent, report.unproved.last_read) == (True, "outputs on")
    first.require_done()


# Resynchronising


@pytest.mark.parametrize("identity", [SUPPLY, SUPPLY.replace("1.0", "1.1")])
def test_instrument_that_answers_twice_is_resynchronised_and_made_safe(identity: str) -> None:
    """Reading the error queue amid resynchronising began to resynchronise again, without end."""
    off = threading.Event()
    answers = {"*IDN?": identity, "*OPC?": "1", "SYST:ERR?": '+0,"No error"', "OUTP?": "0"}

    def twice(connection: socket.socket) -> None:
        for line in lines(connection):
            if line == "OUTP OFF":
                off.set()
            elif line.endswith("?") or "MEAS" in line:
                connection.sendall((answers.get(line, "+0.00000000E+00").encode() + b"\n") * 2)

    with serving(twice) as where:
        session = opened(where)
        supply = E3631A(session)
        report = supply.make_safe(Deadline.after(CLOCK, PLENTY_S))
        session.close()
    assert off.is_set()
    assert report.safe, report.detail


# Connections that are gone


def test_a_new_connection_begins_with_the_safe_words() -> None:
    heard: list[str] = []

    def once(connection: socket.socket, line: str) -> bool:
        if line == "OUTP?":
            connection.shutdown(socket.SHUT_RDWR)
        return line == "OUTP?"

    def back(connection: socket.socket) -> None:
        for line in lines(connection):
            heard.append(line)
            answer = {"*IDN?": SUPPLY, "*OPC?": "1", "SYST:ERR?": NO_ERROR[1], "OUTP?": "0"}.get(line, "+0.0")
            if "?" in line:
                connection.sendall(f"{answer}\n".encode())

    def first(connection: socket.socket) -> None:
        answering(lambda c, line: identified(c, line) or once(c, line))(connection)

    def identified(connection: socket.socket, line: str) -> bool:
        if line == "*IDN?":
            connection.sendall(f"{SUPPLY}\n".encode())
        return line == "*IDN?"

    with serving(first, back) as where:
        supply = E3631A(opened(where))
        with pytest.raises(LinkLost):
            supply.outputs_enabled()
        report = supply.make_safe(Deadline.after(CLOCK, PLENTY_S))
        supply.close()
    assert heard[:2] == ["", "OUTP OFF"]
    assert report.safe, report.detail


@pytest.mark.usefixtures("unhurried")
def test_a_peer_that_has_gone_unnoticed_is_connected_to_anew() -> None:
    """The first thing that is sent to a closed peer seems to be taken."""
    heard: list[str] = []

    def leaving(connection: socket.socket) -> None:
        for line in lines(connection):
            if line == "*IDN?":
                connection.sendall(f"{SUPPLY}\n".encode())
            if line == "*CLS":
                connection.shutdown(socket.SHUT_RDWR)
                return

    def back(connection: socket.socket) -> None:
        heard.extend(lines(connection))

    with serving(leaving, back) as where:
        supply = E3631A(opened(where))
        beneath: socket.socket = supply.session._wire._socket  # type: ignore[attr-defined]
        assert select.select([beneath], [], [], PLENTY_S)[0]  # the end has come
        assert supply.command_safe().sent
        supply.close()
        eventually(lambda: "OUTP OFF" in heard)
    assert heard[:2] == ["", "OUTP OFF"]


def cut_off_supply(clock: VirtualClock, reconnect: Callable[[Deadline], ScriptedWire]) -> E3631A:
    """Return a supply whose cable is off; `reconnect` plugs it in again."""
    wire = ScriptedWire(opening(SUPPLY), clock=clock)
    session = Session(wire, name="power", resource="SCRIPT", clock=clock, timeout_s=1.0, reconnect=reconnect)
    supply = E3631A(session)
    session.locate(LinkLost("the cable is off"), None, session.deadline())
    return supply


def test_reconnection_after_a_while_is_waited_for() -> None:
    clock = VirtualClock()
    proof = [("OUTP OFF", None), NO_ERROR, ("OUTP?", "0"), *((f"MEAS:VOLT? {n}", "0") for n in ("P6V", "P25V", "N25V"))]
    back = ScriptedWire([OFF_BLIND, ("*IDN?", SUPPLY), ("*OPC?", "1"), NO_ERROR, *proof], clock=clock)
    tried: list[int] = []

    def reconnect(deadline: Deadline) -> ScriptedWire:
        del deadline
        tried.append(1)
        if len(tried) < 5:
            raise ConnectFailed("nobody answers there")
        return back

    supply = cut_off_supply(clock, reconnect)
    report = supply.make_safe(Deadline.after(clock, 20.0))
    assert report.safe, report.detail
    back.require_done()


def test_reconnecting_thread_sends_nothing_after_close() -> None:
    """The next run may have the instrument."""
    clock, trying, go_on = VirtualClock(), threading.Event(), threading.Event()
    late = ScriptedWire([], clock=clock)

    def reconnect(deadline: Deadline) -> ScriptedWire:
        del deadline
        trying.set()
        assert go_on.wait(PLENTY_S)
        return late

    supply = cut_off_supply(clock, reconnect)
    assert not supply.command_safe().sent
    assert trying.is_set()
    supply.close()
    go_on.set()
    eventually(lambda: late.closed)
    late.require_done()
    assert not supply.command_safe().sent


def test_a_peer_that_does_not_read_holds_nobody_up() -> None:
    done = threading.Event()

    def deaf(connection: socket.socket, line: str) -> bool:
        if line == "*IDN?":
            connection.sendall(f"{SUPPLY}\n".encode())
        if line == "*CLS":
            done.wait(PLENTY_S)
        return True

    with serving(answering(deaf)) as where:
        supply = E3631A(opened(where))
        filling: socket.socket = supply.session._wire._socket  # type: ignore[attr-defined]
        filling.settimeout(0.2)
        with pytest.raises(TimeoutError):
            filling.sendall(b"x" * 50_000_000)
        begin_s = CLOCK.now()
        outcome = supply.command_safe()
        took_s = CLOCK.now() - begin_s
        done.set()
        supply.close()
    assert not outcome.sent
    assert took_s < BUSY_S


@pytest.mark.usefixtures("unhurried")
def test_the_words_go_to_nothing_special() -> None:
    """A whole instrument hears them amid its ordinary exchanges, and those go on."""
    with serving(answering(nothing_special)) as where:
        session = opened(where)
        session.identify()
        session.declare_safe("OUTP OFF")
        assert session.command_safe()
        assert session.query("A?") == "A"
        session.close()


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are POSIX'")
def test_second_serial_answer_is_not_taken_for_next() -> None:
    """VISA can tell what waits on a serial line; also when the other end of it has gone."""
    import pty  # noqa: PLC0415 - POSIX has it
    import tty  # noqa: PLC0415

    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    answers = {"*IDN?": SUPPLY, "*OPC?": "1", "SYST:ERR?": '+0,"No error"'}

    def twice() -> None:
        received = b""
        with suppress(OSError):
            while data := os.read(ours, 4096):
                *whole, received = (received + data).split(b"\n")
                for line in (each.decode().lstrip("\x03") for each in whole):
                    if line.endswith("?"):
                        os.write(ours, (answers.get(line, line.removesuffix("?")) + "\r\n").encode() * 2)

    thread = threading.Thread(target=twice, daemon=True)
    thread.start()
    session = opened(f"ASRL{os.ttyname(theirs)}::INSTR")
    session.identify()
    wire: Any = session._wire
    for question in ("A", "B", "C"):
        eventually(lambda: session._received or wire._waiting())  # the second answer lies there
        assert session.query(f"{question}?") == question
    session.close()
    os.close(theirs)
    os.close(ours)
