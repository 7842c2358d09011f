"""Order, zeros, repeats in results: against drawn noise, a hysteresis put in, the simulated bench."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs

import vcfbench
from tests.procedures.fakes import make_settings
from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.instructions.schedule import EARTH_DEG_S, Order, SweepSettings, Zeros
from vcfbench.procedures.turntable import SweptTurntableResult, TurntableResult, turntable_results
from vcfbench.records.plain import plain
from vcfbench.records.schema import Point
from vcfbench.station.settings import Sources, Station
from vcfbench.testing import simulated
from vcfbench.uncertainty.windows import Flicker, WindowNoise, sweep_of, window_times

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

K, NOISE, READINGS = -0.0125, 1e-4, 10
WHITE = Station(meter_resolution_v=0.0, sources=Sources())
FLICKERING = Station(meter_resolution_v=0.0, sources=Sources(bias_instability_deg_h=5.0))
QUICK: dict[str, Any] = {"rates_deg_s": [100.0, 20.0, 0.0, -20.0, -100.0], "samples": 3}


def blank(settings: SweepSettings) -> list[Point]:
    """Return the points of a turntable run without noise, in the order of the settings."""
    return [
        Point(5 if rate is None else 1, rate or 0.0, 0.0, K * (rate or 0.0), NOISE, READINGS)
        for rate in settings.visits_deg_s
    ]


def moved(points: list[Point], by_v: NDArray[np.float64]) -> list[Point]:
    return [structs.replace(point, output_v=point.output_v + float(v)) for point, v in zip(points, by_v, strict=True)]


def found(settings: SweepSettings, points: list[Point]) -> SweptTurntableResult:
    results = turntable_results(settings, points)
    assert isinstance(results, SweptTurntableResult)
    return results


@pytest.mark.parametrize("zeros", [Zeros.ENDS, Zeros.BRACKET])
@pytest.mark.parametrize("order", [Order.PAPER, Order.ABBA])
def test_u_is_the_scatter_with_noise_of_zeros(order: Order, zeros: Zeros) -> None:
    """Neighbours share a zero; 1000 draws know their scatter to 2.2 %."""
    settings = make_settings(order=order, zeros=zeros, station=WHITE, samples=READINGS)
    points = blank(settings)
    statement = found(settings, points).uncertainty
    assert statement is not None
    outputs = np.random.default_rng(4).normal(0.0, NOISE / math.sqrt(READINGS), (1000, len(points)))
    rates = np.array([point.rate_deg_s for point in points if point.step == 1])
    corrected = outputs @ sweep_of(settings, points, 1).mixing.T
    slopes, biases = np.polyfit(rates, corrected.T, 1)
    assert statement.value("scale_factor").u == pytest.approx(slopes.std(), rel=0.07)
    assert statement.value("bias").u == pytest.approx(biases.std(), rel=0.07)


def test_simulated_hysteresis_is_found_with_size_rate_and_sign() -> None:
    settings = make_settings(order=Order.LOOP, zeros=Zeros.BRACKET, station=WHITE, samples=READINGS)
    points = blank(settings)
    width = 5e-4 * abs(K) * 200.0  # 0.05 % of full scale at rest, nothing at both ends
    ways, before = [], 0.0
    for point in (p for p in points if p.step == 1):
        ways.append(1.0 if point.rate_deg_s > before else -1.0 if point.rate_deg_s < before else 0.0)
        before = point.rate_deg_s
    own = iter(ways)
    by_v = [0.0 if p.step == 5 else 0.5 * width * next(own) * (1.0 - abs(p.rate_deg_s) / 200.0) for p in points]
    loop = found(settings, moved(points, np.array(by_v))).sweep.hysteresis
    assert loop is not None
    assert loop.seen
    assert loop.rate_deg_s in {1.0, -1.0}
    assert loop.difference.value == pytest.approx(0.05 * (1 - 1 / 200), rel=1e-3)
    u_percent = 100.0 * math.sqrt(3.0) * NOISE / math.sqrt(READINGS) / (abs(K) * 200.0)
    assert loop.difference.u == pytest.approx(u_percent, rel=0.03)  # two windows, and half of four zeros between
    assert loop.difference.unit == "%"


@pytest.mark.parametrize("zeros", [Zeros.NONE, Zeros.BRACKET])
def test_a_hysteresis_without_a_known_flicker_can_be_written(zeros: Zeros) -> None:
    settings = make_settings(order=Order.LOOP, zeros=zeros, station=WHITE, samples=READINGS)
    loop = found(settings, blank(settings)).sweep.hysteresis
    assert loop is not None
    assert [part.dof for part in loop.difference.parts if part.source == "flicker"] == [None]
    assert plain(loop)


@pytest.mark.exhaustive
def test_noise_without_hysteresis_is_recognized_in_95_percent() -> None:
    settings = make_settings(order=Order.LOOP, station=WHITE, samples=READINGS)
    points, rng = blank(settings), np.random.default_rng(8)
    noisy = (moved(points, rng.normal(0.0, NOISE / math.sqrt(READINGS), len(points))) for _ in range(60))
    loops = [found(settings, each).sweep.hysteresis for each in noisy]
    seen = sum(loop.seen for loop in loops if loop is not None)
    assert seen <= 9  # 3 expected, of a binomial with a deviation of 1.7


def test_repeats_scatter_as_noise_with_stated_u() -> None:
    settings = make_settings(repeat=20, station=WHITE, samples=READINGS)
    points = blank(settings)
    noise = np.random.default_rng(6).normal(0.0, NOISE / math.sqrt(READINGS), len(points))
    scale_factor, bias = found(settings, moved(points, noise)).sweep.repeatability
    assert scale_factor.dof == 19
    assert scale_factor.noise == pytest.approx(NOISE / math.sqrt(READINGS * 106_060.0))
    assert bias.noise == pytest.approx(NOISE / math.sqrt(READINGS * 17))
    for each in (scale_factor, bias):
        assert each.u == pytest.approx(each.sd / math.sqrt(38.0))
        assert abs(each.sd - each.noise) < 3.0 * each.u
        assert len(each.values) == 20


def test_flicker_makes_hysteresis_and_repeats_uncertain_as_well() -> None:
    for changes in ({"order": Order.LOOP}, {"repeat": 3}):
        white, flickering = (
            found(settings, blank(settings)).sweep
            for settings in (make_settings(station=each, samples=READINGS, **changes) for each in (WHITE, FLICKERING))
        )
        if white.hysteresis is not None and flickering.hysteresis is not None:
            assert flickering.hysteresis.difference.u > 1.05 * white.hysteresis.difference.u
        else:
            assert flickering.repeatability[1].noise > 1.2 * white.repeatability[1].noise


def flickering(settings: SweepSettings, b_deg_h: float, count: int) -> NDArray[np.float64]:
    """Return (count, windows) of flicker and white noise, V, by the covariance of the windows' means."""
    begin, end = window_times(settings, blank(settings))
    times = np.concatenate([end, begin])
    phase = PhaseNoise(flicker=abs(K) * b_deg_h / 3600.0).covariance((times[:, None] - times).ravel())
    mean = np.hstack([np.diag(1.0 / (end - begin)), -np.diag(1.0 / (end - begin))])
    off = np.eye(begin.size) - 1.0 / begin.size  # a mean of all is no statement of flicker
    covariance = off @ mean @ phase.reshape(times.size, times.size) @ mean.T @ off
    rng = np.random.default_rng(12)
    white = rng.normal(0.0, NOISE / math.sqrt(READINGS), (count, begin.size))
    return np.asarray(white + rng.multivariate_normal(np.zeros(begin.size), covariance, count, method="eigh"))


