"""The M1's driver against its manual, and against its simulated twin."""

from __future__ import annotations

import pytest
from vcfbench.errors import DeadlineExceeded, InstrumentError, LimitError, MeasurementError
from vcfbench.testing import conformance_problems, model_case, over_visa

from acme import MODEL
from acme.driver import M1

IDENTITY = "ACME,M1,0042,1.0"
OPENING = [("*IDN?", IDENTITY), ("*CLS", None)]
WELL = ("SYST:ERR?", '+0,"No error"')


def test_it_does_what_every_driver_must():
    assert conformance_problems(model_case(MODEL)) == []


def test_it_says_what_the_manual_shows(expected_exchange):
    exchanges = [*OPENING, ("RANGE 10", None), WELL, ("MEASURE?", "+1.25000000E+00")]
    with expected_exchange(over_visa(M1), exchanges) as meter:
        meter.configure_dc_voltage(10.0, 1.0)
        assert meter.read_voltage_v() == 1.25


def test_what_is_refused_is_raised(expected_exchange):
    refusal = [("SYST:ERR?", '-222,"Data out of range"'), WELL]
    with expected_exchange(over_visa(M1), [*OPENING, ("RANGE 0.001", None), *refusal]) as meter:
        with pytest.raises(InstrumentError, match="-222"):
            meter.configure_dc_voltage(0.001, 1.0)
        with pytest.raises(LimitError):
            meter.configure_dc_voltage(1e3, 1.0)


def test_driver_and_twin_agree(simulated_bench, simulated_world):
    simulated_bench.multimeter.configure_dc_voltage(10.0, 10.0)
    expected = simulated_world.value_v("output")
    assert simulated_bench.multimeter.read_voltage_v() == pytest.approx(expected, abs=0.01)
    assert simulated_bench.identities["multimeter"].maker == "ACME"


def test_faults_happen_to_it_too(simulated_bench, fault):
    fault("multimeter", "silent")
    with pytest.raises(DeadlineExceeded, match="multimeter at GPIB0::23::INSTR"):
        simulated_bench.multimeter.read_voltage_v()


def test_an_overload_is_no_reading(expected_exchange):
    exchanges = [*OPENING, ("MEASURE?", "+9.90000000E+37")]
    with expected_exchange(over_visa(M1), exchanges) as meter, pytest.raises(MeasurementError):
        meter.read_voltage_v()
