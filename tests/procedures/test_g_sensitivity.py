"""Bias against acceleration: what was set comes out, by other arithmetic too, and what is asked of the operator."""

from __future__ import annotations

import math
from statistics import fmean
from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace

import vcfbench
from vcfbench.errors import ConfigError
from vcfbench.procedures.g_sensitivity import GSensitivitySettings, _earth, gravity
from vcfbench.sim.simulation import true_output
from vcfbench.steps import AskOperator
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription

PER_G = (0.05, -0.02, 0.1)
QUICK: dict[str, Any] = {"samples": 4, "cycles": 1, "warm_up_s": 60.0, "turn_s": 5.0}


def bench(name: str) -> BenchDescription:
    return simulated(name, overrides={"sense_path": {"g_sensitivity_deg_s_g": list(PER_G)}})


def told(of: BenchDescription) -> dict[str, float]:
    output = true_output(of)
    return {"scale_factor_v_per_deg_s": (output(1.0, None) - output(-1.0, None)) / 2.0}


def test_without_noise_each_axis_comes_out_as_it_was_set() -> None:
    """On the equator, where the Earth's rate is level and the input axis points east."""
    ideal = bench("ideal")
    run = vcfbench.run("g-sensitivity", ideal, seed=1, settings={**QUICK, **told(ideal)}, runs=None)
    found = run.results
    assert [*found.per_g] == ["x", "y", "z"]
    assert [each.value for each in found.per_g.values()] == pytest.approx(PER_G, abs=5e-4)
    for axis, each in found.per_g.items():
        assert found.per_m_s2[axis].value == pytest.approx(each.value / 9.80665, rel=1e-12)
        assert found.per_m_s2[axis].u95 == pytest.approx(each.u95 / 9.80665, rel=1e-9)
        assert each.missing == ("scale factor",)
    assert found.gravity_m_s2 == pytest.approx(9.7803253, abs=1e-6)


def test_earth_s_rate_is_taken_off_a_vertical_input_axis() -> None:
    """By hand from the points of a gyroscope that gravity does nothing to, without noise."""
    ideal = simulated("ideal")
    ideal = replace(ideal, site=replace(ideal.site, latitude_deg=60.0))
    scale = told(ideal)["scale_factor_v_per_deg_s"]
    run = vcfbench.run("g-sensitivity", ideal, seed=1, settings={**QUICK, **told(ideal), "axes": ["z"]}, runs=None)
    found = run.results.per_g["z"]
    up, down = (fmean(p.output_v for p in run.points if p.step in steps) / scale for steps in ((0, 3), (1, 2)))
    earth = 15.041067 / 3600.0 * math.sin(math.radians(60.0))
    assert found.value == pytest.approx((0.5 * (up - down) - earth) / (9.819178 / 9.80665), abs=1e-8)
    assert abs(found.value) < 0.1 * earth
    assert found.missing == ("scale factor", "other axes")


@pytest.mark.parametrize(
    ("latitude_deg", "expected"), [(0.0, 9.780325), (45.0, 9.806198), (-90.0, 9.832185), (None, 9.80665)]
)
def test_gravity_is_that_of_wgs_84(latitude_deg: float | None, expected: float) -> None:
    """Published figures of the ellipsoid; without a latitude anywhere at sea level counts."""
    found, u, _ = gravity(latitude_deg)
    assert found == pytest.approx(expected, abs=1e-6)
    assert (u > 0.01) == (latitude_deg is None)


@pytest.mark.exhaustive
def test_unknown_earth_rate_and_warm_up_are_in_budget() -> None:
    def parts(warm_up_s: float) -> list[dict[str, float]]:
        settings = {**QUICK, "warm_up_s": warm_up_s}
        found = vcfbench.run("g-sensitivity", "lab", seed=1, settings=settings, runs=None).results
        return [{part.source: part.u for part in each.parts} for each in found.per_g.values()]

    (x, _, z), (later, *_) = parts(60.0), parts(360.0)
    north_deg_s = 15.041067 / 3600.0 * math.cos(math.radians(37.9)) / (9.7998 / 9.80665)
    by_heading = north_deg_s * math.sin(math.radians(5.0)) / math.sqrt(6.0)
    assert x["the Earth's rate to the north, by heading"] == pytest.approx(by_heading, rel=1e-4)
    assert z["the Earth's rate to the north, by tilt"] == pytest.approx(by_heading / 5.0, rel=2e-3)
    assert later["warm-up"] == pytest.approx(x["warm-up"] / math.e, rel=1e-3)
    assert abs(x["warm-up"]) > 0.0


def test_without_a_latitude_the_vertical_rate_is_of_either_sign() -> None:
    parts = {part.source: part.u for part in _earth(GSensitivitySettings(), "z")}
    assert parts["the Earth's vertical rate, no latitude known"] == pytest.approx(15.041067 / 3600.0 / math.sqrt(3.0))


def test_each_position_is_requested_once_each_way_ending_upright() -> None:
    steps = [each.step for each in vcfbench.dry_run("g-sensitivity", "lab", settings={"cycles": 1}).steps]
    asked = [each for each in steps if isinstance(each, AskOperator)]
    ups = [dict(each.adjustments)["up_axis"] for each in asked]
    there = ["+x", "-x", "+y", "-y", "+z", "-z"]
    assert ups == [*there, *reversed(there[:-1]), "+z"]
    assert asked[0].words.startswith("turn the gyroscope so that its +x axis points up, and its input axis +z east")
    assert "east" not in asked[4].words


@pytest.mark.parametrize(
    ("settings", "said"), [({"axes": ["w"]}, "axes"), ({"samples": 61}, "windows of 60 s and 1000 readings at most")]
)
def test_settings_that_cannot_be(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        vcfbench.dry_run("g-sensitivity", "lab", settings=settings)
