"""Chopped blocks: drift cancels; noise and flicker come out as they went in."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.analysis.chopped import CHOPPED, Block, block_noise, polynomial_through_zero
from vcfbench.errors import ConfigError

VOLTS = st.floats(-10.0, 10.0)


@given(zero=VOLTS, plus=VOLTS, minus=VOLTS, drift=VOLTS)
def test_a_linear_drift_cancels(zero: float, plus: float, minus: float, drift: float) -> None:
    levels = {0: zero, 1: plus, -1: minus}
    block = Block(tuple(levels[sign] + drift * at for at, sign in enumerate(CHOPPED)))
    assert block.differences_v == pytest.approx((plus - zero, minus - zero), abs=1e-12)


def test_a_block_has_six_windows() -> None:
    with pytest.raises(ConfigError, match="6 windows, not 5"):
        Block((0.0,) * 5)


def flicker(rng: np.random.Generator, size: int, coefficient: float) -> np.ndarray:
    """Return samples 1 s apart of the one-sided density `coefficient` / f, shaped by its spectrum."""
    frequency = np.fft.rfftfreq(size, 1.0)
    frequency[0] = np.inf
    shape = np.sqrt(coefficient / frequency * size / 4.0)
    return np.asarray(np.fft.irfft((rng.normal(size=shape.size) + 1j * rng.normal(size=shape.size)) * shape, size))


def scattered(rng: np.random.Generator, blocks: int, white_v: float, coefficient: float) -> list[Block]:
    """Return blocks of windows of 10 s, 12 s apart, with white noise of the means and flicker, at equal levels."""
    samples = flicker(rng, 1 << 17, coefficient) if coefficient else np.zeros(1 << 17)
    starts = 12 * np.arange(6 * blocks)
    means = np.array([samples[s : s + 10].mean() for s in starts]) + rng.normal(0.0, white_v, starts.size)
    return [Block(tuple(row)) for row in means.reshape(blocks, 6).tolist()]


@pytest.mark.parametrize("coefficient", [0.0, 1e-10, 4e-9])
def test_the_scatter_of_differences_is_foreseen(coefficient: float) -> None:
    rng, white_v = np.random.default_rng(3), 3e-5
    blocks = scattered(rng, 1500, white_v, coefficient)
    noise = block_noise(blocks, white_v * np.sqrt(10.0), 10, 10.0, 12.0)
    seen = np.cov(np.array([block.differences_v for block in blocks]).T)
    assert np.array(noise.covariance_v2) == pytest.approx(seen, rel=0.12)
    if coefficient:
        assert noise.flicker_v2 == pytest.approx(coefficient, rel=0.15)


def test_known_flicker_overrides_smaller_flicker_of_few_blocks() -> None:
    rng, of_the_gyroscope = np.random.default_rng(7), 4e-10
    quiet = scattered(rng, 5, 3e-5, 0.0)
    alone = block_noise(quiet, 9.5e-5, 10, 10.0, 12.0)
    known, by_five = (
        block_noise(quiet, 9.5e-5, 10, 10.0, 12.0, known_flicker_v2=of_the_gyroscope, known_dof=dof)
        for dof in (math.inf, 5.0)
    )
    true = block_noise(scattered(rng, 1500, 3e-5, of_the_gyroscope), 9.5e-5, 10, 10.0, 12.0)
    assert known.covariance_v2[0] == pytest.approx(true.covariance_v2[0], rel=0.1)
    assert alone.covariance_v2[0][0] < 0.7 * known.covariance_v2[0][0]
    assert known.flicker_v2 == alone.flicker_v2
    assert alone.flicker_v2 == 0.0  # the rest of the variance is then that of the known flicker (Welch-Satterthwaite)
    share = 1.0 - alone.covariance_v2[0][0] / known.covariance_v2[0][0]
    assert 1.0 / by_five.dof - 1.0 / known.dof == pytest.approx(share**2 / 5.0)
    many = scattered(rng, 500, 3e-5, 0.0)
    worst = block_noise(many, 9.5e-5, 10, 10.0, 12.0, known_flicker_v2=1e-6)  # contradicted by the blocks
    assert worst.covariance_v2[0][0] < 1.2 * block_noise(many, 9.5e-5, 10, 10.0, 12.0).covariance_v2[0][0]


def test_few_blocks_know_the_noise_less_well() -> None:
    rng = np.random.default_rng(4)
    few, many = (block_noise(scattered(rng, count, 3e-5, 1e-9), 9.5e-5, 10, 10.0, 12.0) for count in (5, 500))
    assert 2.0 < few.dof < 30.0 < many.dof


def test_noise_needs_blocks_and_readings() -> None:
    with pytest.raises(ConfigError, match="two readings"):
        block_noise([], 1e-5, 10, 10.0, 12.0)


def test_a_polynomial_through_zero_is_found_with_its_covariance() -> None:
    x = np.array([-2.0, -1.0, 1.0, 2.0, 3.0])
    found, covariance, making = polynomial_through_zero(x, 3.0 * x - 0.5 * x**2, 0.01 * np.eye(5), 2)
    assert found == pytest.approx([3.0, -0.5])
    powers = np.stack([x, x**2], axis=1)
    assert covariance == pytest.approx(0.01 * np.linalg.inv(powers.T @ powers))
    assert making @ (0.01 * np.eye(5)) @ making.T == pytest.approx(covariance)
