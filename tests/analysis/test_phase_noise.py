from __future__ import annotations

import numpy as np
import pytest

from vcfbench.analysis import phase_noise
from vcfbench.analysis.phase_noise import PhaseNoise, _lags, correlated_squares

MIXED = PhaseNoise(quantisation=0.7, white=1.0, flicker=0.6, random_walk=0.1)


def phases(records: int, samples: int) -> np.ndarray:
    """Phases of white noise of 1, one longer than the record."""
    white = np.random.default_rng(1).standard_normal((records, samples))
    return np.hstack([np.zeros((records, 1)), np.cumsum(white, axis=1)])


def test_averaging_times_of_one_record_correlate_as_in_repetition() -> None:
    """20 000 records of 60: mean squares of second differences at 2 and at 5, their covariance and means; 5 %."""
    x = phases(20_000, 60)
    means = []
    for stride in (2, 5):
        difference = x[:, 2 * stride :] - 2.0 * x[:, stride:-stride] + x[:, : -2 * stride]
        means.append(np.mean(difference**2, axis=1))
    found = correlated_squares(PhaseNoise(white=1.0), 57, 2, 51, 5)
    assert found.mean_first == pytest.approx(means[0].mean(), rel=0.02)
    assert found.covariance == pytest.approx(np.cov(means)[0, 1], rel=0.05)


@pytest.mark.parametrize(("first", "second"), [(1, 1), (3, 3), (2, 700), (400, 900)])
def test_stretches_of_lags_by_gauss_give_the_full_sum(first: int, second: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """All four laws at once; every lag of 8000 samples against some hundred nodes."""
    terms = 8001 - 2 * first, first, 8001 - 2 * second, second
    every = correlated_squares(MIXED, *terms)
    monkeypatch.setattr(phase_noise, "_SINGLY", 0)
    nodes = correlated_squares(MIXED, *terms)
    assert nodes.covariance == pytest.approx(every.covariance, rel=2e-5)
    # the covariances themselves nearly cancel in their sum
    assert nodes.covariance_of_means == pytest.approx(every.covariance_of_means, rel=2e-2)


def test_allan_variances_of_the_four_laws() -> None:
    """3 Q^2/m^2, N^2/m, (2 ln 2/pi) B^2 and K^2 m/3 at m samples."""
    m = 7
    expected = {"quantisation": 3 / m**2, "white": 1 / m, "flicker": 2 * np.log(2) / np.pi, "random_walk": m / 3}
    for name, variance in expected.items():
        found = correlated_squares(PhaseNoise(**{name: 1.0}), 10, m, 10, m)
        assert found.mean_first / (2 * m**2) == pytest.approx(variance)


@pytest.mark.parametrize(("low", "high"), [(-5, 8), (-300, 900), (-20_000, 1_000_000)])
@pytest.mark.parametrize("corners", [[0], [-200, 0, 700]])
def test_lags_and_weights_have_every_whole_lag_once(low: int, high: int, corners: list[int]) -> None:
    """A constant and a slope come out exactly, wherever the stretches begin."""
    lags, weights = _lags(low, high, corners)
    count = high - low + 1
    assert float(weights.sum()) == pytest.approx(count, rel=1e-12)
    assert float(weights @ lags) == pytest.approx(0.5 * count * (low + high), rel=1e-9)
