"""An output that does not answer is refused; one that does, however it scatters, is not."""

from __future__ import annotations

import pytest

from tests.procedures.fakes import make_settings
from vcfbench.belief.walk import require_answer
from vcfbench.errors import MeasurementError
from vcfbench.records.schema import Point

STD_V, N = 1e-3, 10


def points(swing_v: float) -> list[Point]:
    return [Point(1, rate, 0.0, swing_v * rate / 200.0, STD_V, N) for rate in (0.0, 100.0, -100.0, -100.0, 100.0, 0.0)]


def test_an_output_that_moves_by_twenty_sigmas_of_a_mean_answers() -> None:
    require_answer(make_settings(), points(20.0 * STD_V / N**0.5))


def test_an_output_that_moves_by_three_sigmas_of_a_mean_does_not() -> None:
    with pytest.raises(MeasurementError, match=r"from -0\.000474342 to \+0\.000474342 V in 6 windows, .* to 0\.0003 V"):
        require_answer(make_settings(), points(3.0 * STD_V / N**0.5))
