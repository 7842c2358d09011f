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

from tests.sim.instruments.messages import UNITS, answers, errors, text, wrong_messages
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
        self.lines = connection.makefile("rb")

    def send(self, message: str) -> None:
        self.connection.sendall(message.encode() + b"\n")

    def ask(self, message: str) -> str:
        self.send(message)
        return self.lines.readline().decode().rstrip("\r\n")

    def error(self) -> int:
        return int(self.ask("SYST:ERR?").partition(",")[0])


@contextmanager
def wire_to(lab: ServedLab, role: str) -> Iterator[Wire]:
    """Connect to an instrument in its *RST state, with nothing in its queue."""
    port = int(lab.resource(role).split("::")[-2])
    with socket.create_connection(("127.0.0.1", port), timeout=30.0) as connection:
        wire = Wire(connection)
        assert wire.ask("*RST;*CLS;*OPC?") == "1"
        yield wire


_BENCH = partial(simulated, parameters="ideal", errors="none")


@pytest.fixture(scope="module")
def lab() -> Iterator[ServedLab]:
    with serve_simulated(_BENCH()) as served:
        yield served


@pytest.fixture(scope="module")
def slow_lab() -> Iterator[ServedLab]:
    with serve_simulated(_BENCH(), speed=1.0) as served:
        yield served


@pytest.mark.parametrize("speed", ["lab", "slow_lab"])
@pytest.mark.parametrize(("message", "answer"), COMPOUNDS)
def test_a_measurement_is_answered_in_its_place(
    speed: str, message: str, answer: str, request: pytest.FixtureRequest
) -> None:
    with wire_to(request.getfixturevalue(speed), "multimeter") as wire:
        assert re.fullmatch(answer, wire.ask(message))
        assert wire.error() == 0


@pytest.mark.parametrize("role", UNITS)
@settings(max_examples=25)
@given(data=st.data())
def test_any_message_is_answered_in_order_up_to_its_error(role: str, lab: ServedLab, data: st.DataObject) -> None:
    units = data.draw(wrong_messages(role))
    with wire_to(lab, role) as wire:
        wire.send(text(units))
        if (expected := answers(units)) is not None:
            assert re.fullmatch(expected, wire.lines.readline().decode().rstrip("\r\n"))
        assert [wire.error() for _ in [*errors(units), 0]] == [*errors(units), 0]
