"""The warm-up: its plan ends when the output is steady; time constant and size are those that are simulated."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.procedures.test_kvc import warm
from tests.sim.gyro.plain import output_v, steady_output_v
from vcfbench.errors import ConfigError
from vcfbench.instructions.scale_factor import scale_factor_used
from vcfbench.procedures import warmup
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.warmup import (
    WARMUP,
    SwitchedOn,
    SwitchOnAndLog,
    WarmupResult,
    WarmupSettings,
    is_steady,
    warmup_results,
)
from vcfbench.records.schema import Point
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.file import embedded_text
from vcfbench.station.parts import Limits
from vcfbench.station.settings import Station
from vcfbench.steps import Acquire, DisableSupply, EnableTable
from vcfbench.steps.dry_run import walk

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.station.description import BenchDescription
    from vcfbench.values.value import Measurand

SCALE = {"scale_factor_v_per_deg_s": -0.0125527}
B_DEG_S = 5.57 / 3600.0
NOTHING_ELSE = """
[simulation.override.drive_mode]
frequency_coefficient_per_k = 0.0
quality_coefficient_per_k = 0.0
[simulation.override.sense_in_phase]
frequency_coefficient_per_k = 0.0
quality_coefficient_per_k = 0.0
[simulation.override.sense_anti_phase]
frequency_coefficient_per_k = 0.0
quality_coefficient_per_k = 0.0
"""
"""The bias alone depends on the temperature: then its exponential is that of the temperature."""


def bench(heating_k: float, tau_s: float, others: str = NOTHING_ELSE) -> BenchDescription:
    thermal = f"[simulation.override.thermal]\nself_heating_k = {heating_k}\ntime_constant_s = {tau_s}\n"
    return parse_bench(f"{embedded_text('paper')}{others}{thermal}", "warm")


def true_amplitude_deg_s(description: BenchDescription) -> float:
    """Return cold less warm output as a rate, by the closed forms: bias, and quadrature through the sense mode's phase.

    With all coefficients on the second adds a fifth: Q falls by 0.2 % a kelvin, the phase with it, and 20 deg/s of
    quadrature come out by the sine of that.
    """
    cold = physical_parameters(description)
    heat_k, earth = cold.thermal.self_heating_k, 15.041067 / 3600.0 * math.sin(math.radians(cold.site.latitude_deg))
    bias_deg_s = cold.thermal.bias_coefficient_deg_s_k * heat_k
    outputs = [
        output_v(gyro, steady_output_v(gyro, math.radians(earth + own)))
        for gyro, own in ((cold, 0.0), (warm(cold), bias_deg_s))
    ]
    return (outputs[0] - outputs[1]) / SCALE["scale_factor_v_per_deg_s"]


def found(figure: Measurand | None) -> tuple[float, float]:
    assert figure is not None
    return figure.value, figure.u


@pytest.mark.parametrize(
    ("heating_k", "tau_s", "others", "seed"),
    few([(10.0, 300.0, "", 4), (10.0, 300.0, NOTHING_ELSE, 4), (6.0, 200.0, NOTHING_ELSE, 6)], (10.0, 300.0, "", 4)),
)
def test_the_simulated_warm_up_is_found(heating_k: float, tau_s: float, others: str, seed: int, tmp_path: Path) -> None:
    """The bias goes by 30 deg/h a kelvin, the embedded bench's coefficient, and by what the sense mode's phase does."""
    described = bench(heating_k, tau_s, others)
    run = vcfbench.run("warmup", described, seed=seed, settings=SCALE, runs=tmp_path)
    time_s, u_s = found(run.results.time_constant)
    assert abs(time_s - tau_s) < 3.0 * u_s < 0.5 * tau_s
    true_deg_s = true_amplitude_deg_s(described)
    assert true_deg_s == pytest.approx((1.0 if others else 1.2) * -heating_k * 30.0 / 3600.0, rel=0.01)
    assert abs(run.results.amplitude.value - true_deg_s) < 3.0 * run.results.amplitude.u < 0.25 * abs(true_deg_s)
    warm_s, u_warm_s = found(run.results.warm_up)
    assert abs(warm_s - tau_s * math.log(abs(true_deg_s) / (5.6 / 3600.0))) < 3.0 * u_warm_s
    assert run.results.steady
    again = vcfbench.load_run("last", runs=tmp_path)
    assert again.results == run.results
    assert vcfbench.text_of(again.report()) == vcfbench.text_of(run.report())
    assert "three means in a row agree" in vcfbench.text_of(run.report())


@pytest.mark.exhaustive
def test_unsteady_output_at_longest_time_is_reported(tmp_path: Path) -> None:
    settings = {**SCALE, "shortest_s": 300.0, "longest_s": 600.0}
    run = vcfbench.run("warmup", bench(60.0, 3000.0), seed=1, settings=settings, runs=tmp_path)
    assert run.status == "complete"
    assert not run.results.steady
    assert 500.0 < run.results.lasted_s <= 610.0
    assert "NOT steady" in vcfbench.text_of(run.report())


def test_steady_output_ends_at_shortest_time(tmp_path: Path) -> None:
    settings = {**SCALE, "shortest_s": 240.0}
    run = vcfbench.run("warmup", bench(0.0, 300.0), seed=2, settings=settings, runs=tmp_path)
    assert run.results.steady
    assert run.results.lasted_s < 500.0
    assert (run.results.amplitude, run.results.time_constant, run.results.warm_up) == (None, None, None)
    assert abs(run.results.bias_end.value - np.mean(run.results.means_deg_s)) < 3.0 * run.results.bias_end.u
    assert run.results.bias_end.u > 0.66 * run.results.bias_instability_deg_s  # so far a mean wanders from day to day
    assert run.results.turn_on_s is not None
    assert run.results.turn_on_s < 2.0


def test_noiseless_bench_has_no_exponential_but_the_last_digit(tmp_path: Path) -> None:
    run = vcfbench.run("warmup", "ideal", settings={**SCALE, "shortest_s": 240.0}, runs=tmp_path)
    assert run.results.time_constant is None
    assert run.results.bias_end.value == pytest.approx(0.0, abs=1e-6)
    assert run.results.bias_end.u > 0.0


def synthetic(rng: np.random.Generator, tau_s: float, amplitude: float, noise: float) -> WarmupResult:
    """Readings one a second of a closed form and white noise."""
    windows = []
    for first in range(0, 1800, 60):
        t_s = first + np.arange(60.0)
        rate = 3.0 + amplitude * np.exp(-(t_s + 0.5) / tau_s) + noise * rng.standard_normal(60)
        windows.append((t_s, 0.0125 * rate))
    log = [(0.1 * n, 0.0125 * (9.0 if n < 12 else 3.0)) for n in range(50)]
    settings = WarmupSettings(
        scale_factor_v_per_deg_s=0.0125, bias_instability_deg_h=3.6e-3, station=Station(meter_resolution_v=1e-9)
    )
    return warmup_results(settings, scale_factor_used(settings), log, windows, steady=True)


@pytest.mark.exhaustive
def test_u95_of_a_weak_exponential_holds_its_time_constant() -> None:
    """By the slope of a fit at what was found 3 of 100 of these stood out."""
    rng, true_s = np.random.default_rng(3), (230.0, 230.0 * math.log(100.0 / 3600.0 / 1e-6))
    results = [synthetic(rng, 230.0, -100.0 / 3600.0, 0.06) for _ in range(60)]
    times = [(each.time_constant, each.warm_up) for each in results if each.time_constant is not None]
    assert len(times) > 54
    held = [[abs(time.value - t) <= time.u95 for time, t in zip(each, true_s, strict=True)] for each in times]
    assert 0.9 <= np.mean(held) < 1.0


@pytest.mark.exhaustive
def test_values_scatter_as_their_uncertainties_say() -> None:
    rng, z = np.random.default_rng(7), []
    for _ in range(60):
        result = synthetic(rng, 250.0, -0.05, 0.01)
        tau_s, u_s = found(result.time_constant)
        amplitude, u_amplitude = found(result.amplitude)
        z.append(((tau_s - 250.0) / u_s, (amplitude + 0.05) / u_amplitude, found(result.bias_end)))
    for column in ([row[0] for row in z], [row[1] for row in z], [(row[2][0] - 3.0) / row[2][1] for row in z]):
        assert abs(np.mean(column)) < 0.5
        assert 0.75 < np.std(column) < 1.3


@pytest.mark.parametrize("amplitude", [-0.5, -5.0, 50.0])
def test_u95_of_a_strong_exponential_is_that_of_its_u(amplitude: float) -> None:
    """Where the time constants that are tried lie further apart than u, they are tried again in between."""
    times = [synthetic(np.random.default_rng(seed), 230.0, amplitude, 0.06).time_constant for seed in range(4)]
    for time in times:
        assert time is not None
        assert abs(time.value - 230.0) <= 4.0 * time.u
        assert time.u95 == pytest.approx(1.96 * time.u, rel=0.1)
        assert time.u == pytest.approx(times[0].u, rel=0.3)  # type: ignore[union-attr]
        assert time.u > 0.3 / abs(amplitude)


def test_warm_up_time_is_as_uncertain_as_its_amplitude(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tau ln |a / limit| moves by tau / a, where noise has made the time constant no other."""
    monkeypatch.setattr(warmup, "_TIME_CONSTANTS", 1)
    monkeypatch.setattr(warmup, "_RESOLVED", 0)
    monkeypatch.setattr(warmup, "_FIT_S", 250.0)
    result = synthetic(np.random.default_rng(2), 250.0, -5.0, 0.1)
    amplitude, u_amplitude = found(result.amplitude)
    assert found(result.warm_up)[1] == pytest.approx(250.0 * u_amplitude / abs(amplitude))


