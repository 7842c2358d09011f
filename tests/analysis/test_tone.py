"""Sines in records of a meter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack_tests.cells import few

from vcfbench.analysis.tone import fit_tone, true_spacing_s
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

INTERVAL_S, APERTURE_S = 5e-3, 3e-3


def record(rng: np.random.Generator, frequency_hz: float, late_s: float, cube: float = 0.0) -> np.ndarray:
    """Return 512 means over the aperture of a sine of 0.2 V, mains and white noise."""
    starts = np.arange(512) * (INTERVAL_S + late_s)
    times = starts[:, None] + (np.arange(64) + 0.5) / 64.0 * APERTURE_S
    phase = rng.uniform(-math.pi, math.pi)
    wave = 0.2 * np.cos(2.0 * math.pi * frequency_hz * times + phase)
    mains = 1.4e-3 * np.cos(2.0 * math.pi * 50.0 * times + rng.uniform(-math.pi, math.pi))
    return np.asarray((wave + cube * wave**3 + mains).mean(axis=1) + 3e-4 * rng.standard_normal(512) - 0.04)


@pytest.mark.exhaustive
def test_tone_is_found_with_unknown_spacing() -> None:
    rng = np.random.default_rng(5)
    z = []
    for _ in range(200):
        frequency_hz, late_s = rng.uniform(4.0, 40.0), rng.uniform(0.0, 0.9e-3)
        samples = record(rng, frequency_hz, late_s)
        spacing_s = true_spacing_s([(frequency_hz, samples)], INTERVAL_S)
        assert spacing_s == pytest.approx(INTERVAL_S + late_s, rel=1e-4)
        tone = fit_tone(samples, spacing_s, APERTURE_S, frequency_hz, mains_hz=50.0)
        z.append((tone.amplitude - 0.2) / tone.u_amplitude)
    assert abs(float(np.mean(z))) < 0.25
    assert 0.85 < float(np.std(z)) < 1.2  # u from 28 degrees of freedom each


def in_noise_of_a_mode(
    seed: int, interval_s: float, parts: Sequence[float], tone: float
) -> tuple[float, list[tuple[float, NDArray[np.float64]]]]:
    """The interval, and sines of parts of a split behind the noise of its mode, of standard deviation 1."""
    rng = np.random.default_rng(seed)
    split_hz, late_s, tau_s = rng.uniform(40.0, 80.0), rng.uniform(0.1e-3, 0.9e-3), rng.uniform(0.3, 1.6)
    spacing_s = interval_s + late_s
    turn = np.exp((2j * math.pi * split_hz - 1.0 / tau_s) * spacing_s)
    records = []
    for part in parts:
        force = rng.standard_normal((2, 512)) * math.sqrt(1.0 - abs(turn) ** 2)
        noise = [complex(*rng.standard_normal(2))]
        for push in (force[0] + 1j * force[1])[1:]:
            noise.append(noise[-1] * turn + push)
        cycles = part * split_hz * spacing_s * np.arange(512) + rng.uniform()
        records.append((part * split_hz, tone / (1.0 - part**2) * np.cos(2.0 * math.pi * cycles) + np.real(noise)))
    return spacing_s, records


@pytest.mark.parametrize("seed", few(range(200), 2, 3, 24))
def test_noise_of_a_narrow_mode_is_no_spacing_sine(seed: int) -> None:
    """It is ten times as strong as the tones, and a line in each record."""
    spacing_s, records = in_noise_of_a_mode(seed, INTERVAL_S, (0.08, 0.18, 0.26, 0.36, 0.48, 0.65, 0.8), 0.1)
    assert true_spacing_s(records, INTERVAL_S) == pytest.approx(spacing_s, rel=2e-3)


@pytest.mark.parametrize("seed", few(range(60), 12, 40))
def test_sines_that_noise_hides_have_a_spacing_all_the_same(seed: int) -> None:
    """The fit of the strongest one may walk away; what the spacing is then matters little."""
    spacing_s, records = in_noise_of_a_mode(seed, 47e-3, (0.012, 0.04, 0.08), 0.02)
    assert true_spacing_s(records, 47e-3) == pytest.approx(spacing_s, abs=2e-3)


def test_the_third_harmonic_shows_a_cube_with_its_sign() -> None:
    """A cube c of a sine A leaves c A^3 / 4 at three times its frequency."""
    rng = np.random.default_rng(1)
    for cube in (0.5, -0.5):
        third = [
            fit_tone(record(rng, 11.0, 3e-4, cube), INTERVAL_S + 3e-4, APERTURE_S, 11.0, mains_hz=50.0).third
            for _ in range(9)
        ]
        assert np.mean(third) == pytest.approx(cube * 0.2**3 / 4.0, abs=3e-5)


def test_noise_about_three_times_the_frequency_is_that_of_the_third_harmonic() -> None:
    """A noise of 30 to 36 Hz, ten times as strong as what is white."""
    rng, steps = np.random.default_rng(8), np.arange(512)
    frequencies = rng.uniform(30.0, 36.0, (80, 40, 1))
    found = [
        fit_tone(
            np.cos(2.0 * math.pi * 11.0 * INTERVAL_S * steps)
            + 1e-3 * np.cos(2.0 * math.pi * (each * INTERVAL_S * steps + rng.uniform(size=(40, 1)))).sum(axis=0)
            + 1e-4 * rng.standard_normal(512),
            *(INTERVAL_S, 0.0, 11.0),
            mains_hz=50.0,
        )
        for each in frequencies
    ]
    thirds, u = np.array([(each.third, each.u_third) for each in found]).T
    assert np.std(thirds) == pytest.approx(np.sqrt(np.mean(u**2)), rel=0.25)
    assert max(each.u_amplitude for each in found) < 0.2 * u.min()


@pytest.mark.parametrize(("count", "frequency_hz"), [(63, 10.0), (512, 96.0)])
def test_samples_that_hold_no_such_sine_are_refused(count: int, frequency_hz: float) -> None:
    with pytest.raises(ConfigError, match="hold no sine"):
        fit_tone(np.ones(count), INTERVAL_S, APERTURE_S, frequency_hz, mains_hz=50.0)


@pytest.mark.parametrize("turns", [1 / 3, 0.25, 0.2, 0.4])
def test_tone_that_its_harmonic_is_folded_onto_does_not_count(turns: float) -> None:
    steps = np.arange(512)
    samples = np.cos(2.0 * math.pi * turns * steps) + 1e-3 * np.cos(4.0 * math.pi * turns * steps + 1.0)
    assert not fit_tone(samples, 5e-3, 0.0, turns / 5e-3, mains_hz=50.0).alone
    assert fit_tone(samples, 5e-3, 0.0, (turns - 0.01) / 5e-3, mains_hz=50.0).alone
