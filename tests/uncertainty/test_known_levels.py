"""Where a generator's ranges end: known, or those that make a value least certain."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from vcfbench.records.schema import Point
from vcfbench.station.settings import Sources
from vcfbench.uncertainty.known_levels import KnownLevels, known_levels


def spread(known: KnownLevels, volts: np.ndarray, weights: np.ndarray) -> float:
    """Return the standard deviation of a sum of levels' errors."""
    found = known.errors({"sum": (volts, weights)}, {})
    return float(np.linalg.norm([found.effects["sum"][each.name] * each.u for each in found.sources]))


def of(*ends_v: float) -> KnownLevels:
    sources = Sources(generator_gain=0.02, generator_offset_v=4e-3, generator_ranges_v=ends_v, generator_bits=14)
    return known_levels((), sources)


def test_no_ranges_make_a_sum_less_certain_than_unknown_ones() -> None:
    random, unknown = np.random.default_rng(5), of()
    for _ in range(100):
        volts, weights = random.uniform(-2.0, 2.0, 7), random.normal(size=7)
        ends = np.sort(random.uniform(0.0, 2.0, random.integers(0, 5))).tolist()
        assert spread(of(*ends, 10.0), volts, weights) <= spread(unknown, volts, weights) * (1.0 + 1e-12)


def test_offset_is_shared_only_on_one_known_range() -> None:
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
    for other_v in (-1.01, -1.02):
        apart_v = 0.02 * (1.0 - other_v)
        assert spread(known, np.array([1.0, other_v]), np.array([1.0, -1.0])) == pytest.approx(apart_v / np.sqrt(3.0))


def test_worst_division_of_levels_into_ranges_counts() -> None:
    """All eight of four levels."""
    random, unknown = np.random.default_rng(7), of()
    for weights in random.normal(size=(40, 4)):
        levels = np.array([0.5, 1.0, 2.0, 4.0])
        for kind in ("gain", "offset"):
            limit = unknown.offset_limit_v if kind == "offset" else lambda _: 0.02
            squares = []
            for cuts in itertools.product((False, True), repeat=3):
                parts = np.split(np.arange(4), [n + 1 for n, cut in enumerate(cuts) if cut])
                squares.append(sum((limit(float(levels[part[0]])) * weights[part].sum()) ** 2 for part in parts))
            found = [
                3.0 * (error.u * effect[0]) ** 2
                for of_kind, _, effect, error in unknown.shared(
                    levels, weights[None] / (levels if kind == "gain" else 1.0)
                )
                if of_kind == kind
            ]
            assert sum(found) == pytest.approx(max(squares))


def test_offset_of_a_range_has_its_variance() -> None:
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
    found = sum(error.u**2 * np.outer(effect, effect) for _, _, effect, error in of(*ends).shared(volts, per_v))
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


def test_level_on_unknown_range_shares_errors_with_opposite_only() -> None:
    covariance = of().covariance_v2(np.array([1.0, -1.0, 1.01]))
    assert covariance[0, 0] == covariance[1, 1] > covariance[0, 1] != 0.0
    assert covariance[0, 2] == covariance[1, 2] == 0.0


@pytest.mark.parametrize(
    ("level_v", "bits", "reach_v", "step_v"),
    [
        (0.05, 10, 10.0, 0.2 / 1024),  # the first range, of both signs
        (-0.1, 10, 10.0, 0.2 / 1024),  # its end belongs to it
        (0.11, 10, 10.0, 2.0 / 1024),
        (1.5, 10, 10.0, 20.0 / 1024),  # beyond all that are known: the largest that there is
        (1.5, 10, np.inf, 0.0),
        (0.05, 0, 10.0, 0.0),
    ],
)
def test_set_level_is_off_by_a_step_of_its_range(level_v: float, bits: int, reach_v: float, step_v: float) -> None:
    known = known_levels((), Sources(generator_ranges_v=(0.1, 1.0), generator_bits=bits, generator_reach_v=reach_v))
    assert (known.by, known.besides, known.sigmas, known.reading_v) == ("generator", "resolution", None, None)
    assert known.u_besides_v(level_v) == known.u_mean_v(level_v, 0.25) == pytest.approx(step_v / np.sqrt(12.0))


