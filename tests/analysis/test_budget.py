"""Budgets against the printed numbers of the GUM, of EA-4/02 and of JCGM 101, and against repetition."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from uncertainties import umath

from tests.analysis.monte_carlo import agreement, propagate
from vcfbench.analysis.budget import Budget, Model, Source, evaluate, summed
from vcfbench.errors import ConfigError
from vcfbench.values.quantile import t_quantile

if TYPE_CHECKING:
    from collections.abc import Mapping


def applied(name: str) -> Any:
    """A function for models: of floats and arrays by NumPy, of uncertain numbers by their derivative."""

    def apply(value: Any) -> Any:
        return getattr(np if isinstance(value, float | int | np.ndarray) else umath, name)(value)

    return apply


cos, exp, log, sin, sqrt = map(applied, ("cos", "exp", "log", "sin", "sqrt"))


def test_end_gauge_of_the_gum() -> None:
    """GUM H.1, first order: 50.000 838 mm, u 32 nm, 16 degrees of freedom, U99 93 nm; the contributions as in H.1.3."""
    sources = [
        Source("standard", 50_000_623.0, 25.0, "nm", 18),
        Source("difference", 215.0, 5.8, "nm", 24),
        Source("comparator, random", 0.0, 3.9, "nm", 5),
        Source("comparator, systematic", 0.0, 6.7, "nm", 8),
        Source.within("expansion", 11.5e-6, 2e-6, "1/K"),
        Source("temperature", -0.1, 0.41, "K"),
        Source("difference of expansion", 0.0, 0.58e-6, "1/K", 50),
        Source("difference of temperature", 0.0, 0.029, "K", 2),
    ]

    def length(x: Mapping[str, Any]) -> Mapping[str, Any]:
        apart = x["difference"] + x["comparator, random"] + x["comparator, systematic"]
        warm = x["difference of expansion"] * x["temperature"] + x["expansion"] * x["difference of temperature"]
        return {"length": x["standard"] + apart - x["standard"] * warm}

    result = evaluate(sources, length, confidence=0.99).result("length")
    assert result.value == pytest.approx(50_000_838.0)
    assert f"{result.u:.0f}" == "32"
    assert math.floor(result.dof) == 16
    assert t_quantile(0.01, 16) == pytest.approx(2.92, abs=0.005)
    assert pytest.approx(result.expanded_u, rel=0.01) == 2.92 * 31.7
    sizes = {line.source: abs(line.u) for line in result.contributions}
    assert sizes["standard"] == pytest.approx(25.0, abs=0.05)
    assert sizes["difference of temperature"] == pytest.approx(16.6, abs=0.1)
    assert sizes["difference of expansion"] == pytest.approx(2.9, abs=0.05)
    assert sizes["expansion"] == sizes["temperature"] == 0.0
    assert [line.source for line in result.contributions[:2]] == ["standard", "difference of temperature"]
    assert sum(line.share for line in result.contributions) == pytest.approx(1.0)


def impedance(x: Mapping[str, Any]) -> Mapping[str, Any]:
    modulus = x["V"] / x["I"]
    return {
        "R": modulus * cos(x["phase"]),
        "X": modulus * sin(x["phase"]),
        "Z": modulus,
    }


IMPEDANCE = [
    Source("V", 4.9990, 0.0032, "V", 4),
    Source("I", 19.6610e-3, 0.0095e-3, "A", 4),
    Source("phase", 1.04446, 0.00075, "rad", 4),
]
IMPEDANCE_CORRELATIONS = {("V", "I"): -0.36, ("V", "phase"): 0.86, ("I", "phase"): -0.65}


def test_resistance_and_reactance_of_the_gum() -> None:
    """GUM H.2: three results of three correlated means; values, u and correlations as in table H.4."""
    budget = evaluate(IMPEDANCE, impedance, IMPEDANCE_CORRELATIONS)
    for name, value, u in (("R", 127.732, 0.071), ("X", 219.847, 0.295), ("Z", 254.260, 0.236)):
        result = budget.result(name)
        assert result.value == pytest.approx(value, abs=6e-3)  # the table is of unrounded means
        assert result.u == pytest.approx(u, rel=0.02)
        assert result.dof == pytest.approx(4.0)
        assert sum(line.share for line in result.contributions) == pytest.approx(1.0)
    printed = [[1.0, -0.588, -0.485], [-0.588, 1.0, 0.993], [-0.485, 0.993, 1.0]]
    assert budget.correlation == pytest.approx(np.array(printed), abs=0.03)


def test_the_same_from_the_raw_observations() -> None:
    """Table H.2 of the GUM: five sets observed together, so nothing is rounded: the printed digits.

    But one: first order gives u(X) = 0.2956, as here; the GUM prints 0.295, which is what its second way gives, the
    scatter of the five reactances (0.2955).
    """
    volts = np.array([5.007, 4.994, 5.005, 4.990, 4.999])
    amperes = np.array([19.663, 19.639, 19.640, 19.685, 19.678]) * 1e-3
    phases = np.array([1.0456, 1.0438, 1.0468, 1.0428, 1.0433])
    columns = np.array([volts, amperes, phases])
    covariance = np.cov(columns) / 5
    u = np.sqrt(np.diag(covariance))
    names = ["V", "I", "phase"]
    sources = [Source(n, m, s, "", 4) for n, m, s in zip(names, columns.mean(axis=1).tolist(), u.tolist(), strict=True)]
    pairs = {(names[i], names[j]): float(covariance[i, j] / u[i] / u[j]) for i, j in ((0, 1), (0, 2), (1, 2))}
    budget = evaluate(sources, impedance, pairs)
    found = {r.name: (f"{r.value:.3f}", f"{r.u:.3f}") for r in budget.results}
    assert found == {"R": ("127.732", "0.071"), "X": ("219.847", "0.296"), "Z": ("254.260", "0.236")}
    assert budget.correlation[0, 1] == pytest.approx(-0.588, abs=6e-4)
    assert budget.correlation[0, 2] == pytest.approx(-0.485, abs=6e-4)
    assert budget.correlation[1, 2] == pytest.approx(0.993, abs=6e-4)


@pytest.mark.parametrize("result", [0, 1, 2])
def test_against_another_implementation(result: int) -> None:
    """The GUM Tree Calculator: two that were observed together, one alone and one known beforehand."""
    gtc = pytest.importorskip("GTC")
    volts, amperes = gtc.multiple_ureal([4.9990, 19.6610e-3], [0.0032, 0.0095e-3], 4)
    gtc.set_correlation(-0.36, volts, amperes)
    phase, gain = gtc.ureal(1.04446, 0.00075, 7), gtc.ureal(1.0, 3e-4)
    modulus = gain * volts / amperes
    numbers = [modulus * gtc.cos(phase), gtc.exp(-phase) + gtc.log(modulus) * gtc.sqrt(gain), modulus * gtc.sin(phase)]

    def model(x: Mapping[str, Any]) -> Mapping[str, Any]:
        z, angle = x["gain"] * x["V"] / x["I"], x["phase"]
        mixed = exp(-angle) + log(z) * sqrt(x["gain"])
        return {"R": z * cos(angle), "mixed": mixed, "X": z * sin(angle)}

    sources = [*IMPEDANCE[:2], Source("phase", 1.04446, 0.00075, "rad", 7), Source("gain", 1.0, 3e-4)]
    budget = evaluate(sources, model, {("V", "I"): -0.36})
    ours, theirs = budget.results[result], numbers[result]
    assert (ours.value, ours.u, ours.dof) == pytest.approx((theirs.x, theirs.u, theirs.df), rel=1e-12)
    others = [gtc.get_correlation(theirs, numbers[n]) for n in range(3) if n != result]
    assert np.delete(budget.correlation[result], result) == pytest.approx(np.array(others), rel=1e-9)


def test_weight_of_ea_4_02() -> None:
    """EA-4/02, S2: 10 kg, 10 000.025 g, u 29.3 mg, U 59 mg with k = 2."""
    sources = [
        Source("standard", 10_000.005, 0.0225, "g"),
        Source.within("drift", 0.0, 0.015, "g"),
        Source("difference", 0.020, 0.025 / math.sqrt(3.0), "g"),
        Source.within("eccentricity", 0.0, 0.010, "g"),
        Source.within("buoyancy", 0.0, 0.010, "g"),
    ]
    result = evaluate(sources, lambda x: {"mass": sum(x.values())}, confidence=0.9545).result("mass")
    assert f"{result.value:.3f}" == "10000.025"
    assert f"{1e3 * result.u:.1f}" == "29.3"
    assert f"{1e3 * result.expanded_u:.0f}" == "59"


ADDITIVE = [
    ("normal", [Source(f"x{i}", 0.0, 1.0) for i in range(4)], 2.0, 3.92),
    ("rectangular", [Source.within(f"x{i}", 0.0, math.sqrt(3.0)) for i in range(4)], 2.0, 3.88),
    (
        "one that rules",
        [
            *(Source.within(f"x{i}", 0.0, math.sqrt(3.0)) for i in range(3)),
            Source.within("x3", 0.0, 10 * math.sqrt(3.0)),
        ],
        10.1,
        17.0,
    ),
]


@pytest.mark.parametrize(("name", "sources", "u", "half_width"), ADDITIVE, ids=[row[0] for row in ADDITIVE])
def test_additive_model_of_jcgm_101(name: str, sources: list[Source], u: float, half_width: float) -> None:
    """JCGM 101, 9.2.2 to 9.2.4: the trials' interval, and first order, which is right for normal sources only."""
    (trials,) = propagate(sources, lambda x: {"sum": sum(x.values())}, trials=1_000_000)
    assert trials.u == pytest.approx(u, abs=0.05)
    assert (trials.low, trials.high) == pytest.approx((-half_width, half_width), rel=4e-3)
    assert (trials.shortest_low, trials.shortest_high) == pytest.approx((-half_width, half_width), rel=0.02)
    result = evaluate(sources, lambda x: {"sum": sum(x.values())}).result("sum")
    assert result.expanded_u == pytest.approx(1.96 * u, rel=6e-3)
    if name != "rectangular":  # there the ends are 0.048 apart, and 0.05 is the tolerance
        assert agreement(result, trials).holds == (name == "normal")


