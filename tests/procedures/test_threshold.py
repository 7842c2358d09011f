"""Threshold, resolution and dead band: the fit by other code, dead bands at their size, and none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from scipy.optimize import curve_fit
from simrack_tests.cells import few

import vcfbench
from vcfbench.analysis.input_limits import fit_dead_band
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions.v_vc import VvcKnown
from vcfbench.procedures import threshold
from vcfbench.procedures.threshold import (
    _AT_REST,
    InputLimit,
    StepShare,
    ThresholdResult,
    ThresholdSettings,
    _blocks_wanted,
    report,
    results,
)
from vcfbench.records.devices import DeviceStore
from vcfbench.records.schema import Point
from vcfbench.station.settings import Station
from vcfbench.testing import simulated
from vcfbench.uncertainty.measurand import measurand

if TYPE_CHECKING:
    from pathlib import Path

SIZES = np.array([2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02])
BOTH = np.stack([SIZES, -SIZES], axis=1).ravel()


def of_band(x: np.ndarray, slope: float, low: float, high: float) -> np.ndarray:
    return slope * (np.maximum(x - high, 0.0) + np.minimum(x - low, 0.0))


@pytest.mark.parametrize(("low", "high"), [(-0.3, 0.3), (-0.01, 0.15), (0.0, 0.0), (-0.3, 0.0)])
def test_fit_finds_the_edges_of_exact_steps(low: float, high: float) -> None:
    y = of_band(BOTH, -0.0125, low, high)
    found = fit_dead_band(BOTH, y, {"readings": 1e-10 * np.eye(BOTH.size)})
    assert (found.slope, found.half_width) == pytest.approx((-0.0125, 0.5 * (high - low)), abs=1e-12)


def test_fit_and_its_u_are_those_of_scipy() -> None:
    sigma = 3e-3
    y = of_band(BOTH, 1.0, -0.3, 0.25) + sigma * np.random.default_rng(5).standard_normal(BOTH.size)
    found = fit_dead_band(BOTH, y, {"readings": sigma**2 * np.eye(BOTH.size)})
    best, covariance = curve_fit(
        of_band, BOTH, y, (1.0, -0.3, 0.3), sigma=np.full(BOTH.size, sigma), absolute_sigma=True
    )
    assert found.half_width == pytest.approx(0.5 * (best[2] - best[1]), abs=1e-6)
    of_half = np.array([0.0, -0.5, 0.5])
    assert found.u["readings"] == pytest.approx(float(of_half @ covariance @ of_half) ** 0.5, rel=1e-3)


@pytest.mark.parametrize("base", [-0.65, -0.21, 0.2, 0.37, 0.9])
def test_steps_that_begin_beyond_the_band_cross_it(base: float) -> None:
    """A generator whose ranges leave a gap cannot be set to the middle of a band of half width 0.15."""
    sigma, half = 3e-3, 0.15

    def answer(x: np.ndarray) -> np.ndarray:
        return of_band(base + x, -0.0125, -half, half) - of_band(np.array(base), -0.0125, -half, half)

    noise = -0.0125 * sigma * np.random.default_rng(8).standard_normal(BOTH.size)
    found = fit_dead_band(BOTH, answer(BOTH) + noise, {"": (0.0125 * sigma) ** 2 * np.eye(BOTH.size)})
    assert found.half_width == pytest.approx(half, abs=4.0 * found.u[""])
    assert found.u[""] < 2.0 * sigma


def test_what_no_dead_band_answers_is_refused() -> None:
    with pytest.raises(ConfigError, match="the steps do not fit a dead band"):
        fit_dead_band(BOTH, BOTH + 0.1 * np.sin(20.0 * BOTH), {"": 1e-6 * np.eye(BOTH.size)})


def test_absent_dead_band_scatters_about_zero_by_its_u() -> None:
    draw, sigma = np.random.default_rng(6), 3e-3
    halves = [
        (
            found := fit_dead_band(BOTH, BOTH + sigma * draw.standard_normal(BOTH.size), {"": sigma**2 * np.eye(14)})
        ).half_width
        / found.u[""]
        for _ in range(400)
    ]
    assert abs(np.mean(halves)) < 5 / 20
    assert np.std(halves) == pytest.approx(1.0, abs=5 * 0.7 / 20)


def test_steps_within_it_alone_are_refused() -> None:
    with pytest.raises(ConfigError, match="larger steps are needed"):
        fit_dead_band(BOTH, of_band(BOTH, 1.0, -1.5, 1.5), {"": np.eye(14)})


def found_of(half_deg_s: float, bench: str = "ideal", **settings: Any) -> ThresholdResult:
    overrides = {"sense_path": {"dead_band_deg_s": half_deg_s}, "pick_up": {"v_vc_lead_v": 0.0}}
    given = {"samples": 4, "at_most_s": 60.0, **settings}
    run = vcfbench.run("threshold", simulated(bench, overrides=overrides), seed=3, settings=given, runs=None)
    results = run.results
    assert isinstance(results, ThresholdResult)
    return results


@pytest.mark.exhaustive
@pytest.mark.parametrize("settings", few([{}, {"by": "table", "rate_tolerance_deg_s": 0.01}], {}))
@pytest.mark.parametrize("half_deg_s", few([0.03, 0.3], 0.3))
def test_noiseless_gyroscope_gives_size_of_dead_band(half_deg_s: float, settings: dict[str, Any]) -> None:
    """What is left is the meters' resolution; half of the expected output is that of twice the half width."""
    found = found_of(half_deg_s, **settings)
    assert found.dead_band.seen
    assert found.dead_band.deg_s.value == pytest.approx(half_deg_s, abs=1e-3)
    assert found.threshold.deg_s.value == pytest.approx(2.0 * found.dead_band.deg_s.value, rel=1e-12)
    assert abs(found.resolution.deg_s.value) < 2e-3
    assert (found.dead_band.v_vc_v is None) == bool(settings)
    shares = {each.step_deg_s: each.plus for each in found.shares if not each.about_deg_s}
    assert shares[2.0] == pytest.approx(1.0 - half_deg_s / 2.0, abs=2e-3)


