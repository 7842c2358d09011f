"""What the points of a run say about each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace

from tests.procedures.fakes import make_settings
from vcfbench.bench.settings import Expected
from vcfbench.errors import MeasurementError
from vcfbench.procedures.sweep.agreement import (
    SWEEP_DRIFT,
    require_agreement,
    require_expected_column,
    require_expected_k_vc,
    require_same_zero,
    require_steady_slope,
)
from vcfbench.record.schema import Point

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


def test_points_that_agree_are_believed() -> None:
    zero = [point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K), point(1, 0.0, BIAS_V + 2e-4)]
    require_agreement(zero, make_settings(), SWEEP_DRIFT)
    require_agreement([*zero, *sweep()[:5]], make_settings(), SWEEP_DRIFT)
    require_steady_slope(sweep())
    require_steady_slope(sweep(), (zero[0], zero[1]))


def test_a_zero_that_moved_is_told_with_both_steps_and_what_is_allowed() -> None:
    points = [point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K), *faulty(sweep()[:5], 0, lambda v: v + 0.5)]
    words = (
        r"was -0\.041 V in step 1 and is now \+0\.459 V at the same \+0 deg/s: \+0\.5 V apart, at most 0\.00\d+ V are"
    )
    with pytest.raises(MeasurementError, match=words) as caught:
        require_agreement(points, make_settings(), SWEEP_DRIFT)
    assert (caught.value.instrument, caught.value.step) == ("multimeter", "3")


def test_the_bench_file_says_how_much_drift_there_may_be() -> None:
    drifted = [point(4, 0.0, 0.01), point(4, 0.0, 0.02)]
    with pytest.raises(MeasurementError, match="are noise and drift"):
        require_agreement(drifted, make_settings(), SWEEP_DRIFT)
    require_agreement(drifted, make_settings(expected=Expected(zero_drift_v=0.011)), SWEEP_DRIFT)


def test_the_same_v_vc_must_give_the_same_output_whatever_the_step() -> None:
    driven = [point(2, 0.0, -0.115, 0.0666), point(2, 0.0, 0.010), point(4, 9.99, -0.100, 0.0666)]
    with pytest.raises(MeasurementError, match=r"V_Vc of \+0.0666 V: \+0.015 V apart"):
        require_agreement(driven, make_settings(), SWEEP_DRIFT)


@pytest.mark.parametrize("since", range(1, 9))
@pytest.mark.parametrize("fault", [lambda _: 0.0, lambda v: -v], ids=["lead off", "leads swapped"])
def test_a_lead_that_comes_off_or_is_swapped_within_a_sweep_is_found(
    since: int, fault: Callable[[float], float]
) -> None:
    with pytest.raises(MeasurementError, match="a lead came off or was swapped"):
        require_steady_slope(faulty(sweep(), since, fault))


def test_a_whole_sweep_with_swapped_leads_has_not_the_slope_of_step_1() -> None:
    step_1 = (point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K))
    with pytest.raises(MeasurementError, match="the slope of step 1 lets expect"):
        require_steady_slope(faulty(sweep(), 0, lambda v: -v), step_1)


def test_curvature_and_noise_are_no_fault() -> None:
    curved = [replace(p, output_v=p.output_v * (1.0 + 0.02 * p.output_v)) for p in sweep()]
    require_steady_slope(curved)
    noisy = [replace(p, output_v=p.output_v + (-1) ** i * 2e-3, std_v=6e-3) for i, p in enumerate(sweep())]
    require_steady_slope(noisy)
    require_steady_slope(sweep()[:1])


def test_v_vc_with_an_offset_moves_the_zero_as_the_generator_comes_on() -> None:
    zero, turning = point(1, 0.0, BIAS_V), point(1, 10.0, BIAS_V + 10 * K)
    require_same_zero(zero, point(2, 0.0, BIAS_V + 0.0517), turning)
    with pytest.raises(MeasurementError, match="V_Vc has an offset"):
        require_same_zero(zero, point(2, 0.0, BIAS_V + 150 * 0.5 * K), turning)


@pytest.mark.parametrize("k_vc", [-150.0, 14.0, 1600.0])
def test_k_vc_has_the_sign_and_roughly_the_size_of_the_guess(k_vc: float) -> None:
    require_expected_k_vc(40.0, 150.0, Expected())
    with pytest.raises(MeasurementError, match="the bench file guesses 150"):
        require_expected_k_vc(k_vc, 150.0, Expected())


def test_what_is_expected_of_the_gyroscope() -> None:
    good = Expected(scale_factor_v_per_deg_s=(-0.013, -0.012), bias_v=(-0.1, 0.1), k_vc_deg_s_per_v=(140.0, 160.0))
    require_expected_column(sweep(1), good)
    require_expected_k_vc(150.0, 36.0, good)
    with pytest.raises(MeasurementError, match=r"scale factor is 0.0125 V/\(deg/s\), the bench file expects -0.013 to"):
        require_expected_column(faulty(sweep(1), 0, lambda v: -v), good)
    with pytest.raises(MeasurementError, match=r"the bias is \+?0.459 V"):
        require_expected_column(faulty(sweep(1), 0, lambda v: v + 0.5), good)
    with pytest.raises(MeasurementError, match=r"K_Vc is 161 .*\(expected.k_vc_deg_s_per_v\)"):
        require_expected_k_vc(161.0, 150.0, good)
