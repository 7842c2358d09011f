"""Every definition on the paper's table, to the digits computed apart, and on shapes with known answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests.analysis.paper import RATE, TURNTABLE, VIRTUAL
from vcfbench.analysis.nonlinearity import DEFINITIONS, best_straight_line, nonlinearity_ppm
from vcfbench.analysis.regression import fit_line, sign_pairs

if TYPE_CHECKING:
    from collections.abc import Sequence

VECTORS = {
    "max_span": ("831.0", "3218.2"),
    "max_span_rounded": ("749.6", "3389.6"),
    "max_fs": ("1662", "6436"),
    "max_out": ("1633", "6397"),
    "rms_fs": ("563", "3043"),
    "sd_fs": ("599", "3239"),
    "pp_fs": ("2180", "11703"),
    "bsl_fs": ("999", "5390"),
    "endpoint_span": ("999", "5390"),
    "reading": ("6543", "40713"),
    "asym": ("3027", "16798"),
    "asym_common": ("3087", "16401"),
}


def ppm(rate: Sequence[float], output: Sequence[float]) -> dict[str, float | None]:
    return nonlinearity_ppm(rate, output, fit_line(rate, output))


@pytest.mark.parametrize("definition", VECTORS)
def test_vectors_of_table_1(definition: str) -> None:
    for column, expected in zip((TURNTABLE, VIRTUAL), VECTORS[definition], strict=True):
        value = ppm(RATE, column)[definition]
        assert value is not None
        assert f"{value:.{1 if '.' in expected else 0}f}" == expected


def test_every_definition_is_described_and_reported_in_order() -> None:
    assert list(ppm(RATE, TURNTABLE)) == list(DEFINITIONS) == list(VECTORS)


def test_a_parabola_has_the_values_that_it_has_on_paper() -> None:
    """A parabola -x/100 + x^2/10000 on -1, 0, 1: residuals +1/3, -2/3, +1/3 of 1e-4 about K = -1/100, b = 2/3 e-4."""
    values = ppm([-1.0, 0.0, 1.0], [0.0101, 0.0, -0.0099])
    assert values["max_span"] == pytest.approx(1e6 * (2 / 3 * 1e-4) / 0.02)
    assert values["rms_fs"] == pytest.approx(1e6 * np.sqrt(2 / 9) * 1e-4 / 0.01)
    assert values["sd_fs"] == pytest.approx(1e6 * np.sqrt(2 / 3) * 1e-4 / 0.01)
    assert values["pp_fs"] == pytest.approx(1e6 * 1e-4 / 0.01)
    assert values["bsl_fs"] == pytest.approx(1e6 * 0.5e-4 / 0.01)
    assert values["endpoint_span"] == pytest.approx(1e6 * 1e-4 / 0.02)
    assert values["asym"] == pytest.approx(-1e6 * 2 * 2e-4 / 0.02)
    assert values["asym_common"] == pytest.approx(values["asym"])


def test_a_straight_line_has_none_of_it() -> None:
    values = ppm(RATE, [-0.0125 * rate + 0.05 for rate in RATE])
    assert max(abs(value) for value in values.values() if value is not None) < 1e-6


@pytest.mark.parametrize(
    ("rate", "undefined"),
    [
        ([1.0, 2.0, 3.0, 4.0], {"reading", "asym", "asym_common"}),
        ([0.0, 100.0, 200.0], {"asym", "asym_common"}),
        ([-200.0, 100.0, 200.0], {"asym"}),
    ],
)
def test_what_the_points_do_not_allow_is_none(rate: list[float], undefined: set[str]) -> None:
    values = ppm(rate, [0.01 * value + 0.001 * value**2 / 200 for value in rate])
    assert {name for name, value in values.items() if value is None} == undefined


def test_level_just_below_10_deg_s_counts_as_reading() -> None:
    """A V_Vc of four digits stands for 9.9996 or 10.0003 deg/s by chance; the largest share is often that of 10."""
    rate = [200.0, 100.0, 50.0, 20.0, 10.0, 5.0, -5.0, -10.0, -20.0, -50.0, -100.0, -200.0]
    output = [0.01 * each + (1e-3 if abs(each) == 10.0 else 0.0) for each in rate]
    exact = ppm(rate, output)["reading"]
    below = ppm([9.9996e-1 * each for each in rate], output)["reading"]
    assert exact is not None
    assert below == pytest.approx(exact, rel=1e-3)
    assert exact > 5e3


def test_a_slope_that_rounds_to_nothing_has_no_rounded_value() -> None:
    values = ppm([-1.0, 0.0, 1.0], [1e-6, 0.0, -1.1e-6])
    assert values["max_span_rounded"] is None
    assert values["max_span"] is not None


def chebyshev_line(rate: list[float], output: list[float]) -> float:
    """Half band of the minimax line by linear programming: minimise t with -t <= y - k x - b <= t."""
    x, y = np.array(rate), np.array(output)
    one = np.ones_like(x)
    bounds = np.block([[-x[:, None], -one[:, None], -one[:, None]], [x[:, None], one[:, None], -one[:, None]]])
    free = (None, None)
    least = linprog([0, 0, 1], A_ub=bounds, b_ub=np.r_[-y, y], bounds=[free, free, (0, None)]).fun
    assert least is not None
    return float(least)


numbers = st.integers(-50, 50).map(float)


@given(st.lists(st.tuples(numbers, numbers), min_size=3, max_size=25).filter(lambda p: len({x for x, _ in p}) > 1))
def test_best_straight_line_is_the_linear_programs(points: list[tuple[float, float]]) -> None:
    rate, output = (list(column) for column in zip(*points, strict=True))
    gain, bias, half_band = best_straight_line(rate, output)
    assert half_band == pytest.approx(chebyshev_line(rate, output), abs=1e-7)
    assert np.abs(np.array(output) - gain * np.array(rate) - bias).max() == pytest.approx(half_band, abs=1e-10)


EVEN_ODD = {
    "turntable": (
        TURNTABLE,
        "-12.5395 -12.5485 -12.5520 -12.5650 -12.5700 -12.5700 -12.5500 -12.5500",
        "-45.70 -42.15 -41.40 -41.20 -41.50 -41.45 -41.50 -41.55",
    ),
    "virtual": (
        VIRTUAL,
        "-12.7463 -12.7180 -12.6520 -12.5650 -12.6200 -11.5700 -12.8000 -13.0500",
        "-13.35 -7.30 -2.60 -0.40 4.70 8.25 5.70 5.65",
    ),
}


@pytest.mark.parametrize("name", EVEN_ODD)
def test_even_and_odd_parts_of_table_1(name: str) -> None:
    """-12.74625 at 200 deg/s lies exactly between two printed values; everything else is as printed."""
    column, chopped, even = EVEN_ODD[name]
    pairs = sign_pairs(RATE, column)
    assert [pair.rate_deg_s for pair in pairs] == [200, 100, 50, 20, 10, 5, 2, 1]
    assert [1e3 * pair.scale_factor for pair in pairs] == pytest.approx([float(k) for k in chopped.split()], abs=5.1e-5)
    assert [1e3 * pair.even_v for pair in pairs] == pytest.approx([float(e) for e in even.split()], abs=1e-9)


def test_pairs_average_repeats_and_skip_the_unpaired() -> None:
    (pair,) = sign_pairs([10, 10, -10, 5, 0], [1.0, 3.0, -4.0, 9.0, 9.0])
    assert (pair.rate_deg_s, pair.scale_factor, pair.even_v) == (10.0, 0.3, -1.0)


def test_no_definition_depends_on_the_order_of_the_points() -> None:
    """A loop, whose ends are measured twice."""
    rate = np.array([-200.0, -100.0, 0.0, 100.0, 200.0, 200.0, 100.0, 0.0, -100.0, -200.0])
    output = -12.5e-3 * rate + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2e-3, 0.0, 0.0, 0.0, -1e-3])
    expected = nonlinearity_ppm(rate, output, fit_line(rate, output))
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(rate.size)
        found = nonlinearity_ppm(rate[order], output[order], fit_line(rate[order], output[order]))
        assert found == pytest.approx(expected, rel=1e-9)
