"""A protocol test: what a driver sends, line by line, against the manual."""

from __future__ import annotations

from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.testing import over_visa


def test_a_voltage_is_one_reading_fetched_twice(expected_exchange) -> None:
    exchanges = [
        ("*IDN?", "HEWLETT-PACKARD,34401A,0,11-5-2"),
        ("*CLS", None),
        ("INIT", None),
        ("FETC?", "+1.23400000E+00"),
        ("FETC?", "+1.23400000E+00"),
    ]
    with expected_exchange(over_visa(Hp34401A), exchanges) as meter:
        assert meter.read_voltage_v() == 1.234