def test_mass_of_jcgm_101() -> None:
    """JCGM 101, 9.3: 1.2341 mg, u 0.0754 mg, shortest interval 1.0834 to 1.3825 mg; first order says 0.0538 mg."""
    sources = [
        Source("reference", 100_000.0, 0.050, "mg"),
        Source("small", 1.234, 0.020, "mg"),
        Source.within("air", 1.20, 0.10, "kg/m3"),
        Source.within("density", 8000.0, 1000.0, "kg/m3"),
        Source.within("density of the reference", 8000.0, 50.0, "kg/m3"),
    ]

    def deviation(x: Mapping[str, Any]) -> Mapping[str, Any]:
        buoyancy = (x["air"] - 1.2) * (1.0 / x["density"] - 1.0 / x["density of the reference"])
        return {"deviation": (x["reference"] + x["small"]) * (1.0 + buoyancy) - 100_000.0}

    first_order = evaluate(sources, deviation).result("deviation")
    assert f"{first_order.value:.4f}" == "1.2340"
    assert first_order.u == pytest.approx(0.0539, abs=1.1e-4)
    (trials,) = propagate(sources, deviation, trials=1_000_000)
    assert trials.value == pytest.approx(1.2341, abs=3e-4)
    assert trials.u == pytest.approx(0.0754, abs=2e-4)
    assert trials.shortest_high - trials.shortest_low == pytest.approx(1.3825 - 1.0834, abs=1e-3)
    assert (trials.shortest_low, trials.shortest_high) == pytest.approx((1.0834, 1.3825), abs=5e-3)
    assert not agreement(first_order, trials).holds


