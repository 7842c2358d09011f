"""What comes in place of an answer is named: by what came, with the instrument, its address and the command."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.clock import VirtualClock
from vcfbench.drivers.rate_table.dialect import TableSettings, spoken
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.registry import find_driver
from vcfbench.drivers.session import Session
from vcfbench.errors import BenchError, DeadlineExceeded

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import Deadline
    from vcfbench.drivers.wire import Interface

KNOWN = {
    "34401A": {"*IDN?": "HEWLETT-PACKARD,34401A,0,10-5-2", "SYST:ERR?": '+0,"No error"', "*OPC?": "1"},
    "E36312A": {"*IDN?": "Keysight Technologies,E36312A,MY1,1.0", "SYST:ERR?": '+0,"No error"', "*OPC?": "1"},
    "acl": {"*IDN?": "Acutronic R&D USA,Acutrol3000,0,A8800", ":Status:STB?": "0", ":Read:Rate? 1": "0.0"},
    "acl u32le2": {"*IDN?": "Acutronic R&D USA,Acutrol3000,0,A8800", ":Status:STB?": "0", ":Read:Rate? 1": "0.0"},
    "esp": {
        "VE?": "ESP301 Version 3.0.1 6/1/99",
        "1TV": "0.0",
        "1MO?": "1",
        "1SN?": "7",
        "TB?": "0, 1, NO ERROR DETECTED",
    },
}


class Chatting:
    """An instrument on a raw socket that answers within 5 ms, after a quirk; what it says by itself comes `after_s`."""

    interface: Interface = "socket"

    def __init__(
        self, clock: VirtualClock, model: str, quirk: Callable[[str, bytes], bytes], unasked: bytes, after_s: float
    ) -> None:
        self._clock, self._known, self._quirk = clock, KNOWN[model], quirk
        self._coming = [(clock.now() + after_s, unasked)] if unasked else []
        self._heard, self._counted = "", model.endswith("le2")

    def send(self, data: bytes, deadline: Deadline) -> None:
        del deadline
        *whole, self._heard = (self._heard + data.decode()).replace("\r", "\n").split("\n")
        for line in filter(None, whole):
            known = self._known.get(line)
            framed = b"" if known is None else f"{known}\r\n".encode()
            if self._counted and framed:
                framed = struct.pack("<II", 0, len(framed) - 2) + framed[:-2]
            said = self._quirk(line, framed)
            self._coming = sorted([*self._coming, (self._clock.now() + 0.005, said)], key=lambda each: each[0])

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        if not self._coming or self._coming[0][0] > deadline.expires_s:
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        self._clock.sleep_until(self._coming[0][0])
        return self._coming.pop(0)[1], False

    def pending(self) -> bytes:
        data = b""
        while self._coming and self._coming[0][0] <= self._clock.now():
            data += self._coming.pop(0)[1]
        return data

    def clear(self, deadline: Deadline) -> None:
        del deadline
        self.pending()

    def close(self) -> None: ...


def opened(model: str, quirk: Callable[[str, bytes], bytes], unasked: bytes = b"", after_s: float = 0.0) -> Any:
    clock = VirtualClock()
    wire = Chatting(clock, model, quirk, unasked, after_s)
    where: Any = {"name": "role", "resource": "socket://x:1", "clock": clock, "timeout_s": 2.0}
    if not model.startswith(("acl", "esp")):
        return find_driver(model).driver_class(Session(wire, **where))
    return RateTableDriver(TableLine(wire, **where), spoken(model[:3], TableSettings())[0], TableSettings())


def echo(line: str, healthy: bytes) -> bytes:
    return line.encode() + b"\r\n" + healthy


def prompt(_: str, healthy: bytes) -> bytes:
    return b"Model X> " + healthy


def telnet(_: str, healthy: bytes) -> bytes:
    return b"\xff\xfd\x03" + healthy if healthy else b""


def well(_: str, healthy: bytes) -> bytes:
    return healthy


def null(_: str, healthy: bytes) -> bytes:
    return healthy and healthy + b"\0"


@pytest.mark.parametrize("model", KNOWN)
@pytest.mark.parametrize(
    ("quirk", "words"),
    [
        (echo, "commands are echoed"),
        (prompt, "a prompt comes"),
        (telnet, "negotiates telnet (IAC)"),
        (null, "a NUL byte comes"),
    ],
)
def test_what_comes_with_every_answer_is_named(model: str, quirk: Callable[[str, bytes], bytes], words: str) -> None:
    with pytest.raises(BenchError) as caught:
        opened(model, quirk).check_errors()
    assert (caught.value.instrument, caught.value.resource) == ("role", "socket://x:1")
    assert caught.value.command
    assert words in str(caught.value)
    assert "baud" not in str(caught.value)


@pytest.mark.parametrize("model", KNOWN)
@pytest.mark.parametrize(
    "greeting",
    [b"\xff\xfd\x03\xff\xfb\x01\xff\xfb\x03", b"Welcome to Agilent's 34401A\r\n34401A> ", b"\r\n", b"a\r\nb\r\n"],
)
def test_a_greeting_is_no_answer_whenever_it_comes(model: str, greeting: bytes) -> None:
    for after_ms in (0, 1, 4, 5, 6, 9, 11, 16, 22, 31, 40, 99, 150):
        instrument = opened(model, well, greeting, after_ms / 1000.0)
        for _ in range(20):
            instrument.check_errors()
        assert instrument.identify().model.startswith(("34401A", "E36312A", "Acutrol3000", "ESP301")), after_ms
