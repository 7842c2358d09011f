"""How far the read-back of a table may be off: a share of the rate, where that is high."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.clock import VirtualClock
from vcfbench.errors import MeasurementError
from vcfbench.steps import AwaitRate
from vcfbench.steps.table import read_rate

RATES = st.floats(-1000.0, 1000.0)


def looking_at(rate_deg_s: float) -> Any:
    table = SimpleNamespace(
        name="table", resource="sim", fault=lambda: None, at_rate=lambda: True, rate_deg_s=lambda: rate_deg_s
    )
    return SimpleNamespace(
        bench=SimpleNamespace(rate_table=table, clock=VirtualClock(), by_hand=("rate_table",)),
        believable=lambda ask, _left: ask(),
    )


@given(rate=RATES, share=st.floats(-200e-6, 200e-6))
def test_table_200_ppm_off_passes_at_every_rate(rate: float, share: float) -> None:
    read = rate * (1.0 + share)
    assert AwaitRate(rate, 0.0, 0.05, 1.0).perform(looking_at(read)).rate_deg_s == read
    assert read_rate(looking_at(read), rate, 0.05) == read


@given(rate=RATES, sign=st.sampled_from((-1.0, 1.0)))
def test_a_table_further_off_does_not_pass(rate: float, sign: float) -> None:
    read = rate + sign * 1.01 * max(0.05, 250e-6 * abs(rate))
    with pytest.raises(MeasurementError, match="off allowed"):
        AwaitRate(rate, 0.0, 0.05, 1.0).perform(looking_at(read))
    with pytest.raises(MeasurementError, match="left"):
        read_rate(looking_at(read), rate, 0.05)


@pytest.mark.parametrize("judged", ["", "[at_rate] of its profile: 3 readings in a row (polls) within 0.02 deg/s"])
@given(rate=RATES, off=st.sampled_from((0.0, 5.0)))
def test_rate_not_reached_names_the_key_that_decides(judged: str, rate: float, off: float) -> None:
    context = looking_at(rate + off)
    table = context.bench.rate_table
    table.at_rate, table.judges_rate_by = lambda: False, judged
    with pytest.raises(MeasurementError, match="rate_deadline_s waits longer") as caught:
        AwaitRate(rate, 0.0, 0.3, 1.0).perform(context)
    assert ("rate_tolerance_deg_s" in str(caught.value)) == bool(off)
    assert ("as the table reports" in str(caught.value)) != bool(judged)
    assert ("[at_rate] of the profile allows more" in str(caught.value)) == bool(judged)
