from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.ring_down import fit_ring_down
from vcfbench.errors import ConfigError

RATE = 20_000.0


def decay(natural: float, q: float, phase: float, offset: float, samples: int) -> np.ndarray:
    """The exact solution of x'' + omega/Q x' + omega^2 x = 0, amplitude 1, written with its complex root."""
    omega = 2.0 * math.pi * natural
    root = complex(-omega / (2.0 * q), omega * math.sqrt(1.0 - 1.0 / (4.0 * q * q)))
    return offset + np.exp(root * np.arange(samples) / RATE + 1j * phase).real


def test_a_clean_decay_is_found_exactly() -> None:
    fit = fit_ring_down(decay(3488.9, 1395.0, 0.3, 0.02, 8000), 1.0 / RATE)
    assert fit.frequency_hz == pytest.approx(3488.9, abs=1e-6)
    assert fit.q == pytest.approx(1395.0, rel=1e-7)
    assert fit.decay_s == pytest.approx(1395.0 / (math.pi * 3488.9), rel=1e-7)
    assert (fit.amplitude, fit.offset) == pytest.approx((1.0, 0.02), abs=1e-8)
    assert fit.residual_rms < 1e-8


def test_a_heavily_damped_mode_has_its_natural_frequency() -> None:
    """Q of 5: the damped frequency is half a per cent lower."""
    fit = fit_ring_down(decay(1000.0, 5.0, 0.0, 0.0, 400), 1.0 / RATE)
    assert fit.frequency_hz == pytest.approx(1000.0, abs=1e-5)
    assert fit.q == pytest.approx(5.0, rel=1e-7)


@pytest.mark.exhaustive
def test_fifty_random_gyroscopes_lie_within_the_stated_uncertainty() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        natural, q, noise = rng.uniform(2500, 5000), rng.uniform(300, 5000), rng.uniform(0.002, 0.1)
        clean = decay(natural, q, rng.uniform(-3, 3), rng.uniform(-0.1, 0.1), 8000)
        fit = fit_ring_down(clean + noise * rng.standard_normal(8000), 1.0 / RATE)
        assert abs(fit.frequency_hz - natural) < 4.0 * fit.u_frequency_hz
        assert abs(fit.q - q) < 4.0 * fit.u_q
        assert fit.residual_rms == pytest.approx(noise, rel=4.0 / math.sqrt(16_000))


@pytest.mark.exhaustive
def test_stated_uncertainties_are_what_repetition_shows() -> None:
    rng, scores = np.random.default_rng(2), []
    clean = decay(3464.1, 1224.0, 1.0, 0.0, 2000)
    for _ in range(400):
        fit = fit_ring_down(clean + 0.05 * rng.standard_normal(2000), 1.0 / RATE)
        scores.append([(fit.frequency_hz - 3464.1) / fit.u_frequency_hz, (fit.q - 1224.0) / fit.u_q])
    for z in np.array(scores).T:
        assert 0.9 < z.std() < 1.1
        assert abs(z.mean()) < 0.15


def test_what_does_not_decay_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least 32"):
        fit_ring_down(np.ones(31), 1e-3)
    with pytest.raises(ConfigError, match="finite"):
        fit_ring_down(np.full(100, np.inf), 1e-3)
    growing = decay(1000.0, 100.0, 0.0, 0.0, 400)[::-1]
    with pytest.raises(ConfigError, match="does not decay"):
        fit_ring_down(growing, 1.0 / RATE)
