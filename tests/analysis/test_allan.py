from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.analysis.allan import (
    AllanPoint,
    Coefficients,
    Noise,
    allan_deviation,
    averaging_factors,
    confidence_interval,
    decompose,
    equivalent_dof,
    ieee952_uncertainty,
    overlapping_deviation,
    read_off,
)
from vcfbench.errors import ConfigError


def nist_record() -> list[float]:
    """NIST SP 1065, 12.4: n[i+1] = 16807 n[i] mod 2^31 - 1 from 1234567890, over 2^31 - 1."""
    modulus, value, record = 2147483647, 1234567890, []
    for _ in range(1000):
        record.append(value / modulus)
        value = 16807 * value % modulus
    return record


@pytest.mark.parametrize(("factor", "expected"), [(1, "2.922319e-01"), (10, "9.159953e-02"), (100, "3.241343e-02")])
def test_nist_vector(factor: int, expected: str) -> None:
    assert f"{overlapping_deviation(nist_record(), factor):.6e}" == expected


# Averaging time, rule of IEEE 952 in per cent, equivalent degrees of freedom, 68 % and 95 % bounds for 3600 points.
# 531 and 444 at 10 and 12 s: confirmed by 15 000 simulated records (532, 444); Greenhall's approximation has 491, 415.
CONFIDENCE = [
    (1, "1.2", "2400", (0.986, 1.015), (0.972, 1.029)),
    (10, "3.7", "531", (0.971, 1.032), (0.943, 1.064)),
    (12, "4.1", "444", (0.968, 1.035), (0.938, 1.070)),
    (100, "12.0", "52", (0.915, 1.115), (0.839, 1.238)),
    (400, "25.0", "11.3", (0.843, 1.299), (0.711, 1.682)),
    (1000, "43.9", "3.5", (0.770, 1.773), (0.584, 3.224)),
]


@pytest.mark.parametrize(("factor", "rule", "edf", "one", "two"), CONFIDENCE)
def test_confidence_of_an_hour_of_white_noise(
    factor: int, rule: str, edf: str, one: tuple[float, float], two: tuple[float, float]
) -> None:
    dof = equivalent_dof(3600, factor)
    assert f"{100 * ieee952_uncertainty(3600, factor):.1f}" == rule
    assert f"{dof:.{1 if '.' in edf else 0}f}" == edf
    assert confidence_interval(dof) == pytest.approx(one, abs=5.1e-4)
    assert confidence_interval(dof, 0.95) == pytest.approx(two, abs=5.1e-4)


@pytest.mark.parametrize(
    ("noise", "make"),
    [
        (Noise.QUANTISATION, lambda white: np.diff(white, axis=1)),
        (Noise.WHITE, lambda white: white[:, 1:]),
        (Noise.RANDOM_WALK, lambda white: np.cumsum(white, axis=1)[:, 1:]),
    ],
)
def test_degrees_of_freedom_are_what_repetition_shows(noise: Noise, make: object) -> None:
    """2 mean^2 / variance of 4000 estimates; its own spread is 2.5 % or so (heavier tails at few degrees): 10 %."""
    records = make(np.random.default_rng(11).standard_normal((4000, 201)))  # type: ignore[operator]
    for factor in (1, 8, 40):
        estimates = np.array([overlapping_deviation(record, factor) ** 2 for record in records])
        assert equivalent_dof(200, factor, noise) == pytest.approx(2 * estimates.mean() ** 2 / estimates.var(), rel=0.1)


def test_flicker_lies_between_white_noise_and_random_walk() -> None:
    flicker, walk, white = (equivalent_dof(3600, 100, n) for n in (Noise.FLICKER, Noise.RANDOM_WALK, Noise.WHITE))
    assert walk < flicker < white


def test_interval_covers_the_truth_as_often_as_it_says() -> None:
    """400 white records: 68 % and 95 % within 4 sigma of a binomial."""
    rng = np.random.default_rng(5)
    for confidence in (0.6827, 0.95):
        inside = 0
        for _ in range(400):
            (point,) = allan_deviation(rng.standard_normal(400), 1.0, [20], confidence=confidence)
            inside += point.low <= 1 / math.sqrt(20) <= point.high
        assert inside / 400 == pytest.approx(confidence, abs=4 * math.sqrt(confidence * (1 - confidence) / 400))


