"""Means of records and what they are known by: quality factors of ring-downs whose mode noise drives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from vcfbench.uncertainty.measurand import quality_of


def test_a_quality_factor_is_that_of_the_mean_rate() -> None:
    found = quality_of([1.0 / 0.9e-3, 1.0 / 1.1e-3, 1.0 / 0.9e-3, 1.0 / 1.1e-3])
    share = math.sqrt(4.0 / 3.0) * 0.1
    assert found.value == pytest.approx(1000.0)
    assert found.u == pytest.approx(1000.0 * math.hypot(share / 2.0, share**2))
    assert found.parts[0].dof == 3


def fitted(rng: np.random.Generator, noise: float) -> float:
    """Return Q, of 1, that a fit finds in four time constants of a decay from 1 and of the noise of its mode."""
    t = np.linspace(0.0, 4.0, 100)
    kept, pushes = math.exp(-t[1]), noise * (rng.standard_normal(100) + 1j * rng.standard_normal(100))
    seen = [1.0 + pushes[0]]
    for push in pushes[1:]:
        seen.append(kept * seen[-1] + math.sqrt(1.0 - kept**2) * push)

    def left(rate_and_turn: np.ndarray) -> np.ndarray:
        decay = np.exp((1j * rate_and_turn[1] - rate_and_turn[0]) * t)
        off = seen - np.vdot(decay, seen) / np.vdot(decay, decay) * decay
        return np.concatenate([off.real, off.imag])

    return float(1.0 / least_squares(left, [1.0, 0.0]).x[0])


@pytest.mark.exhaustive
@pytest.mark.parametrize("noise", [0.01, 0.03, 0.1, 0.2])
def test_u95_holds_q_of_noise_driven_mode(noise: float) -> None:
    """The mean of Q itself is 10 % too large where the noise is a tenth of what rings down, its u 9 %."""
    rng, held = np.random.default_rng(4), []
    for _ in range(80):
        found = quality_of([abs(fitted(rng, noise)) for _ in range(8)])
        held.append(abs(found.value - 1.0) <= found.u95)
    assert np.mean(held) > 0.88
