from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from vcfbench.analysis.k_vc_curve import KVcCurve, covariance_of, covariance_parts, fit_k_vc_curve
from vcfbench.errors import ConfigError

K, EVEN, ODD = 149.99, 0.0132, 0.0145
"""(deg/s)/V, 1/V and 1/V^2: about the modulator of the embedded bench."""
TRUTH = np.array([0.0, K, K * EVEN, K * ODD])
RATES = np.array([sign * rate for rate in (10.0, 20.0, 50.0, 100.0, 200.0) for sign in (1.0, -1.0)])
U_RATE = 1e-3
U_V = 5e-6


def v_of(rate: float) -> float:
    """The V_Vc that the modulator needs for a rate, by bisection."""
    low, high = -2.0, 2.0
    for _ in range(80):
        middle = (low + high) / 2.0
        low, high = (middle, high) if np.polyval(TRUTH[::-1], middle) < rate else (low, middle)
    return low


TRUE_V = np.array([v_of(rate) for rate in RATES])


def fitted(rng: np.random.Generator, u_rate: float = U_RATE, u_v: float = U_V) -> KVcCurve:
    """A table whose rates and a meter whose volts are off by what they say."""
    rate = RATES + u_rate * rng.standard_normal(RATES.size)
    v = TRUE_V + u_v * rng.standard_normal(RATES.size)
    return fit_k_vc_curve(rate, v, covariance_of(rate, u_rate), covariance_of(v, u_v))


def rate_of(curve: KVcCurve, v_vc_v: np.ndarray | float) -> np.ndarray:
    return np.polynomial.polynomial.polyval(v_vc_v, curve.coefficients)


def u_rate_of(curve: KVcCurve, v_vc_v: list[float]) -> np.ndarray:
    powers = np.vander(v_vc_v, len(curve.coefficients), increasing=True)
    return np.sqrt(np.diag(powers @ np.array(curve.covariance) @ powers.T))


def test_a_known_modulator_is_found_exactly() -> None:
    curve = fit_k_vc_curve(RATES, TRUE_V, covariance_of(RATES, 1e-6), covariance_of(TRUE_V, 1e-8))
    assert curve.coefficients == pytest.approx(TRUTH, abs=1e-8)
    assert curve.k_vc == pytest.approx(K, rel=1e-10)
    shape = curve.curvature()
    assert (shape.second_per_v, shape.third_per_v2) == pytest.approx((EVEN, ODD), rel=1e-7)
    assert rate_of(curve, TRUE_V) == pytest.approx(RATES, abs=1e-8)
    assert curve.lack_of_fit_p == pytest.approx(1.0)
    assert curve.lack_of_fit_deg_s == 0.0


def test_one_point_is_off_if_the_curve_is_right() -> None:
    """The K_Vc of one match at 10 deg/s, used at 200 deg/s, against the curve there."""
    curve = fitted(np.random.default_rng(1))
    one_point = RATES[0] / TRUE_V[0]
    high = TRUE_V[-2]
    assert one_point * high / 200.0 - 1.0 < -0.03
    u = math.hypot(u_rate_of(curve, [high])[0], U_V * 1.1 * K)  # the curve is steeper there
    assert abs(rate_of(curve, high) - 200.0) < 4.0 * u < 0.01


