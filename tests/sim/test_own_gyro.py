"""A gyroscope of one's own: what its data sheet says is what runs find.

Tolerances: scale factor 100 ppm, split 0.1 %, Q 2 %, each and four standard uncertainties; noise 10 % over an hour.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.sim.gyro.plain import rate_response as integrated
from vcfbench.analysis.rate_band import split_guess_hz
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.gyro.data_sheet import DataSheet, noise_bandwidth_hz, own_gyro, peak_response, rate_response
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.own_gyro import own_gyro_bench
from vcfbench.testing.gyroscopes import drawn_sheet

if TYPE_CHECKING:
    from pathlib import Path

SHEET = {
    "scale_factor_v_per_deg_s": 5e-3,
    "range_deg_s": 400.0,
    "bias_deg_s": -2.0,
    "drive_hz": 9800.0,
    "q_drive": 8000.0,
    "split_hz": 30.0,
    "q_sense": 2500.0,
    "angle_random_walk_deg_sqrt_h": 0.1,
    "bandwidth_hz": 12.0,
    "k_vc_deg_s_per_v": 300.0,
}

NARROW = {"bandwidth_hz": None, "q_sense": 20_000.0, "scale_factor_v_per_deg_s": 0.016}
"""A response with a peak of 120 times, behind a filter that passes it."""


def written(folder: Path, figures: dict[str, Any], **options: bool) -> tuple[DataSheet, Path]:
    sheet = DataSheet(**figures)
    path = folder / "own.toml"
    path.write_text(own_gyro_bench(sheet, "own", **options), "utf-8")
    return sheet, path


def run(procedure: str, bench: Path, **settings: Any) -> Any:
    return vcfbench.run(procedure, bench, settings=settings, runs=bench.parent / "runs", seed=1)


def require_scale_factor(sheet: DataSheet, results: Any, part: float) -> None:
    slope = results.scale_factor
    allowed = part * abs(sheet.scale_factor_v_per_deg_s) + 4.0 * slope.u
    assert abs(slope.value - sheet.scale_factor_v_per_deg_s) <= allowed


def require_split_and_q(sheet: DataSheet, bench: Path) -> None:
    found = run("bandwidth", bench, warm_up_s=10.0).results
    split_hz = abs(sheet.split_hz)
    assert abs(abs(found.split_hz.value) - split_hz) <= 1e-3 * split_hz + 4.0 * found.split_hz.u
    assert abs(found.q.value - sheet.q_sense) <= 0.02 * sheet.q_sense + 4.0 * found.q.u


def test_a_calibration_gives_back_the_scale_factor_and_the_bias(tmp_path: Path) -> None:
    sheet, bench = written(tmp_path, SHEET)
    results = run("turntable", bench).results
    require_scale_factor(sheet, results, 1e-4)
    assert results.bias_deg_s == pytest.approx(sheet.bias_deg_s, abs=0.02)


@pytest.mark.exhaustive
def test_v_vc_stands_for_as_much_as_was_told(tmp_path: Path) -> None:
    _, bench = written(tmp_path, SHEET)
    assert run("virtual-coriolis", bench).results.k_vc.value == pytest.approx(300.0, rel=1e-3)


def test_the_bandwidth_is_that_of_modes_and_filter_together(tmp_path: Path) -> None:
    sheet, bench = written(tmp_path, SHEET)
    settings = parse_bench(bench.read_text("utf-8"), "own").procedure_table["bandwidth"]
    assert settings["split_guess_hz"] == 30.0
    filtered = (1.0 + (12.0 / settings["low_pass_hz"]) ** 8) ** -0.5
    modes = rate_response(own_gyro(sheet, imperfections=False, latitude_deg=0.0), 12.0)
    assert filtered * modes == pytest.approx(0.5**0.5, rel=1e-4)


def test_imperfections_are_off_unless_they_are_asked_for(tmp_path: Path) -> None:
    sheet, bench = written(tmp_path, SHEET)
    parameters = own_gyro(sheet, imperfections=False, latitude_deg=0.0)
    assert parameters.thermal.bias_coefficient_deg_s_k == 0.0
    assert parameters.output_stage.second_order_per_v == 0.0
    assert 'multimeter = "none"' in bench.read_text("utf-8")
    real = own_gyro(sheet, imperfections=True, latitude_deg=37.9)
    assert real.thermal.bias_coefficient_deg_s_k > 0.0
    assert real.output_stage.second_order_per_v != 0.0


@pytest.mark.exhaustive
def test_with_the_papers_imperfections_it_is_still_that_gyroscope(tmp_path: Path) -> None:
    sheet, bench = written(tmp_path, {**SHEET, "angle_random_walk_deg_sqrt_h": 0.21}, imperfections=True)
    require_scale_factor(sheet, run("turntable", bench).results, 1e-3)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        (
            {"scale_factor_v_per_deg_s": 0.05},
            "range_deg_s: expected outputs within 8.5 V, V_Vc up to 10 % off, got 22.1 V",
        ),
        ({"scale_factor_v_per_deg_s": 0.02, "rail_v": 5.0}, "range_deg_s: expected outputs within 4.25 V"),
        (
            {**NARROW, "angle_random_walk_deg_sqrt_h": 30.0},
            "angle_random_walk_deg_sqrt_h: expected an output that scatters by at most",
        ),
        (
            {**NARROW, "k_vc_deg_s_per_v": -980.0},
            "q_sense: expected outputs within 8.5 V at the peak of the response, by a sine of 0.01 V on V_Vc",
        ),
        ({"bandwidth_hz": 20.0}, "bandwidth_hz: expected a quarter to half the split, else no peak is seen, got 20"),
        ({"split_hz": 500.0}, "split_hz: expected a size from 3 to 80, either sign, got 500"),
        ({"split_hz": -2.0}, "split_hz: expected a size from 3 to 80, either sign, got -2"),
        ({"q_sense": 100.0}, "q_sense: expected at least 2 drive_hz / split_hz, or the response has no peak: 653.3"),
        ({"drive_hz": 1000.0, "q_drive": 1e5}, "q_drive: expected a start within 600 s, got 647 s"),
        ({"drive_hz": 1000.0, "q_sense": 1e5}, "q_sense: expected an output that settles within 20 s, got 383 s"),
        (
            {"range_deg_s": 50.0, "k_vc_deg_s_per_v": 50.0, "q_sense": 700.0, "quadrature_deg_s": 300.0},
            "quadrature_deg_s",
        ),
        ({"k_vc_deg_s_per_v": 1000.5}, "k_vc_deg_s_per_v: expected the range at 0.4 to 9 V of V_Vc, got 0.4 V"),
        ({"k_vc_deg_s_per_v": -40.0}, "k_vc_deg_s_per_v: expected the range at 0.4 to 9 V of V_Vc, got 10 V"),
        ({"quadrature_deg_s": -5.0}, "quadrature_deg_s: expected 0 to 300, got -5"),
        ({"q_drive": -5000.0}, "q_drive: expected 100 to 100000, got -5000"),
        ({"bandwidth_hz": -5.0}, "bandwidth_hz: expected 0.5 to 40, got -5"),
        ({"angle_random_walk_deg_sqrt_h": -0.2}, "angle_random_walk_deg_sqrt_h: expected 0 to 100, got -0.2"),
        ({"angle_random_walk_deg_sqrt_h": float("nan")}, "angle_random_walk_deg_sqrt_h: expected 0 to 100, got nan"),
        ({"k_vc_deg_s_per_v": float("-inf")}, "k_vc_deg_s_per_v: expected a size"),
    ],
)
def test_what_no_such_gyroscope_has_is_refused(figures: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        DataSheet(**{**SHEET, **figures})


@pytest.mark.parametrize("seed", [58, 137, 5092, 6022, 7021])
def test_a_drawn_output_is_free_of_its_end(seed: int) -> None:
    sheet = drawn_sheet(seed)
    output = warm_output(own_gyro(sheet, imperfections=True, latitude_deg=37.9))
    whole_v = 1.02 * sheet.range_deg_s / abs(sheet.k_vc_deg_s_per_v) + 4e-3  # by a generator within its limits
    level_v = max(abs(output(0.0, whole_v)), abs(output(0.0, -whole_v)))
    sine_deg_s = 0.01 * abs(sheet.k_vc_deg_s_per_v) * peak_response(sheet) + abs(sheet.bias_deg_s)
    most_v = max(level_v, sine_deg_s * abs(sheet.scale_factor_v_per_deg_s))
    white_deg_s = sheet.angle_random_walk_deg_sqrt_h / 60.0
    noise_deg_s = white_deg_s * math.sqrt(2.0 * noise_bandwidth_hz(sheet, 0.0))
    assert most_v + 4.0 * noise_deg_s * abs(sheet.scale_factor_v_per_deg_s) < sheet.swing_v


@pytest.mark.parametrize("size_hz", few([3.0, 24.8, 60.0, 76.0, 78.5, 80.0], 3.0, 80.0))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_split_is_guessed_from_the_frequencies_that_are_written(size_hz: float, sign: float) -> None:
    sheet = DataSheet(drive_hz=3488.9, split_hz=sign * size_hz, q_sense=5000.0)
    keys = parse_bench(own_gyro_bench(sheet, "own"), "own").procedure_table["bandwidth"]
    gyro, at_hz = own_gyro(sheet, imperfections=False, latitude_deg=0.0), keys["frequencies_hz"]
    guess_hz = split_guess_hz(at_hz, [rate_response(gyro, each) for each in at_hz])
    assert guess_hz == pytest.approx(size_hz, rel=0.08)


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [2, 13])
def test_random_data_sheets_come_back(number: int, tmp_path: Path) -> None:
    figures = structs.asdict(drawn_sheet(number))
    sheet, bench = written(tmp_path, figures)
    require_scale_factor(sheet, run("turntable", bench).results, 1e-4)
    require_split_and_q(sheet, bench)


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [5, 15])
def test_the_noise_of_a_random_data_sheet_comes_back(number: int, tmp_path: Path) -> None:
    figures = {**structs.asdict(drawn_sheet(number)), "bias_instability_deg_h": 0.0}
    sheet, bench = written(tmp_path, figures)
    still = run("zero", bench, mode="gapless", duration_s=3600.0, powered_s=60.0).results
    noise = still.coefficient("angle random walk")
    assert noise.value == pytest.approx(sheet.angle_random_walk_deg_sqrt_h, rel=0.1), noise


@pytest.mark.parametrize("split_hz", [12.0, -40.0])
def test_response_to_rate_follows_equations_of_motion(split_hz: float) -> None:
    bench = own_gyro(
        DataSheet(**{**SHEET, "split_hz": split_hz, "bandwidth_hz": None}), imperfections=False, latitude_deg=0.0
    )
    frequencies = np.array([1e-3, 3.0, 9.0, 15.0, 30.0])
    by_equations = integrated(bench, frequencies) * (1.0 + (frequencies / bench.sense_path.low_pass_hz) ** 8) ** 0.5
    found = np.array([rate_response(bench, each) for each in frequencies])
    assert found == pytest.approx(by_equations / by_equations[0], rel=2e-3)
