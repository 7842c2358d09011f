"""What all SCPI drivers do alike: how they take an instrument over, refuse another, make it safe and leave it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tests.drivers.openings import NO_ERROR, opening
from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.scpi_instrument import decimal, require_within, safely
from vcfbench.drivers.session import Session
from vcfbench.errors import InstrumentError, LimitError, WrongInstrument
from vcfbench.testing import Exchange, ScriptedWire, expected_exchange, over_visa

if TYPE_CHECKING:
    from vcfbench.drivers.wire import Interface

IDENTITY = "HEWLETT-PACKARD,34401A,0,10-5-2"
OPENING = opening(IDENTITY)
OPEN = over_visa(Hp34401A, name="multimeter")


class WatchedWire(ScriptedWire):
    """A scripted wire that notes the order of what is done with it."""

    def __init__(self, exchanges: list[Exchange], clock: VirtualClock, interface: Interface = "gpib") -> None:
        super().__init__(exchanges, clock=clock, interface=interface)
        self.done: list[str] = []

    def send(self, data: bytes, deadline: Deadline) -> None:
        self.done.append(data.decode().strip())
        super().send(data, deadline)

    def clear(self, deadline: Deadline) -> None:
        self.done.append("device clear")
        super().clear(deadline)


def session_on(wire: ScriptedWire, clock: VirtualClock) -> Session:
    return Session(wire, name="multimeter", resource="SCRIPT", clock=clock, timeout_s=1.0)


def test_device_clear_precedes_first_message() -> None:
    """An earlier program may have left a reading of minutes, or half an answer (34401A p. 116)."""
    clock = VirtualClock()
    wire = WatchedWire([("SYST:REM", None), *OPENING], clock, "asrl")
    Hp34401A(session_on(wire, clock))
    assert wire.done == ["device clear", "SYST:REM", "*IDN?", "*CLS"]
    wire.require_done()


@pytest.mark.parametrize("maker", ["HEWLETT-PACKARD", "Agilent Technologies", "Keysight Technologies", "AGILENT"])
def test_every_maker_that_sold_it_is_accepted(maker: str) -> None:
    identity = f"{maker},34401A,0,10-5-2"
    with expected_exchange(OPEN, [*opening(identity), ("*IDN?", identity)]) as meter:
        assert meter.identify().maker == maker


@pytest.mark.parametrize(
    ("identity", "wanted"),
    [
        ("HEWLETT-PACKARD,34410A,0,1", "expected 34401A, found HEWLETT-PACKARD 34410A, serial number 0"),
        ("RIGOL,34401A,7,1", "expected 34401A, found RIGOL 34401A, serial number 7"),
    ],
)
def test_another_instrument_is_refused_and_given_back(identity: str, wanted: str) -> None:
    clock = VirtualClock()
    wire = ScriptedWire([("*IDN?", identity)], clock=clock)
    with pytest.raises(WrongInstrument, match=wanted) as caught:
        Hp34401A(session_on(wire, clock))
    assert wire.closed
    assert (caught.value.instrument, caught.value.resource) == ("multimeter", "SCRIPT")
    wire.require_done()


def test_another_specimen_is_refused_when_one_is_asked_for() -> None:
    clock = VirtualClock()
    wire = ScriptedWire([("*IDN?", "HEWLETT-PACKARD,34401A,MY1,10-5-2")], clock=clock)
    wanted = "expected 34401A with serial number MY2, found HEWLETT-PACKARD 34401A, serial number MY1"
    with pytest.raises(WrongInstrument, match=wanted):
        Hp34401A(session_on(wire, clock), serial_number="MY2")
    assert wire.closed


def test_error_queue_is_raised_on_request() -> None:
    exchanges: list[Exchange] = [NO_ERROR, ("SYST:ERR?", '+550,"Command not allowed in local"'), NO_ERROR]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as meter:
        meter.check_errors()
        with pytest.raises(InstrumentError, match="550"):
            meter.check_errors()


def test_closing_gives_the_connection_back() -> None:
    clock = VirtualClock()
    wire = ScriptedWire(OPENING, clock=clock)
    meter = Hp34401A(session_on(wire, clock))
    assert meter.session.resource == meter.resource == "SCRIPT"
    assert not wire.closed
    meter.close()
    assert wire.closed
    assert meter.session.closed


def test_expired_deadline_is_not_reported_safe() -> None:
    with expected_exchange(OPEN, OPENING) as meter:
        report = meter.make_safe(Deadline.after(meter.clock, 0.0))
    assert (report.instrument, report.resource, report.safe) == ("multimeter", "SCRIPT", False)
    assert report.detail == "there was no time left to make it safe"


def test_what_is_safe_says_who_and_where() -> None:
    with expected_exchange(OPEN, [*OPENING, ("*OPC?", "1")]) as meter:
        report = meter.make_safe(Deadline.after(meter.clock, 3.0))
    assert (report.instrument, report.resource, report.safe, report.detail) == ("multimeter", "SCRIPT", True, "idle")


def test_hanging_instrument_is_tried_three_times_in_equal_shares() -> None:
    """A third of the time, then half of the rest, then the rest."""
    clock = VirtualClock()
    begun_s: list[float] = []
    with expected_exchange(OPEN, OPENING) as meter:

        def hang(deadline: Deadline) -> str:
            begun_s.append(clock.now())
            clock.sleep_until(deadline.expires_s)
            raise InstrumentError("hangs")

        report = safely(meter, hang, Deadline.after(clock, 9.0))
    assert not report.safe
    assert "hangs" in report.detail
    assert begun_s == pytest.approx([0.0, 3.0, 6.0])
    assert clock.now() == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [(-0.0, "0"), (1.23456789012, "1.23456789"), (1e-7, "1e-07"), (20e6, "20000000"), (-5.0, "-5")],
)
def test_decimals_are_short_and_have_no_negative_zero(value: float, text: str) -> None:
    assert decimal(value) == text


@pytest.mark.parametrize(("value", "within"), [(1.0, True), (2.0, True), (0.999, False), (2.001, False)])
def test_limits_are_within_and_not_a_number_never_is(value: float, within: bool) -> None:  # noqa: FBT001
    with expected_exchange(OPEN, OPENING) as meter:
        if within:
            require_within(meter, "level", value, (1.0, 2.0), "V")
        for wrong in (math.nan, *([] if within else [value])):
            with pytest.raises(LimitError, match=r"level of .* V is outside 1 ... 2 V, nothing was sent") as caught:
                require_within(meter, "level", wrong, (1.0, 2.0), "V")
            assert (caught.value.instrument, caught.value.resource) == ("multimeter", "SCRIPT")
