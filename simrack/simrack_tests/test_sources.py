"""A supply's voltage on its way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from simrack.sources import Approach

SIZES = st.floats(-30.0, 30.0).filter(lambda size: abs(size) > 1e-3)
WAYS = st.builds(
    Approach,
    st.floats(-25.0, 25.0),
    st.floats(0.0, 100.0),
    st.lists(st.tuples(SIZES, st.floats(1e-5, 0.1)), max_size=2),
)


@settings(deadline=None)
@given(WAYS, st.floats(0.0, 0.2))
def test_going_on_later_changes_nothing(way: Approach, since_s: float) -> None:
    start = way.origin_s
    later = way.later(start + since_s)
    for instant in start + since_s + np.array([0.0, 1e-5, 1e-3, 0.1]):
        assert later.at(instant) == pytest.approx(way.at(instant), abs=1.01e-6)


@settings(deadline=None)
@given(WAYS, st.floats(1e-3, 30.0))
def test_it_moves_no_further_than_it_says(way: Approach, distance_v: float) -> None:
    start = way.origin_s
    stop = way.moved_s(start, distance_v)
    instants = np.linspace(start, min(stop, start + 2.0), 500)
    moved = np.abs(np.array([way.at(each) for each in instants]) - way.at(start))
    assert moved.max() <= distance_v * (1 + 1e-9) + 1e-6
    if len(way.terms) == 1 and stop < math.inf:
        assert moved[-1] == pytest.approx(distance_v, abs=1e-6)


@settings(deadline=None)
@given(WAYS, st.floats(-25.0, 25.0))
def test_it_crosses_a_level_where_a_search_finds_it(way: Approach, level_v: float) -> None:
    assume(abs(level_v - way.goal_v) > 1e-5)  # the end is an event by itself
    start = way.origin_s
    instants = start + np.concatenate(([0.0], np.geomspace(1e-8, 3.0, 4000)))
    above = np.array([way.at(each) for each in instants]) > level_v
    places = np.flatnonzero(above != above[0])
    crossed = way.crosses_s(start, level_v)
    nearest = min(abs(way.at(each) - level_v) for each in instants[instants <= min(crossed, start + 3.0)])
    if len(places) == 0:
        # what only touches it may be looked at there
        assert crossed == math.inf or nearest < 1e-5
    else:
        assert instants[places[0] - 1] - 1e-9 <= crossed <= instants[places[0]] + 2e-9


@settings(deadline=None)
@given(WAYS)
def test_it_ends_when_a_microvolt_is_left(way: Approach) -> None:
    end = way.ends_s(way.origin_s)
    if not way.terms:
        assert end == math.inf
        return
    assert way.later(end + 1e-8).terms == ()
    left = sum(abs(size) * math.exp(-(end - way.origin_s) / tau) for size, tau in way.terms)
    assert left == pytest.approx(1e-6, rel=1e-2)
