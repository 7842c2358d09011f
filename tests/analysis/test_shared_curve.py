"""Slopes of one device's runs over the same rates, whichever rates each run visited."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.shared_curve import Windows, slopes_over

WHITE_DEG_S = 2.8e-3
PLANS = (
    (200, 100, 50, 20, 10, 5, 2, 1, 0, -1, -2, -5, -10, -20, -50, -100, -200),
    *((50, 0, -50), (100, 0, -100), (80, 40, 0, -40, -80), (300, 200, 100, 0, -100, -200, -300)),
)


def seen(random: np.random.Generator, rates: tuple[int, ...], curve: np.ndarray, slope: float = 1.0) -> Windows:
    """The windows of a gyroscope whose output has this curve of second and third order, and a kink at rest."""
    rate = np.array(rates, dtype=float)
    x = rate / 200.0
    bent = 200.0 * (curve[0] * x**2 + curve[1] * x**3 + curve[2] * np.abs(x))
    output = slope * rate + bent + WHITE_DEG_S * random.standard_normal(rate.size)
    return Windows(rate, output, WHITE_DEG_S**2 * np.eye(rate.size), WHITE_DEG_S)


def line(rates: tuple[int, ...], curve: np.ndarray) -> float:
    """What the curve adds to the slope of the line through these rates."""
    x = np.array(rates, dtype=float) / 200.0
    bent = 200.0 * (curve[0] * x**2 + curve[1] * x**3 + curve[2] * np.abs(x))
    return float(np.polyfit(200.0 * x, bent, 1)[0])


def test_change_is_found_over_the_rates_of_both() -> None:
    random, z, found = np.random.default_rng(7), [], []
    for number in range(24):
        curve = 1e-3 * random.standard_normal(3) * (2.0, 2.0, 0.5)
        first, other = (PLANS[place] for place in random.permutation(len(PLANS))[:2])
        true = 5e-4 * (number % 2)
        over = min((first, other), key=lambda each: max(each) - min(each))
        runs = [seen(random, first, curve), seen(random, other, curve, 1.0 + true), seen(random, PLANS[0], curve)]
        slopes = slopes_over(over, runs)
        ratio = slopes.values[1] / slopes.values[0]
        by = np.array([-1.0, 1.0, 0.0]) / slopes.values[0]
        u = math.sqrt(by @ slopes.covariance @ by)
        z.append((ratio - 1.0 - true) / u)
        found.append(abs(ratio - 1.0) > 1.96 * u)
        assert slopes.values[0] == pytest.approx(1.0 + line(over, curve), abs=6.0 * u)
    assert math.sqrt(np.mean(np.square(z))) < 1.3
    assert np.mean(found[1::2]) > 0.8
    assert np.mean(np.abs(z) < 1.96) > 0.85


def test_runs_at_the_same_rates_differ_as_their_lines_do() -> None:
    random = np.random.default_rng(3)
    runs = [seen(random, PLANS[0], np.array([2e-3, -1e-3, 0.0])) for _ in range(2)]
    slopes, lines = slopes_over(PLANS[0], runs), [each.slope for each in runs]
    assert slopes.values[1] - slopes.values[0] == pytest.approx(lines[1][0] - lines[0][0], abs=1e-5)
    assert math.sqrt(np.trace(slopes.covariance)) == pytest.approx(math.hypot(lines[0][1], lines[1][1]), rel=0.4)


def test_means_of_windows_have_noise_of_means() -> None:
    rate = np.array([10.0, 0.0, 10.001, -10.0])
    windows = Windows(rate, 2.0 * rate, np.eye(4), 1.0).at([10.0, -10.0], 1e-3, 1e-2)
    assert windows.output_deg_s == pytest.approx(2.0 * np.array([10.0005, -10.0]))
    assert windows.covariance == pytest.approx(np.diag([0.5, 1.0]))