def test_white_noise_falls_with_the_square_root_and_reads_its_own_density() -> None:
    """1e5 points of 0.0035 deg/s at 1 Hz are 0.21 deg/sqrt(h); each point within 4 sigma of its own scatter."""
    record = 0.0035 * np.random.default_rng(7).standard_normal(100_000)
    curve = allan_deviation(record, 1.0, [1, 4, 16, 64])
    for point in curve:
        assert point.deviation == pytest.approx(0.0035 / math.sqrt(point.tau_s), rel=4 / math.sqrt(2 * point.edf))
    assert 60 * read_off(curve).angle_random_walk == pytest.approx(0.21, rel=4 * 0.0027)


def test_dead_time_is_taken_out_of_the_angle_random_walk() -> None:
    curve = [AllanPoint(1.0, 2.0, 100.0, 1.9, 2.1)]
    assert read_off(curve, aperture_s=0.2).angle_random_walk_duty == pytest.approx(2.0 * math.sqrt(0.2))
    assert read_off(curve).angle_random_walk_duty == 2.0


def test_floor_gives_the_bias_instability() -> None:
    curve = [AllanPoint(tau, value, 9.0, 0.0, 9.0) for tau, value in [(1, 12.0), (10, 3.7), (100, 5.0)]]
    values = read_off(curve)
    assert (values.floor, values.floor_tau_s) == (3.7, 10)
    assert values.bias_instability == pytest.approx(3.7 / 0.66428, rel=1e-5)


@given(st.lists(st.floats(1e-3, 1.0), min_size=5, max_size=5))
def test_decomposition_recovers_what_a_curve_was_made_of(values: list[float]) -> None:
    quantisation, walk, flicker, rate_walk, ramp = values
    truth = Coefficients(quantisation, walk, flicker, rate_walk / 30.0, ramp / 1000.0)
    tau = 2.0 ** np.arange(12)
    curve = [
        AllanPoint(t, math.sqrt(v), 50.0, 0.0, 0.0)
        for t, v in zip(tau.tolist(), truth.variance(tau).tolist(), strict=True)
    ]
    assert decompose(curve).variance(tau) == pytest.approx(truth.variance(tau), rel=1e-6)


def test_decomposition_finds_the_paper_gyroscopes_two_terms() -> None:
    truth = Coefficients(0.0, 0.21 / 60, 5.57 / 3600, 0.0, 0.0)
    tau = 2.0 ** np.arange(9)
    variance = truth.variance(tau).tolist()
    found = decompose([AllanPoint(t, math.sqrt(v), 50.0, 0, 0) for t, v in zip(tau.tolist(), variance, strict=True)])
    assert found.angle_random_walk * 60 == pytest.approx(0.21, rel=1e-6)
    assert found.bias_instability * 3600 == pytest.approx(5.57, rel=1e-6)
    assert found.quantisation == pytest.approx(0.0, abs=1e-8)


def test_averaging_factors_stop_at_a_ninth_of_the_record() -> None:
    assert averaging_factors(3600) == [1, 2, 4, 8, 16, 32, 64, 128, 256]
    assert averaging_factors(5) == [1]
    assert averaging_factors(3600, 4)[-1] <= 400


@pytest.mark.parametrize("factor", [0, 6])
def test_a_record_too_short_is_refused(factor: int) -> None:
    with pytest.raises(ConfigError, match="two clusters"):
        overlapping_deviation(np.arange(10.0), factor)
    if factor:
        with pytest.raises(ConfigError, match="two clusters"):
            equivalent_dof(10, factor)


def test_decomposition_trusts_a_point_as_much_as_it_is_certain() -> None:
    """Sure points of pure white noise, and one at the end that lies 45 % low and is worth one degree of freedom."""
    sure = [AllanPoint(float(tau), tau**-0.5, 1000.0, 0.0, 0.0) for tau in (1, 2, 4, 8)]
    doubtful = AllanPoint(8.0, 0.55 * 8**-0.5, 1.0, 0.0, 0.0)
    assert decompose([*sure, doubtful]).angle_random_walk == pytest.approx(1.0, rel=0.01)