@pytest.mark.exhaustive
def test_share_other_than_half_moves_the_threshold_alone() -> None:
    """At 80 % of the expected output the input is five half widths."""
    found = found_of(0.03, share=0.8)
    assert found.threshold.deg_s.value == pytest.approx(5.0 * found.dead_band.deg_s.value, rel=1e-12)


@pytest.mark.exhaustive
def test_a_gyroscope_without_one_has_a_bound_and_not_zero() -> None:
    found = found_of(0.0, "lab")
    assert 0.0 < found.dead_band.at_most_deg_s < 6e-3
    assert found.dead_band.at_most_deg_s > found.dead_band.deg_s.value
    assert found.dead_band.deg_s.missing == ("K_Vc",)
    assert found.dead_band.v_vc_v is not None
    assert not found.dead_band.v_vc_v.missing


@pytest.mark.exhaustive
def test_k_vc_is_that_of_the_certificate(tmp_path: Path) -> None:
    named = {"dut": "G1", "devices": str(tmp_path / "devices")}
    quick = {"samples": 3, "cycles": 1, "health": False}
    kvc = vcfbench.run("kvc", "lab", seed=1, settings={**named, **quick}, runs=tmp_path).results
    found = vcfbench.run("threshold", "lab", seed=2, settings={**named, "at_most_s": 60.0, "samples": 3}, runs=tmp_path)
    settings = found.header["settings"]
    assert settings["k_vc_deg_s_per_v"] == pytest.approx(kvc.k_vc.value, rel=1e-9)
    assert settings["k_vc_u_deg_s_per_v"] == pytest.approx(kvc.k_vc.u, rel=1e-6)
    assert not found.results.dead_band.deg_s.missing
    store = DeviceStore(tmp_path / "devices")
    known = store.certificate("G1").record
    store.add(structs.replace(known, valid_until=known.issued))  # type: ignore[union-attr]
    with pytest.raises(ConfigError, match=r"0002\.json: the certificate is valid from .* not now"):
        vcfbench.dry_run("threshold", "lab", settings=named)
    assert vcfbench.dry_run("threshold", "lab", settings={**named, "outdated": True}).steps