def test_trials_of_correlated_sources_give_what_first_order_gives() -> None:
    """H.2 once more, with many degrees of freedom: the model is nearly linear over the uncertainties."""
    sources = [Source(s.name, s.value, s.u, s.unit) for s in IMPEDANCE]
    budget = evaluate(sources, impedance, IMPEDANCE_CORRELATIONS)
    for trial, result in zip(propagate(sources, impedance, IMPEDANCE_CORRELATIONS), budget.results, strict=True):
        assert trial.u == pytest.approx(result.u, rel=0.01)
        for end, sign in ((trial.low, -1.0), (trial.high, 1.0)):
            assert end == pytest.approx(result.value + sign * result.expanded_u, abs=0.02 * result.expanded_u)


def scale_factors(x: Mapping[str, Any]) -> Mapping[str, Any]:
    table = (x["table"] + x["noise"]) * x["meter"]
    virtual = (x["table"] + x["noise of the virtual column"]) * x["meter"]
    return {"table": table, "virtual": virtual, "difference": virtual - table}


def columns() -> Budget:
    sources = [
        Source("table", 1.0, 1e-5),
        Source("meter", 1.0, 100e-6),
        Source("noise", 0.0, 3e-6),
        Source("noise of the virtual column", 0.0, 4e-6),
    ]
    return evaluate(sources, scale_factors)


