"""In which order rates are visited: what each order promises, for rates of any kind."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.procedures.fakes import make_settings
from vcfbench.instructions.schedule import (
    Earth,
    Order,
    SweepSettings,
    Zeros,
    loop_directions,
    ordered,
    visits,
)
from vcfbench.records.schema import Point
from vcfbench.station.settings import PAPER_RATES_DEG_S, Station
from vcfbench.uncertainty.windows import drift_weights, sweep_of, window_times

MAGNITUDES = st.lists(st.sampled_from([0.5, 1.0, 2.0, 5.0, 10.0, 33.0, 200.0]), min_size=1, max_size=6)
RATES = st.lists(st.floats(-400.0, 400.0, allow_subnormal=False), min_size=1, max_size=12)


@st.composite
def pairs(draw: st.DrawFn) -> list[float]:
    """Return rates of both signs equally often, in any order, with zeros or without."""
    sizes = draw(MAGNITUDES)
    rates = [sign * size for size in sizes for sign in (1.0, -1.0)] + [0.0] * draw(st.integers(0, 2))
    return draw(st.permutations(rates))


def measured(settings: SweepSettings, output: dict[float, float] | None = None, drift_v_s: float = 0.0) -> list[Point]:
    """Return the points of a sweep at step 1 whose output drifts linearly in time and is else that of a line."""
    visited = settings.visits_deg_s
    points = [Point(5 if rate is None else 1, rate or 0.0, 0.0, 0.0, 1e-4, settings.samples) for rate in visited]
    begin, end = window_times(settings, points)
    outputs = output or {point.rate_deg_s: -0.0125 * point.rate_deg_s for point in points}
    return [
        Point(p.step, p.rate_deg_s, 0.0, outputs[p.rate_deg_s] + drift_v_s * 0.5 * (a + b), p.std_v, p.n)
        for p, a, b in zip(points, begin, end, strict=True)
    ]


def line(settings: SweepSettings, points: list[Point]) -> tuple[float, float]:
    """Return slope and intercept of what the results make of the points."""
    own = sweep_of(settings, points, 1).points
    slope, bias = np.polyfit([p.rate_deg_s for p in own], [p.output_v for p in own], 1)
    return float(slope), float(bias)


@given(RATES)
def test_order_paper_keeps_given_order(rates: list[float]) -> None:
    assert ordered(rates, Order.PAPER) == tuple(rates)


@given(RATES)
def test_alternate_goes_by_size_and_takes_plus_before_minus(rates: list[float]) -> None:
    found = ordered(rates, Order.ALTERNATE)
    assert Counter(found) == Counter(rates)
    assert [abs(rate) for rate in found] == sorted(abs(rate) for rate in rates)
    assert all(a >= b for a, b in pairwise(found) if abs(a) == abs(b))


@given(pairs())
def test_abba_takes_each_rate_twice_and_pairs_both_ways(rates: list[float]) -> None:
    found = ordered(rates, Order.ABBA)
    assert Counter(found) == Counter(rates * 2)
    moving = [rate for rate in found if rate]
    for at in range(0, len(moving), 4):
        a, b, c, d = moving[at : at + 4]
        assert (a, b, c, d) == (a, -a, -a, a)
        assert a > 0.0


@given(pairs(), st.sampled_from([Zeros.NONE, Zeros.ENDS, Zeros.BRACKET]), st.integers(1, 3))
def test_a_linear_drift_leaves_abba_as_it_is(rates: list[float], zeros: Zeros, repeat: int) -> None:
    """Ramps take longer at higher rates; each pair is symmetrical in time about its middle all the same."""
    settings = make_settings(rates_deg_s=tuple(rates), order=Order.ABBA, zeros=zeros, repeat=repeat)
    slope, _ = line(settings, measured(settings, drift_v_s=1e-3))
    assert slope == pytest.approx(-0.0125, rel=1e-9)


@given(RATES)
def test_loop_visits_every_rate_up_and_down(rates: list[float]) -> None:
    found, ways = ordered(rates, Order.LOOP), loop_directions(rates)
    assert len(found) == len(ways)
    for rate in rates:
        assert {way for each, way in zip(found, ways, strict=True) if each == rate} == {1, -1}
    assert Counter(found) == {rate: 3 if rate == 0.0 else 2 for rate in {each + 0.0 for each in rates}}
    assert all((b - a) * way >= 0.0 for a, b, way in zip(found, found[1:], ways[1:], strict=False))


def test_loop_begins_and_ends_at_rest() -> None:
    assert ordered((10.0, 0.0, -10.0, 5.0, -5.0), Order.LOOP) == (
        *(0.0, 5.0, 10.0),
        *(10.0, 5.0, 0.0, -5.0, -10.0),
        *(-10.0, -5.0, 0.0),
    )


@given(RATES, st.sampled_from(list(Zeros)), st.integers(1, 4))
def test_zeros_stand_where_they_are_wanted(rates: list[float], zeros: Zeros, repeat: int) -> None:
    found = visits(rates, zeros, repeat)
    assert tuple(rate for rate in found if rate is not None) == tuple(rates) * repeat
    wanted = {Zeros.NONE: 0, Zeros.ENDS: repeat + 1, Zeros.BRACKET: len(rates) * repeat + 1}
    assert sum(rate is None for rate in found) == wanted[zeros]
    if zeros is not Zeros.NONE:
        assert found[0] is None is found[-1]
    if zeros is Zeros.BRACKET:
        assert all((left is None) != (right is None) for left, right in pairwise(found))


@given(st.lists(st.floats(0.1, 100.0), min_size=3, max_size=12), st.floats(-1.0, 1.0, allow_subnormal=False), st.data())
def test_linear_zero_drift_is_removed_and_bias_kept(steps_s: list[float], drift: float, data: st.DataObject) -> None:
    times = np.cumsum(steps_s)
    is_zero = np.array(
        [True, *data.draw(st.lists(st.booleans(), min_size=times.size - 2, max_size=times.size - 2)), True]
    )
    if is_zero.all():
        return
    weights = drift_weights(times[~is_zero], times[is_zero])
    assert weights.sum(axis=1) == pytest.approx(0.0, abs=1e-12)
    outputs = 7.0 + drift * times
    left = outputs[~is_zero] - weights @ outputs[is_zero]
    assert left == pytest.approx(7.0 + drift * times[is_zero].mean(), abs=1e-9)


@pytest.mark.parametrize(("zeros", "tolerance"), [(Zeros.NONE, None), (Zeros.ENDS, 1e-9), (Zeros.BRACKET, 1e-9)])
def test_zeros_take_a_linear_drift_off_the_paper_s_order(zeros: Zeros, tolerance: float | None) -> None:
    settings = make_settings(zeros=zeros)
    points = measured(settings, drift_v_s=1e-4)
    slope, _ = line(settings, points)
    if tolerance is not None:
        assert slope == pytest.approx(-0.0125, rel=tolerance)
        return
    begin, end = window_times(settings, points)
    rates, middle = np.array(PAPER_RATES_DEG_S), 0.5 * (begin + end)
    assert slope + 0.0125 == pytest.approx(1e-4 * float(rates @ (middle - middle.mean())) / 106_060.0)


def test_drift_of_1_mv_reads_by_factors_of_orders() -> None:
    """In windows equally far apart: falling 0.42 %, alternate an eleventh or so of that, abba nothing."""
    read = {}
    for order in (Order.PAPER, Order.ALTERNATE, Order.ABBA):
        rates = np.array(ordered(PAPER_RATES_DEG_S, order))
        read[order] = abs(np.polyfit(rates, 1e-3 * np.arange(rates.size), 1)[0])
    assert read[Order.PAPER] == pytest.approx(0.0520e-3, abs=5e-8)
    assert read[Order.ALTERNATE] == pytest.approx(0.0037e-3, abs=5e-8)
    assert read[Order.ABBA] < 1e-15


def test_abba_without_pairs_is_refused() -> None:
    settings = make_settings(order=Order.ABBA, rates_deg_s=(0.0, 10.0, 20.0))
    assert [invalid_value.path for invalid_value in settings.contradictions()] == ["rates_deg_s"]


def test_the_earth_s_rate_needs_a_latitude() -> None:
    settings = make_settings(earth=Earth.RATE)
    assert [invalid_value.path for invalid_value in settings.contradictions()] == ["earth"]
    at = make_settings(earth=Earth.RATE, station=Station(latitude_deg=38.0, meter_resolution_v=1e-5))
    assert not list(at.contradictions())
    assert 3600.0 * at.earth_rate_deg_s == pytest.approx(15.041067 * math.sin(math.radians(38.0)))
    points = [Point(1, rate, 0.0, -0.0125 * (rate + at.earth_rate_deg_s), 1e-4, 10) for rate in PAPER_RATES_DEG_S]
    assert line(at, points)[1] == pytest.approx(0.0, abs=1e-12)