def test_measured_level_has_errors_and_scatter_of_the_meter() -> None:
    """Scatters are pooled; the windows may have more readings than others, the fewest count."""
    meter = Sources(v_vc_gain=3e-5, v_vc_offset_v=5e-5, v_vc_sigmas=2.0, generator_gain=0.02, generator_bits=14)
    points = [Point(4, 0.0, 1.0, 0.0, 0.0, n, v_vc_measured_v=1.0, v_vc_std_v=s) for n, s in ((25, 3e-3), (16, 4e-3))]
    known = known_levels([*points, Point(1, 0.0, 0.0, 0.0, 0.0, 36)], meter)
    pooled_v = np.sqrt((9.0 + 16.0) / 2.0) * 1e-3
    assert (known.by, known.ranges_v, known.besides) == ("V_Vc meter", (10.0,), "readings")
    assert (known.gain, known.offset_v, known.sigmas) == (3e-5, 5e-5, 2.0)
    assert known.reading_v == pytest.approx(pooled_v)
    assert known.u_besides_v(0.3) == pytest.approx(pooled_v / 4.0)
    assert known.u_mean_v(0.3, 0.09) == pytest.approx(0.3 * pooled_v)
    assert known.offset_limit_v(1.0) == 5e-5  # a reading has no range that begins anywhere
    assert spread(known, np.array([2.0]), np.array([3.0])) == pytest.approx(3.0 * np.hypot(2.0 * 3e-5, 5e-5) / 2.0)
    (gain, offset) = known.shared(np.array([2.0]), np.array([[3.0], [1.0]]))
    assert [gain[:2], offset[:2]] == [("gain", "10 V range"), ("offset", "10 V range")]
    assert (gain[2].tolist(), offset[2].tolist(), gain[3].u) == ([6.0, 2.0], [3.0, 1.0], 3e-5 / 2.0)


def test_levels_are_on_the_range_that_ends_above_them() -> None:
    known, levels = of(0.1, 1.0), np.array([-0.05, 3.0])
    assert [known.range_of(each) for each in (0.0, -0.1, 0.11, 1.0, -3.0)] == [0, 0, 1, 1, 1]
    found = [(kind, where, effect[0], error.u) for kind, where, effect, error in known.shared(levels, np.ones((1, 2)))]
    u_gain, low, high = (limit / np.sqrt(3.0) for limit in (0.02, known.offset_limit_v(0.0), known.offset_limit_v(0.1)))
    assert [each for each in found if each[0] == "gain"] == [
        ("gain", "0.1 V range", -0.05, u_gain),
        ("gain", "1 V range", 3.0, u_gain),
    ]
    assert [each for each in found if each[0] == "offset"] == [
        ("offset", "0.1 V range", 1.0, low),
        ("offset", "1 V range", 1.0, high),
    ]


def test_errors_are_named_by_value_where_nobody_knows_the_ranges() -> None:
    values = {"slope": (np.array([0.5, 2.0]), np.array([1.0, 3.0])), "bias": (np.array([0.5]), np.array([4.0]))}
    for known, of_value in ((of(10.0), ("",)), (of(), (": slope", ": bias"))):
        found = known.errors(values, {"bias": (0.25, "V")})
        *shared, own = found.sources
        assert {each.name.rpartition("V")[2].removeprefix(" range") for each in shared} == set(of_value)
        assert (own.name, own.u, own.unit) == ("generator resolution: bias", 0.25, "V")
        gains = {name: size for name, size in found.effects["bias"].items() if name.startswith("generator gain, ")}
        assert list(gains.values()) == [2.0]
        assert found.through("bias", dict.fromkeys(found.effects["bias"], 0.5)) == 0.5 * (2.0 + 4.0 + 1.0)