def test_what_two_columns_share_cancels_in_their_difference() -> None:
    budget = columns()
    assert budget.result("table").u == pytest.approx(math.sqrt(100.0**2 + 10.0**2 + 3.0**2) * 1e-6, rel=1e-6)
    assert budget.result("difference").u == pytest.approx(5e-6, rel=1e-6)
    assert budget.correlation[0, 1] > 0.995
    meter = {line.source: line for line in budget.result("table").contributions}["meter"]
    assert (meter.sensitivity, meter.u) == pytest.approx((1.0, 1e-4))
    assert meter.share == pytest.approx(100.0**2 / (100.0**2 + 10.0**2 + 3.0**2))


@pytest.mark.exhaustive
@pytest.mark.parametrize("correlation", [0.0, 0.7])
def test_interval_covers_the_truth_as_often_as_it_says(correlation: float) -> None:
    """1000 measurements: two means of six, observed together or not, and a rectangular source; 95 % within 3 sigma."""
    rng = np.random.default_rng(20)
    inside, scores = 0, []
    mixing = np.linalg.cholesky([[1.0, correlation], [correlation, 1.0]])
    for _ in range(1000):
        readings = mixing @ rng.standard_normal((2, 6))
        mean, u = readings.mean(axis=1).tolist(), (readings.std(axis=1, ddof=1) / math.sqrt(6.0)).tolist()
        sources = [
            Source("a", 10.0 + mean[0], u[0], dof=5),
            Source("b", 5.0 + mean[1], u[1], dof=5),
            Source.within("meter", 2.0 + rng.uniform(-0.05, 0.05), 0.05),
        ]
        pairs = {("a", "b"): float(np.corrcoef(readings)[0, 1])} if correlation else {}
        result = evaluate(sources, lambda x: {"y": x["a"] + x["b"] * x["meter"]}, pairs).result("y")
        scores.append((result.value - 20.0) / result.u)
        inside += abs(result.value - 20.0) <= result.expanded_u
    assert inside / 1000 == pytest.approx(0.95, abs=3.0 * math.sqrt(0.95 * 0.05 / 1000))
    assert abs(np.mean(scores)) < 0.15


@given(
    st.lists(
        st.tuples(st.floats(0.0, 1e3), st.sampled_from([2.0, 7.5, math.inf]), st.booleans()), min_size=1, max_size=9
    )
)
def test_a_sum_is_what_a_model_that_adds_is(drawn: list[tuple[float, float, bool]]) -> None:
    sources = [Source(str(n), 0.0, u, "V", dof, rectangular=own) for n, (u, dof, own) in enumerate(drawn)]
    model = evaluate(sources, lambda quantities: {"value": sum(quantities.values(), start=3.0)})
    found, expected = summed(sources, 3.0), model.result("value")
    assert (found.name, found.value, found.dof) == (expected.name, expected.value, pytest.approx(expected.dof))
    assert found.u == pytest.approx(expected.u)
    shares, expected_shares = ({each.source: each.share for each in of.contributions} for of in (found, expected))
    assert shares == pytest.approx(expected_shares)