def own_flicker(settings: SweepSettings, noises: NDArray[np.float64]) -> list[Flicker | None]:
    return [WindowNoise.of(settings, moved(blank(settings), each), K).flicker for each in noises]


@pytest.mark.exhaustive
def test_b_of_zeros_has_true_square_and_scatter() -> None:
    settings = make_settings(zeros=Zeros.BRACKET, repeat=3, station=WHITE, samples=READINGS)
    every = [each for each in own_flicker(settings, flickering(settings, 40.0, 150)) if each is not None]
    squares = np.array([each.deg_h**2 for each in every])
    assert len(every) > 147
    assert squares.mean() == pytest.approx(40.0**2, rel=0.08)
    assert float(np.mean([each.dof for each in every])) == pytest.approx(2.0 * (40.0**2 / squares.std()) ** 2, rel=0.25)


def test_stated_b_overrides_too_few_zeros() -> None:
    few = make_settings(zeros=Zeros.BRACKET, station=FLICKERING, samples=READINGS)
    many = make_settings(zeros=Zeros.BRACKET, repeat=3, station=FLICKERING, samples=READINGS)
    loud = structs.replace(FLICKERING, sources=Sources(bias_instability_deg_h=40.0))
    (kept,) = own_flicker(few, flickering(few, 40.0, 1))
    (stated,) = own_flicker(many, flickering(many, 40.0, 1))
    (own,) = own_flicker(structs.replace(many, station=loud), flickering(many, 40.0, 1))
    assert kept is not None
    assert stated is not None
    assert own is not None
    assert (kept.deg_h, kept.dof, stated.deg_h) == (5.0, math.inf, 5.0)  # 5 deg/h is lost in this white noise
    assert own.dof > 10.0
    assert own.deg_h == pytest.approx(40.0, rel=0.5)
    assert own.said.startswith("51 differences of this run's zeros, dof ")


