"""Digits of values and uncertainties as they are printed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.uncertainty.measurand import stated_cells
from vcfbench.values.printing import digits_of_u, digits_of_value, grouped, in_digits, shorthand

if TYPE_CHECKING:
    from vcfbench.reports.document import Cell


def printed(*values: float) -> list[str]:
    cells: tuple[Cell, ...] = stated_cells(*values)
    return [in_digits(each.value, each.format) for each in cells]


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ((-0.01254137655100886, 1.9627e-07, 3.846e-07), ["-0.01254138", "2.0e-07", "3.8e-07"]),
        ((-0.04207492941176458, 3.0124e-05, 5.9045e-05), ["-0.042075", "3.0e-05", "5.9e-05"]),
        ((796.7587875523208, 6.134888984886051, 12.0768), ["796.8", "6.1", "12"]),
        ((3.354889253235919, 0.0024021966, 0.0047084623), ["3.3549", "0.0024", "0.0047"]),
        ((150.16111439, 1.7347599, 2.853102), ["150.2", "1.7", "2.9"]),
        ((1.5, 0.0996, 0.1952), ["1.50", "0.10", "0.20"]),
        ((3388.4, 123.4, 246.8), ["3390", "120", "250"]),
        ((1.234567e-9, 2.04e-12, 4.0e-12), ["1.2346e-09", "2.0e-12", "4.0e-12"]),
        ((1.2e-9, 2.04e-7, 4.0e-7), ["1e-09", "2.0e-07", "4.0e-07"]),
        ((0.0, 9.96, 20.0), ["0", "10", "20"]),
    ],
)
def test_value_has_digits_of_two_digit_u(stated: tuple[float, ...], words: list[str]) -> None:
    assert printed(*stated) == words


def test_a_value_without_uncertainty_has_eight_digits() -> None:
    assert in_digits(1.23456789012, digits_of_value(1.23456789012, 0.0)) == "1.2345679"
    assert format(0.0, digits_of_u(0.0)) == "0"


@given(st.floats(1e-12, 99.0), st.floats(-1e4, 1e4))
def test_printed_values_are_within_half_the_last_place_of_u(u: float, value: float) -> None:
    said, said_u = format(value, digits_of_value(value, u)), format(u, digits_of_u(u))
    assert abs(float(said_u) - u) <= 0.051 * u
    assert abs(float(said) - value) <= 0.051 * u + 1e-12 * abs(value)
    assert sum(each.isdigit() for each in said_u.split("e", maxsplit=1)[0].lstrip("0.")) == 2
    assert math.isfinite(float(said))


@pytest.mark.parametrize(
    ("value", "u", "said"),
    [
        (-12.541604, 2.96e-4, "-12.541 60(30)"),
        (817.3, 6.4, "817.3(6.4)"),
        (99.97, 0.0996, "99.97(10)"),
        (1234567.0, 560.0, "1 234 570(560)"),
        (3.2e-9, 1.1e-11, "3.200(11)e-09"),
        (3182.0, 664.0, "3180(660)"),
        (4.5, 524.0, "0(520)"),
        (12.0, None, "12"),
        (-6e-12, 0.013, "0.000(13)"),
        (4e-12, 4.5, "0.0(4.5)"),
        (1e-15, 5e-11, "0(50)e-12"),
    ],
)
def test_a_value_has_its_uncertainty_in_parentheses(value: float, u: float | None, said: str) -> None:
    assert shorthand(value, u) == said


def test_digits_of_an_uncertainty_stand_in_threes() -> None:
    assert (grouped(0.000588), grouped(13.2), grouped(11234.0)) == ("0.000 59", "13", "11 000")
