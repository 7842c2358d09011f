"""Long series as a picture can show them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.report.thinning import COLUMNS, thinned


@given(st.integers(3201, 6000), st.integers(0, 2**32 - 1))
def test_the_least_and_the_greatest_of_each_column_are_kept_in_their_order(number: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    x, y = np.cumsum(random.exponential(size=number)), random.normal(size=number)
    kept = thinned(x.tolist(), y.tolist())
    assert kept is not None
    kept_x, kept_y = map(np.array, kept)
    assert np.all(np.diff(kept_x) > 0.0)
    columns = [np.minimum((each - x[0]) / (x[-1] - x[0]) * COLUMNS, COLUMNS - 1).astype(int) for each in (x, kept_x)]
    for column in set(columns[0].tolist()):
        of_all, of_kept = y[columns[0] == column], kept_y[columns[1] == column]
        assert (of_all.min(), of_all.max()) == (of_kept.min(), of_kept.max())
        assert len(of_kept) <= 2


def test_few_values_and_those_that_are_no_record_are_left_as_they_are() -> None:
    assert thinned(range(3200), range(3200)) is None
    assert thinned([0.0] * 5000, range(5000)) is None
    assert thinned([*range(4000), *range(4000)], range(8000)) is None
