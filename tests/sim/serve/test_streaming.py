"""A READ? of more readings than the meter holds, over every wire: they go out while others are taken."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from simrack.serve import MAX_SPEED, Control, ServedClock, ServerSettings
from simrack.serve.raw import ByteStream
from simrack_tests.ports import eventually
from simrack_tests.serve.lamp import ALL, Served, serving

from tests.cells import few
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.served import build_served

if TYPE_CHECKING:
    from collections.abc import Iterator

NO_PTYS = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
WIRES = ["tcp", pytest.param("pty", marks=NO_PTYS), "vxi11", "hislip"]
FAST = "CONF:VOLT:DC 10;:VOLT:NPLC 0.02;:ZERO:AUTO OFF;:TRIG:DEL 0"


@contextmanager
def served_meter(speed: float) -> Iterator[Served]:
    clock = ServedClock(speed)
    bench = build_served(load_bench(), 1, clock)
    devices = {"meter": bench.devices["multimeter"]}
    with serving(devices, clock, ServerSettings(offers={"meter": ALL}), bench.world) as served:
        yield served


@contextmanager
def talking(served: Served, wire: str) -> Iterator[Any]:
    manager = pyvisa.ResourceManager("@py")
    resource: Any = manager.open_resource(
        served.resource(wire, "meter"), read_termination="\n", write_termination="\n", timeout=10_000
    )
    try:
        if wire == "pty":
            resource.write("SYST:REM")
        resource.write(FAST)
        yield resource
    finally:
        resource.close()
        manager.close()


@pytest.mark.parametrize("wire", few(WIRES, "pty"))
def test_a_long_read_after_another_question(wire: str) -> None:
    with served_meter(MAX_SPEED) as served, talking(served, wire) as meter:
        counted, _, readings = meter.query("SAMP:COUN 600;:SAMP:COUN?;:READ?").strip().partition(";")
        assert counted == "+600"
        values = [float(text) for text in readings.split(",")]
        assert len(values) == 600
        assert all(abs(volts) < 20.0 for volts in values)
        assert meter.query("SYST:ERR?").startswith("+0")


@pytest.mark.parametrize("wire", ["vxi11", "hislip"])
def test_message_available_is_set_during_endless_read(wire: str) -> None:
    with (
        served_meter(MAX_SPEED) as served,
        talking(served, wire) as meter,
        Control(served.server.control.port) as bench,
    ):
        bench.request("lead")
        meter.write("TRIG:COUN INF;:READ?")
        assert wire == "hislip" or meter.stb & 16 == 0  # HiSLIP's answers are awaited as they come: time jumps there
        bench.request("advance", seconds=0.1)
        assert meter.stb & 16
        if wire == "hislip":
            return  # PyVISA-py takes the answer that is on its way for the acknowledgement of its device clear
        meter.clear()
        assert meter.stb & 16 == 0
        assert meter.query("TRIG:COUN?").strip() == "+9.90000000E+37"


@pytest.mark.exhaustive
@NO_PTYS
def test_an_endless_read_that_nobody_takes_does_not_pile_up() -> None:
    """The line fills up, then the meter waits with its own memory full; what is taken then is whole."""
    with served_meter(MAX_SPEED) as served, talking(served, "pty") as meter:
        meter.write("TRIG:COUN INF;:READ?")
        clients = [each for each in served.server.instruments["meter"].clients if isinstance(each, ByteStream)]
        eventually(lambda: any(each.blocked for each in clients))
        assert max(each._outbox.size for each in clients) < 1 << 14
        taken = meter.read_bytes(20_000)
        assert {len(text) for text in taken.split(b",")[:-1]} == {15}
