"""Every driver makes its instrument safe over a connection that was lost: it connects anew, and proves it there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.drivers.openings import NO_ERROR, OFF_BLIND, opening
from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.drivers.dso7104b import Dso7104B
from vcfbench.drivers.e3631a import E3631A
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.session import Session
from vcfbench.errors import LinkLost
from vcfbench.models import driver_of, find_model
from vcfbench.testing import Exchange, ScriptedWire

if TYPE_CHECKING:
    from collections.abc import Callable

OUTPUTS, ZERO = ("P6V", "P25V", "N25V"), "+0.00000000E+00"
SAFE: list[tuple[Callable[..., Any], str, list[Exchange], list[Exchange], str]] = [
    (
        E3631A,
        "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0",
        [OFF_BLIND, OFF_BLIND],
        [
            ("OUTP OFF", None),
            NO_ERROR,
            ("OUTP?", "0"),
            *((f"MEAS:VOLT? {name}", ZERO) for name in ("P6V", "P25V", "N25V")),
        ],
        "outputs off, P6V +0 V, P25V +0 V, N25V +0 V at the terminals",
    ),
    (
        Agilent33220A,
        "Agilent Technologies,33220A,MY44008868,2.00-2.00-22-2",
        [OFF_BLIND, OFF_BLIND],
        [("OUTP OFF", None), NO_ERROR, ("OUTP?", "0")],
        "output relay open",
    ),
    (Hp34401A, "HEWLETT-PACKARD,34401A,0,10-5-2", [], [("*OPC?", "1")], "idle"),
    (
        driver_of(find_model("34465A")),
        "Keysight Technologies,34465A,MY54501234,A.02.17-02.40-02.17-00.52-03-01",
        [],
        [("ABOR", None), ("*OPC?", "1")],
        "idle",
    ),
    (
        Dso7104B,
        "AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003",
        [],
        [(":STOP", None), NO_ERROR, (":OPER:COND?", "+0")],
        "stopped",
    ),
]


@pytest.mark.parametrize(
    ("driver", "identity", "first", "safe", "words"), SAFE, ids=lambda value: getattr(value, "__name__", "")
)
def test_a_lost_connection_is_made_anew_to_make_it_safe(
    driver: Callable[..., Any], identity: str, first: list[Exchange], safe: list[Exchange], words: str
) -> None:
    clock = VirtualClock()
    again = ScriptedWire([*first[:1], ("*IDN?", identity), ("*OPC?", "1"), NO_ERROR, *safe], clock=clock)
    session = Session(
        ScriptedWire(opening(identity), clock=clock),
        name="device",
        resource="SCRIPT",
        clock=clock,
        timeout_s=1.0,
        reconnect=lambda _deadline: again,
    )
    instrument = driver(session)
    session.locate(LinkLost("the cable is off"), None, session.deadline())
    report = instrument.make_safe(Deadline.after(clock, 5.0))
    assert report.safe, report.detail
    assert report.detail == words
    again.require_done()
    assert again.clears >= 1


def test_the_meter_is_cleared_before_it_is_called_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading of minutes is aborted, not waited for."""
    clock = VirtualClock()
    wire = ScriptedWire([*opening("HEWLETT-PACKARD,34401A,0,10-5-2"), ("*OPC?", "1")], clock=clock)
    meter = Hp34401A(Session(wire, name="multimeter", resource="SCRIPT", clock=clock, timeout_s=1.0))
    done: list[str] = []
    clear, send = wire.clear, wire.send
    monkeypatch.setattr(wire, "clear", lambda deadline: (done.append("clear"), clear(deadline)))
    monkeypatch.setattr(wire, "send", lambda data, deadline: (done.append(data.decode().strip()), send(data, deadline)))
    assert meter.make_safe(Deadline.after(clock, 5.0)).safe
    assert done == ["clear", "*OPC?"]
