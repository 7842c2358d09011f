from __future__ import annotations

import math
from importlib import import_module
from itertools import product
from typing import Any

import pytest

from vcfbench.values.quantile import f_is_improbable, f_tail, t_quantile, t_tail

DEGREES_AND_BELOW = tuple(product([1, 8, 90], [1, 8, 340, 100_000]))


@pytest.fixture(scope="module")
def stats() -> Any:
    """SciPy's, which takes a second to load: where these tests run, and not where they are only collected."""
    return import_module("scipy.stats")


@pytest.mark.parametrize("degrees", [1, 2, 7, 9, 80, 400, 100_000])
def test_students_t(degrees: int, stats: Any) -> None:
    t = [0.0, 0.3, 1.0, -2.5, 6.5, 40.0]
    wanted = [2.0 * stats.t.sf(abs(each), degrees) for each in t]
    assert [t_tail(each, degrees) for each in t] == pytest.approx(wanted, rel=1e-9, abs=1e-300)


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.5, 1.0, 3.0, 9.0, 400.0])
def test_fishers_f(ratio: float, stats: Any) -> None:
    wanted = [stats.f.sf(ratio, *each) for each in DEGREES_AND_BELOW]
    assert [f_tail(ratio, *each) for each in DEGREES_AND_BELOW] == pytest.approx(wanted, rel=1e-9, abs=1e-300)


@pytest.mark.parametrize("tail", [0.9, 0.3173, 0.1, 0.05, 0.01, 1e-4])
def test_the_t_that_is_exceeded(tail: float, stats: Any) -> None:
    for degrees in (1, 2, 3, 5, 7, 13, 15, 16, 22, 98, 400, 999, 1001, 3e4, 1e9, 1e17, math.inf):
        wanted = stats.t.isf(0.5 * tail, degrees)  # off by up to 1e-9 before SciPy 1.17; Newton's method once more
        wanted += (stats.t.sf(wanted, degrees) - 0.5 * tail) / stats.t.pdf(wanted, degrees)
        assert t_quantile(tail, degrees) == pytest.approx(wanted, rel=1e-12), degrees


@pytest.mark.parametrize("chance", [1e-9, 0.05, 0.6])
def test_what_is_improbable_is_so_by_the_tail(chance: float) -> None:
    ratios = [0.0, 1e-300, 0.01, 1.0, 3.0, 9.0, 30.0, 400.0, 1e40, math.inf]
    for ratio, (degrees, below) in product(ratios, DEGREES_AND_BELOW):
        found = f_is_improbable(ratio, degrees, below, chance=chance)
        assert found == (f_tail(ratio, degrees, below) < chance), (ratio, degrees, below)


@pytest.mark.parametrize("off", [-1e-5, 1e-5])
def test_what_lies_close_to_the_chance_is_worked_out(off: float) -> None:
    probability = f_tail(3.0, 9, 90)
    assert f_is_improbable(3.0, 9, 90, chance=probability * (1.0 + off)) == (off > 0.0)


def test_nothing_is_as_large_as_infinity() -> None:
    assert f_tail(float("inf"), 8, 8) == 0.0
