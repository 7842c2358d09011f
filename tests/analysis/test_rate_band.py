"""The closed form of the rate response through the gains of sampled sines."""

from __future__ import annotations

import cmath
import math
from itertools import product

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

from vcfbench.analysis.rate_band import (
    Known,
    _filtered,
    _smooth_u,
    fit_rate_band,
    response_phase_deg,
    split_guess_hz,
    split_response,
)
from vcfbench.analysis.tone import Tone
from vcfbench.errors import ConfigError


def response(f: np.ndarray, split: float, q: float, share: float, lag: float) -> np.ndarray:
    """Return the response in P and R, as docs/theory.md derives it: another form than that of the module."""
    s, wd = 2j * math.pi * np.append(f, 0.0), 2.0 * math.pi * 3488.9
    total = np.zeros(s.shape, dtype=complex)
    for part, w in ((1.0, wd - 2.0 * math.pi * split), (share, 2.0 * math.pi * 3342.0)):
        p, r = s**2 + w / q * s + w**2 - wd**2, 2.0 * s * wd + w * wd / q
        total += part * (p * math.cos(lag) - r * math.sin(lag)) / (p**2 + r**2)
    return np.asarray(np.abs(total[:-1] / total[-1]))


def test_the_response_is_that_of_p_and_r() -> None:
    f = np.linspace(0.1, 60.0, 300)
    mine = split_response(f, 3488.9, np.array([24.8, 1224.0, 0.8, 146.9, 0.05]))
    np.testing.assert_allclose(mine, response(f, 24.8, 1224.0, 0.8, 0.05), rtol=1e-9)


def test_phase_of_the_response_has_modes_and_filter() -> None:
    """Of fourth order and 100 Hz: two pairs of poles, 1 / (u^2 + a u + 1) with a of 0.765 and 1.848."""
    wd = 2.0 * math.pi * 3488.9
    for at_hz in (0.3, 13.0, 24.8, 40.0, 70.0):
        total = []
        for s in (2j * math.pi * at_hz, 0j):
            sum_ = 0j
            for part, w in ((1.0, wd - 2.0 * math.pi * 24.8), (0.8, 2.0 * math.pi * 3342.0)):
                p, r = s**2 + w / 1224.0 * s + w**2 - wd**2, 2.0 * s * wd + w * wd / 1224.0
                sum_ += part * (p * math.cos(0.05) - r * math.sin(0.05)) / (p**2 + r**2)
            total.append(sum_)
        u = 1j * at_hz / 100.0
        low_pass = 1.0 / ((u**2 + 0.7653668647 * u + 1.0) * (u**2 + 1.8477590650 * u + 1.0))
        expected = math.degrees(cmath.phase(total[0] / total[1] * low_pass))
        seen = response_phase_deg(at_hz, Known(3488.9), np.array([24.8, 1224.0, 0.8, 146.9, 0.05]))
        assert seen == pytest.approx(expected, abs=1e-5)


@pytest.mark.exhaustive
def test_split_and_q_come_back_within_their_uncertainties() -> None:
    rng = np.random.default_rng(2)
    f = np.concatenate([np.linspace(5.0, 55.0, 14), 24.8 * np.array([0.9, 0.95, 0.98, 1.0, 1.02, 1.05, 1.1])])
    true = 1.9 * response(f, 24.8, 1224.0, 0.8, 0.02) / np.sqrt(1.0 + (f / 100.0) ** 8)
    z = []
    for _ in range(30):
        tones = [
            Tone(at, 0.1 * gain + 4e-5 * rng.standard_normal(), 4e-5 * math.sqrt(rng.chisquare(28) / 28), 0.0, 5e-3, 28)
            for at, gain in zip(f.tolist(), true.tolist(), strict=True)
        ]
        band = fit_rate_band(tones, 0.1, Known(3488.9))
        (split_hz, u_split_hz), (q, u_q) = band.split_hz, band.q
        z.append([(split_hz - 24.8) / u_split_hz, (q - 1224.0) / u_q])
    assert np.abs(np.mean(z, axis=0)).max() < 0.45
    assert 0.75 < np.std(z, axis=0).min() < np.std(z, axis=0).max() < 1.25
    assert band.plus_3_db_hz[0] == pytest.approx(14.24, abs=0.2)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", few(range(12), 3))
