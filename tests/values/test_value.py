"""What a value can be, and how it is printed."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.errors import ConfigError
from vcfbench.values.kinds import KINDS, LIMITED
from vcfbench.values.value import Value


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (Value("k", -0.012541, "V/(deg/s)", 5.8e-7, u95=1.1e-6, kind="scale_factor"), "-12.541 00(58)"),
        (Value("b", 823.3, "ppm", u95=13.0), "823"),
        (Value("s", 6.6, "ppm", form="interval", low=3.4, high=41.2), "6.6 (3.4 to 41)"),
        (Value("h", -10.0, "ppm", form="size-below", high=35.1), "size below 35"),
        (Value("t", None, "deg/s", form="below", high=9.1e-4), "below 0.000 91"),
        (Value("r", None, "deg/s", form="at-least", low=540.0), "at least 540"),
        (Value("x", 1.5), "1.5"),
    ],
)
def test_each_form_has_its_line_of_print(value: Value, said: str) -> None:
    assert value.figure(value.named.factor) == said


def test_u_without_u95_gets_factor_by_degrees_of_freedom() -> None:
    assert Value("own", 1.0, u=0.1, dof=3.0).u95 == pytest.approx(0.318, abs=5e-4)
    assert Value("own", 1.0, u=0.1).u95 == pytest.approx(0.196, abs=5e-4)
    assert Value("own", 1.0, u=0.1, u95=0.37).coverage_factor == pytest.approx(3.7)


def test_one_missing_contribution_may_be_a_text() -> None:
    assert str(Value("own", 1.0, "V", missing="meter")).endswith("INCOMPLETE without meter")


@pytest.mark.parametrize(
    "wrong",
    [
        {"value": math.nan},
        {"value": 1.0, "u": -0.1},
        {"value": None},
        {"value": 1.0, "form": "interval", "low": 2.0, "high": 3.0},
        {"value": 1.0, "form": "below"},
        {"value": 50.0, "form": "size-below", "high": 35.0},
        {"value": 7.4, "unit": "ppm", "kind": "scale_factor"},
        {"value": 1.0, "form": "plus minus"},
    ],
)
def test_what_no_value_can_be_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="own: "):
        Value("own", **wrong)


_TEXTS = {"name", "unit", "form", "kind", "words", "of", "missing"}
_NUMBERS = {"value", "u", "dof", "u95", "low", "high"}


@pytest.mark.parametrize("odd", [True, 3, "1", 1j, b"1", [3], {1.0: "u"}, object()])
@pytest.mark.parametrize("field", Value.__struct_fields__)
def test_a_field_of_another_type_is_refused_by_name(field: str, odd: Any) -> None:
    if (odd == "1" and field in _TEXTS) or (type(odd) is int and field in _NUMBERS):
        return
    with pytest.raises(ConfigError, match=f"{field}: expected|expected a form of"):
        Value(**{"name": "own", "value": 1.0, field: odd})


@pytest.mark.parametrize("number", [3, np.float32(3), np.int64(3), np.array(3.0), Fraction(3)])
def test_numbers_of_any_kind_become_plain(number: Any) -> None:
    assert type(Value("own", number, u=number).value) is float


@given(st.floats(0.0, 1e300, exclude_min=True), st.floats(0.0, 1e300, exclude_min=True))
def test_any_value_with_any_uncertainty_can_be_printed(number: float, u: float) -> None:
    assert re.fullmatch(r"[0-9. ]+\([0-9. ]+(e\+\d+)?\)(e[+-]\d+)?", str(Value("own", number, u=u)))


@pytest.mark.parametrize("dof", [-2.0, -0.5, 0, 0.0, 1e-300, 1e-3])
def test_a_factor_by_no_degrees_of_freedom_is_refused(dof: float) -> None:
    with pytest.raises(ConfigError, match=r"expected at least 0\.01 degrees of freedom, got "):
        Value("own", 1.0, u=0.1, dof=dof)
    assert Value("own", 1.0, u=0.1, u95=0.37, dof=dof).u95 == 0.37


def test_each_key_of_acceptance_is_that_of_a_kind() -> None:
    assert LIMITED["scale_factor_v_per_deg_s"] == "scale_factor"
    assert all(KINDS[kind].limit == key for key, kind in LIMITED.items())