def test_turn_on_is_when_the_output_stays() -> None:
    result = synthetic(np.random.default_rng(1), 250.0, -0.05, 0.01)
    assert result.turn_on_s == pytest.approx(1.2)
    assert result.turn_on_resolution_s == pytest.approx(0.1)


def points(*means_v: float, std_v: float = 1e-4) -> list[Point]:
    return [Point(1, 0.0, 0.0, mean_v, std_v, 60) for mean_v in means_v]


def test_three_means_must_agree_and_stand_still() -> None:
    """Sigma of a mean is 12.9 uV of white noise here, and of the floor 0.664 B with B = 20 uV: 18.5 uV together."""
    minute = WarmupSettings(scale_factor_v_per_deg_s=1.0, bias_instability_deg_h=3600.0 * 20e-6)
    assert is_steady(minute, points(0.0, 1e-5, -1e-5))
    assert not is_steady(minute, points(0.0, 1e-5))
    assert not is_steady(minute, points(0.0, 6e-5, 0.0))
    assert not is_steady(minute, points(0.0, 2.5e-5, 5e-5))
    assert is_steady(structs.replace(minute, window_s=120.0), points(0.0, 2.5e-5, 5e-5))


def steps(limits: Limits) -> list[Any]:
    settings = WarmupSettings(station=Station(meter_resolution_v=1e-5, limits=limits))
    return [each.step for each in walk(WARMUP.plan(settings), settings.expected_gyro())]


def test_the_output_is_followed_from_the_first_instant() -> None:
    plan = steps(Limits(max_rate_deg_s=300.0, max_v_vc_v=2.0))
    kinds = [type(step) for step in plan]
    assert kinds.index(EnableTable) < kinds.index(SwitchOnAndLog) < kinds.index(Acquire) < kinds.index(DisableSupply)
    assert kinds.count(Acquire) == 30
    assert all(step.describe() for step in plan)
    alone = {type(step).__name__ for step in steps(Limits())}
    assert alone.isdisjoint({"EnableTable", "DisableVvc", "ConfigureGenerator"})
    assert "warmup" in vcfbench.PROCEDURES
    assert SwitchedOn.kinds["SwitchedOn"] is SwitchedOn


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"longest_s": 600.0}, "longest_s: expected at least shortest_s"),
        ({"shortest_s": 200.0, "window_s": 100.0}, "shortest_s: expected at least three windows"),
    ],
)
def test_settings_that_contradict_themselves_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.dry_run("warmup", settings=changes)
