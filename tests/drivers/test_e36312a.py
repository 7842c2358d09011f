"""The E36312A's driver, after users' drivers of the model."""

from __future__ import annotations

import pytest

from tests.drivers.openings import NO_ERROR, opening, taken_over
from vcfbench.clock import Deadline
from vcfbench.drivers.e36312a import E36312A
from vcfbench.errors import FramingError, InstrumentError, LimitError
from vcfbench.interfaces import Regulation
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("Keysight Technologies,E36312A,MY59002391,2.1.0-1.0.4-1.12")
OPEN = over_visa(E36312A, name="power")
NEGATIVE: list[Exchange] = [
    ("OUTP? (@1,2,3)", "0,0,0"),
    *taken_over(E36312A.left),
    ("CURR 0.1,(@3);:VOLT 10,(@3)", None),
    NO_ERROR,
    ("VOLT? (@3)", "+1.00000000E+01"),
    ("CURR? (@3)", "0.1"),
]


def test_negative_rail_is_reversed_output_3_with_limit_first() -> None:
    with expected_exchange(OPEN, [*OPENING, *NEGATIVE, ("MEAS:VOLT? (@3)", "+9.998")]) as supply:
        supply.configure_output("N25V", -10.0, 0.1)
        assert supply.measure_voltage_v("N25V") == -9.998


def test_only_what_was_configured_is_switched_on() -> None:
    exchanges: list[Exchange] = [*NEGATIVE, ("OUTP ON,(@3)", None), NO_ERROR, *[("OUTP? (@1,2,3)", "0,0,1")] * 2]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        supply.configure_output("N25V", -10.0, 0.1)
        supply.enable_outputs()


@pytest.mark.parametrize(
    ("states", "words"),
    [("0,0,0", "do not read back so: the over-voltage protection of N25V"), ("1,1,1", "P6V and P25V came on")],
)
def test_output_that_stays_off_is_an_error(states: str, words: str) -> None:
    asked: Exchange = ("OUTP? (@1,2,3)", states)
    exchanges: list[Exchange] = [*NEGATIVE, ("OUTP ON,(@3)", None), NO_ERROR, asked]
    if states == "0,0,0":
        exchanges += [asked, ("VOLT:PROT:TRIP? (@1,2,3)", "0,0,1"), ("CURR:PROT:TRIP? (@1,2,3)", "0,0,0")]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        supply.configure_output("N25V", -10.0, 0.1)
        with pytest.raises(InstrumentError, match=words):
            supply.enable_outputs()


@pytest.mark.parametrize(("output", "volts", "amps"), [("N25V", 10.0, 0.1), ("P25V", -1.0, 0.1), ("P6V", 6.2, 0.1)])
def test_what_is_out_of_range_is_not_sent(output: str, volts: float, amps: float) -> None:
    with expected_exchange(OPEN, OPENING) as supply, pytest.raises(LimitError):
        supply.configure_output(output, volts, amps)


def test_regulation_is_told_by_its_own_register() -> None:
    with expected_exchange(OPEN, [*OPENING, ("STAT:QUES:INST:ISUM2:COND?", "2")]) as supply:
        assert supply.regulation("P25V") is Regulation.CONSTANT_VOLTAGE


def test_states_that_are_not_three_are_refused() -> None:
    with expected_exchange(OPEN, [*OPENING, ("OUTP? (@1,2,3)", "0,1")]) as supply, pytest.raises(FramingError):
        supply.outputs_enabled()


def test_safe_is_every_output_off_and_discharged() -> None:
    exchanges: list[Exchange] = [
        (b"\nOUTP OFF,(@1,2,3)\n", None),
        ("OUTP OFF,(@1,2,3)", None),
        NO_ERROR,
        ("OUTP? (@1,2,3)", "0,0,0"),
        *[(f"MEAS:VOLT? (@{number})", "0.012") for number in (1, 2, 3)],
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        assert supply.make_safe(Deadline.after(supply.clock, 3.0)).safe
