"""Latency by ramps: what was put between table and output is found, with its u."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.analysis.latency import Ramp, instants_by_counter, mean_latency

REST_S = 0.5


def ramp(seed: int, behind_s: float, readback_s: float, *, down: bool, noise: float = 1e-4) -> Ramp:
    """Return a ramp of a table that tells its rate late, and an output that is behind the table by another time."""
    rng = np.random.default_rng(seed)
    lasts_s = rng.uniform(0.5, 4.0)

    def rate(t_s: np.ndarray) -> np.ndarray:
        up = np.clip((t_s - REST_S) / lasts_s, 0.0, 1.0)
        return np.asarray(1.0 - up if down else up)

    asked_s = np.cumsum(rng.uniform(0.01, 0.03, 1000))
    asked_s = asked_s[asked_s < lasts_s + 2.0 * REST_S]
    answered_s = asked_s + rng.uniform(0.005, 0.01)
    of_s = rng.uniform(asked_s, answered_s)
    came_s = np.arange(0.0, lasts_s + 2.0 * REST_S, 0.01)
    number = 7.0 - 3.0 * rate(came_s - behind_s) + rng.normal(0.0, noise, len(came_s))
    return Ramp(asked_s, answered_s, rate(of_s - readback_s), came_s, number)


@given(st.integers(0, 10_000), st.floats(0.0, 0.2), st.floats(0.0, 0.05))
def test_latency_is_found_within_its_uncertainty(seed: int, behind_s: float, readback_s: float) -> None:
    ramps = [ramp(seed, behind_s, readback_s, down=down) for down in (False, True)]
    found = mean_latency(ramps, 0.05)
    assert found is not None
    assert abs(found.latency_s - behind_s) < 2.0 * found.u_s
    known = mean_latency(ramps, 0.0)
    assert known is not None
    assert abs(known.latency_s + readback_s - behind_s) < 3.0 * known.u_s < 0.015


@pytest.mark.parametrize("points", [0, 3, 20])
def test_ramp_of_too_few_points_has_no_latency(points: int) -> None:
    whole = ramp(1, 0.05, 0.0, down=False)
    seen = Ramp(whole.asked_s, whole.answered_s, whole.rate_deg_s, whole.came_s[:points], whole.number[:points])
    assert mean_latency([whole, seen], 0.0) is None
    assert mean_latency([], 0.0) is None


def test_table_that_stands_has_no_latency() -> None:
    whole = ramp(1, 0.05, 0.0, down=False)
    still = Ramp(whole.asked_s, whole.answered_s, 0.0 * whole.rate_deg_s, whole.came_s, whole.number)
    assert still.latency is None


@given(st.integers(0, 1000))
def test_frames_that_were_found_late_came_by_their_counter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    counter = np.cumsum(rng.integers(1, 4, 50))
    late_s = rng.exponential(0.02, 50)
    late_s[rng.integers(50)] = 0.0
    found = instants_by_counter(counter.tolist(), 3.0 + 0.01 * counter + late_s, 0.01)
    assert found == pytest.approx(3.0 + 0.01 * counter)