def test_which_b_is_in_the_budget_is_said() -> None:
    settings = make_settings(zeros=Zeros.BRACKET, repeat=3, station=WHITE, samples=READINGS)
    (noise,) = flickering(settings, 40.0, 1)
    said = found(settings, moved(blank(settings), noise)).uncertainty
    assert said is not None
    assert any(each.startswith("flicker: B ") and "this run's zeros" in each for each in said.known_from)
    assert not any("flicker" in each for each in said.not_in_u)
    (flicker,) = [each for each in said.value("bias").parts if each.source.startswith("flicker")]
    assert flicker.dof is not None


def test_as_in_the_paper_results_have_nothing_more() -> None:
    settings = make_settings(station=WHITE, samples=READINGS)
    assert type(turntable_results(settings, blank(settings))) is TurntableResult


# --- on the simulated bench ---

STILL = """
[noise]
angle_random_walk_deg_sqrt_s = 0.0
bias_instability_deg_s = 0.0
[pick_up]
meter_leads_v = 0.0
v_vc_lead_v = 0.0
[table]
rate_error = 0.0
flutter_per_sqrt_hz = 0.0
"""
NO_RIPPLE = "ripple_arcsec = []\nripple_harmonic = []\nripple_phase_rad = []\n"
DRIFTING = f"""{STILL}{NO_RIPPLE}
[thermal]
self_heating_k = 1.0
time_constant_s = 20000.0
bias_coefficient_deg_s_k = 20.0
"""
"""1 mdeg/s of bias in each second: 12.5 uV/s, and nearly linear over a run."""


def turntable(tmp_path: Path, overrides: str, **settings: Any) -> Any:
    bench = simulated("ideal", errors="none", overrides=overrides)
    asked_settings = {**QUICK, "warm_up_s": 10.0, **settings}
    bench = structs.replace(bench, expected=structs.replace(bench.expected, zero_drift_v=0.1))
    return vcfbench.run("turntable", bench, settings=asked_settings, runs=tmp_path)


