"""The drivers of the Keithley 2000 and DMM6500, after users' drivers of both."""

from __future__ import annotations

import pytest

from tests.drivers.openings import NO_ERROR, opening, taken_over
from vcfbench.clock import Deadline
from vcfbench.drivers.keithley import Keithley2000, KeithleyDMM6500
from vcfbench.errors import FramingError, LimitError, WrongInstrument
from vcfbench.testing import Exchange, expected_exchange, over_visa

IDENTITY_2000 = "KEITHLEY INSTRUMENTS INC.,MODEL 2000,1308393,A20  /A02"
IDENTITY_6500 = "KEITHLEY INSTRUMENTS,MODEL DMM6500,04592448,1.7.12b"
OPENING_2000 = opening(IDENTITY_2000)
OPENING_6500: list[Exchange] = [("*LANG?", "SCPI"), *opening(IDENTITY_6500)]
OPEN_2000 = over_visa(Keithley2000, name="multimeter")
OPEN_6500 = over_visa(KeithleyDMM6500, name="multimeter")
CONFIGURED_2000: list[Exchange] = [
    ("INIT:CONT OFF", None),
    ("ABOR", None),
    *taken_over(Keithley2000.left, header="VOLT", mains="50"),
    ("CONF:VOLT:DC", None),
    ("VOLT:RANG 10", None),
    ("VOLT:NPLC 10", None),
    ("VOLT:AVER:STAT OFF;:VOLT:REF:STAT OFF;:VOLT:DIG 7", None),
    ("SYST:AZER:STAT ON", None),
    ("TRIG:SOUR IMM;:TRIG:COUN 1;:SAMP:COUN 1", None),
    ("TRIG:DEL:AUTO ON", None),
    NO_ERROR,
    ("VOLT:RANG?", "10"),
    ("VOLT:NPLC?", "10.00"),
]
CONFIGURED_6500: list[Exchange] = [
    ("ABOR", None),
    *taken_over(KeithleyDMM6500.left, header="VOLT", mains="50"),
    ('FUNC "VOLT:DC"', None),
    ("VOLT:RANG 10", None),
    ("VOLT:NPLC 10", None),
    ("VOLT:AZER ON", None),
    ("COUN 1", None),
    NO_ERROR,
    ("VOLT:RANG?", "10"),
    ("VOLT:NPLC?", "10"),
]


def test_2000_is_stopped_and_averaging_switched_off_before_a_reading() -> None:
    value = "-1.67463210E-01"
    reading: list[Exchange] = [("INIT", None), ("*OPC?", "1"), ("FETC?", value), ("FETC?", value)]
    with expected_exchange(OPEN_2000, [*OPENING_2000, *CONFIGURED_2000, *reading]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        assert meter.read_voltage_v() == -0.16746321


def test_the_dmm6500_reads_into_its_buffer_and_answers_from_there() -> None:
    value = "-1.674632E-01"
    reading: list[Exchange] = [
        ('TRAC:TRIG "defbuffer1"', None),
        ("*OPC?", "1"),
        ("FETC?", value),
        ("FETC?", value),
    ]
    with expected_exchange(OPEN_6500, [*OPENING_6500, *CONFIGURED_6500, *reading]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        assert meter.read_voltage_v() == -0.1674632


def test_a_dmm6500_set_to_tsp_is_refused_with_words() -> None:
    words = "it is set to the command set TSP, not SCPI"
    with pytest.raises(WrongInstrument, match=words), expected_exchange(OPEN_6500, [("*LANG?", "TSP")]):
        pass


def test_readings_that_differ_when_they_are_fetched_again_are_refused() -> None:
    reading: list[Exchange] = [("INIT", None), ("*OPC?", "1"), ("FETC?", "1.1"), ("FETC?", "1.2")]
    with expected_exchange(OPEN_2000, [*OPENING_2000, *reading]) as meter, pytest.raises(FramingError):
        meter.read_voltage_v()


@pytest.mark.parametrize(("range_v", "nplc"), [(5.0, 10.0), (10.0, 0.02), (10.0, 100.0)])
def test_ranges_and_times_that_it_has_not_are_not_sent(range_v: float, nplc: float) -> None:
    with expected_exchange(OPEN_2000, OPENING_2000) as meter, pytest.raises(LimitError):
        meter.configure_dc_voltage(range_v, nplc)


def test_the_2000_samples_into_its_buffer() -> None:
    two = "+1.0E-01,-1.0E-01"
    exchanges: list[Exchange] = [
        ("SYST:AZER:STAT OFF", None),
        ("TRAC:CLE;:TRAC:POIN 2;:TRAC:FEED SENS;:TRAC:FEED:CONT NEXT", None),
        ("TRIG:COUN 2;:TRIG:DEL 0.8", None),
        NO_ERROR,
        ("INIT", None),
        ("*OPC?", "1"),
        *[("TRAC:DATA?", two)] * 2,
        ("TRAC:FEED:CONT NEV", None),
        ("TRIG:COUN 1;:TRIG:DEL:AUTO ON", None),
        ("SYST:AZER:STAT ON", None),
        NO_ERROR,
    ]
    with expected_exchange(OPEN_2000, [*OPENING_2000, *exchanges]) as meter:
        assert meter.start_sampling(2, 1.0) == pytest.approx(2.05)
        assert meter.sampled_voltages_v() == (0.1, -0.1)


def test_the_dmm6500_samples_by_a_trigger_model() -> None:
    two = "1.0E-01,-1.0E-01"
    exchanges: list[Exchange] = [
        ("VOLT:AZER OFF", None),
        ("AZER:ONCE", None),
        ('TRAC:CLE "defbuffer1"', None),
        ('TRIG:LOAD "SimpleLoop",2,0.8,"defbuffer1"', None),
        NO_ERROR,
        ("INIT", None),
        ("*OPC?", "1"),
        *[('TRAC:DATA? 1,2,"defbuffer1",READ', two)] * 2,
        ("VOLT:AZER ON", None),
        NO_ERROR,
    ]
    with expected_exchange(OPEN_6500, [*OPENING_6500, *exchanges]) as meter:
        meter.start_sampling(2, 1.0)
        assert meter.sampled_voltages_v() == (0.1, -0.1)


def test_safe_is_idle() -> None:
    exchanges: list[Exchange] = [("INIT:CONT OFF", None), ("ABOR", None), ("*OPC?", "1")]
    with expected_exchange(OPEN_2000, [*OPENING_2000, *exchanges]) as meter:
        assert meter.make_safe(Deadline.after(meter.clock, 3.0)).safe
