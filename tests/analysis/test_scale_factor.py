from __future__ import annotations

import json

import numpy as np
import pytest

from tests.analysis.paper import RATE, TURNTABLE, VIRTUAL
from vcfbench.analysis.nonlinearity import DEFINITIONS
from vcfbench.analysis.regression import slope
from vcfbench.analysis.scale_factor import characterise, compare, scale_factor_error_percent
from vcfbench.errors import ConfigError


def test_paper_error_is_1_533_percent_rounded_1_515() -> None:
    comparison = compare(characterise(RATE, TURNTABLE), characterise(RATE, VIRTUAL))
    assert f"{comparison.scale_factor_error_percent:.3f}" == "1.533"
    assert f"{comparison.scale_factor_error_percent_rounded:.3f}" == "1.515"
    assert f"{scale_factor_error_percent(-0.01254, -0.01273):.3f}" == "1.515"


def test_paper_columns_disagree_by_more_than_their_scatter() -> None:
    comparison = compare(characterise(RATE, TURNTABLE), characterise(RATE, VIRTUAL))
    assert f"{comparison.e_n:.1f}" == "3.5"
    assert f"{comparison.residual_correlation:.2f}" == "0.59"
    assert comparison.zero_difference_v == pytest.approx(51.7e-3)
    assert comparison.bias_difference_v == pytest.approx(0.000658824 + 0.042041176, abs=1e-9)
    assert comparison.u_fit_scale_factor_error_percent == pytest.approx(
        101.533 * np.hypot(4.6169e-6 / 0.012542052, 2.5331e-5 / 0.012734330), rel=1e-4
    )


@pytest.mark.parametrize(
    ("reach", "expected"), [(10, "-1.13"), (20, "-0.28"), (50, "+0.61"), (100, "+1.18"), (200, "+1.53")]
)
def test_paper_error_depends_on_the_fitted_range(reach: float, expected: str) -> None:
    rate = np.array(RATE, dtype=float)
    within = np.abs(rate) <= reach
    table, virtual = (slope(rate[within], np.array(column)[within]) for column in (TURNTABLE, VIRTUAL))
    assert f"{scale_factor_error_percent(table, virtual):+.2f}" == expected


def test_contract_of_the_json_result() -> None:
    result = characterise(RATE, TURNTABLE).as_json()
    assert set(result["scale_factor"]) == set(result["bias"]) == {"value", "u", "unit", "u_fit", "complete", "missing"}
    assert (result["scale_factor"]["unit"], result["bias"]["unit"]) == ("V/(deg/s)", "V")
    assert round(result["scale_factor"]["value"], 9) == -0.012542052
    assert set(result["nonlinearity_ppm"]) == set(DEFINITIONS)
    assert result["asymmetry_ppm"] == result["nonlinearity_ppm"]["asym"]
    assert (round(result["zero_deg_s"], 4), result["zero_v"]) == (3.3328, -0.0418)
    assert list(result["polynomial"]) == ["c0", "c1", "c2", "c3", "s_v", "max_span_ppm"]
    assert round(result["polynomial"]["max_span_ppm"]) == 94
    assert result["type_a"] is None
    assert json.loads(json.dumps(result, allow_nan=False)) == result


@pytest.mark.parametrize(
    ("u_output_v", "ppm", "bias_uv", "bias_deg_h"),
    [(13.9e-6, "3.4", "3.4", "0.97"), (18.9e-6, "4.6", "4.6", "1.3"), (28.9e-6, "7.1", "7.0", "2.0")],
)
def test_noise_alone_on_the_papers_grid(u_output_v: float, ppm: str, bias_uv: str, bias_deg_h: str) -> None:
    """What 17 means can reach: angle random walk, the same with the flicker floor, rounding to 0.1 mV."""
    noise = characterise(RATE, TURNTABLE, u_output_v).type_a
    assert noise is not None
    assert f"{1e6 * noise.u_scale_factor / 0.012542052:.1f}" == ppm
    assert f"{1e6 * noise.u_bias:.1f}" == bias_uv
    assert f"{3600 * noise.u_bias / 0.012542052:.{len(bias_deg_h) - 2}f}" == bias_deg_h