def test_a_number_alone_is_a_result_without_uncertainty() -> None:
    budget = evaluate([Source("a", 1.0, 0.1)], lambda x: {"a": x["a"], "two": 2.0})
    assert (budget.result("two").value, budget.result("two").u, budget.result("two").expanded_u) == (2.0, 0.0, 0.0)
    with pytest.raises(ConfigError, match="no result b"):
        budget.result("b")


def test_half_widths() -> None:
    source = Source.within("x", 1.0, 0.6, "V")
    assert source.u == pytest.approx(0.6 / math.sqrt(3.0))
    (trials,) = propagate([source], lambda x: {"x": x["x"]}, trials=100_000)
    assert trials.u == pytest.approx(source.u, rel=0.01)
    assert 0.4 <= trials.low < trials.high <= 1.6


def test_trials_of_few_degrees_of_freedom_are_students() -> None:
    (trials,) = propagate([Source("x", 0.0, 1.0, dof=5)], lambda x: {"x": x["x"]}, trials=400_000)
    assert (trials.low, trials.high) == pytest.approx((-2.571, 2.571), rel=0.02)


@pytest.mark.parametrize(
    ("sources", "pairs", "message"),
    [
        ([Source("a", 0.0, 1.0), Source("a", 0.0, 1.0)], {}, "got twice: a"),
        ([Source("a", 0.0, -1.0)], {}, "source a"),
        ([Source("a", 0.0, math.inf)], {}, "source a"),
        ([Source("a", math.nan, 1.0)], {}, "source a"),
        ([Source("a", 0.0, 1.0, dof=0.0)], {}, "source a"),
        ([Source("a", 0.0, 1.0)], {("a", "b"): 0.5}, "no such pair"),
        ([Source("a", 0.0, 1.0)], {("b", "a"): 0.5}, "no such pair"),
        ([Source("a", 0.0, 1.0)], {("a", "a"): 0.5}, "no such pair"),
        ([Source("a", 0.0, 1.0), Source("b", 0.0, 1.0)], {("a", "b"): -1.5}, "no such pair"),
        ([Source("a", 0.0, 1.0), Source("b", 0.0, 1.0)], {("a", "b"): 1.5}, "no such pair"),
        ([Source("a", 0.0, 1.0, dof=3), Source("b", 0.0, 1.0)], {("a", "b"): 0.5}, "equal degrees"),
    ],
)
def test_what_cannot_be_is_refused(sources: list[Source], pairs: dict[tuple[str, str], float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        evaluate(sources, lambda x: {"a": x["a"]}, pairs)


def test_one_degree_of_freedom_is_enough() -> None:
    result = evaluate([Source("a", 0.0, 1.0, dof=1.0)], lambda x: {"a": x["a"]}).result("a")
    assert result.coverage_factor == pytest.approx(math.tan(math.pi * 0.475))  # Cauchy's


@pytest.mark.parametrize(("coefficient", "u"), [(1.0, 0.7), (-1.0, 0.1), (0.0, 0.5)])
def test_what_is_fully_correlated_adds_up_or_cancels(coefficient: float, u: float) -> None:
    sources = [Source("a", 1.0, 0.3), Source("b", 1.0, 0.4), Source("exact", 1.0, 0.0)]
    model: Model = lambda x: {"sum": x["a"] + x["b"] + x["exact"]}  # noqa: E731
    assert evaluate(sources, model, {("a", "b"): coefficient}).result("sum").u == pytest.approx(u)


def test_trials_refuse_what_they_cannot_draw() -> None:
    model = lambda x: {"a": x["a"]}  # noqa: E731
    with pytest.raises(ConfigError, match="too few"):
        propagate([Source("a", 0.0, 1.0)], model, trials=1000)
    pair = [Source.within("a", 0.0, 1.0), Source("b", 0.0, 1.0)]
    with pytest.raises(ConfigError, match="must be normal"):
        propagate(pair, model, {("a", "b"): 0.5})
    three = [Source(name, 0.0, 1.0) for name in "abc"]
    with pytest.raises(ConfigError, match="contradict"):
        propagate(three, model, {("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9})
