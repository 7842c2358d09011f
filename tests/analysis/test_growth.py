"""What an analysis costs grows with its rows, and no faster; what it finds is what the definition says."""

from __future__ import annotations

import time
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.analysis.csv_table import Layout
from vcfbench.analysis.regression import sign_pairs
from vcfbench.analysis.scale_factor import characterise
from vcfbench.archive.analyzed import read_table

FEW, MANY = 3_000, 30_000


def _cpu_s(rows: int, curvature: float) -> float:
    rate = np.linspace(-300.0, 300.0, rows)
    noise = 1e-6 * np.random.default_rng(1).standard_normal(rows)
    output = -0.0125 * rate + curvature * rate**2 + (noise if curvature == 0.0 else 0.0)
    steps = "\n".join(f"{row},{r!r},0,{v!r},0,1" for row, (r, v) in enumerate(zip(rate.tolist(), output.tolist())))  # noqa: B905
    table = f"step,rate_deg_s,v_vc_v,output_v,std_v,n\n3,0,0,0,0,1\n3,1,0,1,0,1\n3,2,0,2,0,1\n{steps}"
    began = time.process_time()
    characterise(rate, output)
    read_table(BytesIO(table.encode()), "points.csv", Layout(), [])
    return time.process_time() - began


@pytest.mark.exhaustive
@pytest.mark.parametrize("curvature", [0.0, 1e-8], ids=["noise", "every point a corner of the hull"])
def test_ten_times_the_rows_cost_about_ten_times(curvature: float) -> None:
    """On a busy machine others take the caches away, at one time more than at another: one try in five must hold."""
    _cpu_s(100, curvature)  # imports
    assert any(_cpu_s(MANY, curvature) < 30.0 * _cpu_s(FEW, curvature) for _ in range(5))


@given(st.lists(st.tuples(st.integers(-5, 5), st.integers(-9, 9)), min_size=3, max_size=30))
def test_pairs_are_those_of_the_definition(points: list[tuple[int, int]]) -> None:
    rate, output = np.array(points, dtype=float).T
    if np.ptp(rate) == 0.0:
        return
    mean = {r: output[rate == r].mean() for r in set(rate.tolist())}
    expected = [w for w in sorted(mean, reverse=True) if w > 0.0 and -w in mean]
    pairs = sign_pairs(rate, output)
    assert [pair.rate_deg_s for pair in pairs] == expected
    for pair in pairs:
        plus, minus = mean[pair.rate_deg_s], mean[-pair.rate_deg_s]
        assert pair.scale_factor == pytest.approx((plus - minus) / (2.0 * pair.rate_deg_s))
        assert pair.even_v == pytest.approx((plus + minus) / 2.0)
