"""What the outputs of windows may scatter by, window by window as its causes are defined."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest

from tests.procedures.fakes import make_settings
from vcfbench.analysis.correlation import Correlation
from vcfbench.belief.jumps import _HIGHEST, _MOST_BENT, _NEXT, _covariance
from vcfbench.belief.walk import Limits, Seen, Walk
from vcfbench.records.schema import Point
from vcfbench.station.settings import PlacedInstrument, Sources, Station

GROWTH, ORDERS, DIGIT_V = 1.7, 2, 2e-5
GENERATOR = {"rate_source": PlacedInstrument(model="33220A", where="FAKE")}
METER = {**GENERATOR, "v_vc_meter": PlacedInstrument(model="34401A", where="FAKE")}


def walked(seed: int, *, driven: bool, measured: bool = False) -> Walk:
    """Return windows of three levels and rest, so with free orders up to the second, and drawn limits."""
    rng = np.random.default_rng(seed)
    sizes = {name: 10.0 ** rng.uniform(-5.0, -3.0) for name in Limits.__struct_fields__}
    limits = Limits(**{**sizes, "warm_up_s": rng.uniform(200.0, 3000.0)})
    sources = Sources(generator_gain=0.02, generator_offset_v=4e-3, generator_ranges_v=(0.4, 10.0), generator_bits=14)
    instruments = METER if measured else GENERATOR
    walk = Walk(
        make_settings(station=Station(instruments=instruments, meter_resolution_v=DIGIT_V, sources=sources)), limits
    )
    begin_s = 100.0
    for level in rng.permutation([-200.0, -50.0, 0.0, 200.0, -200.0, -50.0, 0.0, 200.0, 200.0]):
        lasts_s, volts = rng.uniform(5.0, 15.0), level / 150.0 * driven
        output_v = 0.0125 * level + 1e-3 * (level / 200.0) ** 2 + 1e-4 * rng.normal()
        v_vc = (volts, 1e-6) if measured else (None, None)
        point = Point(1, level, volts, output_v, rng.uniform(1e-5, 1e-4), int(rng.integers(4, 20)), *v_vc)
        walk.add(Seen(point, driven, (), 0.0 if driven else level, False, begin_s, begin_s + lasts_s, "+z" * driven))  # noqa: FBT003
        begin_s += lasts_s + rng.uniform(2.0, 200.0)
    walk.correlation = Correlation(growth=GROWTH)
    return walk


def by_causes(walk: Walk, x: np.ndarray, free: np.ndarray, one: int, other: int) -> Any:
    """Return the covariance of two windows' outputs, cause by cause."""
    limits, windows, same = walk.limits, walk.windows, one == other
    output = [each.point.output_v for each in windows]
    span_v, at_s = max(output) - min(output), [0.5 * (each.begin_s + each.end_s) for each in windows]
    curve = np.linalg.solve(free.T @ free, free.T @ np.array(output))
    slope_v, (a, b), (t, s) = abs(curve[1]), (windows[one], windows[other]), (at_s[one], at_s[other])
    total = 1e-18 * same
    if same:
        alike = [each.point.std_v**2 for each in windows if abs(each.table_deg_s) == abs(a.table_deg_s)]
        dof = [each.point.n - 1 for each in windows]
        pooled = sum(n * each.point.std_v**2 for n, each in zip(dof, windows, strict=True)) / sum(dof)
        total += GROWTH * max(pooled, sum(alike) / len(alike)) / a.point.n + DIGIT_V**2 / 12.0
        total += (limits.table_rate * slope_v * x[one]) ** 2 / 3.0 * (a.table_deg_s != 0.0)
        total += (limits.placed_share * span_v + limits.placed_v) ** 2 / 3.0 * bool(a.up)
    sizes = [min(abs(each), _MOST_BENT * span_v) for each in curve]
    for order in range(ORDERS + 1, _HIGHEST + 1):
        below = sizes[order - 2] if order > 3 else _MOST_BENT * span_v
        sizes.append(max(_NEXT * below, 1e-6 * span_v))
        total += (sizes[order] * x[one] ** order) * (sizes[order] * x[other] ** order)
    lasts_s = sum(each.end_s - each.begin_s for each in windows) / len(windows)
    longest = 3.0 + math.log((at_s[-1] - at_s[0]) / lasts_s)
    apart = 0.0 if same else 1.5 + math.log(max(1.0, abs(t - s) / lasts_s))
    total += limits.flicker_v**2 / math.pi * (longest - apart)
    cooled = math.exp(-(t + s - 2.0 * windows[0].begin_s) / limits.warm_up_s)
    moved_v2 = slope_v**2 * x[one] * x[other]
    total += cooled * (limits.warm_up_v**2 + limits.warm_up_share**2 * moved_v2)
    wandered = (min(t, s) - at_s[0]) / (at_s[-1] - at_s[0])
    total += wandered * (limits.wander_v**2 + limits.wander_share**2 * moved_v2)
    if a.driven:
        volts, others = a.point.v_vc_v, b.point.v_vc_v
        if a.point.v_vc_measured_v is not None:
            return total + (1e-5 * slope_v) ** 2 * (volts == others)
        above, error_v2 = abs(volts) > 0.4, 0.0
        if above == (abs(others) > 0.4):
            room_v = 0.02 * 0.4 * above
            error_v2 = (0.02**2 * volts * others + 4e-3**2 + 4e-3 * room_v + room_v**2 / 3.0) / 3.0
        digit_v = 2.0 * (10.0 if above else 0.4) / 2**14
        total += (slope_v / max(abs(each.point.v_vc_v) for each in windows)) ** 2 * (
            error_v2 + digit_v**2 / 12.0 * (volts == others)
        )
    return total


@pytest.mark.parametrize(("seed", "kind"), list(product(range(4), ["table", "set", "measured"])))
def test_outputs_vary_together_by_the_causes_that_they_share(seed: int, kind: str) -> None:
    walk = walked(seed, driven=kind != "table", measured=kind == "measured")
    levels = np.array([each.point.rate_deg_s for each in walk.windows])
    x = levels / np.abs(levels).max()
    free = np.column_stack([x**order for order in range(ORDERS + 1)])
    found = _covariance(walk, walk.windows, x, free)
    count = range(len(levels))
    assert found == pytest.approx(
        np.array([[by_causes(walk, x, free, i, j) for j in count] for i in count]), rel=1e-6, abs=1e-17
    )
