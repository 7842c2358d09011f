from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from vcfbench.instructions.schedule import SweepSettings
from vcfbench.procedures.turntable import turntable_results
from vcfbench.procedures.virtual_coriolis.results import virtual_coriolis_results
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.schema import Point
from vcfbench.station.acceptance import judged, limit_key
from vcfbench.station.settings import Limit, Station
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import Value

K, K_VC = -0.0125, 150.0
RATES = (20.0, 10.0, 0.0, -10.0, -20.0)


def column(step: int, k: float = K, bias_v: float = -0.041) -> list[Point]:
    """A column that bends: the middle lies 0.1 mV off the line."""
    return [
        Point(step, rate, rate / K_VC * (step == 4), k * rate + bias_v + 1e-4 * (not rate), 1.2e-4, 10)
        for rate in RATES
    ]


def four_steps() -> list[Point]:
    outputs = ((1, 0.0, 0.0), (1, 10.0, 0.0), (2, 0.0, 0.0), (2, 0.0, 10.0 / K_VC))
    matching = [Point(step, rate, v_vc, K * (rate + K_VC * v_vc), 1.2e-4, 10) for step, rate, v_vc in outputs]
    return [*matching, *column(3), *column(4, 1.015 * K)]


STATION = Station(meter_resolution_v=1e-5)
POINTS = column(1)
TURNTABLE = turntable_results(SweepSettings(station=STATION), POINTS)
RESULTS = virtual_coriolis_results(VirtualCoriolisSettings(station=STATION), four_steps())


def verdicts(results: Any, *limits: Limit, points: list[Point] = POINTS) -> list[str]:
    acceptance = judged(limits, results, points)
    assert acceptance is not None
    return [acceptance.as_json()["verdict"], *(limit.word for limit in acceptance.limits)]


def test_what_is_within_its_limits_passes_bounds_included() -> None:
    ppm = RESULTS.turntable.nonlinearity_ppm.max_span
    assert ppm is not None
    assert ppm > 100.0
    stated = RESULTS.uncertainty
    limits = (
        Limit("scale_factor_v_per_deg_s", stated.value("turntable.scale_factor").value, -0.0120),
        Limit("bias_v", -0.05, stated.value("turntable.bias").value),
        Limit("bias_deg_s", 3.0, 3.5),
        Limit("nonlinearity_ppm", 0.0, ppm * (1.0 + 1e-9)),
        Limit("reading_noise_v", 0.0, 1.3e-4),
        Limit("k_vc_deg_s_per_v", 140.0, 160.0),
        Limit("scale_factor_error_percent", 1.4, 1.6),
    )
    assert verdicts(RESULTS, *limits) == ["pass"] * 8


def test_values_are_those_of_the_column_measured_on_the_table() -> None:
    values = {limit_key(each): each for each in reversed([*RESULTS.stated()]) if isinstance(each, Value)}
    assert values["scale_factor_v_per_deg_s"].value == pytest.approx(K)
    assert values["k_vc_deg_s_per_v"].value == pytest.approx(K_VC)
    assert values["scale_factor_error_percent"].value == pytest.approx(1.5)


def test_one_limit_that_fails_fails_the_run() -> None:
    limits = Limit("bias_v", -0.05, 0.05), Limit("nonlinearity_ppm", 0.0, 100.0)
    assert verdicts(TURNTABLE, *limits) == ["fail", "pass", "fail"]


def test_unmeasured_limit_is_listed_and_not_judged() -> None:
    limits = Limit("bias_v", -0.05, 0.05), Limit("k_vc_deg_s_per_v", 1.0, 2.0)
    assert verdicts(TURNTABLE, *limits) == ["pass", "pass", "not measured"]
    assert judged(limits[1:], TURNTABLE, POINTS) is None
    assert judged((), RESULTS, POINTS) is None


@dataclass(frozen=True, slots=True)
class Zero:
    """What somebody's own procedure came to."""

    bias_v: float | None
    spread_v: tuple[float, ...] = (0.1, 0.2)


def test_custom_result_is_judged_by_names_of_its_numbers() -> None:
    limits = Limit("bias_v", -0.05, 0.05), Limit("reading_noise_v", 0.0, 1e-3), Limit("bias_deg_s", 0.0, 1.0)
    assert verdicts(Zero(0.01), *limits) == ["pass", "pass", "pass", "not measured"]
    assert verdicts(Zero(0.1), *limits) == ["fail", "fail", "pass", "not measured"]
    assert verdicts({"bias_v": 0.01}, *limits) == ["pass", "pass", "pass", "not measured"]
    single = [Point(1, 0.0, 0.0, 0.0, 0.0, 1)]
    assert verdicts(Zero(0.01), *limits, points=single) == ["pass", "pass", "not measured", "not measured"]
    assert judged(limits, None, []) is None


def test_a_result_that_cannot_be_computed_does_not_pass() -> None:
    assert verdicts(Zero(None), Limit("bias_v", -1.0, 1.0)) == ["fail", "fail"]


@dataclass(frozen=True, slots=True)
class Stated:
    """Results of one's own, with values that have a kind."""

    offset: Value
    bend: Value


STATED = Stated(Value("offset", 0.010, "V", u95=0.002, kind="bias"), Value("bend", 999.0, "ppm", kind="nonlinearity"))


@pytest.mark.parametrize(
    ("high", "word"), [(0.0125, "pass"), (0.0115, "marginal"), (0.0095, "marginal"), (0.0075, "fail")]
)
def test_guard_band_is_u95_on_both_sides(high: float, word: str) -> None:
    assert verdicts(STATED, Limit("bias_v", -1.0, high, guarded=True)) == [word] * 2
    assert verdicts(STATED, Limit("bias_v", -1.0, high))[1] == ("pass" if high >= 0.010 else "fail")


def test_one_marginal_limit_makes_a_run_marginal_and_not_passed() -> None:
    limits = (Limit("bias_v", -1.0, 0.011, guarded=True), Limit("nonlinearity_ppm", 0.0, 1000.0, guarded=True))
    acceptance = judged(limits, STATED, POINTS)
    assert acceptance is not None
    assert not acceptance.passed
    written = acceptance.as_json()
    assert [written["verdict"], *(each["verdict"] for each in written["limits"])] == ["marginal", "marginal", "pass"]
    assert [each.get("u95") for each in written["limits"]] == [0.002, None]
    assert [each["rule"] for each in written["limits"]] == ["guarded, w = U95", "no U95: simple acceptance"]
    assert acceptance.conditional == acceptance.limits[0].conditional == "conditional pass"
    assert verdicts(STATED, limits[0], Limit("nonlinearity_ppm", 0.0, 1.0))[0] == "fail"


def test_an_e_n_by_an_incomplete_u95_says_so() -> None:
    found = measurand(3.0, "ppm", [], ("temperature",)).called("drift_ppm")
    verdict = judged([Limit("e_n", 0.0, 1.5)], {"e": Value("e_n", 0.4, kind="e_n", missing=found.missing)}, ())
    assert verdict is not None
    assert (verdict.word, verdict.said) == ("pass", "PASS with an incomplete U95, without temperature")
    guarded = judged([Limit("drift_ppm", 0.0, 5.0)], {"drift": found}, ())
    assert guarded is not None
    assert guarded.said == "PASS with an incomplete U95, without temperature"
