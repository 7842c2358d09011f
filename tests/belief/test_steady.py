"""Steps, pulses and walks of the output between windows, and outputs that do not answer: found, and nothing else."""

from __future__ import annotations

import math
import re
import tracemalloc
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec.structs import replace

import vcfbench
from experiments.beliefs import Case, Windows, faults_of, run, spoilt, with_fault
from tests.procedures.fakes import make_settings
from vcfbench.belief.jumps import (
    _covariance,
    _free_orders,
    largest_jump,
    note,
    require_no_jump,
)
from vcfbench.belief.unseen import Course, Unseen, unseen
from vcfbench.belief.walk import Limits, Seen, Walk
from vcfbench.errors import MeasurementError
from vcfbench.instructions.schedule import Order, Zeros
from vcfbench.records.schema import Point
from vcfbench.station.parts import Expected
from vcfbench.station.settings import PAPER_RATES_DEG_S, Sources, Station
from vcfbench.steps import Acquire, Window

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

K, BIAS_V, NOISE_V = -0.0125, -0.041, 1.2e-4
RATES = (0.0, *PAPER_RATES_DEG_S, 0.0)
KNOWN = Sources(bias_instability_deg_h=5.57, scale_factor_ppm_k=104.0, bias_deg_h_k=36.0, warm_up_k=0.3)


def walked(added_v: NDArray[np.float64], rates: Sequence[float] = RATES, **settings: Any) -> Walk:
    """Return the windows of a gyroscope with a curve of 0.1 % and drawn noise, with something added to each."""
    station = Station(meter_resolution_v=1e-5, sources=KNOWN, expected=settings.pop("expected", Expected()))
    asked = make_settings(station=station, **settings)
    walk, rng = Walk(asked, Limits.of(asked)), np.random.default_rng(1)
    for rate, more_v in zip(rates, added_v, strict=True):
        x = rate / 200.0
        output_v = BIAS_V + K * rate + 4e-3 * x**2 - 2.5e-3 * x**3 + more_v + NOISE_V / math.sqrt(10.0) * rng.normal()
        point = Point(1, rate, 0.0, output_v, NOISE_V, 10)
        step = Acquire(1, rate, 0.0, rate, 0.05, (), 0.1, 10, 1.0, 1e-5)
        note(walk, step, Window((), rate, (), point))
    return walk


def test_a_gyroscope_that_is_not_straight_is_believed() -> None:
    require_no_jump(walked(np.zeros(len(RATES))))


@pytest.mark.parametrize(("apart_s", "moved_v", "believed"), [(20.0, 2e-3, False), (600.0, 2e-3, True)])
def test_windows_of_one_setting_may_differ_by_warm_up(apart_s: float, moved_v: float, *, believed: bool) -> None:
    """10 mV with 300 s from the first window on: 0.6 mV in the first 20 s, 8.6 mV in 600 s."""
    settings = make_settings(station=Station(meter_resolution_v=1e-5, sources=KNOWN))
    limits = replace(Limits.of(settings), warm_up_v=1e-2, warm_up_s=300.0, flicker_v=0.0, wander_v=0.0)
    walk = Walk(settings, limits)
    for at_s, output_v in ((1800.0, 0.0), (1800.0 + apart_s, moved_v)):
        point, ends_s = Point(1, 0.0, 0.0, output_v, 1e-5, 10), at_s + 10.0
        walk.add(Seen(point, driven=False, rails_v=(), table_deg_s=0.0, reference=False, begin_s=at_s, end_s=ends_s))
    with nullcontext() if believed else pytest.raises(MeasurementError, match="V apart"):
        walk.require_same(walk.windows[-1])


