"""V_Vc is matched on a gyroscope whose noise is much of the least rate, and not where it does nothing."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from msgspec import structs

from vcfbench.errors import MeasurementError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.null_comparison.plan import invalid_match_rates, nulled
from vcfbench.procedures.virtual_coriolis.plan import _match
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.schema import Point
from vcfbench.station.file import embedded_text
from vcfbench.steps import Acquire, Window

if TYPE_CHECKING:
    from vcfbench.procedures.kvc import KVcSettings

SETTINGS = cast("KVcSettings", settings_of(PROCEDURES["kvc"], checked_bench(tomllib.loads(embedded_text("lab")), "")))
RATE_DEG_S, SPAN_V = 10.0, 0.125


def matched(seed: int, noise: float, answers: float = 1.0, later: tuple[float, float] = (1.0, 1.0)) -> None:
    """Match one rate with means whose noise is a share of its output; V_Vc moves it by a share of what it should.

    After the search by a share of that again, `later`, at levels of either sign.
    """
    rng, gyro = np.random.default_rng(seed), SETTINGS.expected_gyro()
    plan = nulled(SETTINGS, [RATE_DEG_S], 1, 4, (1, 2, 3))
    result: Any = None
    while True:
        try:
            step = plan.send(result)
        except StopIteration:
            return
        result = step.predict(gyro)
        if isinstance(step, Acquire) and isinstance(result, Window):
            point = result.point
            rate_deg_s = (
                point.rate_deg_s if step.step == 1 else answers * SETTINGS.k_vc_guess_deg_s_per_v * point.v_vc_v
            )
            rate_deg_s *= later[int(point.v_vc_v * SETTINGS.k_vc_guess_deg_s_per_v < 0.0)] if step.step == 3 else 1.0
            output_v = gyro.scale_factor * rate_deg_s + noise * SPAN_V * rng.standard_normal()
            std_v = noise * SPAN_V * np.sqrt(point.n * rng.chisquare(point.n - 1) / (point.n - 1))
            result = structs.replace(result, point=structs.replace(point, output_v=output_v, std_v=float(std_v)))


def test_a_noisy_gyroscope_is_matched() -> None:
    for seed in range(60):
        matched(seed, float(np.random.default_rng(seed).uniform(0.0, 0.05)))


def test_output_that_ignores_v_vc_is_not_matched() -> None:
    for seed in range(20):
        with pytest.raises(MeasurementError):
            matched(seed, 0.01, answers=0.0)


@pytest.mark.parametrize("later", [(0.8, 1.0), (1.2, 1.0), (1.0, 0.8), (1.0, 1.2)])
def test_a_side_that_answers_otherwise_after_the_search_is_refused(later: tuple[float, float]) -> None:
    with pytest.raises(MeasurementError, match="the table moves the output by"):
        matched(1, 0.001, later=later)


def stepped(seed: int) -> float:
    """Match in step 2 with a generator whose range changes near the match; return what is left over the span."""
    rng, settings = np.random.default_rng(seed), VirtualCoriolisSettings(station=SETTINGS.station)
    end_v = settings.match_rate_deg_s / settings.k_vc_guess_deg_s_per_v * rng.uniform(0.95, 1.05)
    gain, true_k_vc = 1.0 + rng.uniform(-0.02, 0.02, 2), settings.k_vc_guess_deg_s_per_v * rng.uniform(0.97, 1.03)

    def taken(step: int, rate_deg_s: float, v_vc_v: float) -> Point:
        arrives_deg_s = rate_deg_s + true_k_vc * v_vc_v * gain[int(v_vc_v > end_v)]
        return Point(step, rate_deg_s, v_vc_v, 0.0125 * arrives_deg_s + 2e-6 * rng.standard_normal(), 6e-6, 10)

    plan = _match(settings, [taken(1, rate, 0.0) for rate in (0.0, settings.match_rate_deg_s)])
    result: Any = None
    while True:
        try:
            step = plan.send(result)
        except StopIteration as ended:
            matching = ended.value[1]
            return float(abs(matching.residual_v / matching.span_v))
        result = step.predict(settings.expected_gyro())
        if isinstance(step, Acquire) and isinstance(result, Window):
            result = structs.replace(result, point=taken(2, 0.0, step.v_vc_v))


def test_generator_range_ending_near_the_match_uses_the_nearer_end() -> None:
    left = [stepped(seed) for seed in range(100)]
    assert max(left) < 0.1
    assert sum(each < 5e-4 for each in left) > 80


@pytest.mark.parametrize(("order", "least"), [(1, 2), (2, 2), (3, 3), (4, 3), (5, 4)])
def test_a_curve_has_two_matches_more_than_coefficients_at_least(order: int, least: int) -> None:
    """Of either sign, so twice as many as magnitudes."""
    for count in range(1, 7):
        rates = [sign * 20.0 * n for n in range(1, count + 1) for sign in (1.0, -1.0)]
        few = [
            each.expected for each in invalid_match_rates(SETTINGS, rates, order) if each.path == "match_rates_deg_s"
        ]
        assert bool(few) is (count < least)
        assert all(each.startswith(f"at least {least} different") for each in few)
