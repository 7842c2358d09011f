from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.model_fit import fit_model, not_negative, propagated
from vcfbench.errors import ConfigError

X = np.linspace(-1.0, 2.0, 12)
DESIGN = np.column_stack([np.ones(12), X])


def test_a_straight_line_has_the_covariance_of_the_normal_equations() -> None:
    y = 3.0 - 0.2 * X + 0.1 * np.random.default_rng(1).standard_normal(12)
    fit = fit_model(lambda p: (p @ DESIGN.T - y) / 0.1, np.array([1.0, 1.0]), "line")
    expected, *_ = np.linalg.lstsq(DESIGN, y, rcond=None)
    covariance = 0.01 * np.linalg.inv(DESIGN.T @ DESIGN)
    assert fit.parameters == pytest.approx(expected, abs=1e-9)
    assert fit.covariance == pytest.approx(covariance, rel=1e-6)
    assert fit.dof == 10
    assert fit.chi_square == pytest.approx(float(np.sum((DESIGN @ expected - y) ** 2)) / 0.01)
    at = np.array([1.0, 0.5])
    assert propagated(lambda p: np.array([at @ p]), fit) == pytest.approx(math.sqrt(at @ covariance @ at), rel=1e-6)


def test_what_the_points_do_not_determine_is_refused() -> None:
    with pytest.raises(ConfigError, match="comb: 2 points do not determine 3"):
        fit_model(lambda p: p[:2], np.ones(3), "comb")
    with pytest.raises(ConfigError, match="comb: the points do not determine"):
        fit_model(lambda p: DESIGN[:, 1] * (p[..., :1] + p[..., 1:] - 1.0), np.array([1.0, 2.0]), "comb")


def test_nearly_dependent_columns_do_not_alternate_for_ever() -> None:
    random = np.random.default_rng(2)
    for _ in range(200):
        signs, apart = random.choice([1.0, -1.0], 6), 10.0 ** random.uniform(-16.0, -6.0)
        design = random.standard_normal((12, 1)) * signs + apart * random.standard_normal((12, 6))
        found = not_negative(design / np.linalg.norm(design, axis=0), 1e-6 * random.standard_normal(12))
        assert (found >= 0.0).all()
