from __future__ import annotations

import math

import pytest

from vcfbench.errors import ConfigError
from vcfbench.values.verdict import conformity, e_n


def test_e_n_of_the_papers_two_columns() -> None:
    """Slopes in V/(deg/s) with t of 15 degrees of freedom: 3.5, they disagree."""
    expanded = 2.1314 * 4.6169e-6, 2.1314 * 2.5331e-5
    assert e_n(-0.012542052, expanded[0], -0.012734330, expanded[1]) == pytest.approx(3.5, abs=0.01)


@pytest.mark.parametrize(
    ("value", "expanded_u", "expected"),
    [
        (8.0, 1.0, "pass"),
        (9.0, 1.0, "pass"),
        (9.01, 1.0, "marginal"),
        (10.99, 1.0, "marginal"),
        (11.01, 1.0, "fail"),
        (-9.01, 1.0, "marginal"),
        (-11.01, 1.0, "fail"),
        (9.99, 0.0, "pass"),
        (10.01, 0.0, "fail"),
        (9.6, 0.5, "marginal"),
        (9.4, 0.5, "pass"),
    ],
)
def test_guard_bands(value: float, expanded_u: float, expected: str) -> None:
    assert conformity(value, expanded_u, -10.0, 10.0) == expected


def test_one_limit_alone() -> None:
    assert conformity(-1e9, 1.0, -math.inf, 10.0) == "pass"
    assert conformity(1e9, 1.0, 10.0, math.inf) == "pass"


def test_a_tolerance_narrower_than_the_uncertainty_never_passes() -> None:
    assert conformity(0.0, 2.0, -1.0, 1.0) == "marginal"


def test_what_cannot_be_judged_is_refused() -> None:
    for arguments in ((0.0, 1.0, 1.0, -1.0), (0.0, -1.0, 0.0, 1.0), (math.nan, 1.0, 0.0, 1.0)):
        with pytest.raises(ConfigError, match="no verdict"):
            conformity(*arguments)
    with pytest.raises(ConfigError, match="E_n"):
        e_n(1.0, 0.0, 2.0, 0.0)
