from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.scpi.formats import real

NO_OVERFLOW = st.floats(min_value=-1e99, max_value=1e99, exclude_min=True, exclude_max=True)


@given(NO_OVERFLOW)
def test_an_exponent_of_two_digits_has_two_digits(value: float) -> None:
    assert re.fullmatch(r"[+-]\d\.\d{8}E[+-]\d\d", real(8)(value))


@pytest.mark.parametrize("value", [2.78e-119, -2.78e-119, 5e-324, -0.0])
def test_what_is_too_small_for_the_exponent_is_zero(value: float) -> None:
    assert real(8)(value) == "+0.00000000E+00"
