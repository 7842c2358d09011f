from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.analysis.noise import flicker, random_walk
from vcfbench.analysis import phase_noise
from vcfbench.analysis.allan import AllanPoint, Sampling, Term, allan_deviation, block_means
from vcfbench.analysis.noise_fit import Coefficients, fit_noise
from vcfbench.errors import ConfigError

SECONDS = Sampling.without_gaps(1.0)


def curve_of(truth: Coefficients, factors: np.ndarray) -> list[AllanPoint]:
    variances = truth.variance(factors).tolist()
    return [AllanPoint(float(t), math.sqrt(v), 50.0, 0.0, 0.0) for t, v in zip(factors, variances, strict=True)]


def test_factors_of_ieee_952() -> None:
    """Q at sqrt(3) s, N at 1 s, B over the floor, K at 3 s, R at sqrt(2) s: each is read off as itself."""
    tau = {"quantisation": 3**0.5, "angle_random_walk": 1.0, "rate_random_walk": 3.0, "rate_ramp": 2**0.5}
    for name, where in tau.items():
        assert Coefficients(**{name: 2.0}).variance(where)[0] == pytest.approx(4.0)
    assert math.sqrt(Coefficients(bias_instability=2.0).variance(5.0)[0]) == pytest.approx(2.0 * 0.66428, rel=1e-5)


@settings(deadline=None, max_examples=10)
@given(st.lists(st.floats(1e-2, 1.0), min_size=5, max_size=5))
def test_fit_recovers_what_a_curve_was_made_of(values: list[float]) -> None:
    quantisation, walk, unstable, rate_walk, ramp = values
    truth = Coefficients(quantisation, walk, unstable, rate_walk / 30.0, ramp / 1000.0)
    factors = 2 ** np.arange(12)
    found = fit_noise(curve_of(truth, factors), 50_000, SECONDS, Term).coefficients
    assert found.variance(factors) == pytest.approx(truth.variance(factors), rel=1e-6)


def test_fit_finds_the_paper_gyroscopes_two_terms() -> None:
    truth = Coefficients(0.0, 0.21 / 60, 5.57 / 3600)
    found = fit_noise(curve_of(truth, 2 ** np.arange(9)), 3600, SECONDS)
    assert found.coefficients.angle_random_walk * 60 == pytest.approx(0.21, rel=1e-6)
    assert found.coefficients.bias_instability * 3600 == pytest.approx(5.57, rel=1e-6)
    for term in (Term.RATE_RANDOM_WALK, Term.RATE_RAMP):
        assert found.terms[term].value == pytest.approx(0.0, abs=1e-8)
        assert found.terms[term].upper_95 > 0.0


CASES = [
    (Coefficients(0.0, 1.0), [Term.ANGLE_RANDOM_WALK]),
    (Coefficients(0.0, 1.0, 0.5), [Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY]),
    (Coefficients(0.0, 1.0, 0.0, 0.1), [Term.ANGLE_RANDOM_WALK, Term.RATE_RANDOM_WALK]),
]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("truth", "terms"), CASES)
def test_stated_uncertainty_is_what_repetition_shows(truth: Coefficients, terms: list[Term]) -> None:
    """300 records of 600: a standard deviation scatters by 4 %, more where the estimate is skewed: 12 %."""
    rng = np.random.default_rng(6)
    noise = truth.angle_random_walk * rng.standard_normal((300, 600))
    noise += truth.bias_instability * flicker(600, rng, records=300)
    noise += truth.rate_random_walk * random_walk(600, rng, records=300)
    fits = [fit_noise(allan_deviation(record, 1.0), 600, SECONDS, terms) for record in noise]
    for term in terms:
        place = list(Term).index(term)
        squares = np.array([fit.coefficients.squares()[place] for fit in fits])
        stated = np.sqrt([fit.covariance_of_squares[place, place] for fit in fits])
        expected = truth.squares()[place]
        assert squares.mean() == pytest.approx(expected, abs=0.25 * stated.mean())
        assert squares.std() == pytest.approx(np.median(stated), rel=0.12)
        below = np.mean([fit.terms[term].upper_95 ** 2 >= expected for fit in fits])
        assert below == pytest.approx(0.95, abs=0.06)


