from __future__ import annotations

import math
from fractions import Fraction
from random import Random
from typing import Any

import pytest

from vcfbench.errors import ConfigError
from vcfbench.values.value import Value
from vcfbench.values.verdict import Rule, e_n, judge


def test_e_n_of_the_papers_two_columns() -> None:
    """Slopes in V/(deg/s) with t of 15 degrees of freedom: 3.5, they disagree."""
    expanded = 2.1314 * 4.6169e-6, 2.1314 * 2.5331e-5
    assert e_n(-0.012542052, expanded[0], -0.012734330, expanded[1]) == pytest.approx(3.5, abs=0.01)


@pytest.mark.parametrize(
    ("value", "expanded_u", "expected"),
    [
        (8.0, 1.0, "pass"),
        (9.0, 1.0, "pass"),
        (9.01, 1.0, "marginal"),
        (10.99, 1.0, "marginal"),
        (11.01, 1.0, "fail"),
        (-9.01, 1.0, "marginal"),
        (-11.01, 1.0, "fail"),
        (9.99, 0.0, "pass"),
        (10.01, 0.0, "fail"),
        (9.6, 0.5, "marginal"),
        (9.4, 0.5, "pass"),
    ],
)
def test_guard_bands(value: float, expanded_u: float, expected: str) -> None:
    assert judge(Value("v", value, u95=expanded_u), -10.0, 10.0, guarded=True).word == expected


def test_one_limit_alone() -> None:
    assert judge(Value("v", -1e9, u95=1.0), -math.inf, 10.0, guarded=True).word == "pass"
    assert judge(Value("v", 1e9, u95=1.0), 10.0, math.inf, guarded=True).word == "pass"


def test_a_tolerance_narrower_than_the_uncertainty_never_passes() -> None:
    assert judge(Value("v", 0.0, u95=2.0), -1.0, 1.0, guarded=True).word == "marginal"


def test_what_cannot_be_judged_is_refused() -> None:
    with pytest.raises(ConfigError, match="no verdict"):
        judge(Value("v", 0.0), 1.0, -1.0, guarded=True)
    with pytest.raises(ConfigError, match="E_n"):
        e_n(1.0, 0.0, 2.0, 0.0)


def drawn(random: Random) -> Value | None:
    """A value of any form, in eighths, so that sums are exact."""
    low, middle, high = sorted(random.randint(-80, 80) / 8.0 for _ in range(3))
    size, seen = random.randint(0, 80) / 8.0, random.choice([None, 0.0])
    forms: list[dict[str, Any] | None] = [
        None,
        {"value": middle},
        {"value": middle, "u": size / 2.0, "u95": size},
        {"value": middle, "form": "interval", "low": low, "high": high},
        {"value": seen, "form": "size-below", "high": size},
        {"value": None if seen is None else low, "form": "below", "high": size},
        {"value": None, "form": "at-least", "low": size},
        {"value": float(random.randint(0, 4)), "kind": random.choice(["e_n", "wrong_signs"])},
    ]
    form = random.choice(forms)
    return None if form is None else Value("v", **form)


def by_hand(value: Value | None, low: Fraction, high: Fraction, *, guarded: bool) -> tuple[str, str]:
    """Word and rule by the definitions: what the true value may be, as two numbers, and no function of the program."""
    if value is None:
        return "fail", "not found"
    number = Fraction(value.value or 0)
    alone = "pass" if low <= number <= high else "fail"
    band = Fraction(value.u95 or 0)
    may = {
        "plus-minus": (number - band, number + band, "guarded, w = U95"),
        "interval": (value.low, value.high, "guarded by its 95 % interval"),
        "size-below": (-(value.high or 0), value.high, "all that its bound leaves"),
        "below": (0, value.high, "all that its bound leaves"),
        "at-least": (value.low, 10**9, "all that its bound leaves"),
    }[value.form]
    if value.kind:
        return alone, "as it stands"
    if value.form == "plus-minus" and value.u95 is None:
        return alone, "no U95: simple acceptance"
    if value.value is not None and not guarded:
        return alone, "simple acceptance"
    least, most = (Fraction(each or 0) for each in may[:2])
    word = "fail" if most < low or least > high else "pass" if low <= least and most <= high else "marginal"
    return word, may[2]


def test_drawn_values_have_defined_verdict_and_rule() -> None:
    random = Random(42)  # noqa: S311
    seen = set()
    for _ in range(10_000):
        value, guarded = drawn(random), random.random() < 0.5
        low, high = sorted(random.randint(-80, 80) / 8.0 for _ in range(2))
        found = judge(value, low, high, guarded=guarded)
        assert (found.word, found.rule.value) == by_hand(value, Fraction(low), Fraction(high), guarded=guarded), value
        seen.add((found.rule, found.word))
    assert {rule for rule, _ in seen} == {*Rule}
    assert {word for rule, word in seen if rule is Rule.BOUND} == {"pass", "marginal", "fail"}


@pytest.mark.parametrize(
    ("value", "low", "high", "word"),
    [
        (Value("nonlinearity", 822.5, "ppm", u95=12.0, kind="nonlinearity"), 0.0, 830.0, "marginal"),
        (Value("nonlinearity", 20.0, "ppm", form="below", high=35.0, kind="nonlinearity"), 0.0, 30.0, "marginal"),
        (Value("bias", 3.312, "deg/s", u95=0.093, kind="bias_at_rest_deg_s"), 3.30, 3.33, "marginal"),
        (Value("dead_band", None, "deg/s", form="below", high=9e-4), 0.0, 1e-3, "pass"),
    ],
)
def test_no_value_passes_nearer_to_its_limit_than_is_known(value: Value, low: float, high: float, word: str) -> None:
    assert judge(value, low, high, guarded=True).word == word
