"""Sines and noise that comes back are no ramp or walk, though their curves rise so; ramps and walks are stated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.cells import few
from vcfbench.analysis.allan import Sampling
from vcfbench.procedures.zero.noise import record_noise

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.analysis.arrays import Floats

T_S = 0.2 * np.arange(3000.0)


def white(r: np.random.Generator) -> Floats:
    return r.standard_normal(T_S.size) / np.sqrt(2000.0)


def walk(r: np.random.Generator, size: float) -> Floats:
    return size * np.sqrt(0.2) * np.cumsum(r.standard_normal(T_S.size))


def stated(readings: Floats, interval_s: float = 0.2) -> set[str]:
    found = record_noise(
        readings, Sampling.without_gaps(interval_s), corrected=False, u_bandwidth_hz=0.0, meter_deg_s=0.0
    )
    assert found.described or "stated" in found.remarks[-1]
    return {each.words for each in found.coefficients if each.u is not None}


SEEDS = [1000, 1001, 1002, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in range(1003, 1060))]


@pytest.mark.parametrize("seed", SEEDS)
def test_slow_sine_is_neither_ramp_nor_walk(seed: int) -> None:
    noise = white(np.random.default_rng(seed))
    assert stated(noise + 0.1 * np.sin(2.0 * np.pi * T_S / 300.0)) <= {"angle random walk"}


@pytest.mark.parametrize(
    ("size", "records", "most", "least"),
    few([(3600, 15, 1, 9), (3600, 60, 3, 40), (10_000, 60, 3, 40)]),
)
def test_swings_of_any_length_are_seldom_a_walk(size: int, records: int, most: int, least: int) -> None:
    """K was stated in 39 of the short records of swings, in 32 of the long ones."""
    of_swings = of_walks = 0
    for seed in range(records):
        draw, u = np.random.default_rng(5000 + seed), np.arange(size) / size
        noise, swings = draw.standard_normal(size), draw.uniform(1.0, 6.0)
        slow = draw.uniform(0.1, 0.4) * np.sin(2.0 * np.pi * (swings * u + draw.uniform()))
        of_swings += "rate random walk" in stated(noise + slow, 1.0)
        of_walks += "rate random walk" in stated(noise + np.cumsum(60.0 / size * draw.standard_normal(size)), 1.0)
    assert of_swings <= most
    assert of_walks >= least


@pytest.mark.exhaustive
def test_noise_that_comes_back_is_seldom_a_walk() -> None:
    """K of Gauss-Markov noise of 10 s was stated in 22 of 24 records of 60000, at 0.7 of what it is."""
    from scipy.signal import lfilter  # noqa: PLC0415  # it takes a second to load

    remembered, walks, interval_s = np.exp(-0.001), 0, 0.01
    for seed in range(24):
        draw = np.random.default_rng(1000 + seed)
        noise = 0.1 * draw.standard_normal(60_000)
        slow = lfilter([np.sqrt(1.0 - remembered**2)], [1.0, -remembered], draw.standard_normal(60_000))
        walks += "rate random walk" in stated(noise + 0.02 * slow, interval_s)
    assert walks <= 3


@pytest.mark.exhaustive
@pytest.mark.parametrize("records", few([8, 30], 8))
def test_noise_without_a_walk_is_not_said_to_come_back(records: int) -> None:
    """It was, in a third of white records: the variance of their means was below that of their N."""
    for seed in range(records):
        draw, sampling = np.random.default_rng(2000 + seed), Sampling.without_gaps(1.0)
        for size, part in ((600, 0.0), (3000, 0.0), (3000, 0.3)):
            readings = white(draw)[:size]
            readings[1:] += part * readings[:-1]
            found = record_noise(readings, sampling, corrected=False, u_bandwidth_hz=0.0, meter_deg_s=0.0)
            assert not any("comes back" in each or "to and fro" in each for each in found.remarks)


def test_remark_says_why_a_walk_is_not_stated() -> None:
    from scipy.signal import lfilter  # noqa: PLC0415  # it takes a second to load

    draw = np.random.default_rng(1000)
    remembered = np.exp(-0.2 / 30.0)
    slow = lfilter([np.sqrt(1.0 - remembered**2)], [1.0, -remembered], draw.standard_normal(T_S.size))
    assert stated(white(draw) + 0.04 * slow) <= {"angle random walk"}


CLEAN: dict[str, tuple[str, Callable[[np.random.Generator], Floats]]] = {
    "ramp": ("rate ramp", lambda _: 0.5 * T_S / 600.0),
    "ramp and walk": ("rate random walk", lambda r: 0.5 * T_S / 600.0 + walk(r, 0.006)),
    "walk": ("rate random walk", lambda r: walk(r, 0.02)),
}


@pytest.mark.parametrize("kind", few(CLEAN, every=9))
def test_what_is_slow_by_itself_is_stated(kind: str) -> None:
    name, slow = CLEAN[kind]
    for seed in (1000, 1001):
        draw = np.random.default_rng(seed)
        assert name in stated(white(draw) + slow(draw))
