"""A reference's phase from records of a sense signal that turns, against records made of cosines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack_tests.cells import few

from vcfbench.analysis.rotating import fit_rotation, reference_phase
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

DRIVE_HZ, INTERVAL_S, POINTS = 3488.9, 5e-5, 10_000
DELAY_S = 4.16e-3


def records(
    difference_hz: float,
    reference_deg: float,
    *,
    gain: float = 1.7,
    noise_v: float = 0.0,
    seed: int = 0,
    thin: float = 1,
    drive_hz: float = DRIVE_HZ,
) -> tuple[NDArray[np.float64], ...]:
    """Return drive, sense and output: the output is the sense phasor seen along the reference, late by the delay."""
    random = np.random.default_rng(seed)
    t = INTERVAL_S * thin * np.arange(round(POINTS / thin))
    start, at_rest, turned = random.uniform(-math.pi, math.pi, 3)
    drive_rad = 2.0 * math.pi * drive_hz * t + start
    turn_rad = 2.0 * math.pi * difference_hz * t + turned
    sense = 0.4 * np.cos(drive_rad + at_rest) + 1.1 * np.cos(drive_rad + turn_rad)
    late_rad = turn_rad - 2.0 * math.pi * difference_hz * DELAY_S
    output = -0.04 + gain * np.cos(late_rad - math.radians(reference_deg)) + 0.003 * np.cos(2.0 * late_rad)
    return tuple(each + noise_v * random.standard_normal(t.size) for each in (np.cos(drive_rad), sense, output))


@pytest.mark.parametrize("gain", few([1.7, -1.7], every=3))
@pytest.mark.parametrize("reference_deg", [-90.5, -89.0, 12.0, 178.0])
def test_the_reference_comes_back_apart_from_half_turns(reference_deg: float, gain: float) -> None:
    found = [
        fit_rotation(*records(offset_hz, reference_deg, gain=gain, seed=n), INTERVAL_S, math.copysign(8.0, offset_hz))
        for n, offset_hz in enumerate((7.87, -8.13, 8.11, -7.9))
    ]
    phase = reference_phase([(each.difference_hz, each.reference_deg) for each in found])
    assert math.remainder(phase.phase_deg - reference_deg, 180.0) == pytest.approx(0.0, abs=1e-6)
    assert -90.0 <= phase.phase_deg <= 90.0
    assert phase.delay_s == pytest.approx(DELAY_S, rel=1e-6)
    assert found[1].difference_hz == pytest.approx(-8.13, abs=1e-9)
    assert found[0].drive_hz == pytest.approx(DRIVE_HZ)
    assert (found[0].turning, found[0].output) == pytest.approx((1.1, 1.7))


def test_phase_and_delay_of_records_have_u_of_a_line() -> None:
    """89.5 deg and 2 ms of delay, a tenth of a degree more and less: by hand."""
    away_deg = (0.1, 0.1, -0.1, -0.1) * 2
    found = reference_phase(
        [(hz, 89.5 + 360.0 * 2e-3 * hz + off) for hz, off in zip((8.0, -8.0) * 4, away_deg, strict=True)]
    )
    scatter_deg = 0.1 * math.sqrt(8.0 / 6.0)
    assert (found.phase_deg, found.delay_s, found.dof) == (pytest.approx(89.5), pytest.approx(2e-3), 6)
    assert found.scatter_deg == pytest.approx(scatter_deg)
    assert found.u_phase_deg == pytest.approx(scatter_deg / math.sqrt(8.0))
    assert found.u_delay_s == pytest.approx(scatter_deg / math.sqrt(8.0) / 8.0 / 360.0)


@pytest.mark.exhaustive
def test_the_uncertainty_is_the_scatter() -> None:
    z = []
    for trial in range(12):
        found = [
            fit_rotation(
                *records(offset_hz, 89.5, noise_v=0.03, seed=10 * trial + n, thin=2), 2 * INTERVAL_S, offset_hz
            )
            for n, offset_hz in enumerate((8.0, -8.0) * 4)
        ]
        phase = reference_phase([(each.difference_hz, each.reference_deg) for each in found])
        z.append(math.remainder(phase.phase_deg - 89.5, 180.0) / phase.u_phase_deg)
    assert 0.5 < np.std(z) < 1.8
    assert 0.005 < phase.u_phase_deg < 0.1


def test_what_cannot_be_told_is_said() -> None:
    drive, sense, output = records(8.0, 90.0)
    with pytest.raises(ConfigError, match="two periods"):
        fit_rotation(drive, sense, output, INTERVAL_S, 2.0)
    with pytest.raises(ConfigError, match="as long as each other"):
        fit_rotation(drive, sense[:-1], output, INTERVAL_S, 8.0)
    with pytest.raises(ConfigError, match="either direction"):
        reference_phase([(8.0, 90.0)] * 3)


def test_hidden_part_is_measured_at_sent_frequency() -> None:
    """Over 100 periods of the drive neither time base loses a thousandth of a turn."""
    random, times_s = np.random.default_rng(4), np.arange(3000) / (30.0 * 10_920.0)
    found = []
    for _ in range(8):
        drive = np.cos(2.0 * np.pi * 10_920.0 * times_s)
        turning = 1e-3 * np.cos(2.0 * np.pi * (10_920.0 + 4695.6) * times_s + 0.7)
        sense = 0.5 * drive + turning + 0.05 * random.standard_normal(times_s.size)
        rotation = fit_rotation(drive, sense, drive, float(times_s[1]), 4695.6)
        found.append(rotation.turning)
        assert abs(rotation.difference_hz - 4695.6) < 120.0
    assert max(found) < 0.01


@pytest.mark.parametrize("drive_hz", [12_000.0, 36_000.0, 49_000.0])
@pytest.mark.parametrize("ppm", few([-55.0, -20.0, 20.0, 55.0], -20.0))
def test_part_is_found_at_frequency_shifted_by_time_bases(drive_hz: float, ppm: float) -> None:
    """V_Vc is at twice the drive and a little by its own time base, the drive is read by another one."""
    moved_hz = 13.0 + 2e-6 * ppm * drive_hz
    found = fit_rotation(*records(moved_hz, 40.0, thin=0.2, drive_hz=drive_hz), 0.2 * INTERVAL_S, 13.0)
    assert found.difference_hz == pytest.approx(moved_hz, abs=1e-6)


def lag_deg(at_hz: float, cut_off_hz: float, order: int) -> float:
    """Return by how much a Butterworth filter lags, without jumps: each of its poles by itself."""
    poles = np.exp(0.5j * np.pi * (1.0 + (2.0 * np.arange(order) + 1.0) / order))
    lags = np.angle(1j * at_hz / cut_off_hz - poles) - np.angle(-poles)
    return float(np.degrees(lags.sum()))


@pytest.mark.parametrize("seed", range(40))
def test_reference_and_delay_are_right_of_narrow_filters(seed: int) -> None:
    """Drawn filters that lag by up to nearly half a turn, references and signs of the output."""
    random = np.random.default_rng(seed)
    order, reference_deg = int(random.integers(1, 7)), random.uniform(-180.0, 180.0)
    difference_hz = math.exp(random.uniform(math.log(0.5), math.log(20.0)))
    share = random.uniform(0.05, 1.0) * (1.0 if order < 5 else 0.75)
    of_hz = difference_hz / share * 1.03
    found = []
    for off in random.uniform(-5e-4, 5e-4, 4):
        for sign in (1.0, -1.0):
            at_hz = difference_hz * (sign + off)
            late_deg = reference_deg + lag_deg(at_hz, of_hz, order) + 0.001 * random.standard_normal()
            found.append((at_hz, math.remainder(late_deg, 360.0)))
    phase = reference_phase(found)
    assert math.remainder(phase.phase_deg - reference_deg, 180.0) == pytest.approx(0.0, abs=0.06)
    expected_s = lag_deg(difference_hz, of_hz, order) / 360.0 / difference_hz
    assert phase.delay_s == pytest.approx(expected_s, rel=1e-2, abs=1e-6)
