from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lsim, lti

from vcfbench.analysis.resonance import SenseMode, fit_rate_response, fit_resonance, rate_response
from vcfbench.errors import ConfigError

DRIVE, SENSE, Q = 3488.9, 3464.1, 1224.0
IN_PHASE = 3342.0
POINTS = np.concatenate([np.geomspace(0.1, 18.0, 12), np.linspace(19.0, 30.0, 12), np.geomspace(32.0, 60.0, 6)])


@pytest.mark.parametrize(
    ("others", "plus", "peak", "minus"),
    [
        ((), 13.49, 24.76, 38.6),
        ((SenseMode(IN_PHASE, Q, 1.0),), 14.24, 24.73, 35.0),
        ((SenseMode(IN_PHASE, Q, -1.0),), 12.60, None, 46.9),
    ],
)
def test_points_of_the_papers_gyroscope(
    others: tuple[SenseMode, ...], plus: float, peak: float | None, minus: float
) -> None:
    gains = 0.0125 * rate_response(POINTS, DRIVE, DRIVE - SENSE, Q, others)
    found = fit_rate_response(POINTS, gains, 1e-6, DRIVE, others)
    assert found.plus_3_db.frequency_hz == pytest.approx(plus, abs=0.01)
    assert peak is None or found.peak.frequency_hz == pytest.approx(peak, abs=0.01)
    assert found.minus_3_db.frequency_hz == pytest.approx(minus, abs=0.06)
    assert found.split_hz == pytest.approx(24.8, abs=1e-6)
    assert found.q == pytest.approx(Q, rel=1e-6)
    assert found.static_gain == pytest.approx(0.0125, rel=1e-7)
    assert others or found.peak_gain == pytest.approx(8.8, abs=0.06)


def test_high_q_gives_the_closed_form() -> None:
    """df^2 / (df^2 - f^2) far below the carrier: +3 dB at sqrt(1 - 1/sqrt 2) df."""
    f = np.array([1.0, 5.0, 13.0])
    assert rate_response(f, 1e6, 24.8, 1e9) == pytest.approx(24.8**2 / (24.8**2 - f**2), rel=1e-4)


@pytest.mark.exhaustive
@pytest.mark.parametrize("f", [3.0, 13.5, 30.0])
def test_against_the_equation_of_motion(f: float) -> None:
    """A force cos(2 pi f t) sin(omega_d t) on the mode, integrated, demodulated; against a constant force."""
    drive, split, q = 400.0, 24.8, 100.0
    omega = 2.0 * math.pi * (drive - split)
    mode = lti([omega**2], [1.0, omega / q, omega**2])
    times = np.arange(0.0, 3.0, 5e-5)
    swing = []
    for modulation in (f, 0.0):
        force = np.cos(2.0 * math.pi * modulation * times) * np.sin(2.0 * math.pi * drive * times)
        moved = lsim(mode, force, times)[1] * np.sin(2.0 * math.pi * drive * times)
        settled = times >= 1.0  # whole cycles of every f here, and of the carrier
        line = np.exp(-2j * math.pi * modulation * times[settled])
        swing.append(abs(np.mean(moved[settled] * line)) * (2.0 if modulation else 1.0))
    assert rate_response(f, drive, split, q)[0] == pytest.approx(swing[0] / swing[1], rel=2e-3)


@pytest.mark.exhaustive
def test_fifty_random_gyroscopes_lie_within_the_stated_uncertainty() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        split, q, gain = rng.uniform(15.0, 35.0), rng.uniform(400.0, 3000.0), rng.uniform(0.005, 0.05)
        points = POINTS * split / 24.8
        clean = gain * rate_response(points, DRIVE, split, q)
        noise = 0.003 * clean + 1e-3 * gain
        found = fit_rate_response(points, clean + noise * rng.standard_normal(clean.size), noise, DRIVE)
        assert abs(found.split_hz - split) < 4.0 * found.u_split_hz
        assert abs(found.q - q) < 4.0 * found.u_q
        assert abs(found.static_gain - gain) < 4.0 * found.u_static_gain
        assert found.chi_square < found.dof + 5.0 * math.sqrt(2.0 * found.dof)


@pytest.mark.exhaustive
def test_stated_uncertainties_are_what_repetition_shows() -> None:
    rng, scores = np.random.default_rng(4), []
    truth = fit_rate_response(POINTS, rate_response(POINTS, DRIVE, 24.8, Q), 1e-3, DRIVE)
    clean = rate_response(POINTS, DRIVE, 24.8, Q)
    for _ in range(250):
        found = fit_rate_response(POINTS, clean * (1.0 + 0.005 * rng.standard_normal(30)), 0.005 * clean, DRIVE)
        row = [(found.split_hz - 24.8) / found.u_split_hz, (found.q - Q) / found.u_q]
        for name in ("plus_3_db", "peak", "minus_3_db"):
            point = getattr(found, name)
            row.append((point.frequency_hz - getattr(truth, name).frequency_hz) / point.u_frequency_hz)
        scores.append(row)
    for z in np.array(scores).T:
        assert 0.9 < z.std() < 1.1
        assert abs(z.mean()) < 0.2


def test_a_driven_mode() -> None:
    """50 random modes within 4 u, and the scatter of 50 z-scores near 1 (10 % is one sigma of it)."""
    rng, scores = np.random.default_rng(5), []
    for _ in range(50):
        frequency, q, peak = rng.uniform(2500, 5000), rng.uniform(300, 3000), rng.uniform(0.1, 10)
        f = frequency + frequency / q * np.linspace(-4.0, 4.0, 25)
        clean = peak / q / np.abs(1.0 - (f / frequency) ** 2 + 1j * f / (frequency * q))
        found = fit_resonance(f, clean * (1.0 + 0.01 * rng.standard_normal(25)), 0.01 * clean)
        scores.append(
            [
                (found.frequency_hz - frequency) / found.u_frequency_hz,
                (found.q - q) / found.u_q,
                (found.peak - peak) / found.u_peak,
            ]
        )
    assert np.abs(scores).max() < 4.0
    assert np.std(scores, axis=0) == pytest.approx([1.0] * 3, abs=0.3)


def test_what_has_no_resonance_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least 4"):
        fit_resonance([1.0, 2.0, 3.0], [1.0, 2.0, 1.0], 0.1)
    with pytest.raises(ConfigError, match="positive"):
        fit_resonance([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 0.0, 1.0], 0.1)
