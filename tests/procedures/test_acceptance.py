from __future__ import annotations

from typing import Any

from vcfbench.procedures.acceptance import judged
from vcfbench.procedures.settings import Limit
from vcfbench.record.schema import Point

COLUMN: dict[str, Any] = {
    "scale_factor": {"value": -0.0125},
    "bias": {"value": -0.041},
    "nonlinearity_ppm": {"max_span": 350.0},
}
RESULTS = {"turntable": COLUMN, "k_vc": {"value": 150.1}, "scale_factor_error_percent": 1.5}
POINTS = [Point(1, rate, 0.0, -0.0125 * rate, 1.2e-4, 10) for rate in (-1.0, 0.0, 1.0)]


def verdicts(results: dict[str, Any], *limits: Limit) -> list[str]:
    acceptance = judged(limits, results, POINTS)
    assert acceptance is not None
    return [acceptance.as_json()["verdict"], *(limit.word for limit in acceptance.limits)]


def test_what_is_within_its_limits_passes_bounds_included() -> None:
    limits = (
        Limit("scale_factor_v_per_deg_s", -0.0125, -0.0120),
        Limit("bias_v", -0.05, -0.041),
        Limit("bias_deg_s", 3.0, 3.5),
        Limit("nonlinearity_ppm", 0.0, 350.0),
        Limit("reading_noise_v", 0.0, 1.3e-4),
        Limit("k_vc_deg_s_per_v", 140.0, 160.0),
        Limit("scale_factor_error_percent", -2.0, 2.0),
    )
    assert verdicts(RESULTS, *limits) == ["pass"] * 8


def test_one_limit_that_fails_fails_the_run() -> None:
    limits = Limit("bias_v", -0.05, 0.05), Limit("nonlinearity_ppm", 0.0, 349.9)
    assert verdicts(COLUMN, *limits) == ["fail", "pass", "fail"]


def test_what_the_procedure_does_not_measure_is_said_and_not_judged() -> None:
    limits = Limit("bias_v", -0.05, 0.05), Limit("k_vc_deg_s_per_v", 1.0, 2.0)
    assert verdicts(COLUMN, *limits) == ["pass", "pass", "not measured"]
    assert judged(limits[1:], COLUMN, POINTS) is None
    assert judged((), RESULTS, POINTS) is None


def test_a_result_that_cannot_be_computed_does_not_pass() -> None:
    none = {**COLUMN, "nonlinearity_ppm": {"max_span": None}}
    assert verdicts(none, Limit("nonlinearity_ppm", 0.0, 1e6)) == ["fail", "fail"]
    still = {**COLUMN, "scale_factor": {"value": 0.0}}
    assert verdicts(still, Limit("bias_deg_s", -5000.0, 5000.0)) == ["fail", "fail"]