@pytest.fixture(scope="module")
def drifting(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return runs on a bench whose bias drifts: the paper's order, and what is done against drift; and one at rest."""
    path = tmp_path_factory.mktemp("drifting")
    return {
        "true": turntable(path, STILL + NO_RIPPLE),
        "paper": turntable(path, DRIFTING),
        "abba": turntable(path, DRIFTING, order="abba"),
        "bracket": turntable(path, DRIFTING, zeros="bracket"),
        "loop": turntable(path, DRIFTING, order="loop", zeros="bracket"),
    }


def off_ppm(drifting: dict[str, Any], name: str) -> float:
    true = drifting["true"].results.scale_factor.value
    return float(1e6 * (drifting[name].results.scale_factor.value / true - 1.0))


@pytest.mark.exhaustive
def test_drift_in_paper_order_errs_as_in_theory(drifting: dict[str, Any]) -> None:
    rates = np.array(QUICK["rates_deg_s"])
    times = np.array([0.0, *np.cumsum(np.abs(np.diff(rates)) / 100.0 + 5.0)])
    expected = 1e-3 * float(rates @ (times - times.mean())) / float(rates @ rates)
    assert off_ppm(drifting, "paper") == pytest.approx(1e6 * expected, rel=0.05)
    assert abs(expected) > 1e-4


@pytest.mark.exhaustive
def test_abba_and_zeros_take_the_drift_away(drifting: dict[str, Any]) -> None:
    """What is left is the bend of the exponential, some thousandths, and how exactly waits are known."""
    paper = abs(off_ppm(drifting, "paper"))
    assert abs(off_ppm(drifting, "abba")) < paper / 100.0
    assert abs(off_ppm(drifting, "bracket")) < paper / 100.0
    drift_v = drifting["bracket"].results.sweep.zero_drift_v
    assert abs(drift_v) > 50.0 * abs(drifting["bracket"].results.s_v - drifting["true"].results.s_v)


def test_the_simulated_gyroscope_has_no_hysteresis(drifting: dict[str, Any]) -> None:
    loop = drifting["loop"].results.sweep.hysteresis
    assert abs(loop.difference.value) < 1e-3  # % of full scale; the drift alone is 0.1 % a minute
    assert abs(drifting["loop"].results.sweep.zero_drift_v) > 1e-3


def test_a_record_shows_the_same_again(drifting: dict[str, Any]) -> None:
    for name in ("abba", "loop"):
        again = vcfbench.load_run(drifting[name].directory)
        assert again.results == drifting[name].results


def test_added_earths_rate_leaves_the_bias(tmp_path: Path) -> None:
    bench = simulated("ideal", errors="none", overrides=STILL + NO_RIPPLE)
    bench = structs.replace(bench, site=structs.replace(bench.site, latitude_deg=52.0))
    measured, added = (
        vcfbench.run("turntable", bench, settings={**QUICK, "earth": e}, runs=tmp_path) for e in ("bias", "rate")
    )
    rate = EARTH_DEG_S * math.sin(math.radians(52.0))
    assert measured.results.bias.value == pytest.approx(measured.results.scale_factor.value * rate, rel=1e-3)
    assert added.results.bias.value == pytest.approx(0.0, abs=1e-3 * abs(measured.results.bias.value))
    assert added.results.sweep.earth_rate_deg_s == pytest.approx(rate)
    stated = added.results.uncertainty
    assert "without Earth's rate" in stated.value("bias").of
    assert not any("Earth" in each for each in stated.not_in_u)
    tilt = next(each for each in stated.value("bias").parts if "tilt" in each.source)
    left = EARTH_DEG_S * math.cos(math.radians(52.0)) * math.sin(math.radians(0.5))
    assert tilt.u_source == pytest.approx(abs(measured.results.scale_factor.value) * left / math.sqrt(3.0), rel=1e-6)


@pytest.mark.exhaustive
def test_budget_holds_scale_factor_of_tilted_axis(tmp_path: Path) -> None:
    angle_deg = 2.0
    askew = simulated("ideal", errors="none", overrides=f"{STILL}misalignment_deg = {angle_deg}\n{NO_RIPPLE}")
    known = structs.replace(askew.uncertainty, misalignment_deg=angle_deg)
    benches = (
        simulated("ideal", errors="none", overrides=STILL + NO_RIPPLE),
        structs.replace(askew, uncertainty=known),
    )
    straight, tilted = (vcfbench.run("turntable", each, settings=QUICK, runs=tmp_path).results for each in benches)
    away = tilted.scale_factor.value - straight.scale_factor.value
    assert away / straight.scale_factor.value == pytest.approx(math.cos(math.radians(angle_deg)) - 1.0, rel=1e-3)
    stated = tilted.uncertainty.value("scale_factor")
    limit = next(each for each in stated.parts if each.source == "misalignment").u * math.sqrt(3.0)
    assert abs(away) <= limit * 1.001
    others = math.sqrt(sum(each.u**2 for each in stated.parts if each.source != "misalignment"))
    assert abs(away) > 3.0 * others


@pytest.mark.exhaustive
def test_the_four_steps_take_order_zeros_and_repeats_too(tmp_path: Path) -> None:
    settings = {**QUICK, "order": "abba", "zeros": "ends", "repeat": 2, "rates_deg_s": [100.0, 0.0, -100.0]}
    run = vcfbench.run("virtual-coriolis", simulated("ideal"), settings=settings, runs=tmp_path)
    steps = [point.step for point in run.points]
    assert [steps.count(step) for step in (3, 4, 5, 6)] == [12, 12, 3, 3]
    assert run.results.scale_factor_error_percent == pytest.approx(0.0, abs=0.05)
    for sweep in (run.results.turntable_sweep, run.results.virtual_sweep):
        assert [each.dof for each in sweep.repeatability] == [1, 1]
    assert vcfbench.load_run(run.directory).results == run.results
