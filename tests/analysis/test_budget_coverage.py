"""Coverage factors of sums against closed forms, the printed numbers of JCGM 101, and trials."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tests.analysis.monte_carlo import propagate
from vcfbench.analysis.budget import Source, convolved_coverage_factor, evaluate

if TYPE_CHECKING:
    from collections.abc import Mapping


def half_width(sources: list[Source], pairs: Mapping[tuple[str, str], float] | None = None) -> float:
    result = evaluate(sources, lambda x: {"sum": sum(x.values())}, pairs).result("sum")
    return convolved_coverage_factor(result, sources) * result.u


def rectangular(*half_widths: float) -> list[Source]:
    return [Source.within(f"limit {n}", 0.0, width) for n, width in enumerate(half_widths)]


@pytest.mark.parametrize("limit", [1e-9, 1.0, 3e6])
def test_one_source_alone(limit: float) -> None:
    assert half_width([Source.within("x", 5.0, limit)]) == pytest.approx(0.95 * limit, rel=1e-3)


def test_two_alike_make_a_triangle() -> None:
    assert half_width(rectangular(0.5, 0.5)) == pytest.approx(1.0 - math.sqrt(0.05), rel=1e-3)


def test_sums_of_jcgm_101() -> None:
    """9.2.3 and 9.2.4: 3.88, and 17.0 where one rules."""
    root = math.sqrt(3.0)
    assert f"{half_width(rectangular(root, root, root, root)):.2f}" == "3.88"
    assert f"{half_width(rectangular(root, root, root, 10.0 * root)):.1f}" == "17.0"


@pytest.mark.parametrize("u", [1e-6, 1e-4, 1e-3, 0.1, 0.5, 2.0])
def test_a_limit_of_1_and_a_normal_source(u: float) -> None:
    """The probability within w is the mean of the normal distribution's integral over the limit."""
    found = half_width([*rectangular(1.0), Source("noise", 0.0, u)])

    def integral(x: float) -> float:
        density = math.exp(-0.5 * (x / u) ** 2) / math.sqrt(2.0 * math.pi)
        return 0.5 * x * (1.0 + math.erf(x / u / math.sqrt(2.0))) + u * density

    inside = integral(found + 1.0) - integral(found - 1.0) - 1.0
    assert inside == pytest.approx(0.95, abs=2e-4)


@pytest.mark.parametrize("dof", [4, 20])
def test_few_degrees_of_freedom_observed_together(dof: int) -> None:
    sources = [*rectangular(1.0, 0.3), Source("a", 0.0, 0.3, dof=dof), Source("b", 0.0, 0.5, dof=dof)]
    (trials,) = propagate(sources, lambda x: {"sum": sum(x.values())}, {("a", "b"): 0.6}, trials=1_000_000)
    expected = 0.5 * (trials.high - trials.low)
    assert half_width(sources, {("a", "b"): 0.6}) == pytest.approx(expected, rel=4e-3)


def test_normal_sources_keep_their_factor_and_so_does_no_uncertainty() -> None:
    assert half_width([Source("a", 0.0, 1.0, dof=5)]) == pytest.approx(2.5706, abs=1e-4)
    assert half_width([Source("a", 0.0, 0.0)]) == 0.0
