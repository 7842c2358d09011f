"""A gyroscope of one's own: what its data sheet says is what runs find.

Tolerances: scale factor 100 ppm, split 0.1 %, Q 2 %, each and four standard uncertainties; noise 10 % over an hour.
"""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.gyro.data_sheet import DataSheet, own_gyro, rate_response
from vcfbench.sim.own_gyro import own_gyro_bench

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
    assert abs(found.split_hz.value - sheet.split_hz) <= 1e-3 * sheet.split_hz + 4.0 * found.split_hz.u
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
        ({"scale_factor_v_per_deg_s": 0.05}, "range_deg_s: expected outputs within 8.5 V, came 10 V"),
        ({"bandwidth_hz": 20.0}, "bandwidth_hz: expected at most half the split, came 20"),
        ({"split_hz": 500.0}, "split_hz: expected at most a tenth of drive_hz"),
        ({"q_sense": 1.0}, "q_sense: expected a size from 10 to"),
        ({"angle_random_walk_deg_sqrt_h": float("nan")}, "angle_random_walk_deg_sqrt_h: expected a size"),
    ],
)
def test_what_no_such_gyroscope_has_is_refused(figures: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words.replace(".", r"\.")):
        DataSheet(**figures)


def random_sheet(number: int) -> dict[str, float]:
    random = Random(number)  # noqa: S311  # data sheets, no secrets

    def between(low: float, high: float) -> float:
        return float(f"{low * (high / low) ** random.random():.4g}")

    reach, split, drive = between(50.0, 900.0), between(12.0, 40.0), between(2000.0, 20_000.0)
    return {
        "scale_factor_v_per_deg_s": random.choice((-1.0, 1.0)) * between(0.5, 6.0) / reach,
        "range_deg_s": reach,
        "bias_deg_s": random.uniform(-0.01, 0.01) * reach,
        "drive_hz": drive,
        "q_drive": between(500.0, 20_000.0),
        "split_hz": split,
        "q_sense": between(max(300.0, 4.0 * drive / split), 20_000.0),  # else the response has no peak to see
        "angle_random_walk_deg_sqrt_h": between(0.01, 2.0),
        "bandwidth_hz": random.uniform(0.2, 0.5) * split,
        "k_vc_deg_s_per_v": between(0.3, 1.0) * reach,
    }


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [0, 12])
def test_random_data_sheets_come_back(number: int, tmp_path: Path) -> None:
    figures = random_sheet(number)
    sheet, bench = written(tmp_path, figures)
    require_scale_factor(sheet, run("turntable", bench).results, 1e-4)
    del figures["bandwidth_hz"]  # a narrow filter leaves too little of the peak to be measured
    require_split_and_q(*written(tmp_path, figures))


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [5, 15])
def test_the_noise_of_a_random_data_sheet_comes_back(number: int, tmp_path: Path) -> None:
    sheet, bench = written(tmp_path, random_sheet(number))
    still = run("zero", bench, mode="gapless", duration_s=3600.0, powered_s=60.0).results
    noise = still.coefficient("angle random walk")
    assert noise.value == pytest.approx(sheet.angle_random_walk_deg_sqrt_h, rel=0.1), noise