@pytest.mark.parametrize("u_v", [U_V, 3e-3])
def test_against_a_fit_of_all_true_values_at_once(u_v: float) -> None:
    """The likelihood written out, every true V_Vc a parameter: the same coefficients and covariance."""
    rng = np.random.default_rng(2)
    rate = RATES + U_RATE * rng.standard_normal(RATES.size)
    v = TRUE_V + u_v * rng.standard_normal(RATES.size)

    def residuals(p: np.ndarray) -> np.ndarray:
        return np.concatenate([(np.polyval(p[3::-1], p[4:]) - rate) / U_RATE, (p[4:] - v) / u_v])

    solved = least_squares(residuals, np.concatenate([TRUTH, v]), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    covariance = np.linalg.inv(solved.jac.T @ solved.jac)[:4, :4]
    curve = fit_k_vc_curve(rate, v, covariance_of(rate, U_RATE), covariance_of(v, u_v))
    u = np.sqrt(np.diag(covariance))
    assert np.abs(np.array(curve.coefficients) - solved.x[:4]).max() <= 1e-4 * u.max()
    assert np.sqrt(np.diag(curve.covariance)) == pytest.approx(u, rel=0.01)
    assert curve.chi_square == pytest.approx(2.0 * solved.cost, rel=0.02)


@pytest.mark.exhaustive
def test_stated_uncertainties_are_what_repetition_shows() -> None:
    """1000 certificates: coefficients and rates in between scatter as stated, 95 % in 95 %, chi-square too."""
    rng = np.random.default_rng(3)
    between = np.array([-0.9, -0.02, 0.3])
    expected = np.polyval(TRUTH[::-1], between)
    scores, chi_squares, shapes = [], [], []
    for _ in range(1000):
        curve = fitted(rng)
        u = u_rate_of(curve, between)
        coefficients = (np.array(curve.coefficients) - TRUTH) / np.sqrt(np.diag(curve.covariance))
        scores.append([*coefficients, *((rate_of(curve, between) - expected) / u)])
        chi_squares.append(curve.chi_square)
        shape = curve.curvature()
        shapes.append(
            [(shape.second_per_v - EVEN) / shape.u_second_per_v, (shape.third_per_v2 - ODD) / shape.u_third_per_v2]
        )
    for z in np.hstack([scores, shapes]).T:
        assert 0.93 < z.std() < 1.07
        assert abs(z.mean()) < 0.1
        assert np.mean(np.abs(z) < 1.96) == pytest.approx(0.95, abs=0.021)
    assert np.mean(chi_squares) == pytest.approx(6.0, abs=0.4)
    assert np.std(chi_squares) == pytest.approx(math.sqrt(12.0), rel=0.12)


@pytest.mark.exhaustive
def test_common_meter_error_goes_whole_into_k_vc() -> None:
    """30 ppm of gain: 1000 meters; the z of k1 and of a rate at another V_Vc, and no sign of it in the lack of fit."""
    rng, scores, tails = np.random.default_rng(4), [], []
    for _ in range(1000):
        v = TRUE_V * (1.0 + 30e-6 * rng.standard_normal()) + 1e-7 * rng.standard_normal(RATES.size)
        v += 4e-6 * rng.standard_normal()
        rate = RATES + 1e-4 * rng.standard_normal(RATES.size)
        curve = fit_k_vc_curve(rate, v, covariance_of(rate, 1e-4), covariance_of(v, 1e-7, 30e-6, 4e-6))
        off, u_k_vc = rate_of(curve, 0.5) - np.polyval(TRUTH[::-1], 0.5), math.sqrt(curve.covariance[1][1])
        scores.append([(curve.k_vc - K) / u_k_vc, off / u_rate_of(curve, [0.5])[0]])
        tails.append(curve.lack_of_fit_p)
    assert u_k_vc / K == pytest.approx(30e-6, rel=0.1)
    for z in np.array(scores).T:
        assert 0.93 < z.std() < 1.07
    assert np.mean(np.array(tails) < 0.05) == pytest.approx(0.05, abs=0.021)


def test_lack_of_fit_is_reported_outside_the_uncertainty() -> None:
    """A line through a curved modulator: improbable residuals, tenths of deg/s too much; u as if nothing were wrong."""
    straight = fit_k_vc_curve(RATES, TRUE_V, covariance_of(RATES, U_RATE), covariance_of(TRUE_V, U_V), order=1)
    assert straight.lack_of_fit_p is not None
    assert straight.lack_of_fit_p < 1e-9
    assert straight.lack_of_fit_deg_s == pytest.approx(np.sqrt(np.mean(np.square(straight.residuals_deg_s))), rel=1e-3)
    assert straight.lack_of_fit_deg_s > 0.5
    assert straight.covariance[1][1] < 2e-3**2
    with pytest.raises(ConfigError, match="no second and third"):
        straight.curvature()


def test_four_pairs_for_four_coefficients_leave_nothing_to_test() -> None:
    places = [0, 1, 8, 9]
    curve = fit_k_vc_curve(RATES[places], TRUE_V[places], covariance_of(RATES[places], 1e-3), np.zeros((4, 4)))
    assert (curve.dof, curve.lack_of_fit_p) == (0, None)
    assert curve.coefficients == pytest.approx(TRUTH, abs=1e-7)


GOOD = covariance_of(RATES, 1e-3)


@pytest.mark.parametrize(
    ("rate", "v", "of_rate", "of_v", "message"),
    [
        (np.abs(RATES), np.abs(TRUE_V), GOOD, GOOD, "both signs"),
        (RATES[:3], TRUE_V[:3], GOOD[:3, :3], GOOD[:3, :3], "do not determine"),
        (RATES, np.sign(TRUE_V), GOOD, GOOD, "2 different V_Vc"),
        (RATES, TRUE_V, GOOD[:5, :5], GOOD, "10 by 10"),
        (RATES, TRUE_V, 0.0 * GOOD, 0.0 * GOOD, "zero or depend"),
        (RATES * np.nan, TRUE_V, GOOD, GOOD, "finite"),
    ],
)
def test_what_cannot_be_fitted_is_refused(
    rate: np.ndarray, v: np.ndarray, of_rate: np.ndarray, of_v: np.ndarray, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        fit_k_vc_curve(rate, v, of_rate, of_v)


def test_the_parts_of_the_covariance_add_up_to_it() -> None:
    v = np.array([-1.3, -0.7, -0.3, 0.3, 0.7, 1.3])
    rate = 150.0 * v + 2.0 * v**2 + 2.2 * v**3
    of_rate = {"readings": covariance_of(rate, 3e-3), "table": covariance_of(rate, 0.0, 6e-6)}
    of_v = {"gain": covariance_of(v, 0.0, 9e-6), "offset": covariance_of(v, 0.0, 0.0, 1e-5)}
    curve = fit_k_vc_curve(rate, v, sum(of_rate.values()), sum(of_v.values()))
    parts = covariance_parts(curve, v, of_rate, of_v)
    assert sum(parts.values()) == pytest.approx(np.array(curve.covariance), rel=1e-6)
    assert parts["gain"][1, 1] ** 0.5 / curve.k_vc == pytest.approx(9e-6, rel=1e-3)


def test_shape_has_u_by_covariance_of_coefficients() -> None:
    curve = fitted(np.random.default_rng(6), u_rate=0.05)
    shape = curve.curvature()
    drawn = np.random.default_rng(7).multivariate_normal(curve.coefficients, curve.covariance, 40_000)
    assert np.std(drawn[:, 2] / drawn[:, 1]) == pytest.approx(shape.u_second_per_v, rel=0.02)
    assert np.std(drawn[:, 3] / drawn[:, 1]) == pytest.approx(shape.u_third_per_v2, rel=0.02)
    k, covariance = np.array(curve.coefficients), np.array(curve.covariance)
    for place, u in ((2, shape.u_second_per_v), (3, shape.u_third_per_v2)):
        gradient = np.zeros(k.size)
        gradient[1], gradient[place] = -k[place] / k[1] ** 2, 1.0 / k[1]
        assert u == pytest.approx(math.sqrt(gradient @ covariance @ gradient), rel=1e-12)
