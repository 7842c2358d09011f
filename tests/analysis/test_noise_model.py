"""N, B, K, R of records as sensors give them: filtered, held, drifting; and what is said where no model fits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.analysis.noise import flicker
from tests.cells import few
from vcfbench.analysis.allan import AllanPoint, Sampling, Term, allan_deviation, averaging_factors
from vcfbench.analysis.noise_model import NoiseModel, _curve_of, noise_model

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.analysis.arrays import Floats

SIZE = 10_000
SAMPLES = Sampling.without_gaps(1.0)
KINDS: dict[str, Callable[[np.random.Generator], Floats]] = {
    "white": lambda r: r.standard_normal(SIZE),
    "flicker": lambda r: r.standard_normal(SIZE) + 0.1 * flicker(SIZE, r)[0],
    "walk": lambda r: r.standard_normal(SIZE) + np.cumsum(3e-3 * r.standard_normal(SIZE)),
    "ramp": lambda r: r.standard_normal(SIZE) + 2e-4 * np.arange(SIZE),
    "held twice": lambda r: np.repeat(r.standard_normal(SIZE // 2), 2) / math.sqrt(2.0),
    "held four times": lambda r: np.repeat(r.standard_normal(SIZE // 4), 4) / 2.0,
    "mean of four": lambda r: np.convolve(r.standard_normal(SIZE + 3), np.ones(4) / 4.0, "valid"),
}


def model_of(record: Floats, interval_s: float = 1.0) -> NoiseModel:
    curve = allan_deviation(record, interval_s, averaging_factors(record.size, 2), confidence=0.95)
    return noise_model(curve, record.size, Sampling.without_gaps(interval_s))


def exact(variances: Floats, factors: list[int]) -> list[AllanPoint]:
    return [
        AllanPoint(float(m), math.sqrt(v), 50.0, 0.0, 2.0 * math.sqrt(v))
        for m, v in zip(factors, variances.tolist(), strict=True)
    ]


@pytest.mark.parametrize("size", [9, 16, 31])
def test_white_allan_points_covary_as_second_differences(size: int) -> None:
    """Each is a quadratic form of the readings, with n + 1 - 2 m second differences of their integral."""
    factors = [1, 2, 4]
    forms = []
    for m in factors:
        sums = np.tril(np.ones((size + 1, size)), -1)  # the integral before, between and after the readings
        second = sums[2 * m :] - 2.0 * sums[m:-m] + sums[: -2 * m]
        forms.append(second.T @ second / (2.0 * m**2 * len(second)))
    curve, scale = _curve_of(exact(np.array([np.trace(each) for each in forms]), factors), size, SAMPLES)
    assert scale == pytest.approx(0.5)
    found = curve.covariance(np.array([0.0, 1.0, 0.0, 0.0, 0.0]))
    true = [[2.0 * np.trace(one @ other) for other in forms] for one in forms]
    assert found == pytest.approx(np.array(true), rel=2e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", KINDS)
def test_stated_values_and_bounds_hold_the_truth(kind: str) -> None:
    """Forty records each; N is 1, B 0.1 of flicker alone, K 3e-3 of the walk alone."""
    found = [model_of(KINDS[kind](np.random.default_rng(9000 + seed))) for seed in range(40)]
    walks, unstable, steps = (
        [each.fit.terms[term] for each in found]
        for term in (Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY, Term.RATE_RANDOM_WALK)
    )
    assert all(each.described for each in found)
    assert abs(np.mean([each.value for each in walks]) - 1.0) < 0.015
    assert sum(abs(each.value - 1.0) < 2.0 * (each.u or 0.0) for each in walks) >= 36
    assert sum(each.upper_95 >= 1.0 for each in walks) >= 35
    assert sum(each.upper_95 >= (0.1 if kind == "flicker" else 0.0) for each in unstable) >= 35
    assert sum(each.upper_95 >= (3e-3 if kind == "walk" else 0.0) for each in steps) >= 36
    stated = sum(each.value > 0.0 for each in unstable)
    assert stated >= 26 if kind == "flicker" else stated <= 3


@pytest.mark.parametrize("kind", ["white", "held four times", "walk"])
def test_record_is_told_right_by_its_first_seed(kind: str) -> None:
    found = model_of(KINDS[kind](np.random.default_rng(9001)))
    walk = found.fit.terms[Term.ANGLE_RANDOM_WALK]
    assert walk.u is not None
    assert abs(walk.value - 1.0) < 2.0 * walk.u < 0.1
    assert found.fit.terms[Term.BIAS_INSTABILITY].value == 0.0
    assert (found.fit.coefficients.quantisation < -0.5) == (kind == "held four times")


@pytest.mark.parametrize("seeds", few([range(7000, 7040), [7000]], [7000]))
def test_short_walk_is_not_taken_for_flicker(seeds: Sequence[int]) -> None:
    """N is 1 and K 0.05 a reading, 600 readings: B was stated of 5 of 40."""
    draws = map(np.random.default_rng, seeds)
    records = [each.standard_normal(600) + np.cumsum(0.05 * each.standard_normal(600)) for each in draws]
    assert sum(model_of(each).fit.terms[Term.BIAS_INSTABILITY].value > 0.0 for each in records) <= len(seeds) // 20


def test_clear_flicker_has_bound_by_its_u() -> None:
    """The least of the bounds of all points, of which many are near to the flicker, is below the truth too often."""
    draw = np.random.default_rng(17)
    found = [model_of(0.1 * draw.standard_normal(3600) + flicker(3600, draw)[0]) for _ in range(4)]
    for each in (one.fit.terms[Term.BIAS_INSTABILITY] for one in found):
        assert each.u is not None
        assert each.upper_95 >= each.value + 1.6 * each.u


@pytest.mark.parametrize("length", [2, 4, 8])
def test_mean_of_neighbours_leaves_n_exactly(length: int) -> None:
    """White noise 1 behind a mean of M: sigma^2 = 1/tau - (M^2 - 1) / (2 M tau^2) beyond M, in closed form."""
    lags = np.arange(-length, length + 1)
    share = (length - np.abs(lags)) / length**2

    def spread(m: int) -> float:
        return float(share @ np.abs(lags + m))

    factors = averaging_factors(SIZE, 2)
    variances = np.array([(4 * spread(m) - 3 * spread(0) - spread(2 * m)) / (2.0 * m**2) for m in factors])
    found = noise_model(exact(variances, factors), SIZE, SAMPLES)
    assert found.fit.coefficients.angle_random_walk == pytest.approx(1.0, abs=1e-6)
    assert found.fit.coefficients.squares()[0] == pytest.approx(-(length**2 - 1) / (6.0 * length), rel=1e-3)


@pytest.mark.exhaustive
def test_short_record_is_not_fitted_within_filter_memory() -> None:
    """A time constant of three readings: N was 35 % low at a u of 9 %, its start being within the filter's memory."""
    pole, off = math.exp(-0.1 * math.pi), []
    for seed in range(8):
        white = np.random.default_rng(7000 + seed).standard_normal(1300)
        impulse = (1.0 - pole) * pole ** np.arange(100)
        walk = model_of(np.convolve(white, impulse, "valid")[-1200:]).fit.terms[Term.ANGLE_RANDOM_WALK]
        off += [abs(walk.value - 1.0) / walk.u] if walk.u else []
    assert sum(each < 2.0 for each in off) >= len(off) - 1