def test_noise_of_third_harmonics_is_in_u_of_q(seed: int) -> None:
    """Of a split of 50 Hz, 150 Hz are folded onto the peak: Q was 3 to 130 u off where that noise did not count."""
    rng, split_hz, q = np.random.default_rng(seed), 50.0, 3000.0
    f = split_hz * np.concatenate([np.linspace(0.1, 0.8, 10), np.linspace(0.9, 1.1, 15), np.linspace(1.2, 1.6, 5)])
    level = split_response(f, 9000.0, [split_hz, q, 0.8, 400.0, 0.0])
    noise, thirds = rng.standard_normal((2, f.size))
    columns = np.array([f, level + 1e-3 * noise, 3e-2 * thirds]).T.tolist()
    tones = [Tone(at, seen, 1e-3, third, 5e-3, 28.0, u_third=3e-2) for at, seen, third in columns]
    band = fit_rate_band(tones, 1.0, Known(9000.0, 400.0, low_pass_hz=1e9))
    assert abs(band.q[0] - q) < 4.0 * band.q[1]


@pytest.mark.exhaustive
def test_what_the_closed_form_lacks_widens_the_uncertainty() -> None:
    """Gains that drift by 1 % in the order of the frequencies."""
    rng = np.random.default_rng(2)
    f = np.concatenate([np.linspace(5.0, 55.0, 14), 24.8 * np.array([0.9, 0.95, 0.98, 1.0, 1.02, 1.05, 1.1])])
    true = 0.19 * response(f, 24.8, 1224.0, 0.8, 0.02) / np.sqrt(1.0 + (f / 100.0) ** 8)
    seen = true * np.linspace(0.995, 1.005, f.size) + 4e-5 * rng.standard_normal(f.size)
    tones = [Tone(at, each, 4e-5, 0.0, 5e-3, 28) for at, each in zip(f.tolist(), seen.tolist(), strict=True)]
    blind, told = (fit_rate_band(tones, 0.1, Known(3488.9, off_form=share)) for share in (0.0, 1e-2))
    assert blind.chi_square > 9.0 * blind.dof
    by_noise = blind.q[1] / math.sqrt(blind.chi_square / blind.dof)
    assert 4.0 * by_noise < abs(blind.q[0] - 1224.0) < 2.0 * blind.q[1]
    assert told.chi_square < 2.0 * told.dof
    assert abs(told.q[0] - 1224.0) < 2.0 * told.q[1]


@pytest.mark.exhaustive
@pytest.mark.parametrize("side", few([1.0, -1.0], -1.0))
def test_high_q_mode_near_drive_is_found_on_its_side(side: float) -> None:
    """From a start far off the fit of the other side ended with a lag of 0.4 and the in-phase mode's sign turned."""
    rng, split = np.random.default_rng(4), side * 4.322
    f = 4.322 * np.array([0.05, 0.1, 0.3, 0.5, 0.7, 0.85, 0.93, 0.97, 0.99, 1.0, 1.01, 1.03, 1.07, 1.2, 1.4, 1.7, 2.5])
    parameters = np.array([split, 3890.0, 1.0, 117.5, 0.0])
    gains = split_response(f, 2790.0, parameters)
    tones = [Tone(at, each, 2e-5, 0.0, 5e-3, 28) for at, each in zip(f.tolist(), gains.tolist(), strict=True)]
    tones = [structs.replace(each, amplitude=each.amplitude + 2e-5 * rng.standard_normal()) for each in tones]
    band = fit_rate_band(tones, 1.0, Known(2790.0, in_phase_split_hz=140.0))
    assert abs(band.q[0] - 3890.0) < 4.0 * band.q[1]
    assert math.copysign(1.0, band.in_phase_share[0]) == side


def test_noise_of_tones_follows_modes_except_one_with_flicker() -> None:
    """One of the lowest tones had six times the noise of the others, and the weights swung: no noise by the modes."""
    f = np.concatenate([[4.6], np.linspace(10.0, 50.0, 9), 57.65 + np.array([-3.0, -1.5, 0.0, 1.5, 3.0, 6.0, 10.0])])
    shape = np.array([57.65, 28950.0, 1.0, 992.0, 0.0])
    gains, known = split_response(f, 23570.0, shape), Known(23570.0)
    u = 5e-6 * gains * np.where(f < 5.0, 6.0, 1.0)
    tones = [
        Tone(at, gain, by, 0.0, 5e-3, 28) for at, gain, by in zip(f.tolist(), gains.tolist(), u.tolist(), strict=True)
    ]
    found = _smooth_u(tones, np.insert(shape, 2, 1.0), known)
    assert found[f > 40.0] == pytest.approx(u[f > 40.0], rel=0.3)


