"""Charts of repeated results: the handbook's example, what is shared, a creep, and what chance alone does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.control_chart import cusum, recursive_residuals

HANDBOOK = (
    *(324.925, 324.675, 324.725, 324.350, 325.350, 325.225, 324.125, 324.525, 325.225, 324.600),
    *(324.625, 325.150, 328.325, 327.250, 327.825, 328.500, 326.675, 327.775, 326.875, 328.350),
)
"""NIST/SEMATECH e-Handbook 6.3.2.3: means of groups, target 325, k = 0.3175."""


def test_the_example_of_the_handbook() -> None:
    found = cusum(np.array(HANDBOOK) - 325.0, 0.3175)
    assert found[12:] == pytest.approx([3.01, 4.94, 7.45, 10.63, 11.99, 14.44, 16.00, 19.04], abs=0.006)


def covariance(entries: int, own_ppm: float, shared_ppm: float, certificate_ppm: float) -> np.ndarray:
    """Return that of a certificate and `entries` after it, which share an instrument with each other alone."""
    made = np.diag([certificate_ppm**2, *[own_ppm**2] * entries])
    made[1:, 1:] += shared_ppm**2
    return made


@pytest.mark.exhaustive
def test_unchanged_device_has_independent_residuals_of_unit_size() -> None:
    rng, size = np.random.default_rng(1), covariance(12, 12.0, 30.0, 14.0)
    drawn = rng.multivariate_normal(np.zeros(13), size, 4000)
    residuals = np.array([recursive_residuals(each, size) for each in drawn])
    assert np.cov(residuals.T) == pytest.approx(np.eye(12), abs=0.08)
    assert np.mean([cusum(each).max() > 5.0 for each in residuals]) < 0.02


def test_a_creep_that_no_single_run_shows_is_seen() -> None:
    """10 ppm a month: E_n to the certificate stays below 1 for a year, where another meter than its own is used."""
    rng, size = np.random.default_rng(2), covariance(12, 12.0, 70.0, 14.0)
    creep = 10.0 * np.arange(13)
    drawn = rng.multivariate_normal(creep, size, 300)
    months = [int(np.argmax(cusum(recursive_residuals(each, size)) > 5.0)) + 1 for each in drawn]
    assert creep[-1] < 2.0 * np.hypot(np.hypot(12.0, 70.0), 14.0)
    assert np.mean([cusum(recursive_residuals(each, size))[-1] > 5.0 for each in drawn]) > 0.99
    assert np.median(months) <= 8


def test_two_values_without_noise_are_compared() -> None:
    assert recursive_residuals(np.zeros(3), np.ones((3, 3))) == pytest.approx([0.0, 0.0])


def test_a_prediction_is_the_mean_by_weights_of_all_before() -> None:
    """0 +- 2 and 10 +- 1 predict 8 +- 0.89 for 5 +- 3."""
    residuals = recursive_residuals(np.array([0.0, 10.0, 5.0]), np.diag([4.0, 1.0, 9.0]))
    assert residuals == pytest.approx([10.0 / math.sqrt(5.0), -3.0 / math.sqrt(9.8)])