def test_points_that_are_too_low_are_seen() -> None:
    factors = averaging_factors(SIZE, 2)
    tau = np.array(factors, dtype=np.float64)
    variances = 1.0 / tau + 2.0 * math.log(2.0) / math.pi * 0.01
    good = noise_model(exact(variances, factors), SIZE, SAMPLES)
    assert good.described
    assert good.p > 0.999
    variances[-2:] /= 4.0
    bad = noise_model(exact(variances, factors), SIZE, SAMPLES)
    assert not bad.described
    assert bad.p < 1e-3
    assert bad.fit.terms[Term.BIAS_INSTABILITY].value == 0.0
    assert bad.fit.terms[Term.ANGLE_RANDOM_WALK].value == pytest.approx(1.0, rel=0.02)


def test_slow_sine_gives_no_noise_coefficient() -> None:
    record = KINDS["white"](np.random.default_rng(9002)) + 0.2 * np.sin(2.0 * np.pi * 20.0 * np.arange(SIZE) / SIZE)
    found = model_of(record)
    assert not found.described
    assert {found.fit.terms[term].value for term in (Term.BIAS_INSTABILITY, Term.RATE_RANDOM_WALK)} == {0.0}
    walk = found.fit.terms[Term.ANGLE_RANDOM_WALK]
    assert walk.u is not None  # that of the short averages
    assert abs(walk.value - 1.0) < 2.0 * walk.u


@pytest.mark.parametrize("drift", [1.0, 10.0, 1000.0])
def test_drift_that_outweighs_the_noise_is_bounded_and_no_error(drift: float) -> None:
    found = model_of(KINDS["white"](np.random.default_rng(9003))[:3600] + drift * np.arange(3600.0))
    walk = found.fit.terms[Term.ANGLE_RANDOM_WALK]
    assert walk.upper_95 >= 1.0
    assert all(math.isfinite(each.upper_95) for each in found.fit.terms.values())


def test_result_scales_with_record_and_time() -> None:
    record = KINDS["flicker"](np.random.default_rng(9004))
    one, other = model_of(record), model_of(1e6 * record, 0.01)
    assert other.fit.coefficients.angle_random_walk == pytest.approx(1e5 * one.fit.coefficients.angle_random_walk)
    for term, each in one.fit.terms.items():
        power = {Term.ANGLE_RANDOM_WALK: 0.5, Term.BIAS_INSTABILITY: 0.0, Term.RATE_RANDOM_WALK: -0.5}.get(term, -1.0)
        assert other.fit.terms[term].upper_95 == pytest.approx(1e6 * 0.01**power * each.upper_95, rel=1e-6)
