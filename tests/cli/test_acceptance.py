"""``[expected]`` ends a run with 3, ``[acceptance]`` fails it with 1; both are in text, JSON and record."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from pathlib import Path

    from click.testing import Result

RATES = "[procedure]\nrates_deg_s = [100, 10, 0, -10, -100]\n"


def bench(tmp_path: Path, tables: str) -> Path:
    path = tmp_path / "bench.toml"
    text = embedded_text("paper").replace("[procedure.drive]", f"{RATES}\n[procedure.drive]")
    path.write_text(f"{text}\n{tables}", encoding="utf-8")
    return path


def run(tmp_path: Path, tables: str, *options: str) -> Result:
    words = ["--bench", str(bench(tmp_path, tables)), "--runs", str(tmp_path / "runs"), "--quiet", *options]
    return CliRunner().invoke(app, ["run", "turntable", *words])


def shown(tmp_path: Path) -> dict[str, Any]:
    answer = CliRunner().invoke(app, ["runs", "show", "last", "--runs", str(tmp_path / "runs"), "--json"])
    return dict(json.loads(answer.stdout))


PASSING = "[acceptance]\nscale_factor_v_per_deg_s = [-0.013, -0.012]\nk_vc_deg_s_per_v = [140, 160]\n"
FAILING = "[acceptance]\nscale_factor_v_per_deg_s = [-0.013, -0.012]\nbias_v = [-0.01, 0.01]\n"


def test_a_run_within_its_limits_passes(tmp_path: Path) -> None:
    done = run(tmp_path, PASSING)
    assert done.exit_code == 0
    assert "\nPASS\n" in done.stdout
    (said,) = [line for line in done.stdout.splitlines() if line.startswith("K_Vc, rate per volt") and "160" in line]
    assert "NOT MEASURED" in said
    assert "simple acceptance" in done.stdout


def test_run_outside_a_limit_fails_with_1_in_all_outputs(tmp_path: Path) -> None:
    done = run(tmp_path, FAILING)
    assert done.exit_code == 1
    assert "\nFAIL\n" in done.stdout
    answer = json.loads(run(tmp_path, FAILING, "--json").stdout)
    assert (answer["status"], answer["acceptance"]["verdict"]) == ("complete", "fail")
    scale_factor, bias = answer["acceptance"]["limits"]
    assert (scale_factor["key"], scale_factor["verdict"]) == ("scale_factor_v_per_deg_s", "pass")
    assert (bias["low"], bias["high"], bias["verdict"]) == (-0.01, 0.01, "fail")
    assert bias["value"] == pytest.approx(answer["results"]["bias"]["value"])
    assert shown(tmp_path)["acceptance"] == answer["acceptance"]
    [result] = list((tmp_path / "runs").glob("*/result.json"))[:1]
    assert json.loads(result.read_text())["acceptance"]["verdict"] == "fail"
    text = CliRunner().invoke(app, ["runs", "show", "last", "--runs", str(tmp_path / "runs")])
    assert "\nFAIL\n" in text.stdout


@pytest.mark.exhaustive
def test_a_run_within_its_guard_band_is_marginal_with_1(tmp_path: Path) -> None:
    results = json.loads(run(tmp_path, "", "--json").stdout)["results"]
    [bias] = [each for each in results["uncertainty"]["values"] if each["name"] == "bias"]
    low = bias["value"] - 0.5 * bias["u95"]
    limits = f"[acceptance]\nbias_v = [{low!r}, 1.0]\n"
    assert run(tmp_path, limits).exit_code == 0
    guarded = run(tmp_path, f'{limits}guard_band = "U95"\n')
    assert guarded.exit_code == 1
    assert "\nMARGINAL\n" in guarded.stdout
    acceptance = shown(tmp_path)["acceptance"]
    assert (acceptance["verdict"], acceptance["limits"][0]["u95"]) == ("marginal", bias["u95"])


def test_without_limits_nothing_is_judged(tmp_path: Path) -> None:
    answer = json.loads(run(tmp_path, "", "--json").stdout)
    assert answer["acceptance"] is None
    assert answer["asked_again"] == []
    assert shown(tmp_path)["acceptance"] is None


@pytest.mark.parametrize(
    ("table", "words"),
    few(
        [
            ("scale_factor_v_per_deg_s = [0.012, 0.013]", "the scale factor is -0.0125"),
            ("bias_v = [0.0, 0.1]", "the bias is -0.041"),
            ("reading_noise_v = [0.001, 0.002]", "the bench file expects 0.001 to 0.002 V"),
            ("nonlinearity_ppm = 50", "ppm of the span, the bench file expects at most 50 ppm"),
            ("zero_drift_v = 0.0\nreading_noise_v = [0.0, 1e-6]", "the readings scatter by"),
        ],
        every=3,
    ),
)
def test_unexpected_gyroscope_ends_the_run_with_3(tmp_path: Path, table: str, words: str) -> None:
    done = run(tmp_path, f"[expected]\n{table}\n")
    assert done.exit_code == 3
    assert words in done.stderr
    assert "multimeter at GPIB0::22::INSTR: " in done.stderr


def test_a_dry_run_is_of_the_expected_gyroscope(tmp_path: Path) -> None:
    done = run(tmp_path, "[expected]\nscale_factor_v_per_deg_s = [0.5, 0.7]\nbias_v = [1, 2]\n", "--dry-run")
    assert done.exit_code == 0
    assert "the zero, to compare" in done.stdout


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[acceptance]\nbias_v = [0.1, -0.1]", r"acceptance\.bias_v: expected a window \[low, high\] with low below"),
        ("[expected]\nbias_v = [0.1, 0.1]", r"expected\.bias_v: expected a window \[low, high\] with low below high"),
        ("[expected]\nbias = [0, 1]", r"expected\.bias: expected a known key \('bias_v'\?\), got an unknown key"),
        ("[acceptance]\nbias_v = 0.1", r"acceptance\.bias_v: expected a list of 2 numbers, got 0\.1"),
        ("[acceptance]\nbias_v = [0, inf]", r"acceptance\.bias_v\[1\]: expected a finite number, got inf"),
        ("[acceptance]\nnonlinearity_ppm = [-5, 5]", r"nonlinearity_ppm\[0\]: expected a number at least 0"),
        ("[expected]\nzero_drift_v = -1", r"expected\.zero_drift_v: expected a number at least 0"),
    ],
)
def test_nonsense_is_refused_with_file_key_and_what_came(table: str, words: str) -> None:
    with pytest.raises(ConfigError, match=rf"b\.toml: .*{words}"):
        parse_bench(f"{embedded_text('paper')}\n{table}\n", "b.toml")
