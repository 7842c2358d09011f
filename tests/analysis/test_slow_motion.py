"""A slow sine is no rate ramp, though the curve of its record rises as that of one; ramps and walks are stated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

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


def stated(readings: Floats) -> set[str]:
    found = record_noise(readings, Sampling.without_gaps(0.2), corrected=False, u_bandwidth_hz=0.0, meter_deg_s=0.0)
    assert found.described or len(found.remarks) == 1
    return {each.words for each in found.coefficients if each.u is not None}


SEEDS = [1000, 1001, 1002, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in range(1003, 1060))]


@pytest.mark.parametrize("seed", SEEDS)
def test_slow_sine_is_neither_ramp_nor_walk(seed: int) -> None:
    noise = white(np.random.default_rng(seed))
    assert stated(noise + 0.1 * np.sin(2.0 * np.pi * T_S / 300.0)) <= {"angle random walk"}


CLEAN: dict[str, tuple[str, Callable[[np.random.Generator], Floats]]] = {
    "ramp": ("rate ramp", lambda _: 0.5 * T_S / 600.0),
    "ramp and walk": ("rate random walk", lambda r: 0.5 * T_S / 600.0 + walk(r, 0.006)),
    "walk": ("rate random walk", lambda r: walk(r, 0.02)),
}


@pytest.mark.parametrize("kind", CLEAN)
def test_what_is_slow_by_itself_is_stated(kind: str) -> None:
    name, slow = CLEAN[kind]
    for seed in (1000, 1001):
        draw = np.random.default_rng(seed)
        assert name in stated(white(draw) + slow(draw))
