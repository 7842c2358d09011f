"""Noise behind the demodulator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from tests.sim.gyro.bench import mean_v, powered
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.gyro.electronic import ElectronicNoise

DENSITY, CORNER_HZ = 2e-6, 800.0


@pytest.mark.exhaustive
def test_its_spectrum_is_white_up_to_a_first_order_corner() -> None:
    noise = ElectronicNoise(DENSITY, CORNER_HZ, (1,))
    rate_hz, length = 10e3, 1000
    volts = noise.at(np.arange(300_000) / rate_hz).reshape(-1, length)
    window = np.hanning(length)
    densities = 2 * (np.abs(np.fft.rfft(volts * window)) ** 2).mean(axis=0) / (rate_hz * (window**2).sum())
    frequencies = np.fft.rfftfreq(length, 1 / rate_hz)
    for low, high in ((20.0, 200.0), (200.0, 600.0), (600.0, 1200.0)):
        held = (frequencies >= low) & (frequencies < high)
        wanted = DENSITY**2 / (1 + (frequencies[held] / CORNER_HZ) ** 2)
        # 300 records, some 18 to 60 free lines a band
        assert densities[held].mean() == pytest.approx(wanted.mean(), rel=0.06)


def test_means_scatter_by_the_density_and_are_those_of_the_waveform() -> None:
    noise = ElectronicNoise(DENSITY, CORNER_HZ, (2,))
    starts = 0.3 + 0.02 * np.arange(500)
    means = np.array([noise.integral(start, start + 0.02) / 0.02 for start in starts])
    assert means.std() == pytest.approx(DENSITY / math.sqrt(2 * 0.02), rel=5 / math.sqrt(2 * 500))
    times = starts[7] + (np.arange(200_000) + 0.5) * 1e-7
    assert noise.at(times).mean() == pytest.approx(means[7], abs=1e-10)
    halves = noise.integral(starts[7], starts[7] + 0.0077) + noise.integral(starts[7] + 0.0077, starts[7] + 0.02)
    assert halves == pytest.approx(0.02 * means[7], rel=1e-9)


def test_the_same_instant_has_the_same_volts_for_everybody() -> None:
    times = np.random.default_rng(3).uniform(0.0, 500.0, 200)
    once, backwards = ElectronicNoise(DENSITY, CORNER_HZ, (4,)), ElectronicNoise(DENSITY, CORNER_HZ, (4,))
    assert np.array_equal(once.at(times), backwards.at(times[::-1])[::-1])
    assert not np.array_equal(once.at(times), ElectronicNoise(DENSITY, CORNER_HZ, (5,)).at(times))


def test_readings_and_records_of_the_output_have_it_and_the_rest_stays() -> None:
    ideal = ideal_bench()
    loud = replace(ideal, noise=replace(ideal.noise, electronic_v_sqrt_hz=1e-5))
    clock, world = powered(loud, 6)
    seen = []
    for _ in range(200):
        start = clock.now()
        capture = world.capture(start, start + 0.02)
        seen.append(mean_v(clock, world, 0.02))
    assert np.std(seen) == pytest.approx(1e-5 / math.sqrt(0.04), rel=0.25)
    times = start + (np.arange(20_000) + 0.5) * 1e-6
    assert capture.samples("output", times).mean() == pytest.approx(
        seen[-1], abs=5e-9
    )  # straight lines of 16 us, points each 1 us
    world.set_rail("positive", 0.0)
    assert mean_v(clock, world, 0.02) == 0.0
