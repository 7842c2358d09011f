"""The pace of a log: its interval, and the rows at which its times are uneven."""

from __future__ import annotations

import numpy as np
import pytest

from vcfbench.analysis.pace import pace_of
from vcfbench.errors import ConfigError

EVEN = 0.005 * np.arange(20_000)


def test_gap_splits_a_log_where_it_stands() -> None:
    for gap_s in (0.005, 0.5, 5.0, -3.0):  # a reading that is missing, gaps, a clock that was set back
        found = pace_of(np.where(np.arange(EVEN.size) >= 15_000, EVEN + gap_s, EVEN))
        assert (found.breaks, found.begin, found.end) == ((15_000,), 0, 15_000)
        assert found.interval_s == pytest.approx(0.005)


@pytest.mark.parametrize(("rate_hz", "digits"), [(400.0, 3), (333.0, 3), (60.0, 2), (2000.0, 3), (1800.0, 3)])
def test_rounded_times_are_even(rate_hz: float, digits: int) -> None:
    found = pace_of(np.round(EVEN / 0.005 / rate_hz, digits))
    assert found.interval_s == 1.0 / rate_hz
    assert found.breaks == ()


def test_time_that_is_late_by_itself_is_no_break() -> None:
    doubled, swapped = EVEN.copy(), EVEN.copy()
    doubled[777] = doubled[776]
    swapped[[5, 6]] = swapped[[6, 5]]
    assert (pace_of(doubled).breaks, pace_of(doubled).repeats) == ((), (777,))
    assert (pace_of(swapped).breaks, pace_of(swapped).backwards) == ((), (6,))


def test_jitter_is_told_and_changes_nothing() -> None:
    found = pace_of(EVEN + 1e-4 * np.random.default_rng(1).standard_normal(EVEN.size))
    assert found.jitter_s == pytest.approx(1e-4 * np.sqrt(2.0), rel=0.05)
    assert found.interval_s == pytest.approx(0.005, rel=1e-5)


@pytest.mark.parametrize(
    ("times", "words"), [(EVEN[::-1], "run backwards"), (0.0 * EVEN, "repeat"), (EVEN[:2], "2 times")]
)
def test_times_that_tell_no_interval_are_refused(times: np.ndarray, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        pace_of(times)
