"""Messages of many units over TCP: one line with the answers in order, however fast time goes."""

from __future__ import annotations

import re
import socket
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack_tests.cells import few
from simrack_tests.instruments.messages import UNITS, answers, errors, text, wrong_messages

from vcfbench.testing import ServedLab, serve_simulated, simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

NUMBER = r"[-+]\d\.\d{8}E[-+]\d\d"
QUICK = "MEAS:VOLT? 10,MAX"
COMPOUNDS = [
    (f"{QUICK};*OPC?", f"{NUMBER};1"),
    (f"{QUICK};:SYST:ERR?", rf'{NUMBER};\+0,"No error"'),
    (f"*OPC?;:{QUICK}", f"1;{NUMBER}"),
    (f"{QUICK};:MEAS:RES? 100,MAX", f"{NUMBER};{NUMBER}"),
    (f"VOLT:RANG 1;:{QUICK};:VOLT:RANG?", rf"{NUMBER};\+1\.00000000E\+01"),
    (f"{QUICK};:READ?", f"{NUMBER};{NUMBER}"),
]


class Wire:
    """A plain socket to one instrument."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection

    def send(self, message: str) -> None:
        self.connection.sendall(message.encode() + b"\n")

    def ask(self, message: str) -> str:
        self.send(message)
        return self.line()

    def line(self, timeout_s: float = 30.0) -> str:
        """Return the next line without its end."""
        self.connection.settimeout(timeout_s)
        data = b""
        while not data.endswith(b"\n"):
            part = self.connection.recv(1)
            assert part, "the server closed the connection"
            data += part
        return data.decode().rstrip("\r\n")

    def error(self) -> int:
        return int(self.ask("SYST:ERR?").partition(",")[0])


@contextmanager
def plain_wire_to(lab: ServedLab, role: str) -> Iterator[Wire]:
    """Connect to an instrument."""
    port = int(lab.resource(role).split("::")[-2])
    with socket.create_connection(("127.0.0.1", port)) as connection:
        yield Wire(connection)


@contextmanager
def wire_to(lab: ServedLab, role: str) -> Iterator[Wire]:
    """Connect to an instrument in its *RST state, with nothing in its queue."""
    with plain_wire_to(lab, role) as wire:
        assert wire.ask("*RST;*CLS;*OPC?") == "1"
        yield wire


CLEARS = ["\x03", "++clr\n", "++CLR\r\n"]
WAITING = [("multimeter", "TRIG:SOUR BUS;:INIT"), ("multimeter", "TRIG:SOUR EXT;:READ?"), ("power", "*TST?")]

_BENCH = partial(simulated, parameters="ideal", errors="none")


@pytest.fixture(scope="module")
def lab() -> Iterator[ServedLab]:
    with serve_simulated(_BENCH()) as served:
        yield served


@pytest.fixture(scope="module")
def slow_lab() -> Iterator[ServedLab]:
    with serve_simulated(_BENCH(), speed=1.0) as served:
        yield served


@pytest.mark.parametrize("speed", few(["lab", "slow_lab"], every=4))
@pytest.mark.parametrize(("message", "answer"), COMPOUNDS)
def test_a_measurement_is_answered_in_its_place(
    speed: str, message: str, answer: str, request: pytest.FixtureRequest
) -> None:
    with wire_to(request.getfixturevalue(speed), "multimeter") as wire:
        assert re.fullmatch(answer, wire.ask(message))
        assert wire.error() == 0


@pytest.mark.parametrize("role", UNITS)
@settings(max_examples=10)
@given(data=st.data())
def test_any_message_is_answered_in_order_up_to_its_error(role: str, lab: ServedLab, data: st.DataObject) -> None:
    units = data.draw(wrong_messages(role))
    with wire_to(lab, role) as wire:
        wire.send(text(units))
        if (expected := answers(units)) is not None:
            assert re.fullmatch(expected, wire.line())
        assert [wire.error() for _ in [*errors(units), 0]] == [*errors(units), 0]


@pytest.mark.parametrize("clear", few(CLEARS, every=4))
@pytest.mark.parametrize(("role", "message"), WAITING)
def test_device_clear_ends_busy_state_behind_converter(
    role: str, message: str, clear: str, slow_lab: ServedLab
) -> None:
    with wire_to(slow_lab, role) as wire:
        wire.send(message)
        wire.send("SYST:ERR?")
        with pytest.raises(TimeoutError):
            wire.line(0.1)
        wire.connection.sendall(clear.encode() + b"*OPC?;:SYST:ERR?\n")
        assert wire.line() == '1;+0,"No error"'


@pytest.mark.parametrize("clear", CLEARS)
def test_a_client_frees_the_meter_for_the_others(clear: str, slow_lab: ServedLab) -> None:
    with wire_to(slow_lab, "multimeter") as gone:
        gone.send("TRIG:SOUR BUS;:INIT")
    with plain_wire_to(slow_lab, "multimeter") as waiting, plain_wire_to(slow_lab, "multimeter") as other:
        waiting.send("TRIG:SOUR?")
        with pytest.raises(TimeoutError):
            waiting.line(0.1)
        other.connection.sendall(clear.encode())
        assert other.ask("TRIG:SOUR?") == "BUS"
        assert waiting.ask("TRIG:SOUR?") == "BUS"  # what waited in the input buffer is gone with it


def test_socket_with_device_clear_takes_every_byte(lab: ServedLab) -> None:
    with wire_to(lab, "rate_source") as wire:
        wire.connection.sendall(b"DATA:DAC VOLATILE, #216" + bytes([0, 3]) * 8 + b"\n")
        assert wire.error() == 0
        assert wire.ask("DATA:ATTR:POIN? VOLATILE") == "+8"
