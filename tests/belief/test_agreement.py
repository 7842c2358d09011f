"""What the points of a run say about each other."""

from __future__ import annotations

import math
from random import Random
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace

from vcfbench.belief.agreement import (
    require_expected_column,
    require_expected_k_vc,
    require_same_zero,
    require_steady_slope,
)
from vcfbench.errors import MeasurementError
from vcfbench.records.schema import Point
from vcfbench.station.parts import Expected

if TYPE_CHECKING:
    from collections.abc import Callable

K, BIAS_V, NOISE_V = -0.0125, -0.041, 1.2e-4
RATES = (200.0, 100.0, 50.0, 10.0, 0.0, -10.0, -50.0, -100.0, -200.0)


def point(step: int, rate_deg_s: float, output_v: float, v_vc_v: float = 0.0) -> Point:
    return Point(step, rate_deg_s, v_vc_v, output_v, NOISE_V, 10)


def sweep(step: int = 3) -> list[Point]:
    return [point(step, rate, BIAS_V + K * rate) for rate in RATES]


def faulty(points: list[Point], since: int, fault: Callable[[float], float]) -> list[Point]:
    return [replace(p, output_v=fault(p.output_v)) if i >= since else p for i, p in enumerate(points)]


def test_points_on_a_line_are_believed() -> None:
    require_steady_slope(sweep())
    require_steady_slope(sweep(), (point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K)))


@pytest.mark.parametrize("since", range(1, 9))
@pytest.mark.parametrize("fault", [lambda _: 0.0, lambda v: -v], ids=["lead off", "leads swapped"])
def test_lead_that_comes_off_or_is_swapped_is_found(since: int, fault: Callable[[float], float]) -> None:
    with pytest.raises(MeasurementError, match="a lead is off or swapped"):
        require_steady_slope(faulty(sweep(), since, fault))


def test_measured_levels_pass_however_wrong_the_generator_is() -> None:
    """Offsets of 3.6 and -4.3 mV again: V_Vc as it was set predicts half or twice the step, as measured the step."""
    levels = [-0.067, -0.037, -0.015, 0.0, 0.015, 0.037, 0.067]
    seen = [(v, v + (3.6e-3 if abs(v) < 0.03 else -4.3e-3)) for v in levels]
    points = [replace(point(4, 0.0, -1.88 * is_v, v), v_vc_measured_v=is_v) for v, is_v in seen]
    require_steady_slope(points, (points[3], points[-1]))
    with pytest.raises(MeasurementError, match="predicts"):
        require_steady_slope(faulty(points, 4, lambda _: 0.0), (points[3], points[-1]))


def test_small_levels_on_two_ranges_are_no_fault() -> None:
    """Seen: offsets of 3.6 and -4.3 mV, each within 2 % and 4 mV, between 15 and 37 mV."""
    per_v = -1.88
    levels = [-0.067, -0.037, -0.015, 0.0, 0.015, 0.037, 0.067]
    points = [point(4, 0.0, per_v * (v + (3.6e-3 if abs(v) < 0.03 else -4.3e-3)), v) for v in levels]
    reference = (point(2, 0.0, per_v * 3.6e-3), point(2, 0.0, per_v * (0.067 - 4.3e-3), 0.067))
    with pytest.raises(MeasurementError, match="predicts"):
        require_steady_slope(points, reference)
    require_steady_slope(points, reference, lambda v: 0.02 * abs(v) + 4e-3)
    for broken in (faulty(points, 4, lambda _: 0.0), faulty(points, 4, lambda v: -v)):
        with pytest.raises(MeasurementError, match="a lead is off or swapped"):
            require_steady_slope(broken, reference, lambda v: 0.02 * abs(v) + 4e-3)


def test_sweep_with_swapped_leads_contradicts_the_slope_of_step_1() -> None:
    step_1 = (point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K))
    with pytest.raises(MeasurementError, match="the slope of step 1 predicts"):
        require_steady_slope(faulty(sweep(), 0, lambda v: -v), step_1)


def test_curvature_and_noise_are_no_fault() -> None:
    curved = [replace(p, output_v=p.output_v * (1.0 + 0.02 * p.output_v)) for p in sweep()]
    require_steady_slope(curved)
    noisy = [replace(p, output_v=p.output_v + (-1) ** i * 2e-3, std_v=6e-3) for i, p in enumerate(sweep())]
    require_steady_slope(noisy)
    require_steady_slope(sweep()[:1])


def test_v_vc_offset_moves_zero_when_generator_comes_on() -> None:
    zero, turning = point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K)
    for bias_v in (BIAS_V, -3.0):
        both = point(1, 0.0, bias_v), point(2, 0.0, bias_v + 0.0517)
        require_same_zero(*both, point(1, 10.0, bias_v + 10 * K))
    with pytest.raises(MeasurementError, match="V_Vc has an offset"):
        require_same_zero(zero, point(2, 0.0, BIAS_V + 150 * 0.5 * K), turning)


@pytest.mark.parametrize("k_vc", [-150.0, 14.9, 1501.0])
def test_k_vc_has_sign_and_rough_size_of_guess(k_vc: float) -> None:
    for good in (15.0, 40.0, 1500.0):
        require_expected_k_vc(good, 150.0, Expected())
    with pytest.raises(MeasurementError, match="the bench file guesses 150"):
        require_expected_k_vc(k_vc, 150.0, Expected())


