"""Long series as a picture can show them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vcfbench.reports.plot import COLUMNS, thinned


@settings(max_examples=20)  # each is thousands of values
@given(st.integers(3201, 6000), st.integers(0, 2**32 - 1))
def test_the_least_and_the_greatest_of_each_column_are_kept(number: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    x, y = np.cumsum(random.exponential(size=number)), random.normal(size=number)
    kept = thinned(x.tolist(), y.tolist())
    assert kept is not None
    begins, extremes = np.array(kept[0][::2]), np.array(kept[1]).reshape(-1, 2)
    assert len(begins) <= COLUMNS
    for begin, end, (least, greatest) in zip(begins, [*begins[1:], np.inf], extremes, strict=True):
        column = y[(x >= begin) & (x < end)]
        assert (least, greatest) == (column.min(), column.max())
    assert begins[0] == x[0]
    assert np.diff(begins).max() <= 2.0 * (x[-1] - x[0]) / COLUMNS + np.diff(x).max()


def test_few_values_and_other_series_are_unchanged() -> None:
    assert thinned(range(3200), range(3200)) is None
    assert thinned([0.0] * 5000, range(5000)) is None
    assert thinned([*range(4000), *range(4000)], range(8000)) is None
