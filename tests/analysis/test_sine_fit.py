from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.sine_fit import fit_sine, phase_difference, u_of_frequency
from vcfbench.errors import BenchError, ConfigError

RATE = 50_000.0
TIMES = np.arange(1000) / RATE


def wave(frequency: float, amplitude: float, phase: float, offset: float) -> np.ndarray:
    return offset + amplitude * np.cos(2.0 * math.pi * frequency * TIMES + phase)


def between(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def bound(noise: float, amplitude: float) -> tuple[float, float, float]:
    """Cramer and Rao's bounds over many cycles: frequency, amplitude, and phase at the first sample."""
    u = noise * math.sqrt(2.0 / TIMES.size)
    return math.sqrt(6.0) * noise / (math.pi * amplitude * 0.02 * math.sqrt(TIMES.size)), u, 2.0 * u / amplitude


def test_a_clean_sine_is_found_exactly() -> None:
    fit = fit_sine(wave(3488.9, 1.25, -2.0, 0.3), 1.0 / RATE)
    assert fit.frequency_hz == pytest.approx(3488.9, abs=1e-7)
    assert (fit.amplitude, fit.phase_rad) == pytest.approx((1.25, -2.0), abs=1e-9)


@pytest.mark.exhaustive
def test_random_sines_scatter_by_cramer_rao_bound() -> None:
    """A scatter of 200 is known to 5 %; 0.2 to 20 kHz, all phases, 0.5 to 50 % noise, four cycles and more."""
    rng, scores = np.random.default_rng(1), []
    for _ in range(200):
        frequency, amplitude, phase = rng.uniform(200, 20_000), rng.uniform(0.01, 10), rng.uniform(-3.1, 3.1)
        offset, noise = rng.uniform(-2, 2), amplitude * rng.uniform(0.005, 0.5)
        fit = fit_sine(wave(frequency, amplitude, phase, offset) + noise * rng.standard_normal(1000), 1.0 / RATE)
        off = fit.frequency_hz - frequency, fit.amplitude - amplitude, between(fit.phase_rad - phase)
        scores.append(np.array(off) / bound(noise, amplitude))
    for z in np.array(scores).T:
        assert np.abs(z).max() < 4.5
        assert 0.85 < z.std() < 1.15


def test_phase_between_channels_to_a_twentieth_of_a_degree() -> None:
    """Oscilloscope-like: 8 bits, 1 % noise, amplitudes and offsets apart: 50 random phases within 0.2 deg."""
    rng, scores = np.random.default_rng(4), []
    for _ in range(50):
        lead, phase, frequency = rng.uniform(-179, 179), rng.uniform(-3, 3), rng.uniform(3300, 3500)
        first = wave(frequency, 1.0, phase, 0.1) + 0.01 * rng.standard_normal(1000)
        second = wave(frequency, 0.5, phase + math.radians(lead), -0.2) + 0.005 * rng.standard_normal(1000)
        channels = [np.round(channel * 100.0) / 100.0 for channel in (first, second)]
        found = phase_difference(*channels, 1.0 / RATE)
        scores.append(math.remainder(found.phase_deg - lead, 360.0))
        assert abs(found.gain - 0.5) < 2e-3
    assert np.abs(scores).max() < 0.2
    assert np.std(scores) < 0.05


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.ones(4), "at least five"),
        (np.array([1.0, np.nan, 1.0, 2.0, 3.0]), "finite"),
        (np.ones(100), "no sine"),
    ],
)
def test_what_is_no_sine_is_refused(samples: np.ndarray, message: str) -> None:
    with pytest.raises(BenchError, match=message):
        fit_sine(samples, 1e-3)


@pytest.mark.parametrize(("noise", "points"), [(0.003, 1000), (0.03, 300)])
def test_a_fitted_frequency_scatters_by_its_u(noise: float, points: int) -> None:
    t, random = 5e-3 / points * np.arange(points), np.random.default_rng(1)
    off = []
    for _ in range(40):
        taken = 2.0 * np.cos(2.0 * math.pi * 3488.9 * t + random.uniform(0.0, 6.0)) + noise * random.standard_normal(
            points
        )
        found = fit_sine(taken, t[1])
        off.append((found.frequency_hz - 3488.9) / u_of_frequency(taken, t[1], found))
    assert np.std(off) == pytest.approx(1.0, abs=0.35)
    assert abs(np.mean(off)) < 0.5


def test_channels_of_different_length_are_refused() -> None:
    with pytest.raises(ConfigError, match="as long as each other"):
        phase_difference(np.ones(10), np.ones(11), 1e-3)
    with pytest.raises(ConfigError, match="are too short"):
        fit_sine(np.arange(100.0), 1e-3, 1e-9)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("apart_hz", "noise"), [(10.0, 0.003), (20.0, 0.01), (80.0, 0.03)])
def test_channels_that_tell_two_frequencies_settle_between_them(apart_hz: float, noise: float) -> None:
    """Drive and a sense signal that still rings: the weights follow what is left, so that rounds gain little each."""
    t = 5e-7 * np.arange(1000)
    left = np.random.default_rng(3).standard_normal((2, t.size))
    drive = np.cos(2.0 * math.pi * 24_490.0 * t) + noise * left[0]
    sense = 2.2 * np.cos(2.0 * math.pi * (24_490.0 - apart_hz) * t + 1.0) + 2.2 * noise * left[1]
    found = phase_difference(drive, sense, 5e-7)
    assert found.phase_deg == pytest.approx(math.degrees(1.0) - 180.0 * apart_hz * t[-1], abs=0.5)
    for size in (1e-9, 1e-6, 1e6):  # in any unit
        assert phase_difference(size * drive, size * sense, 5e-7).phase_deg == pytest.approx(found.phase_deg, abs=1e-6)


def test_a_gain_is_that_of_the_second_over_the_first() -> None:
    t = 1e-5 * np.arange(1000)
    first, second = (size * np.cos(2.0 * math.pi * 1234.5 * t + turn) for size, turn in ((2.0, 0.0), (3.0, 0.5)))
    assert phase_difference(first, second, 1e-5).gain == pytest.approx(1.5)
