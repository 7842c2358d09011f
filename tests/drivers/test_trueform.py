"""The driver of the 33500B and 33600A, in words and behind the simulated generator."""

from __future__ import annotations

from typing import Any

import pytest

from tests.drivers.openings import NO_ERROR, opening, taken_over
from vcfbench.clock import Deadline
from vcfbench.drivers.registry import find_driver
from vcfbench.drivers.trueform import Trueform
from vcfbench.errors import InstrumentError, LimitError
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("Agilent Technologies,33522B,MY1,3.05-1.19-2.00-52-00")
STARTED: list[Exchange] = [
    *OPENING,
    *[("OUTP1 OFF", None), NO_ERROR, ("OUTP1?", "0")],
    *taken_over(Trueform.left),
]
"""Before the first setting."""
OPEN = over_visa(Trueform.of_model("33522B", sine_hz=30e6), name="rate_source")
BLIND: Exchange = (b"\nOUTP1 OFF\n", None)
OPEN_CIRCUIT: list[Exchange] = [("OUTP1:LOAD INF", None), NO_ERROR, ("OUTP1:LOAD?", "+9.900000000000000E+37")]


def test_direct_voltage_goes_to_channel_1_and_high_impedance() -> None:
    exchanges: list[Exchange] = [
        *OPEN_CIRCUIT,
        ("SOUR1:FUNC DC", None),
        ("SOUR1:VOLT:OFFS 0.0666", None),
        NO_ERROR,
        *[("SOUR1:VOLT:OFFS?", "+6.6600000000000E-02")] * 2,
    ]
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator:
        assert generator.configure_dc(0.0666) == 0.0666


def test_limits_are_off_before_the_load_is_changed() -> None:
    commands = [command for command, _ in STARTED]
    exchanges: list[Exchange] = [("OUTP1:LOAD INF", None), NO_ERROR, ("OUTP1:LOAD?", "+5.000000000000000E+01")]
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator, pytest.raises(InstrumentError, match="50 ohm"):
        generator.configure_dc(1.0)
    assert "SOUR1:VOLT:LIM:STAT OFF" in commands


def test_frequencies_are_those_of_the_model() -> None:
    found: list[Any] = [find_driver(name).driver_class for name in ("33509B", "33522B", "33622A")]
    assert [(each.model, each.sine_hz) for each in found] == [("33509B", 20e6), ("33522B", 30e6), ("33622A", 120e6)]
    alike: Any = find_driver("33699A", like="33622A").driver_class
    assert (alike.model, alike.sine_hz) == ("33699A", 120e6)
    with expected_exchange(OPEN, OPENING) as generator, pytest.raises(LimitError, match="frequency of"):
        generator.configure_sine(31e6, 1.0)


def test_safe_is_the_first_output_off_by_read_back() -> None:
    exchanges: list[Exchange] = [BLIND, ("OUTP1 OFF", None), NO_ERROR, ("OUTP1?", "0")]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as generator:
        assert generator.make_safe(Deadline.after(generator.clock, 3.0)).safe
