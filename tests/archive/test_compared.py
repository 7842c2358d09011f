"""Runs beside each other."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs
from typer.testing import CliRunner

import vcfbench
from tests import warm
from tests.archive.test_written import QUICK
from vcfbench import Point, Run, Status
from vcfbench.archive.compared import compare_runs
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Figure, Heading, Table
from vcfbench.reports.text import text_of
from vcfbench.values.definition import Definition
from vcfbench.values.value import Value

POINTS = (Point(1, 10.0, 0.0, 0.5, 3e-3, 9), Point(1, 0.0, 0.0, 0.25, 3e-3, 9))


@dataclass(frozen=True)
class Found:
    gain: Value
    offset_v: Value
    name: str = "x"
    list_of_them: tuple[float, ...] = (1.0,)


def made(gain: float, u: float, *, procedure: str = "own", unit: str = "V", points: tuple[Point, ...] = POINTS) -> Run:
    return Run(procedure, Status.COMPLETE, points, Found(Value("gain", gain, unit, u), Value("offset_v", 0.5)))


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with two calibrations in it that differ in a setting and their seed."""
    folder = tmp_path_factory.mktemp("two")
    for seed, settle_s in ((3, 0.5), (4, 0.75)):
        settings: dict[str, Any] = {**QUICK, "settle_s": settle_s}
        vcfbench.run("turntable", seed=seed, settings=settings, runs=folder / "runs", metadata={"dut": f"G-{seed}"})
    return folder


def test_values_are_found_by_type_with_unit_and_uncertainty() -> None:
    assert values_of(made(2.0, 0.1).results) == {
        "gain": Value("gain", 2.0, "V", 0.1),
        "offset_v": Value("offset_v", 0.5),
    }
    assert values_of(None) == {}


def test_combined_uncertainties_come_before_those_of_the_fit(two: Path) -> None:
    run = vcfbench.load_run("last", two / "runs")
    stated = run.results.uncertainty.value("scale_factor")
    found = values_of(run.results)["scale_factor"]
    assert (found.value, found.u, found.u95) == (stated.value, stated.u, stated.u95)
    assert found.coverage_factor == pytest.approx(stated.coverage_factor)


def test_differences_have_their_uncertainty_and_e_n() -> None:
    gain, offset = compare_runs(made(2.0, 0.3), made(3.0, 0.4), made(1.5, 0.0)).results
    assert gain.values == (2.0, 3.0, 1.5)
    first, second = gain.differences
    assert (first.value, first.u, first.e_n) == (1.0, 0.5, pytest.approx(1.0 / (1.96 * 0.5), rel=1e-4))
    assert (second.value, second.u, second.e_n) == (-0.5, 0.3, pytest.approx(0.5 / (1.96 * 0.3), rel=1e-4))
    assert offset.differences[0].e_n is None


def test_results_with_an_uncertainty_stand_in_the_first_table() -> None:
    parts = compare_runs(made(2.0, 0.3), made(3.0, 0.4)).report().parts
    heads = [part.text for part in parts if isinstance(part, Heading)]
    tables = [part for part in parts if isinstance(part, Table) and part.columns[0].name == "result"]
    first, second = ([row[0] for row in table.rows] for table in tables)
    assert heads[1:3] == ["Shared results", "Shared results without uncertainty"]
    assert (first, second) == (["gain"], ["offset"])


@pytest.mark.exhaustive
def test_the_last_two_calibrations_of_a_device_are_compared(tmp_path: Path) -> None:
    for seed, dut in ((1, "G1"), (2, "G2"), (3, "G1")):
        vcfbench.run("turntable", seed=seed, settings={"samples": 2}, metadata={"dut": dut}, runs=tmp_path)
    vcfbench.run("polarity", seed=4, metadata={"dut": "G1"}, runs=tmp_path)
    done = CliRunner().invoke(app, ["compare", "--dut", "G1", "--runs", str(tmp_path), "--json"])
    of_device = [each.run for each in vcfbench.run_summaries(tmp_path, dut="G1") if each.procedure == "turntable"]
    assert (done.exit_code, json.loads(done.stdout)["runs"]) == (0, of_device)
    refused = CliRunner().invoke(app, ["compare", "last", "--dut", "G1", "--runs", str(tmp_path)])
    assert "--dut chooses the runs" in refused.stderr
    single = CliRunner().invoke(app, ["compare", "--dut", "G2", "--runs", str(tmp_path)])
    found = "expected two complete runs of G2, of one procedure, to compare, found 1 turntable; one of elsewhere"
    assert f"{tmp_path}: {found}" in single.stderr


@pytest.mark.exhaustive
def test_run_of_another_directory_is_compared_by_path_or_copy(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "compare.md").read_text("utf-8")
    for seed, folder in ((1, "archive"), (2, "runs")):
        metadata = {"dut": "G1"}
        vcfbench.run("turntable", seed=seed, settings={"samples": 2}, metadata=metadata, runs=tmp_path / folder)
    (kept,) = (tmp_path / "archive").iterdir()
    command, copy = "vcfbench compare archive/RUN last", "cp -r archive/RUN runs/"
    assert command in page
    assert copy in page
    named = warm.run(command.replace("RUN", kept.name).split(), tmp_path)
    assert (named.returncode, kept.name in named.stdout) == (0, True), named.stderr
    shutil.copytree(kept, tmp_path / "runs" / kept.name)
    history = warm.run(["vcfbench", "device", "G1"], tmp_path)
    assert history.stdout.count("turntable") == 2


