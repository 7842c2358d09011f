from __future__ import annotations

import pytest
from scipy.special import stdtrit

from vcfbench.analysis.quantile import student_t


@pytest.mark.parametrize("confidence", [0.5, 0.6827, 0.95, 0.99])
@pytest.mark.parametrize("dof", [1, 2, 3, 4, 15, 16, 199, 200, 201, 5000])
def test_quantile_is_scipys(dof: int, confidence: float) -> None:
    assert student_t(dof, confidence) == pytest.approx(float(stdtrit(dof, 0.5 + confidence / 2)), rel=1e-10)


def test_fifteen_degrees_of_freedom_of_the_papers_table() -> None:
    assert round(student_t(15), 3) == 2.131


def test_no_degree_of_freedom_has_no_quantile() -> None:
    with pytest.raises(ValueError, match="at least one"):
        student_t(0)