def test_the_report_has_the_shares_either_way_in_percent() -> None:
    none = InputLimit(measurand(0.0, "deg/s", []), None, seen=False, at_most_deg_s=0.1)
    found = ThresholdResult(none, none, none, (StepShare(10.0, 0.5, 0.97, 0.91, 0.02),), 2)
    (table,) = [each for each in report(ThresholdSettings(), (), found).parts if str(each).count("share, up")]
    assert list(table.rows) == [pytest.approx((10.0, 0.5, 97.0, 91.0, 2.0))]


def test_a_dead_band_wider_than_the_steps_is_told() -> None:
    with pytest.raises(MeasurementError, match="a wide dead band needs"):
        found_of(3.0, "lab")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"steps_deg_s": [1.0, -1.0, 0.5]}, "three different sizes or more"),
        ({"at_rate_deg_s": 3.0}, "at least twice the largest step, 2"),
        ({"by": "table"}, r"at least 0.05 deg/s \(rate_tolerance_deg_s\)"),
        ({"by": "table", "rate_tolerance_deg_s": 0.01, "at_rate_deg_s": 299.0}, "300 deg/s with the largest step"),
        ({"at_rate_deg_s": 250.0}, "a range for 1.68 V"),
        ({"at_rate_deg_s": 250.0, "k_vc_deg_s_per_v": -150.0}, "a range for 1.68 V"),
        ({"k_vc_deg_s_per_v": 0.0}, "a number that is not 0"),
    ],
)
def test_settings_that_cannot_be(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        vcfbench.dry_run("threshold", "lab", settings=settings)


@pytest.mark.parametrize(
    ("smallest_deg_s", "noise_v", "times"), [(0.5, 2e-2, 1.0), (0.25, 2e-2, 4.0), (0.5, 4e-2, 4.0)]
)
def test_blocks_go_by_the_square_of_noise_over_the_smallest_step(
    smallest_deg_s: float, noise_v: float, times: float
) -> None:
    bench = Station(meter_resolution_v=1e-6)
    asked = ThresholdSettings(steps_deg_s=(2.0, 1.0, smallest_deg_s), at_most_s=1e6, station=bench)
    largest = [asked.sizes_deg_s[0] * sign for sign in (0.0, 1.0, -1.0, -1.0, 1.0, 0.0)]
    points = [Point(_AT_REST, level, 0.0, -0.0125 * level, noise_v, 10) for level in largest]
    assert _blocks_wanted(asked, points) == pytest.approx(times * 100.0, rel=0.03)


@pytest.mark.exhaustive
def test_noisier_output_is_taken_more_often_within_the_time() -> None:
    assert found_of(0.0, "lab").blocks == 2
    assert 3 <= found_of(0.0, "lab", at_most_s=3000.0).blocks <= 6


def test_steps_that_the_generator_cannot_make_are_refused() -> None:
    """Levels that are one about a rate: 2 uV, of 0.02 deg/s at 10 000 (deg/s)/V, and nothing to divide by."""
    points = [
        Point(_AT_REST, 0.0, level, -0.0125 * level, 1e-5, 10)
        for size in (0.02, 0.01, 0.0)
        for level in (0.0, size, -size, -size, size, 0.0)
    ]
    asked = ThresholdSettings(steps_deg_s=(2.0, 1.0, 0.5), v_vc=VvcKnown.SET)
    with pytest.raises(MeasurementError, match=r"steps of 0\.5 deg/s about 0 deg/s make no difference of V_Vc"):
        results(asked, points)


def test_recalled_k_vc_has_u_as_root_of_variance(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    curve = SimpleNamespace(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 0.0004)))
    record = SimpleNamespace(k_vc=curve, valid_at=lambda _: True)
    monkeypatch.setattr(threshold, "last_certificate", lambda _: SimpleNamespace(record=record, path=tmp_path))
    recalled = ThresholdSettings(dut="G1", devices=str(tmp_path)).recalled()
    assert (recalled.k_vc_deg_s_per_v, recalled.k_vc_u_deg_s_per_v) == (150.0, pytest.approx(0.02))