@pytest.mark.parametrize(("third_v", "believed"), [(0.0, True), (-8e-4, False)])
def test_window_is_held_against_every_earlier_one_of_its_setting(third_v: float, *, believed: bool) -> None:
    """Within 1 mV of the first, but 1.6 mV away from the second."""
    settings = make_settings(station=Station(meter_resolution_v=1e-5, sources=KNOWN))
    limits = replace(Limits.of(settings), warm_up_v=0.0, flicker_v=0.0, wander_v=1e-3)
    walk = Walk(settings, limits)
    for at_s, output_v in ((0.0, 0.0), (20.0, 8e-4), (40.0, third_v)):
        point = Point(1, 0.0, 0.0, output_v, 1e-6, 10)
        walk.add(Seen(point, False, (), 0.0, False, at_s, at_s + 10.0))  # noqa: FBT003
    with nullcontext() if believed else pytest.raises(MeasurementError, match="V apart"):
        walk.require_same(walk.windows[-1])


@pytest.mark.parametrize(("rate_error", "believed"), [(1e-3, True), (1e-6, False)])
def test_table_rates_may_be_off_by_stated_error(rate_error: float, *, believed: bool) -> None:
    """One of +100 deg/s by half of 0.1 %: 0.6 mV."""
    off_v = np.where(np.array(RATES) == 100.0, 5e-4 * K * 100.0, 0.0)
    known = replace(KNOWN, table_rate=rate_error, bias_instability_deg_h=0.5)
    walk = walked(off_v)
    walk.limits = Limits.of(make_settings(station=Station(meter_resolution_v=1e-5, sources=known)))
    with nullcontext() if believed else pytest.raises(MeasurementError, match="no smooth curve"):
        require_no_jump(walk)


def by_columns(walk: Walk) -> float:
    """Return the sigmas of the largest pattern, a column for each, as in the definition."""
    windows = walk.windows
    count, x = len(windows), np.array([each.table_deg_s for each in windows])
    x, at_s = x / np.abs(x).max(), np.array([each.middle_s for each in windows])
    free = np.column_stack([x**order for order in range(_free_orders(windows) + 1)])
    place = np.arange(count)
    patterns = [
        ((place >= first) & (place <= last)).astype(float)
        for first in range(count)
        for last in range(first, count)
        if last - first < count - 1
    ]
    patterns += [np.maximum(0.0, at_s - at_s[first - 1]) / (at_s[-1] - at_s[0]) for first in range(1, count - 1)]
    inverse = np.linalg.inv(_covariance(walk, windows, x, free))
    output = np.array([each.point.output_v for each in windows])
    found = [0.0]
    for pattern in patterns:
        weighted = inverse - inverse @ free @ np.linalg.solve(free.T @ inverse @ free, free.T @ inverse)
        shows = float(pattern @ weighted @ pattern)
        if shows > 1e-4 * float(pattern @ inverse @ pattern):
            found.append(float(pattern @ weighted @ output) / math.sqrt(shows))
    return max(found, key=abs)


@pytest.mark.parametrize("seed", range(12))
def test_the_largest_jump_is_that_of_the_definition(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(12, 30))
    rates = rng.choice(np.array([200.0, 50.0, 10.0, 0.0, -20.0, -100.0, -200.0]), count)
    added, (first, last) = np.zeros(count), sorted(rng.integers(0, count, 2))
    added[first:last] = 1e-4 * rng.normal()
    walk = walked(added, rates)
    found = largest_jump(walk, walk.windows)
    assert found is not None
    assert abs(found.sigmas) == pytest.approx(abs(by_columns(walk)), rel=1e-6)


def moved(course: Course) -> list[Unseen]:
    """Return what is not seen of eight values that are sums of the windows, one of them held for a spread."""
    shares = np.random.default_rng(2).normal(size=(8, len(course.windows))) / len(course.windows)
    u95 = {str(place): 1e-6 for place in range(len(shares))}

    def values(output_v: NDArray[np.float64], _: object) -> dict[str, float]:
        return dict(zip(u95, (shares @ output_v).tolist(), strict=True))

    return list(unseen(course, u95, values, frozenset({"3"})))


def all_watched(walk: Walk) -> Course:
    places = tuple(range(len(walk.windows)))
    return Course(tuple(walk.windows), places, ((walk, places),))


