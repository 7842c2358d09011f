"""Decays at carrier level, against records made of decaying cosines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vcfbench.analysis.decays import _let_go, _line, _Samples, fit_decays, fit_release
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

CARRIER_HZ = 3488.9


def ringing(t: NDArray[np.float64], hz: float, q: float, size: float) -> NDArray[np.float64]:
    """Return a free decay of a mode by its natural frequency and quality factor."""
    damped = 2.0 * math.pi * hz * math.sqrt(1.0 - 1.0 / (4.0 * q * q))
    return np.asarray(size * np.exp(-math.pi * hz / q * t) * np.cos(damped * t + 0.4))


def test_two_modes_beside_a_carrier_come_back() -> None:
    t = 2.5e-5 * np.arange(20_000)
    noise = 2e-3 * np.random.default_rng(1).standard_normal(t.size)
    steady = 0.3 * np.cos(2.0 * math.pi * CARRIER_HZ * t + 1.0)
    sense = steady + ringing(t, 3464.1, 1224.0, 1.0) + ringing(t, 3342.0, 900.0, 0.2)
    anti_phase, in_phase = fit_decays(sense + noise, 2.5e-5, CARRIER_HZ)
    assert anti_phase.frequency_hz == pytest.approx(3464.1, abs=1e-3)
    assert anti_phase.q == pytest.approx(1224.0, rel=1e-3)
    assert anti_phase.amplitude_v == pytest.approx(1.0, rel=0.01)
    assert in_phase.frequency_hz == pytest.approx(3342.0, abs=5e-3)
    assert in_phase.q == pytest.approx(900.0, rel=5e-3)


@pytest.mark.parametrize("rate_s", [20.0, 60.0])
@pytest.mark.parametrize("offset_hz", [-150.0, -24.8, 40.0])
def test_line_of_a_decay_has_its_offset_and_half_its_rate(rate_s: float, offset_hz: float) -> None:
    t = 2.5e-5 * np.arange(20_000)
    decay = np.exp(-rate_s * t) * np.cos(2.0 * math.pi * (CARRIER_HZ + offset_hz) * t + 0.4)
    found = _line(decay, _Samples(decay, 2.5e-5), CARRIER_HZ, {0.0: 2.0})
    assert found == pytest.approx((offset_hz, 0.5 * rate_s), abs=0.2 + 0.1 * rate_s)


def test_a_single_mode_above_the_carrier_is_one() -> None:
    t = 2.5e-5 * np.arange(20_000)
    noise = 2e-3 * np.random.default_rng(2).standard_normal(t.size)
    (mode,) = fit_decays(ringing(t, 3510.0, 1500.0, 1.0) + noise, 2.5e-5, CARRIER_HZ)
    assert mode.frequency_hz == pytest.approx(3510.0, abs=2e-3)
    assert mode.q == pytest.approx(1500.0, rel=2e-3)


@pytest.mark.parametrize("let_go_s", [0.0, 0.061])
def test_a_drive_that_is_let_go_and_vanishes(let_go_s: float) -> None:
    t = 4e-6 * np.arange(50_000)
    after = np.maximum(t - let_go_s, 0.0)
    level = np.exp(-math.pi * CARRIER_HZ / 1395.0 * after) * (t < let_go_s + 0.027)
    noise = 7e-3 * np.random.default_rng(3).standard_normal(t.size)
    found = fit_release(level * np.cos(2.0 * math.pi * CARRIER_HZ * t + 0.3) + noise, 4e-6, CARRIER_HZ + 0.2)
    assert found.q == pytest.approx(1395.0, rel=0.01)
    assert found.frequency_hz == pytest.approx(CARRIER_HZ, abs=0.02)


@pytest.mark.parametrize("size", [9, 14, 30])
def test_drive_ends_where_a_line_has_four_windows(size: int) -> None:
    for last in range(size - 1):
        logarithm = -0.3 * np.maximum(np.arange(size) - last, 0.0)
        assert _let_go(logarithm) == min(last, size - 5) + 1


def test_what_does_not_decay_is_said() -> None:
    t = 2.5e-5 * np.arange(20_000)
    steady = np.cos(2.0 * math.pi * CARRIER_HZ * t) + 1e-3 * np.random.default_rng(4).standard_normal(t.size)
    with pytest.raises(ConfigError, match="no decay was found"):
        fit_decays(steady, 2.5e-5, CARRIER_HZ)
    with pytest.raises(ConfigError, match="decays next to a carrier need"):
        fit_decays(steady[:300], 2.5e-5, CARRIER_HZ)
    with pytest.raises(ConfigError, match="has no signal"):
        fit_release(0.0 * steady, 2.5e-5, CARRIER_HZ)
    with pytest.raises(ConfigError, match="does not decay freely"):
        fit_release(np.where(t < 0.02, steady, 0.0), 2.5e-5, CARRIER_HZ)
    with pytest.raises(ConfigError, match="too far apart"):
        fit_release(steady[::10], 2.5e-4, CARRIER_HZ)


@pytest.mark.exhaustive
@given(
    carrier_hz=st.floats(1000.0, 50_000.0),
    split_hz=st.floats(3.0, 80.0),
    sign=st.sampled_from((-1.0, 1.0)),
    turns=st.floats(0.7, 10.0),
)
@settings(max_examples=15, deadline=None)
def test_modes_of_every_split_and_quality_come_back(
    carrier_hz: float, split_hz: float, sign: float, turns: float
) -> None:
    """Within a time constant the mode turns some times against the drive; the record is as long as it asks for."""
    split_hz = min(max(split_hz, 4e-4 * carrier_hz), 0.05 * carrier_hz)
    own_hz, lasts_s = carrier_hz - sign * split_hz, turns / split_hz
    q, far_hz = math.pi * own_hz * lasts_s, carrier_hz - max(0.042 * carrier_hz, 6.0 * split_hz)
    record_s = max(1.5 * lasts_s, min(4.0 / split_hz, 8.0 * lasts_s))
    interval_s = 1.0 / (3.0 * carrier_hz)
    t = interval_s * np.arange(round(record_s / interval_s))
    sense = 0.5 * np.cos(2.0 * math.pi * carrier_hz * t) + ringing(t, own_hz, q, 1.0) + ringing(t, far_hz, q, 0.1)
    near, far = fit_decays(sense + 1e-3 * np.random.default_rng(1).standard_normal(t.size), interval_s, carrier_hz)
    assert carrier_hz - near.frequency_hz == pytest.approx(sign * split_hz, rel=1e-3)
    assert near.q == pytest.approx(q, rel=0.01)
    assert far.frequency_hz == pytest.approx(far_hz, rel=1e-4)
