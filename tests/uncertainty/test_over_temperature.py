"""Values over temperature: coefficients of the value that is stated, and their scatter."""

from __future__ import annotations

import numpy as np
import pytest
from simrack_tests.cells import few

from vcfbench.uncertainty.over_temperature import Cause, Temperatures, over_temperature, relative_over_temperature

AT_C = np.array([25.0, 40.0, 55.0, 70.0, 85.0, 70.0, 55.0, 40.0, 25.0])
DRAWN = [tuple(np.random.default_rng(seed).uniform((1.0, -2e-3, -2e-6), (9.0, 2e-3, 2e-6))) for seed in range(8)]


@pytest.mark.parametrize("drawn", few([(each,) for each in DRAWN], *((each,) for each in DRAWN[:1])))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_coefficients_are_those_of_the_value_at_the_reference(drawn: tuple[float, ...], sign: float) -> None:
    """Not of the mean over temperatures that lie on one side of it."""
    size, tc, tc2 = drawn
    truth = sign * size * (1.0 + tc * (AT_C - 25.0) + tc2 * (AT_C - 25.0) ** 2)
    rng, u = np.random.default_rng(0), 1e-5 * size
    z = []
    for _ in range(200):
        values = truth + u * rng.standard_normal(AT_C.size)
        noise = Cause("noise", u**2 * np.eye(AT_C.size))
        made = relative_over_temperature(Temperatures(AT_C, [True] * 9, 25.0), values.tolist(), [noise], "V")
        of_truth = ((made.value, sign * size), (made.tc, 1e6 * tc), (made.tc2, 1e6 * tc2))
        z.append([(each.value - true) / each.u for each, true in of_truth])
    assert np.abs(np.mean(z, axis=0)).max() < 0.3  # four of its own u
    assert (np.abs(np.std(z, axis=0) - 1.0) < 0.2).all()
    absolute = over_temperature(Temperatures(AT_C, [True] * 9, 25.0), values.tolist(), [noise], "V")
    assert made.tc.value == pytest.approx(1e6 * absolute.tc.value / absolute.value.value, rel=1e-12)
    assert (absolute.tc.unit, made.tc.unit) == ("V/K", "ppm/K")