def test_filter_far_below_split_leaves_guess_right() -> None:
    """Of a bandwidth of 4 Hz and a split of 12 Hz, 1.7 Hz was guessed: the filter's corner."""
    f = np.array([0.15, 0.5, 1.0, 2.2, 4.4, 7.7, 9.7, 12.1, 15.0, 18.4, 29.0])
    seen = response(f, 12.0, 6000.0, 0.8, 0.0) / np.sqrt(1.0 + (f / 4.0) ** 8)
    assert split_guess_hz(f, seen, (4.0, 4)) == pytest.approx(12.0, rel=0.1)


def test_the_split_is_guessed_from_a_few_gains() -> None:
    f = np.array([1.0, 4.0, 9.0, 16.0, 31.0, 48.0])
    assert split_guess_hz(f, response(f, 24.8, 1224.0, 0.0, 0.0)) == pytest.approx(24.8, rel=0.02)
    with pytest.raises(ConfigError, match="cannot be guessed"):
        split_guess_hz(f[:3], f[:3])


@pytest.mark.parametrize("seed", few([0, 5, 6, 9]))
def test_tone_between_the_modes_does_not_prevent_a_fit(seed: int) -> None:
    """At 48 Hz both modes of this gyroscope cancel but for 0.6 %; one in six such responses could not be fitted."""
    true = np.array([16.372558, 1527.1, 1.0594, 141.21, -0.0241])
    ratios = np.array([0.5, 0.54, 0.6, 0.7, 0.8, 0.88, 0.93, 0.96, 0.98, 0.99, 1.0, 1.01, 1.02, 1.04, 1.07, 1.12, 1.2])
    far = [0.3, 1.0, 2.0, 4.5, 6.5, 9.0, 12.0, 16.0, 20.0, 25.0, 31.0, 38.0, 48.0, 60.0]
    frequency_hz = np.array([*far, *(16.18 * ratios), 21.843, 24.27, 25.079, 26.697])
    level = 0.2458 * split_response(frequency_hz, 3489.987, true) / np.sqrt(1.0 + (frequency_hz / 100.0) ** 8)
    u = 2e-5 + 1.8e-4 * level
    seen = level + u * np.random.default_rng(seed).standard_normal(level.size)
    spacing_s = np.where(frequency_hz < 4.0, 0.047, 5e-3)
    columns = zip(frequency_hz, seen, u, spacing_s, strict=True)
    tones = [Tone(f, each, u_each, 0.0, spacing, 10.0) for f, each, u_each, spacing in columns]
    band = fit_rate_band(tones, 0.1, Known(3489.987))
    for (value, u), right in zip((band.split_hz, band.q), true, strict=False):
        assert abs(value - right) < 4.0 * u


def test_tone_noise_is_taken_at_its_frequency() -> None:
    """White force noise through both sense modes and a flat part, read two hertz either side of each tone."""
    drive, split, q, in_phase, share = 3488.9, 24.8, 1224.0, 147.0, 0.8
    f = np.concatenate([np.geomspace(3.0, 20.0, 12), np.linspace(21.0, 28.0, 15), np.geomspace(30.0, 60.0, 8)])

    def noise(at: np.ndarray) -> np.ndarray:
        own, other = drive - split, drive - in_phase
        bands = [
            np.abs(1.0 / (own**2 - s**2 + 1j * s * own / q) + share / (other**2 - s**2 + 1j * s * other / q)) ** 2
            for s in (drive + at, drive - at)
        ]
        return np.asarray(1e-4**2 * (0.1 + (bands[0] + bands[1]) * (2.0 * drive * split) ** 2 / 40.0))

    gains = response(f, split, q, share, 0.02) + np.sqrt(noise(f)) * np.random.default_rng(3).standard_normal(f.size)
    tones = []
    for at, gain in zip(f.tolist(), gains.tolist(), strict=True):
        lines = at + np.array([-2.5, -1.5, 1.5, 2.5])
        read = float(np.sqrt(noise(lines).mean()))
        tones.append(Tone(at, gain, read, 0.0, 0.01, 12.0, tuple(lines.tolist())))
    band = fit_rate_band(tones, 1.0, Known(drive, low_pass_hz=1e9))
    assert band.u_gain == pytest.approx(np.sqrt(noise(f)), rel=0.01)


