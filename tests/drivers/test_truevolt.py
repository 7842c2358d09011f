"""The drivers of 34461A and 34465A against the Truevolt guide; what they share with the 34401A is tested there."""

from __future__ import annotations

import pytest

from tests.drivers.openings import NO_ERROR, opening, taken_over
from vcfbench.clock import Deadline
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.truevolt import Truevolt
from vcfbench.errors import InstrumentError, LimitError, WrongInstrument
from vcfbench.models import driver_of, find_model
from vcfbench.testing import Exchange, expected_exchange, over_visa

FIRMWARE = "A.02.17-02.40-02.17-00.52-03-01"
OPENING_34461A = opening(f"Keysight Technologies,34461A,MY53201234,{FIRMWARE}")
OPENING_34465A = opening(f"Keysight Technologies,34465A,MY54501234,{FIRMWARE}")
Keysight34461A, Keysight34465A = (driver_of(row) for row in map(find_model, ("34461A", "34465A")) if row is not None)
OPEN_34461A = over_visa(Keysight34461A, name="multimeter")
OPEN_34465A = over_visa(Keysight34465A, name="multimeter")

TAKEN = taken_over(Truevolt.left, header="VOLT:DC", mains="50")


def configured(nplc: float) -> list[Exchange]:
    return [
        ("ABOR", None),
        *TAKEN,
        ("CONF:VOLT:DC 10", None),
        (f"VOLT:DC:NPLC {nplc:g}", None),
        ("VOLT:DC:ZERO:AUTO ON", None),
        ("VOLT:DC:IMP:AUTO ON", None),
        ("TRIG:SOUR IMM", None),
        NO_ERROR,
        ("VOLT:DC:RANG?", "+1.00000000E+01"),
        ("VOLT:DC:NPLC?", f"{nplc:+.8E}"),
    ]


def test_autozero_of_dc_voltage_is_set_and_readings_fetched_twice() -> None:
    reading: list[Exchange] = [("INIT", None), ("FETC?", "-1.67463210E-01"), ("FETC?", "-1.67463210E-01")]
    with expected_exchange(OPEN_34461A, [*OPENING_34461A, *configured(10.0), *reading]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        assert meter.read_voltage_v() == -0.16746321


@pytest.mark.parametrize("nplc", [0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0])
def test_every_integration_time_of_a_34465a(nplc: float) -> None:
    with expected_exchange(OPEN_34465A, [*OPENING_34465A, *configured(nplc)]) as meter:
        meter.configure_dc_voltage(10.0, nplc)


def test_integration_time_of_a_missing_option_is_an_error() -> None:
    refused: list[Exchange] = [*configured(0.006)[:-3], ("SYST:ERR?", '-222,"Data out of range"'), NO_ERROR]
    with (
        expected_exchange(OPEN_34465A, [*OPENING_34465A, *refused]) as meter,
        pytest.raises(InstrumentError, match="Data out of range"),
    ):
        meter.configure_dc_voltage(10.0, 0.006)


@pytest.mark.parametrize("nplc", [0.06, 0.006, 2.0])
def test_integration_times_unknown_to_34461a_are_not_sent(nplc: float) -> None:
    with expected_exchange(OPEN_34461A, OPENING_34461A) as meter, pytest.raises(LimitError, match="is not one of"):
        meter.configure_dc_voltage(10.0, nplc)


def test_an_older_34461a_says_agilent() -> None:
    with expected_exchange(OPEN_34461A, opening(f"Agilent Technologies,34461A,MY53200001,{FIRMWARE}")):
        pass


@pytest.mark.parametrize("driver", [Keysight34461A, Hp34401A])
def test_another_model_is_refused(driver: type[Hp34401A]) -> None:
    with pytest.raises(WrongInstrument), expected_exchange(over_visa(driver), OPENING_34465A[:1]):
        pass


def test_safe_ends_what_a_raw_socket_cannot_clear() -> None:
    with expected_exchange(OPEN_34465A, [*OPENING_34465A, ("ABOR", None), ("*OPC?", "1")]) as meter:
        assert meter.make_safe(Deadline.after(meter.clock, 3.0)).safe