def test_what_is_expected_of_the_gyroscope() -> None:
    good = Expected(scale_factor_v_per_deg_s=(-0.013, -0.012), bias_v=(-0.1, 0.1), k_vc_deg_s_per_v=(140.0, 160.0))
    require_expected_column(sweep(1), good)
    for k_vc in (140.0, 150.0, 160.0):
        require_expected_k_vc(k_vc, 1.0, good)
    with pytest.raises(MeasurementError, match=r"scale factor is 0.0125 V/\(deg/s\), the bench file expects -0.013 to"):
        require_expected_column(faulty(sweep(1), 0, lambda v: -v), good)
    with pytest.raises(MeasurementError, match=r"multimeter: the bias is \+?0.459 V.*step 1"):
        require_expected_column(faulty(sweep(1), 0, lambda v: v + 0.5), good)
    with pytest.raises(MeasurementError, match=r"K_Vc is 161 .*\(expected.k_vc_deg_s_per_v\), step 2"):
        require_expected_k_vc(161.0, 150.0, good)


def test_slope_within_noise_is_accepted() -> None:
    """Two rates near to each other come first; by all of them the slope is known, and one that is off is refused."""
    random, expected = Random(3), Expected(scale_factor_v_per_deg_s=(1.05 * K, 0.95 * K), bias_v=(-0.042, -0.040))  # noqa: S311
    for _ in range(200):
        noise_v = 10.0 ** random.uniform(-4.0, -1.5)
        found = [
            Point(1, rate, 0.0, BIAS_V + K * rate + random.gauss(0.0, noise_v / math.sqrt(10.0)), noise_v, 10)
            for rate in random.sample((0.0, -1.0, 10.0, -20.0), 2)
        ]
        require_expected_column(found, expected)
    with pytest.raises(MeasurementError, match="scale factor is"):
        require_expected_column(faulty(sweep(1), 0, lambda v: 1.06 * v), expected)


def test_what_is_expected_is_the_slope_from_end_to_end() -> None:
    """Of a curved column; its slope between the first two rates is 4 % larger."""
    curved = [point(1, rate, K * (rate + rate**3 * 4e-7)) for rate in RATES]
    ends = K * (1.0 + 200.0**2 * 4e-7)
    around = (min(ends * 1.001, ends * 0.999), max(ends * 1.001, ends * 0.999))
    require_expected_column(curved, Expected(scale_factor_v_per_deg_s=around))


def test_the_bias_is_that_of_the_rate_nearest_to_zero() -> None:
    """Of a curved column, 40 mV higher at both ends; nearest are 0 or, without it, -10 deg/s."""
    curved = [point(1, rate, BIAS_V + K * rate + rate**2 * 1e-6) for rate in RATES]
    expected = Expected(bias_v=(BIAS_V - 2e-4, BIAS_V + 2e-4))
    require_expected_column(curved, expected)
    require_expected_column([p for p in curved if p.rate_deg_s not in {0.0, 10.0}], expected)


@pytest.mark.parametrize(("by_v", "found"), [(0.99, False), (1.01, True)])
def test_allowed_step_follows_the_noise_of_two_means(by_v: float, *, found: bool) -> None:
    """Half a step of the line, and eight standard deviations of a difference of means of ten readings each."""
    bound_v = 0.5 * abs(K) * 10.0 + 8.0 * NOISE_V * 100.0 * (2.0 / 10.0) ** 0.5
    noisy = [replace(p, std_v=NOISE_V * 100.0) for p in sweep()]
    moved = [replace(p, output_v=p.output_v + bound_v * by_v) if p.rate_deg_s == 0.0 else p for p in noisy]
    if found:
        with pytest.raises(MeasurementError, match="the output moves by"):
            require_steady_slope(moved)
    else:
        require_steady_slope(moved)


@pytest.mark.parametrize(("by_v", "found"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_level_as_set_may_be_off_by_both_limits(by_v: float, sign: float, *, found: bool) -> None:
    """Half a step of 0.1 V, 5 mV at 0 V and 6 mV at -0.1 V."""
    levels = [point(4, 0.0, sign * K * 150.0 * v, v) for v in (-0.1, 0.0, 0.1, 0.2)]
    bound_v = abs(K) * 150.0 * (0.5 * 0.1 + 0.005 + 0.006)
    quiet = [replace(p, std_v=0.0) for p in levels]
    moved = [replace(p, output_v=p.output_v - sign * bound_v * by_v) if p.v_vc_v == 0.0 else p for p in quiet]

    def limit_v(level_v: float) -> float:
        return 5e-3 + 0.01 * abs(level_v)

    reference = (point(2, 0.0, 0.0), point(2, 0.0, sign * K * 15.0, 0.1))
    if found:
        with pytest.raises(MeasurementError, match=r"predicts .*step 4"):
            require_steady_slope(moved, reference, limit_v)
    else:
        require_steady_slope(moved, reference, limit_v)


def test_constant_output_is_found_although_noise_hides_each_step() -> None:
    dead = [replace(p, output_v=BIAS_V, std_v=0.1) for p in sweep()]
    step_1 = (point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K))
    with pytest.raises(MeasurementError, match=r"from -200 deg/s to \+200 deg/s the output moves by \+0 V"):
        require_steady_slope(dead, step_1)
    with pytest.raises(MeasurementError, match="the slope of step 1"):
        require_steady_slope(dead[::8], step_1)


@pytest.mark.parametrize("step", [2, 4, 6, 7])
def test_point_with_generator_on_is_placed_at_its_v_vc(step: int) -> None:
    levels = [point(step, 0.0, BIAS_V + K * 150.0 * v, v_vc_v=v) for v in (1.0, 0.5, 0.0, -0.5, -1.0)]
    require_steady_slope(levels)
    with pytest.raises(MeasurementError, match="V_Vc of"):
        require_steady_slope(faulty(levels, 2, lambda _: 0.0))


@pytest.mark.parametrize("step", [1, 3, 5])
def test_with_the_generator_off_a_point_stands_at_its_rate(step: int) -> None:
    require_steady_slope(sweep(step))