def test_noise_is_kept_apart_from_lack_of_fit() -> None:
    curved = -0.0125 * np.array(RATE) + 1e-7 * np.array(RATE) ** 2
    result = characterise(RATE, curved, 1e-5)
    assert result.type_a is not None
    assert result.type_a.lack_of_fit_v == pytest.approx(np.sqrt(result.line.s_v**2 - 1e-10), rel=1e-12)
    assert result.type_a.u_scale_factor < result.line.u_scale_factor / 50


def test_no_uncertainty_is_stated_that_is_less_than_the_noise() -> None:
    """Points that lie on a line by luck, or by their resolution, are known no better than their readings."""
    exact = characterise([-1, 0, 1], [-2.0, 0.0, 2.0], 1e-3)
    result = exact.as_json()
    assert result["scale_factor"]["u"] is None
    assert result["scale_factor"]["u_fit"] == pytest.approx(1e-3 / np.sqrt(2))
    assert result["bias"]["u_fit"] == pytest.approx(1e-3 / np.sqrt(3))
    other = characterise([-1, 0, 1], [-2.001, 0.0, 2.001], 1e-3)
    assert compare(exact, other).e_n == pytest.approx(1e-3 / (12.7062 * 1e-3), rel=1e-5)
    noisy = characterise(RATE, TURNTABLE, 1e-5)
    assert noisy.u_fit_scale_factor == noisy.line.u_scale_factor


def test_residuals_are_compared_where_the_rates_nearly_agree() -> None:
    stretched = compare(characterise(RATE, TURNTABLE), characterise(1.001 * np.array(RATE), VIRTUAL))
    assert stretched.residual_correlation == pytest.approx(0.5924, abs=1e-3)


def test_unequal_noise_weighs_where_it_is() -> None:
    """Noise at one end alone: u(K) is that point's weight in the slope times its noise."""
    u_output = np.zeros(17)
    u_output[0] = 1e-3
    noise = characterise(RATE, TURNTABLE, u_output).type_a
    assert noise is not None
    assert noise.u_scale_factor == pytest.approx(200 / 106060 * 1e-3)
    assert noise.u_bias == pytest.approx(1e-3 / 17)


def test_few_points_leave_out_what_they_cannot_tell() -> None:
    result = characterise([1, 2, 3], [1.0, 2.1, 2.9]).as_json()
    assert result["polynomial"] is None
    assert result["zero_v"] is None
    assert result["zero_deg_s"] is None
    assert result["pairs"] == []


def test_exact_columns_compare_without_a_verdict() -> None:
    rate = [-1.0, 0.0, 1.0]
    comparison = compare(characterise(rate, [-2.0, 0.0, 2.0]), characterise(rate, [-2.5, 0.0, 2.5]))
    assert comparison.scale_factor_error_percent == 25.0
    assert comparison.e_n is None
    assert comparison.residual_correlation is None


def test_columns_at_different_rates_compare_without_point_by_point_values() -> None:
    comparison = compare(characterise([1, 2, 3], [1.0, 2.1, 2.9]), characterise([1, 2, 4], [1.0, 2.1, 3.9]))
    assert comparison.residual_correlation is None
    assert comparison.zero_difference_v is None


def test_a_reference_that_rounds_to_zero_has_no_rounded_error() -> None:
    assert scale_factor_error_percent(1e-6, 1.1e-6, 5) is None
    assert scale_factor_error_percent(1e-6, 1.1e-6) == pytest.approx(10.0)


def test_an_output_that_does_not_follow_is_refused() -> None:
    with pytest.raises(ConfigError, match="does not follow the rate"):
        characterise([-1, 0, 1], [0.5, 0.5, 0.5])


def test_lopsided_grid_has_noise_of_weighted_sums() -> None:
    """Each point with a noise of its own, through the normal equations written out: (X'X)^-1 X' V X (X'X)^-1."""
    rate, u = np.array([0.0, 10.0, 50.0, 200.0]), np.array([1e-5, 2e-5, 3e-5, 5e-5])
    noise = characterise(rate, -0.0125 * rate, u).type_a
    assert noise is not None
    design = np.column_stack([np.ones(4), rate])
    weights = np.linalg.inv(design.T @ design) @ design.T
    bias, slope_ = np.sqrt(np.diag(weights @ np.diag(u**2) @ weights.T))
    assert (noise.u_bias, noise.u_scale_factor) == pytest.approx((bias, slope_), rel=1e-9)
