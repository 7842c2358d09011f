from __future__ import annotations

import pytest

from vcfbench.analysis.regression import fit_line
from vcfbench.analysis.running_fit import line_so_far


@pytest.mark.parametrize("rates", [(), (1.0,), (1.0, 2.0), (1.0, 2.0, 1.0, 2.0), (5.0, 5.0, 5.0)])
def test_fewer_than_three_rates_have_no_line(rates: tuple[float, ...]) -> None:
    assert line_so_far(rates, [0.1 * rate for rate in rates]) is None


def test_it_is_the_line_of_the_results() -> None:
    rates, outputs = [200.0, 100.0, 0.0, -100.0], [-2.51, -1.24, 0.012, 1.27]
    line = line_so_far(rates, outputs)
    assert line is not None
    expected = fit_line(rates, outputs)
    assert (line.scale_factor, line.bias) == (expected.scale_factor, expected.bias)
    assert list(line.residuals_v) == list(expected.residuals_v)


def test_what_is_no_measurement_has_no_line() -> None:
    assert line_so_far([0.0, 1.0, 2.0], [0.0, float("nan"), 1.0]) is None
