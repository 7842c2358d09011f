"""An output that does not answer is refused; one that does, however it scatters, is not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from tests.belief.test_jumps import DIGIT_V, GROWTH, walked
from tests.procedures.fakes import make_settings
from vcfbench.belief.walk import Limits, require_answer
from vcfbench.errors import MeasurementError
from vcfbench.instructions.schedule import Order
from vcfbench.procedures.g_sensitivity import GSensitivitySettings
from vcfbench.records.schema import Point
from vcfbench.station.parts import Expected
from vcfbench.station.settings import Sources, Station

STD_V, N = 1e-3, 10


def points(swing_v: float) -> list[Point]:
    return [Point(1, rate, 0.0, swing_v * rate / 200.0, STD_V, N) for rate in (0.0, 100.0, -100.0, -100.0, 100.0, 0.0)]


def test_an_output_that_moves_by_twenty_sigmas_of_a_mean_answers() -> None:
    require_answer(make_settings(), points(20.0 * STD_V / N**0.5))


def test_an_output_that_moves_by_three_sigmas_of_a_mean_does_not() -> None:
    with pytest.raises(MeasurementError, match=r"from -0\.000474342 to \+0\.000474342 V in 6 windows, .* to 0\.0003 V"):
        require_answer(make_settings(), points(3.0 * STD_V / N**0.5))


@pytest.mark.parametrize("order", [Order.PAPER, Order.LOOP])
@pytest.mark.parametrize("seed", range(6))
def test_two_windows_of_one_setting_may_differ_by_what_moves_between_them(seed: int, order: Order) -> None:
    walk = walked(seed, driven=False)
    walk.settings = structs.replace(walk.settings, order=order)
    limits, begun_s = walk.limits, walk.windows[0].begin_s
    outputs = [each.point.output_v for each in walk.windows]
    dof = np.array([each.point.n - 1 for each in walk.windows])
    squares = np.array([each.point.std_v**2 for each in walk.windows])
    pooled = GROWTH * float(dof @ squares) / float(dof.sum())
    for n, later in enumerate(walk.windows):
        for earlier in walk.windows[:n]:
            apart_s = 0.5 * (later.begin_s + later.end_s - earlier.begin_s - earlier.end_s)
            of_readings = pooled * (1.0 / earlier.point.n + 1.0 / later.point.n) + 2.0 * DIGIT_V**2 / 12.0
            alike = [
                q
                for q, each in zip(squares, walk.windows, strict=True)
                if abs(each.table_deg_s) == abs(earlier.table_deg_s)
            ]
            moved_v = abs(earlier.point.output_v - outputs[0])
            of_table = 0.0
            if earlier.table_deg_s:
                of_table = 2.0 * max(0.0, GROWTH * float(np.mean(alike)) - pooled) / earlier.point.n
                of_table += 2.0 * (limits.table_rate * moved_v) ** 2
            lasts_s = earlier.end_s - earlier.begin_s
            of_flicker = 2.0 / math.pi * limits.flicker_v**2 * (1.5 + math.log(max(1.0, apart_s / lasts_s)))
            warmer = math.exp(-(0.5 * (earlier.begin_s + earlier.end_s) - begun_s) / limits.warm_up_s)
            warmer *= 1.0 - math.exp(-apart_s / limits.warm_up_s)
            drift_v = warmer * (limits.warm_up_v + limits.warm_up_share * moved_v)
            drift_v += limits.wander_v + limits.wander_share * moved_v
            drift_v += 0.01 * (max(outputs) - min(outputs)) * (order is Order.LOOP)
            sigmas = 6.0 + 40.0 / float(dof.sum())
            allowed_v = max(sigmas * math.sqrt(of_readings + of_table + of_flicker) + drift_v, 2.0 * DIGIT_V)
            assert walk._allowed_v(earlier, later) == pytest.approx(allowed_v, rel=1e-9)


@pytest.mark.parametrize("known", [True, False])
def test_limits_are_those_of_the_bench_file_or_of_the_class(*, known: bool) -> None:
    """By hand: 36 mV a deg/s are 10 uV a deg/h; what nobody tells is 20 deg/h, 1 K, 0.5 K, 100 deg/h/K, 300 ppm/K."""
    told: dict[str, Any] = {
        "bias_instability_deg_h": 5.0,
        "warm_up_k": 0.4,
        "bias_deg_h_k": 30.0,
        "scale_factor_ppm_k": 50.0,
    }
    sources = Sources(**(told | {"temperature_k": 2.0} if known else {}), warm_up_time_s=600.0, table_rate=1e-4)
    station = Station(expected=Expected(scale_factor_v_per_deg_s=(-0.037, -0.035)), sources=sources)
    settings = GSensitivitySettings(station=station, warm_up_s=300.0, tilt_deg=0.3, heading_deg=2.0)
    found = Limits.of(settings)
    flicker, begun_k, bias, share, wander_k = (5.0, 0.4, 30.0, 5e-5, 2.0) if known else (20.0, 1.0, 100.0, 3e-4, 0.5)
    begun_k *= math.exp(-settings.start_up_s / 600.0)
    by_hand = Limits(
        flicker_v=1e-5 * flicker,
        warm_up_s=600.0,
        warm_up_v=1e-5 * bias * begun_k,
        warm_up_share=share * begun_k,
        wander_v=1e-5 * bias * wander_k,
        wander_share=share * wander_k,
        table_rate=1e-4,
        placed_share=math.sin(math.radians(0.3)),
        placed_v=1e-5 * 15.041 * math.sin(math.radians(2.0)),
    )
    assert structs.astuple(found) == pytest.approx(structs.astuple(by_hand), rel=1e-5)
    stated = structs.replace(settings, station=structs.replace(station, expected=Expected(zero_drift_v=7e-3)))
    assert Limits.of(stated).wander_v == 7e-3