def test_results_in_other_units_are_not_compared() -> None:
    other = made(3.0, 0.4, unit="A", points=POINTS[:1])
    comparison = compare_runs(made(2.0, 0.3), other)
    assert [each.name for each in comparison.results] == ["offset_v"]
    assert comparison.points == ()


def test_what_shares_nothing_is_refused_in_words() -> None:
    nothing = Run("other", Status.COMPLETE)
    with pytest.raises(ConfigError, match=r"no common points: own \(own\) has gain, offset_v; other"):
        compare_runs(made(2.0, 0.3), nothing)
    with pytest.raises(ConfigError, match="expected 2 to 26 runs to compare, got 1"):
        compare_runs(nothing)


def test_comparison_shows_results_points_differences_and_figures(two: Path) -> None:
    comparison = compare_runs(*vcfbench.list_runs(two / "runs"))
    assert comparison.settings == {"settle_s": ("0.5", "0.75")}
    assert comparison.equipment == {"dut": ("G-3", "G-4"), "seed": ("3", "4")}
    assert comparison.instruments == ()  # of each seed there is another meter and another table
    assert {each.name for each in comparison.results} <= {*comparison.runs[0].values}
    report = comparison.report()
    words = " ".join(text_of(report).split())
    assert ("non-linearity" in words, "max span" in words, "durbin watson" in words) == (True, False, False)
    numbered = structs.replace(comparison, instruments=("multimeter 34401A 17",)).report()
    assert "that both runs have cancel: multimeter 34401A 17." in " ".join(text_of(numbered).split())
    figures = [part for part in report.parts if isinstance(part, Figure)]
    assert [each.title for each in figures] == [
        *("Differences of the points", "Output against the table's rate", "Residuals of the least-squares line"),
    ]
    assert [each.label for each in figures[1].series] == [
        *("A: turntable", "A: turntable, least-squares line", "B: turntable", "B: turntable, least-squares line"),
    ]
    assert len(figures[0].series[0].x) == 3


@pytest.mark.exhaustive
def test_the_command_prints_writes_and_answers_in_json(two: Path) -> None:
    first, second = (run.name for run in vcfbench.list_runs(two / "runs"))
    shown = warm.run(["vcfbench", "compare"], two)
    assert shown.returncode == 0, shown.stderr
    assert "Shared results" in shown.stdout
    answered = warm.run(["vcfbench", "compare", str(first), "last", "--json", "-o", "both.html"], two)
    answer = json.loads(answered.stdout)
    assert answer["runs"] == [first, second]
    assert {"name", "unit", "values", "u", "differences"} <= answer["results"][0].keys()
    assert (two / "both.html").read_text(encoding="utf-8").count("<figure>") == 3


def test_last_sentence_explains_change_and_rest() -> None:
    def run(value: float, *rates: float) -> Run:
        over = Definition.of(rates)
        slope = Value("scale_factor", value, "V/(deg/s)", 2e-7, kind="scale_factor", definition=over)
        return Run("own", Status.COMPLETE, POINTS, {"scale_factor": slope})

    (said,) = text_of(compare_runs(run(-0.0125, 1, 0), run(-0.012503, 1, 0)).report()).splitlines()[-1:]
    assert said == "scale factor, A to B: changed by +240±44 ppm, more than its U95."


def test_a_run_compared_with_itself_has_no_difference(two: Path) -> None:
    run = vcfbench.load_run("last", two / "runs")
    comparison = compare_runs(run, structs.replace(run))
    assert {d.value for each in comparison.results for d in each.differences} == {0.0}
    assert comparison.settings == {}
    assert "A and B are one record, which agrees with itself." in text_of(comparison.report())


def test_a_copy_under_another_name_is_told_as_one(two: Path, tmp_path: Path) -> None:
    first, last = vcfbench.list_runs(two / "runs")
    copied = shutil.copytree(two / "runs" / str(last.name), tmp_path / "copied")
    words = text_of(compare_runs(last, first, vcfbench.load_run(copied)).report())
    assert words.count("A and C are one record, which agrees with itself.") == 1
    assert "one record" not in text_of(compare_runs(first, last).report())


@pytest.mark.parametrize("status", [each for each in Status if each is not Status.COMPLETE])
def test_run_that_is_not_complete_is_named(status: Status) -> None:
    error = ConfigError("the record is damaged: line 9 was changed") if status is Status.DAMAGED else None
    words = text_of(compare_runs(made(1.0, 0.1), structs.replace(made(1.0, 0.1), status=status, error=error)).report())
    assert f"B is {status}, not complete: {error or 'its points are not all'}." in " ".join(words.split())
    assert "A is" not in words


def test_line_and_small_signal_slope_are_not_compared() -> None:
    def found(kind: str, value: float) -> Run:
        slope = Value("scale_factor", value, "V/(deg/s)", 2e-7, kind=kind)
        return Run("own", Status.COMPLETE, POINTS, {"scale_factor": slope, "gain": Value("gain", 1.0, "V", 0.1)})

    compared = compare_runs(found("scale_factor", -0.012542), found("scale_factor_small", -0.012552))
    assert [each.name for each in compared.results] == ["gain"]
    why = "of another measurand: scale factor and scale factor of small signals"
    assert compared.of_others == (f"scale factor: {why}",)
    assert f"Not compared:\n  scale factor: {why}" in text_of(compared.report())


def test_more_runs_than_letters_are_refused_before_anything_is_read(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["compare", *map(str, range(100)), "--runs", str(tmp_path)])
    assert (done.exit_code, done.stderr) == (2, "vcfbench: expected 2 to 26 runs to compare, got 100\n")