@pytest.mark.exhaustive
@pytest.mark.parametrize("side", few([1.0, -1.0], -1.0))
@pytest.mark.parametrize("seed", few(range(12), 1))
def test_split_of_unknown_side_covers_both_sides(seed: int, side: float) -> None:
    """A wide mode near the drive: of which side it is moves the split by half a thousandth of a hertz."""
    drive_hz, split_hz, q, apart_hz = 3488.9, 8.0, 1307.0, 147.0
    f = split_hz * np.concatenate([np.linspace(0.1, 0.8, 12), np.linspace(0.85, 1.2, 15), np.linspace(1.25, 2.0, 8)])
    gain = split_response(f, drive_hz, np.array([side * split_hz, q, 0.5, apart_hz, 0.0]))
    noisy = (gain * (1.0 + 3e-5 * np.random.default_rng(seed).standard_normal(f.size))).tolist()
    tones = [Tone(at, each, 3e-5 * each, 0.0, 5e-3, 28.0) for at, each in zip(f.tolist(), noisy, strict=True)]
    band = fit_rate_band(tones, 1.0, Known(drive_hz, apart_hz, low_pass_hz=1e9))
    assert abs(band.split_hz[0] - split_hz) < 3.0 * band.split_hz[1]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("drive_hz", "split_hz"),
    few(list(product((1000.0, 3488.9, 12_000.0), (24.8, -24.8, 40.0, -40.0))), (1000.0, -24.8)),
)
def test_q_covers_mode_on_either_side_of_drive(drive_hz: float, split_hz: float) -> None:
    size, apart_hz = abs(split_hz), max(0.042 * drive_hz, 6.0 * abs(split_hz))
    f = size * np.concatenate([np.linspace(0.1, 0.8, 12), np.linspace(0.85, 1.2, 15), np.linspace(1.25, 2.0, 8)])
    q = 30.0 * drive_hz / size
    gain = split_response(f, drive_hz, np.array([split_hz, q, 1.0, apart_hz, 0.0]))
    noise = 1e-5 * np.random.default_rng(1).standard_normal(f.size)
    tones = [
        Tone(at, each, 1e-6, 0.0, 5e-3, 28.0) for at, each in zip(f.tolist(), (gain + noise).tolist(), strict=True)
    ]
    band = fit_rate_band(tones, 1.0, Known(drive_hz, apart_hz, low_pass_hz=1e9))
    assert band.split_hz[0] == pytest.approx(size, rel=1e-4)
    assert abs(band.q[0] - q) < 4.0 * band.q[1]
    assert band.q[1] < max(1e-3, 1.2 * size / drive_hz) * q
    assert band.in_phase_share[0] * split_hz > 0.0


@pytest.mark.parametrize("lag", [-2.0, -0.3, 0.0, 0.3])
@pytest.mark.parametrize("split_hz", [25.0, -25.0])
def test_response_with_its_filter_is_1_at_rest_and_has_the_sizes_of_both(lag: float, split_hz: float) -> None:
    shape = np.array([split_hz, 1200.0, 0.3, 150.0, lag])
    known = Known(3489.0, 150.0, low_pass_hz=60.0, low_pass_order=3)
    assert _filtered(np.array([1e-9]), known, shape) == pytest.approx(np.array([1.0 + 0.0j]), abs=1e-6)
    f = np.array([0.5, 5.0, 20.0, 30.0, 90.0])
    expected = split_response(f, 3489.0, shape) / np.sqrt(1.0 + (f / 60.0) ** 6)
    assert np.abs(_filtered(f, known, shape)) == pytest.approx(expected)


@pytest.mark.exhaustive
def test_a_sweep_has_its_split_and_q_in_any_unit() -> None:
    rng = np.random.default_rng(6)
    f = np.concatenate([np.linspace(5.0, 55.0, 12), 24.8 * np.array([0.95, 0.98, 1.0, 1.02, 1.05])])
    gains = response(f, 24.8, 1224.0, 0.8, 0.02) / np.sqrt(1.0 + (f / 100.0) ** 8) + 4e-4 * rng.standard_normal(f.size)

    def found(size: float) -> list[tuple[float, float]]:
        lines = [tuple((at + 0.4 * np.arange(-6, 7)).tolist()) for at in f.tolist()]
        columns = zip(f.tolist(), (size * gains).tolist(), lines, strict=True)
        tones = [Tone(at, each, 4e-4 * size, 1e-4 * size, 5e-3, 28.0, near, 4e-4 * size) for at, each, near in columns]
        band = fit_rate_band(tones, size, Known(3488.9))
        return [band.split_hz, band.q, band.peak_gain]

    assert np.array(found(1e-6)) == pytest.approx(np.array(found(1.0)), rel=1e-4)
