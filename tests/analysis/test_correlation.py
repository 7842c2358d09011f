"""Readings that remember the last one: the variance of their means grows by as much as is true, or by nothing."""

from __future__ import annotations

import numpy as np
import pytest

from vcfbench.analysis.correlation import Correlation


def windows(rng: np.random.Generator, rho: float, count: int, size: int) -> np.ndarray:
    """Draw windows of readings of variance 1, each correlated with the next by `rho`; they begin anew."""
    new = rng.standard_normal((size, count)) * np.sqrt(1.0 - rho**2)
    readings = [rng.standard_normal(count)]
    for each in new[1:]:
        readings.append(rho * readings[-1] + each)
    return np.array(readings).T


def growth(readings: np.ndarray) -> float:
    found = Correlation()
    for each in readings.tolist():
        found.add(each)
    return found.growth


def test_u_of_means_is_their_scatter_whatever_readings_remember() -> None:
    for seed in range(15):
        rng = np.random.default_rng(seed)
        rho, size = float(rng.uniform(0.3, 0.9)), int(rng.integers(10, 70))
        drawn = windows(rng, rho, 60, size)
        u = np.sqrt(growth(drawn) * drawn.var(axis=1, ddof=1).mean() / size)
        between = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
        true = np.sqrt(np.power(rho, between).sum()) / size
        assert u == pytest.approx(true, rel=0.35), (seed, rho, size)


@pytest.mark.exhaustive
def test_independent_readings_have_scatter_over_root_n() -> None:
    rng, resolution_v = np.random.default_rng(1), 1e-5
    for _ in range(500):
        count, size, noise_v = int(rng.integers(2, 120)), int(rng.integers(3, 40)), 10.0 ** rng.uniform(-5.5, -3.0)
        drift_v = noise_v * rng.normal(0.0, 0.3) * np.linspace(0.0, 1.0, size)
        readings = noise_v * rng.standard_normal((count, size)) + drift_v
        assert growth(np.round(readings / resolution_v) * resolution_v) == 1.0
