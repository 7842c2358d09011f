"""The regression of Table 1 to every digit it was computed with, and what a line must do with any data."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.analysis.paper import RATE, TURNTABLE, VIRTUAL
from vcfbench.analysis.regression import durbin_watson, fit_line, fit_polynomial, line_so_far, sign_runs
from vcfbench.errors import ConfigError


def test_turntable_column() -> None:
    fit = fit_line(RATE, TURNTABLE)
    assert round(fit.scale_factor, 9) == -0.012542052
    assert round(fit.bias, 9) == -0.042041176
    assert f"{fit.s_v:.6e}" == "1.503568e-03"
    assert f"{fit.u_scale_factor:.4e}" == "4.6169e-06"
    assert f"{fit.u_bias:.4e}" == "3.6467e-04"
    assert round(1e6 * fit.coverage_factor * fit.u_scale_factor / abs(fit.scale_factor)) == 785
    assert round(1e3 * np.abs(fit.residuals_v).max(), 6) == 4.169157
    assert RATE[int(np.abs(fit.residuals_v).argmax())] == -200
    assert round(fit.bias_deg_s, 4) == 3.3520


def test_virtual_column() -> None:
    fit = fit_line(RATE, VIRTUAL)
    assert round(fit.scale_factor, 9) == -0.012734330
    assert round(fit.bias, 9) == 0.000658824
    assert f"{fit.s_v:.6e}" == "8.249392e-03"
    assert f"{fit.u_scale_factor:.4e}" == "2.5331e-05"
    assert f"{fit.u_bias:.4e}" == "2.0008e-03"
    assert round(1e6 * fit.coverage_factor * fit.u_scale_factor / abs(fit.scale_factor)) == 4240
    assert round(1e3 * np.abs(fit.residuals_v).max(), 5) == 16.39290
    assert RATE[int(np.abs(fit.residuals_v).argmax())] == 200
    assert round(fit.bias_deg_s, 4) == -0.0517


def test_slope_and_intercept_are_uncorrelated_on_papers_grid() -> None:
    fits = [fit_line(RATE, column) for column in (TURNTABLE, VIRTUAL)]
    for fit in fits:
        assert (fit.sxx, fit.dof, fit.rate_mean_deg_s, fit.covariance) == (106060.0, 15, 0.0, 0.0)


@pytest.mark.parametrize(
    ("column", "s_mv"),
    [(TURNTABLE, ["1.504", "0.475", "0.265", "0.221"]), (VIRTUAL, ["8.25", "5.41", "5.22", "4.18"])],
)
def test_residual_deviation_by_degree(column: list[float], s_mv: list[str]) -> None:
    for degree, expected in enumerate(s_mv, 1):
        s_v = fit_polynomial(RATE, column, degree).s_v
        assert s_v is not None
        assert f"{1e3 * s_v:.{len(expected) - 2}f}" == expected


def test_cubic_of_the_turntable_column() -> None:
    _, _, c2, c3 = fit_polynomial(RATE, TURNTABLE, 3).coefficients
    assert f"{c2:.2e} {c3:.1e}" == "-1.06e-07 3.3e-10"


def test_residuals_are_systematic() -> None:
    residuals = [fit_line(RATE, column).residuals_v for column in (TURNTABLE, VIRTUAL)]
    watson = [durbin_watson(column) for column in residuals]
    assert [None if value is None else round(value, 2) for value in watson] == [0.87, 0.42]
    assert [sign_runs(column) for column in residuals] == [3, 3]


def test_polynomial_without_a_degree_of_freedom_has_no_deviation() -> None:
    exact = fit_polynomial([-1, 0, 1, 2], [3.0, 1.0, 4.0, 1.0], 3)
    assert exact.s_v is None
    assert np.abs(exact.residuals_v).max() < 1e-12


def test_durbin_watson_of_an_exact_fit_says_nothing() -> None:
    assert durbin_watson(np.zeros(5)) is None


rates = st.lists(st.integers(-300, 300), min_size=4, max_size=40, unique=True)


@given(rates, st.floats(-0.1, 0.1), st.floats(-1, 1), st.randoms(use_true_random=False))
def test_residuals_are_orthogonal_to_the_line(rate: list[int], gain: float, bias: float, random: object) -> None:
    noise = np.random.default_rng(random.getrandbits(32)).normal(0.0, 1e-3, len(rate))  # type: ignore[attr-defined]
    fit = fit_line(rate, gain * np.array(rate) + bias + noise)
    assert abs(fit.residuals_v.sum()) < 1e-11
    assert abs(fit.residuals_v @ np.array(rate)) < 1e-8


@given(rates, st.floats(0.001, 1000.0), st.floats(-100, 100))
def test_line_and_uncertainty_follow_scale_and_shift_of_output(rate: list[int], factor: float, shift: float) -> None:
    output = np.sin(np.array(rate, dtype=float))
    plain, moved = fit_line(rate, output), fit_line(rate, factor * output + shift)
    size = factor * plain.s_v + abs(shift)
    assert moved.scale_factor == pytest.approx(factor * plain.scale_factor, abs=1e-11 * size)
    assert moved.u_scale_factor == pytest.approx(factor * plain.u_scale_factor, rel=1e-9, abs=1e-11 * size)


@pytest.mark.exhaustive
def test_stated_uncertainties_are_what_repetition_shows() -> None:
    """4000 lines through noise of 1 mV on an unsymmetrical grid; the spread has 1.1 % of its own (1 sigma): 5 %."""
    rng = np.random.default_rng(3)
    rate = np.array([0.0, 10.0, 20.0, 50.0, 100.0, 200.0])
    lines = [fit_line(rate, -0.0125 * rate + rng.normal(0.0, 1e-3, 6)) for _ in range(4000)]
    slopes, biases = np.array([(line.scale_factor, line.bias) for line in lines]).T
    sxx, mean = lines[0].sxx, rate.mean()
    assert slopes.std() == pytest.approx(1e-3 / np.sqrt(sxx), rel=0.05)
    assert biases.std() == pytest.approx(1e-3 * np.sqrt(1 / 6 + mean**2 / sxx), rel=0.05)
    assert np.mean([line.u_bias**2 for line in lines]) == pytest.approx(biases.var(), rel=0.08)
    assert np.mean([line.covariance for line in lines]) == pytest.approx(np.cov(slopes, biases)[0, 1], rel=0.1)


@pytest.mark.parametrize(
    ("rate", "output", "words"),
    [
        ([1, 2], [1, 2], "at least three points"),
        ([5, 5, 5], [1, 2, 3], r"the rate never changes \(5 deg/s"),
        ([0, 0, 1e-200], [1, 2, 3], "the rate never changes"),
        ([1, 2, 3], [1, 2], "as many outputs as rates"),
        ([1, 2, 3], [1, float("nan"), 3], "not a finite number"),
        ([1, 2, 1e200], [1, 2, 3], "larger than any gyroscope"),
    ],
)
def test_points_that_make_no_line_are_refused(rate: list[float], output: list[float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        fit_line(rate, output)


@pytest.mark.parametrize("size_deg_s", [1e-9, 1e-6, 1.0, 1e3, 1e6])
def test_rates_that_differ_by_rounding_alone_are_one_rate_in_any_unit(size_deg_s: float) -> None:
    def rates(apart: float) -> list[float]:
        return [size_deg_s, size_deg_s * (1.0 + apart), size_deg_s]

    assert fit_line(rates(1e-10), [1.0, 2.0, 1.0]).scale_factor == pytest.approx(1e10 / size_deg_s, rel=1e-4)
    with pytest.raises(ConfigError, match="the rate never changes"):
        fit_line(rates(1e-13), [1.0, 2.0, 1.0])


def test_a_line_and_its_coverage_factor_load_no_scipy() -> None:
    """It takes as long to load as all the rest of what a calibration needs."""
    code = "import sys; from vcfbench.analysis.regression import line_so_far, fit_line as fit; "
    code += "print(fit([0, 1, 2], [0, 1, 2.1]).coverage_factor > 12, 'scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.split() == ["True", "False"]


@pytest.mark.parametrize("rates", [(), (1.0,), (1.0, 2.0), (1.0, 2.0, 1.0, 2.0), (5.0, 5.0, 5.0)])
def test_fewer_than_three_rates_have_no_line(rates: tuple[float, ...]) -> None:
    assert line_so_far(rates, [0.1 * rate for rate in rates]) is None


def test_it_is_the_line_of_the_results() -> None:
    rates, outputs = [200.0, 100.0, 0.0, -100.0], [-2.51, -1.24, 0.012, 1.27]
    line = line_so_far(rates, outputs)
    assert line is not None
    expected = fit_line(rates, outputs)
    assert (line.scale_factor, line.bias) == (expected.scale_factor, expected.bias)
    assert list(line.residuals_v) == list(expected.residuals_v)


def test_what_is_no_measurement_has_no_line() -> None:
    assert line_so_far([0.0, 1.0, 2.0], [0.0, float("nan"), 1.0]) is None
