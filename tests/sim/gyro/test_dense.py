from __future__ import annotations

import math

import numpy as np
import pytest
from simrack.dense import coarser

from tests.sim.gyro.bench import powered
from vcfbench.sim.gyro.design import paper_bench


@pytest.mark.parametrize("count", [1024, 5000, 65536])
@pytest.mark.parametrize("step_s", [1.25e-9, 7e-8, 4.9e-7])
def test_a_sine_at_twice_the_carrier_is_kept(count: int, step_s: float) -> None:
    times = 12.5 + step_s * np.arange(count)
    coarse = coarser(times)
    assert coarse is not None
    speed = 2 * math.pi * 6978.0
    made = coarse.interpolated(np.sin(speed * coarse.times_s()))
    assert np.abs(made - np.sin(speed * times)).max() < 3e-6
    assert len(coarse.times_s()) < count / 3 + 4


def test_few_or_uneven_times_are_computed_one_by_one() -> None:
    assert coarser(np.linspace(0.0, 1e-6, 100)) is None
    assert coarser(np.linspace(0.0, 1.0, 5000)) is None
    assert coarser(np.geomspace(1e-6, 1e-3, 5000)) is None
    assert coarser(np.zeros(5000)) is None


@pytest.mark.parametrize("node", ["drive", "carrier", "sense", "output"])
def test_a_dense_record_shows_what_single_looks_show(node: str) -> None:
    clock, world = powered(paper_bench(), 3)
    capture = world.capture(4.0, 4.01)
    clock.sleep_until(4.02)
    times = np.linspace(4.001, 4.003, 20_000)
    dense, single = capture.samples(node, times), capture.samples(node, times[::200])
    assert np.abs(dense[::200] - single).max() < 3e-6 * max(np.abs(single).max(), 1e-3)
