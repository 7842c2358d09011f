"""Where a generator's ranges end: known, or those that make a value least certain."""

from __future__ import annotations

import numpy as np
import pytest

from vcfbench.procedures.shared.budget.known_levels import KnownLevels, known_levels
from vcfbench.station.settings import Sources


def spread(known: KnownLevels, volts: np.ndarray, weights: np.ndarray) -> float:
    """Return the standard deviation of a sum of levels' errors."""
    sources, effects = known.errors({"sum": (volts, weights)})
    return float(np.linalg.norm([effects["sum"][each.name] * each.u for each in sources]))


def of(*ends_v: float) -> KnownLevels:
    sources = Sources(generator_gain=0.02, generator_offset_v=4e-3, generator_ranges_v=ends_v, generator_bits=14)
    return known_levels((), sources)


def test_no_ranges_make_a_sum_less_certain_than_unknown_ones() -> None:
    random, unknown = np.random.default_rng(5), of()
    for _ in range(100):
        volts, weights = random.uniform(-2.0, 2.0, 7), random.normal(size=7)
        ends = np.sort(random.uniform(0.0, 2.0, random.integers(0, 5))).tolist()
        assert spread(of(*ends, 10.0), volts, weights) <= spread(unknown, volts, weights) * (1.0 + 1e-12)


def test_zero_and_a_level_share_an_offset_only_where_they_are_known_to_lie_on_one_range() -> None:
    pair, difference = np.array([0.067, 0.0]), np.array([1.0, -1.0])

    def apart(low_v: float) -> float:
        room_v = 0.02 * low_v
        above_v2 = 4e-3**2 + 4e-3 * room_v + room_v**2 / 3.0
        return float(np.sqrt((0.02 * 0.067) ** 2 + 4e-3**2 + above_v2) / np.sqrt(3.0))

    assert spread(of(), pair, difference) == pytest.approx(apart(0.067))
    assert spread(of(0.05, 10.0), pair, difference) == pytest.approx(apart(0.05))
    assert spread(of(0.1, 10.0), pair, difference) == pytest.approx(0.02 * 0.067 / np.sqrt(3.0))


def test_levels_of_both_signs_are_one_level() -> None:
    known = of()
    assert spread(known, np.array([1.0, -1.01]), np.array([1.0, -1.0])) == pytest.approx(0.02 * 2.01 / np.sqrt(3.0))


def test_the_offset_of_a_range_has_the_variance_of_what_its_lowest_level_leaves_room_for() -> None:
    random, low_v = np.random.default_rng(3), 1.0
    gain = random.uniform(-0.02, 0.02, 200_000)
    offset_v = random.uniform(-1.0, 1.0, gain.size) * (4e-3 + (0.02 - np.abs(gain)) * low_v)
    assert of().offset_limit_v(low_v) / np.sqrt(3.0) == pytest.approx(offset_v.std(), rel=0.01)
    assert of().offset_limit_v(0.0) == 4e-3


def test_the_covariance_of_sums_is_that_of_drawn_ranges() -> None:
    random, ends = np.random.default_rng(6), np.array([0.32, 1.0, 10.0])
    volts, per_v = random.uniform(-3.0, 3.0, 8), random.normal(size=(2, 8))
    own = np.searchsorted(ends, np.abs(volts))
    gain, share = random.uniform(-0.02, 0.02, (100_000, 3)), random.uniform(-1.0, 1.0, (100_000, 3))
    offset = share * (4e-3 + (0.02 - np.abs(gain)) * np.array([0.0, 0.32, 1.0]))
    drawn = (volts * gain[:, own] + offset[:, own]) @ per_v.T
    found = sum(part for _, _, part in of(*ends).covariances(volts, per_v, 0))
    assert found == pytest.approx(np.cov(drawn.T), rel=0.03)


def test_the_covariance_of_levels_is_that_of_the_budget() -> None:
    random = np.random.default_rng(6)
    volts = random.uniform(-2.0, 2.0, 9)
    volts[4:8] = -volts[:4]
    for known in (of(0.1, 1.0, 10.0), of(10.0)):
        own_v = np.array([known.u_besides_v(each) for each in volts])
        for weights in random.normal(size=(5, 9)):
            square = spread(known, volts, weights) ** 2 + float(np.square(weights * own_v).sum())
            assert weights @ known.covariance_v2(volts) @ weights == pytest.approx(square)


def test_where_no_range_is_known_a_level_shares_its_errors_with_its_opposite_alone() -> None:
    covariance = of().covariance_v2(np.array([1.0, -1.0, 1.01]))
    assert covariance[0, 0] == covariance[1, 1] > covariance[0, 1] != 0.0
    assert covariance[0, 2] == covariance[1, 2] == 0.0
