from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.sine_fit import fit_sine, phase_difference
from vcfbench.errors import BenchError, ConfigError

RATE = 50_000.0
TIMES = np.arange(1000) / RATE


def wave(frequency: float, amplitude: float, phase: float, offset: float) -> np.ndarray:
    return offset + amplitude * np.cos(2.0 * math.pi * frequency * TIMES + phase)


def between(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def test_a_clean_sine_is_found_exactly() -> None:
    fit = fit_sine(wave(3488.9, 1.25, -2.0, 0.3), 1.0 / RATE)
    assert fit.frequency_hz == pytest.approx(3488.9, abs=1e-7)
    assert (fit.amplitude, fit.phase_rad, fit.offset) == pytest.approx((1.25, -2.0, 0.3), abs=1e-9)
    assert (fit.dof, fit.residual_rms) == (996, pytest.approx(0.0, abs=1e-9))


def test_fifty_random_sines_lie_within_the_stated_uncertainty() -> None:
    """All of 50 within 4 u, each of four quantities; 2.0 to 20 kHz, all phases, 0.5 to 50 % noise."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        frequency, amplitude, phase = rng.uniform(200, 20_000), rng.uniform(0.01, 10), rng.uniform(-3.1, 3.1)
        offset, noise = rng.uniform(-2, 2), amplitude * rng.uniform(0.005, 0.5)
        fit = fit_sine(wave(frequency, amplitude, phase, offset) + noise * rng.standard_normal(1000), 1.0 / RATE)
        assert abs(fit.frequency_hz - frequency) < 4.0 * fit.u_frequency_hz
        assert abs(fit.amplitude - amplitude) < 4.0 * fit.u_amplitude
        assert abs(between(fit.phase_rad - phase)) < 4.0 * fit.u_phase_rad
        assert abs(fit.offset - offset) < 4.0 * fit.u_offset
        assert fit.residual_rms == pytest.approx(noise, rel=4.0 / math.sqrt(2000))


@pytest.mark.exhaustive
def test_stated_uncertainties_are_what_repetition_shows() -> None:
    """600 records, 4.3 cycles: sd of z within 0.9 and 1.1, mean within 0.15; known frequency likewise."""
    rng, scores = np.random.default_rng(2), []
    for _ in range(600):
        record = wave(215.0, 1.0, 0.7, -0.2) + 0.1 * rng.standard_normal(1000)
        fit = fit_sine(record, 1.0 / RATE)
        scores.append(
            [
                (fit.frequency_hz - 215.0) / fit.u_frequency_hz,
                (fit.amplitude - 1.0) / fit.u_amplitude,
                (fit.phase_rad - 0.7) / fit.u_phase_rad,
                (fit.offset + 0.2) / fit.u_offset,
            ]
        )
    for z in np.array(scores).T:
        assert 0.9 < z.std() < 1.1
        assert abs(z.mean()) < 0.15


def test_uncertainty_is_the_bound_of_cramer_and_rao() -> None:
    """Many whole cycles: u(f) = sqrt(6) s / (pi A T sqrt(N)), u(A) = s sqrt(2 / N), u(first phase) = 2 u(A)/A."""
    rng = np.random.default_rng(3)
    fit = fit_sine(wave(5000.0, 2.0, 0.1, 0.0) + 0.01 * rng.standard_normal(1000), 1.0 / RATE)
    s = fit.residual_rms
    assert fit.u_frequency_hz == pytest.approx(math.sqrt(6.0) * s / (math.pi * 2.0 * 0.02 * math.sqrt(1000)), rel=0.01)
    assert fit.u_amplitude == pytest.approx(s * math.sqrt(2.0 / 1000), rel=0.01)
    assert fit.u_phase_rad == pytest.approx(2.0 * s * math.sqrt(2.0 / 1000) / 2.0, rel=0.01)


def test_phase_between_channels_to_a_twentieth_of_a_degree() -> None:
    """Oscilloscope-like: 8 bits, 1 % noise, amplitudes and offsets apart: 50 random phases within 4 u < 0.2 deg."""
    rng, scores = np.random.default_rng(4), []
    for _ in range(50):
        lead, phase, frequency = rng.uniform(-179, 179), rng.uniform(-3, 3), rng.uniform(3300, 3500)
        first = wave(frequency, 1.0, phase, 0.1) + 0.01 * rng.standard_normal(1000)
        second = wave(frequency, 0.5, phase + math.radians(lead), -0.2) + 0.005 * rng.standard_normal(1000)
        channels = [np.round(channel * 100.0) / 100.0 for channel in (first, second)]
        found = phase_difference(*channels, 1.0 / RATE)
        scores.append(math.remainder(found.phase_deg - lead, 360.0) / found.u_phase_deg)
        assert found.u_phase_deg < 0.05
        assert abs(found.gain - 0.5) < 4.0 * found.u_gain
        assert abs(found.frequency_hz - frequency) < 4.0 * found.u_frequency_hz
    assert np.abs(scores).max() < 4.0
    assert 0.75 < np.std(scores) < 1.25


@pytest.mark.exhaustive
def test_uncertainty_of_the_phase_difference_is_what_repetition_shows() -> None:
    rng, scores = np.random.default_rng(5), []
    for _ in range(400):
        noise = rng.standard_normal((2, 1000)) * [[0.2], [0.02]]
        found = phase_difference(
            wave(400.0, 1.0, 0.0, 0.0) + noise[0], wave(400.0, 2.0, 1.0, 0.0) + noise[1], 1.0 / RATE
        )
        scores.append((math.radians(found.phase_deg) - 1.0) / math.radians(found.u_phase_deg))
    assert 0.9 < np.std(scores) < 1.1
    assert abs(np.mean(scores)) < 0.15


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


def test_channels_of_different_length_are_refused() -> None:
    with pytest.raises(ConfigError, match="as long as each other"):
        phase_difference(np.ones(10), np.ones(11), 1e-3)
    with pytest.raises(ConfigError, match="do not tell"):
        fit_sine(np.arange(100.0), 1e-3, 1e-9)