@pytest.mark.exhaustive
def test_dead_time_is_corrected() -> None:
    """The same white noise and flicker, read with gaps and without: both give the instrument's coefficients."""
    rng = np.random.default_rng(8)
    fine = rng.standard_normal(80_000) * math.sqrt(8.0) + 1.0 * flicker(80_000, rng)[0]
    gapped = Sampling(1.0, 0.125)
    terms = [Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY]
    for record, sampling in ((block_means(fine, 8), SECONDS), (fine[::8], gapped)):
        fit = fit_noise(allan_deviation(record, 1.0), record.size, sampling, terms)
        for term, expected in zip(terms, (1.0, 1.0), strict=True):
            found = fit.terms[term]
            assert found.u is not None
            assert abs(found.value - expected) < 3.5 * found.u


def test_a_ramp_is_found_beside_white_noise() -> None:
    rng = np.random.default_rng(4)
    record = rng.standard_normal(3600) + 0.002 * np.arange(3600)
    fit = fit_noise(allan_deviation(record, 1.0), 3600, SECONDS)
    ramp = fit.terms[Term.RATE_RAMP]
    assert ramp.u is not None
    assert abs(ramp.value - 0.002) < 3.5 * ramp.u
    assert ramp.u < 1e-3


def test_an_uncertain_point_at_the_end_hardly_counts() -> None:
    """White noise, and the last point 45 % low: one of few degrees of freedom."""
    curve = curve_of(Coefficients(0.0, 1.0), 2 ** np.arange(12))
    low = AllanPoint(curve[-1].tau_s, 0.55 * curve[-1].deviation, 1.0, 0.0, 0.0)
    fit = fit_noise([*curve[:-1], low], 10_000, SECONDS, [Term.ANGLE_RANDOM_WALK])
    assert fit.terms[Term.ANGLE_RANDOM_WALK].value == pytest.approx(1.0, rel=0.01)


def test_second_fit_of_record_reuses_sums_over_lags() -> None:
    """The sums are those of the lags alone: a record of a million readings is fitted from many averaging times on."""
    curve = curve_of(Coefficients(0.0, 1.0, 0.1), 2 ** np.arange(12))
    fit_noise(curve, 54_321, SECONDS)
    summed = phase_noise.sums_of_lags.cache_info().misses
    for first in (1, 2, 3):
        fit_noise(curve[first:], 54_321, SECONDS)
    assert phase_noise.sums_of_lags.cache_info().misses == summed


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        ([AllanPoint(1.0, 1.0, 1.0, 0.0, 0.0)], "do not determine"),
        ([AllanPoint(t, 1.0, 1.0, 0.0, 0.0) for t in (1.0, 1.5, 2.0, 4.0)], "not a multiple"),
        ([AllanPoint(t, 0.0, 1.0, 0.0, 0.0) for t in (1.0, 2.0, 4.0, 8.0)], "no noise"),
    ],
)
def test_what_cannot_be_fitted_is_refused(curve: list[AllanPoint], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        fit_noise(curve, 100, SECONDS)


@pytest.mark.parametrize("quantisation", [-30.0, -1.0, -0.3, 0.0, 0.3, 30.0])
@pytest.mark.parametrize("interval_s", [0.01, 1.0, 20.0])
def test_neighbouring_readings_share_one_mean(quantisation: float, interval_s: float) -> None:
    """The density of the readings, white^2 + 4 q |q| sin^2, is nowhere negative: it is 0 at its end for such a mean."""
    law = Coefficients(quantisation=quantisation * interval_s**0.5, angle_random_walk=1.0)
    noise = law.phase_noise(Sampling.without_gaps(interval_s))
    at_end = noise.white**2 + 4.0 * math.copysign(noise.quantisation**2, noise.quantisation)
    expected = (1.0 + 4.0 * math.copysign(quantisation**2, quantisation)) / interval_s
    assert at_end == pytest.approx(max(0.0, expected), rel=1e-9, abs=1e-9)