def test_many_windows_are_looked_at_in_little_memory() -> None:
    """Of 45 repeats of a turntable: their patterns, a column each, would take 2.4 GB; those of a list 340 MB."""
    rates = np.random.default_rng(1).choice(np.array(RATES), size := 300)
    walk = walked(np.zeros(size), rates)
    tracemalloc.start()
    try:
        assert largest_jump(walk, walk.windows) is not None
        assert moved(all_watched(walk))
        assert tracemalloc.get_traced_memory()[1] < 150.0 * size**2
    finally:
        tracemalloc.stop()


def test_too_many_windows_are_skipped_and_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    rates = np.random.default_rng(1).choice(np.array(RATES), 60)
    walk = walked(np.zeros(60), rates)
    assert {each.size is None for each in moved(all_watched(walk)) if each.kind == "step"} == {False}
    for module in ("patterns", "unseen"):
        monkeypatch.setattr(f"vcfbench.belief.{module}.MOST_WINDOWS", 40)
    with pytest.raises(MemoryError, match="60 windows, at most 40"):
        largest_jump(walk, walk.windows)
    few = moved(all_watched(walk))
    assert {(each.kind, each.size) for each in few if each.kind in {"step", "ramp"}} == {("step", None), ("ramp", None)}


@pytest.mark.parametrize("failure", [MemoryError("no more"), np.linalg.LinAlgError("not positive definite")])
def test_a_look_that_cannot_be_had_costs_no_run(failure: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise failure

    monkeypatch.setattr("vcfbench.belief.jumps.largest_jump", fails)
    settings = {"rates_deg_s": [100.0, 0.0, -100.0], "samples": 3}
    done = vcfbench.run("turntable", "lab", settings=settings, runs=None)
    assert done.status == "complete"
    assert done.results.scale_factor.value == pytest.approx(-0.0125, rel=0.01)
    assert [each.split(":")[0] for each in done.not_checked] == ["whether the output stepped or walked between windows"]


def test_two_levels_there_and_back_are_a_line() -> None:
    rates = (200.0, -200.0, -200.0, 200.0)
    require_no_jump(walked(np.zeros(4), rates))
    with pytest.raises(MeasurementError, match="apart, at most"):
        walked(np.array([0.0, 0.0, 3e-3, 0.0]), rates)


@pytest.mark.parametrize(
    ("place", "covers"), [(1, 1), (1, 3), (5, 1), (8, 2), (12, 3), (17, 1), (15, 3), (10, 9)], ids=str
)
@pytest.mark.parametrize("offset_v", [3e-3, -3e-3, 0.5])
def test_a_pulse_between_two_references_is_told_with_its_windows(place: int, covers: int, offset_v: float) -> None:
    added = np.zeros(len(RATES))
    added[place : place + covers] = offset_v
    with pytest.raises(MeasurementError, match=r"apart|was off by|stepped by|does not follow") as caught:
        require_no_jump(walked(added))
    assert caught.value.instrument == "multimeter"


def test_the_words_say_when_and_how_large() -> None:
    added = np.zeros(len(RATES))
    added[3:5] = 3e-3
    words = r"off by \+0\.00\d+ V .* from \+50 deg/s \(step 1, 38\.0 to 48\.0 s\) to \+20 deg/s .*, and is not any"
    with pytest.raises(MeasurementError, match=words):
        require_no_jump(walked(added))
    with pytest.raises(MeasurementError, match=r"was -0\.04\d+ V at \+0 deg/s .* and is now .*: \+0\.00\d+ V apart"):
        walked(np.where(np.arange(len(RATES)) > 14, 3e-3, 0.0))


def test_clipped_output_is_compared_with_rails() -> None:
    walk = walked(np.zeros(len(RATES)))
    for place, each in enumerate(walk.windows):
        within = replace(each.point, output_v=min(each.point.output_v, 2.3))
        walk.windows[place] = replace(each, point=within, rails_v=(4.0, -4.0))
    with pytest.raises(MeasurementError, match=r"whether it clips, at -2\.\d+ V on rails of 4 V"):
        require_no_jump(walk)


@pytest.mark.parametrize("since", [5, 13, 15])
def test_disagreeing_windows_name_the_two_around_step(since: int) -> None:
    places = " and ".join(f"{RATES[at]:+g} deg/s" for at in (since - 1, since))
    with pytest.raises(MeasurementError, match=r"apart, at most") as caught:
        walked(np.where(np.arange(len(RATES)) >= since, 5e-3, 0.0))
    found = re.search(
        r"the output stepped by \+0\.00[45]\d* V \(.*?\) between (.*?) \(.*\) and (.*?) \(", str(caught.value)
    )
    assert found is not None, caught.value
    assert " and ".join(found.groups()) == places


def test_walk_beyond_expected_drift_is_found() -> None:
    walk_v = 2e-3 * np.arange(len(RATES)) / len(RATES)
    with pytest.raises(MeasurementError, match="apart, at most"):
        walked(walk_v)
    require_no_jump(walked(walk_v, expected=Expected(zero_drift_v=3e-3)))


def test_an_output_that_does_not_answer_is_no_output() -> None:
    walk = walked(np.zeros(len(RATES)))
    dead = [replace(each, point=replace(each.point, output_v=1e-5 * (n % 3))) for n, each in enumerate(walk.windows)]
    walk.windows[:] = dead
    with pytest.raises(MeasurementError, match="does not respond to the table's rate"):
        require_no_jump(walk)


@pytest.mark.parametrize(("at_200_deg_s_v", "believed"), [(4e-4, True), (1e-4, False)])
def test_output_responds_if_slope_is_eight_uncertainties(at_200_deg_s_v: float, *, believed: bool) -> None:
    """A mean is known to 43 uV by noise and flicker."""
    walk, rng = walked(np.zeros(len(RATES))), np.random.default_rng(2)
    for n, each in enumerate(walk.windows):
        output_v = at_200_deg_s_v * each.table_deg_s / 200.0 + NOISE_V / math.sqrt(10.0) * rng.normal()
        walk.windows[n] = replace(each, point=replace(each.point, output_v=output_v))
    with nullcontext() if believed else pytest.raises(MeasurementError, match="does not respond"):
        require_no_jump(walk)


SWEEPS = [
    Case("turntable"),
    Case("turntable", order=Order.LOOP, zeros=Zeros.ENDS),
    Case("kvc", "lab", samples=4, match_rates_deg_s=[20.0, 100.0, 200.0], cycles=1),
]


@pytest.mark.parametrize(
    ("case", "each"),
    [
        pytest.param(case, each, marks=pytest.mark.exhaustive)
        for case, each in ((SWEEPS[0], 401), *((s, 197) for s in SWEEPS))
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_faults_of_the_multimeter_end_a_simulated_run(case: Case, each: int, tmp_path: Any) -> None:
    """A sample of what experiments/beliefs.py does in every gap."""
    seen = Windows()
    assert not isinstance(run(case, 3, str(tmp_path), [seen]), MeasurementError)
    for name, fault in list(faults_of(seen.times_s))[::each]:
        with spoilt(with_fault(fault)):
            assert isinstance(run(case, 3, str(tmp_path)), MeasurementError), name


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("case", "fault"),
    [
        (Case("virtual-coriolis", "paper"), "pulse +0.1 V over 3 from window 38"),
        pytest.param(
            Case("virtual-coriolis", "lab", order="abba", zeros="ends"),
            "pulse +0.003 V over 2 from window 88",
            marks=pytest.mark.exhaustive,
        ),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_pulse_over_ends_of_virtual_sweep_ends_run(case: Case, fault: str, tmp_path: Any) -> None:
    """A pulse over the largest levels of one sign, or over both visits of the smallest."""
    seen = Windows()
    run(case, 3, str(tmp_path), [seen])
    with spoilt(with_fault(dict(faults_of(seen.times_s))[fault])):
        assert isinstance(run(case, 3, str(tmp_path)), MeasurementError)
