from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import stdtrit

from tests.analysis.noise import flicker
from vcfbench.analysis.allan import Sampling, Term, allan_deviation
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, fit_noise, u_of_combination
from vcfbench.errors import ConfigError

SECONDS = Sampling.without_gaps(1.0)
TERMS = [Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY]


def known(coefficients: Coefficients) -> NoiseFit:
    return NoiseFit(coefficients, {}, np.zeros((5, 5)))


@pytest.mark.exhaustive
def test_mean_of_the_next_record_lies_within_what_is_stated() -> None:
    """300 records of white noise and flicker: the next mean differs by sqrt(2) u, in 95 % by t with the dof.

    Scatter over the root of the number of readings would be six times too small here.
    """
    rng = np.random.default_rng(9)
    records = rng.standard_normal((300, 1200)) + 0.5 * flicker(1200, rng, records=300)
    scores, inside = [], 0
    for record in records:
        first, second = record[:600], record[600:]
        variance, dof = fit_noise(allan_deviation(first, 1.0), 600, SECONDS, TERMS).variance(SECONDS, 600)
        z = (second.mean() - first.mean()) / math.sqrt(2.0 * variance)
        scores.append(z)
        inside += abs(z) <= stdtrit(dof, 0.975)
    assert 0.9 < np.std(scores) < 1.1
    assert inside / 300 == pytest.approx(0.95, abs=3.5 * math.sqrt(0.95 * 0.05 / 300))


def test_white_noise_alone_falls_with_the_root_of_the_number() -> None:
    fit = known(Coefficients(0.0, 0.0035))
    assert math.sqrt(fit.variance(SECONDS, 10)[0]) == pytest.approx(0.0035 / math.sqrt(10.0))
    assert math.sqrt(fit.variance(Sampling(1.0, 0.2), 10)[0]) == pytest.approx(0.0035 / math.sqrt(2.0))
    assert math.isinf(fit.variance(SECONDS, 10)[1])


@pytest.mark.parametrize("order", ["rising", "alternating"])
@pytest.mark.exhaustive
def test_slope_under_flicker_and_drift_of_the_bias(order: str) -> None:
    """800 records, 20 windows of 20 s: the scatter of the slope is the stated one, for either order; 4 sigma: 10 %."""
    rng = np.random.default_rng(12)
    rates = np.linspace(-1.0, 1.0, 20)
    if order == "alternating":
        rates = np.concatenate([[r, -r] for r in rates[:10]])
    weights = (rates - rates.mean()) / np.sum((rates - rates.mean()) ** 2)
    records = 0.3 * rng.standard_normal((800, 400)) + flicker(400, rng, records=800)
    slopes = records.reshape(800, 20, 20).mean(axis=2) @ weights
    begin = 20.0 * np.arange(20)
    stated = u_of_combination(known(Coefficients(0.0, 0.3, 1.0)), SECONDS, begin, begin + 20.0, weights)
    assert slopes.std() == pytest.approx(stated.u, rel=0.1)
    assert (stated.u > 0.5) == (order == "rising")


@pytest.mark.exhaustive
def test_mean_within_a_horizon() -> None:
    """1000 records of flicker: the middle tenth against the whole."""
    records = flicker(500, np.random.default_rng(13), records=1000)
    apart = records[:, 225:275].mean(axis=1) - records.mean(axis=1)
    law = known(Coefficients(bias_instability=1.0))
    stated = u_of_combination(law, SECONDS, [225.0, 0.0], [275.0, 500.0], [1.0, -1.0])
    assert apart.std() == pytest.approx(stated.u, rel=0.09)


def test_a_ramp_goes_into_a_difference_as_a_whole() -> None:
    """Two windows 100 s apart: R times 100 s."""
    stated = u_of_combination(
        known(Coefficients(rate_ramp=0.5)), Sampling.without_gaps(2.0), [0.0, 100.0], [10.0, 110.0], [-1.0, 1.0]
    )
    assert stated.u == pytest.approx(50.0)


def test_degrees_of_freedom_are_those_of_the_noise() -> None:
    """Twice the value squared over its variance: N^2 known to 10 % is worth 200 degrees."""
    covariance = np.zeros((5, 5))
    covariance[1, 1] = 0.1**2
    assert NoiseFit(Coefficients(0.0, 1.0), {}, covariance).variance(SECONDS, 7)[1] == pytest.approx(200.0)


def test_a_sum_of_means_has_no_finite_uncertainty() -> None:
    with pytest.raises(ConfigError, match="add up to 0"):
        u_of_combination(known(Coefficients(0.0, 1.0)), SECONDS, [0.0], [1.0], [1.0])
    with pytest.raises(ConfigError, match="begin"):
        u_of_combination(known(Coefficients(0.0, 1.0)), SECONDS, [0.0, 1.0], [1.0, 1.0], [1.0, -1.0])
