from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.page.view import drawn


@given(st.lists(st.floats(-10, 10), max_size=300), st.integers(2, 100))
def test_no_extreme_is_lost_and_time_goes_forwards(values: list[float], most: int) -> None:
    value = np.array(values, dtype=float)
    t_s, shown = drawn(np.arange(value.size, dtype=float), value, most)
    assert t_s.size == shown.size <= max(most, 2)
    assert np.all(np.diff(t_s) >= 0)
    if value.size:
        assert (shown.min(), shown.max()) == (value.min(), value.max())


def test_few_readings_are_drawn_as_they_are() -> None:
    t_s, value = np.array([0.0, 1.0, 2.0]), np.array([3.0, 1.0, 2.0])
    shown = drawn(t_s, value, 10)
    assert np.array_equal(shown[0], t_s)
    assert np.array_equal(shown[1], value)


def test_a_spike_among_a_million_is_seen() -> None:
    value = np.zeros(1_000_000)
    value[333_333] = 1.0
    t_s, shown = drawn(np.arange(value.size, dtype=float), value, 2000)
    assert shown.size <= 2000
    assert abs(t_s[int(np.argmax(shown))] - 333_333) <= 1000
