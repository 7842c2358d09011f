"""The command `vcfbench batch`: devices one after another, going on, and the sheet."""

from __future__ import annotations

import io
import json
import math
import re
import shutil
import sys
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs

import vcfbench
from tests import warm
from tests.cells import few
from vcfbench.archive.batch_sheet import SheetRow, batch_sheet, sheet_rows
from vcfbench.cli import batch as module
from vcfbench.cli.conduct import RunOptions
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError, MeasurementError, NotSafe
from vcfbench.records.device_values import Characteristics, Conditions
from vcfbench.records.devices import Characterisation, DeviceStore
from vcfbench.records.schema import Status
from vcfbench.reports.text import text_of
from vcfbench.runs.batch import read_batch
from vcfbench.station.acceptance import Acceptance, Verdict
from vcfbench.station.file import embedded_text
from vcfbench.station.settings import Limit
from vcfbench.values.value import Value

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

PLAN = """
name = "b7"
operator = "A. Person"
devices = ["G-1", "G-2"]
[[runs]]
procedure = "turntable"
settings = { rates_deg_s = [100, 50, 0, -50, -100], samples = 3, settle_s = 0.5 }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    return tmp_path


def batch(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return warm.run(["vcfbench", "batch", "plan.toml", "--quiet", *words], folder)


def slope_of(row: dict[str, Any]) -> float:
    return next(float(each["value"]) for each in row["values"] if each["kind"] == "scale_factor")


def summaries(folder: Path) -> tuple[Any, ...]:
    return vcfbench.run_summaries(folder / "runs")


@pytest.mark.exhaustive
def test_each_device_gets_record_with_serial_tag_and_operator(folder: Path) -> None:
    done = batch(folder, "--json", "--sheet", "sheet.md")
    assert done.returncode == 0, done.stderr
    assert [(each.dut, each.tags, each.operator) for each in summaries(folder)] == [
        ("G-1", {"batch": "b7"}, "A. Person"),
        ("G-2", {"batch": "b7"}, "A. Person"),
    ]
    answer = json.loads(done.stdout)
    first, second = answer["rows"]
    assert slope_of(first) != slope_of(second)  # each is a specimen of its own
    assert answer["sheet"] == ["sheet.md"]
    text = (folder / "sheet.md").read_text(encoding="utf-8")
    assert "Yield: 2 of 2 devices" in text
    assert "simulated bench" in text
    assert f"{1e3 * slope_of(first):.4f}" in text


def test_unwritable_sheet_is_refused_before_first_device(folder: Path) -> None:
    done = batch(folder, "--sheet", "sheet.docx")
    assert done.returncode == 2
    assert "sheet.docx" in done.stderr
    assert not (folder / "runs").exists()


def test_the_sheet_has_eighty_columns_on_a_terminal(folder: Path) -> None:
    done = batch(folder)
    assert "turntable\n---------" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


@pytest.mark.exhaustive
def test_the_same_command_goes_on_with_what_is_not_complete(folder: Path) -> None:
    batch(folder)
    first, second = summaries(folder)
    shutil.rmtree(second.directory)
    done = batch(folder)
    assert "G-1: measured already" in done.stderr
    assert [each.dut for each in summaries(folder)] == ["G-1", "G-2"]
    assert summaries(folder)[0].run == first.run


@pytest.mark.exhaustive
def test_device_whose_entry_was_withdrawn_is_measured_again(folder: Path) -> None:
    batch(folder)
    first, second = summaries(folder)
    store = DeviceStore(folder / "devices")
    of_run = Conditions(bench="paper", run=second.run, simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
    none = Characteristics()
    made = Characterisation(
        serial="G-2", done=second.started, procedure="turntable", conditions=of_run, characteristics=none
    )
    entry = store.add(made)
    assert "G-2: measured already" in batch(folder).stderr
    store.withdraw("G-2", entry.name, reason="wrong leads", by="P")
    done = batch(folder)
    assert "G-1: measured already" in done.stderr
    assert "G-2: turntable: complete" in done.stdout + done.stderr
    said = " ".join(done.stdout.split())
    assert f"Left out: {second.run}, G-2, turntable: its entry in the history of the device was withdrawn." in said
    assert [each.dut for each in summaries(folder)] == ["G-1", "G-2", "G-2"]
    assert summaries(folder)[0].run == first.run
    assert "G-2: measured already" in batch(folder).stderr


@pytest.mark.exhaustive
def test_drift_is_change_since_last_run_before_batch(folder: Path) -> None:
    settings = {"rates_deg_s": [100, 50, 0, -50, -100], "samples": 3, "settle_s": 0.5}
    before = vcfbench.run("turntable", seed=1, settings=settings, metadata={"dut": "G-1"}, runs=folder / "runs")
    first, second = json.loads(batch(folder, "--json").stdout)["rows"]
    change = slope_of(first) / before.results.scale_factor.value - 1.0
    assert math.isclose(first["drift_ppm"], 1e6 * change, rel_tol=1e-6, abs_tol=1e-6)
    assert first["e_n"] > 0.0
    assert second["drift_ppm"] is None
    still = structs.replace(sheet_rows("b7", folder / "runs")[0], drift_ppm=-0.3, u95_drift_ppm=None, e_n=0.0)
    assert "   0 (0.00)" in text_of(batch_sheet("b7", [still]))


@pytest.mark.exhaustive
def test_failed_limit_is_exit_1_and_counts_in_yield(folder: Path) -> None:
    limits = "\n[acceptance]\nnonlinearity_ppm = [0, 1]\n"
    (folder / "strict.toml").write_text(embedded_text("paper") + limits, encoding="utf-8")
    (folder / "plan.toml").write_text(f'bench = "strict.toml"\n{PLAN}', encoding="utf-8")
    done = batch(folder)
    assert done.returncode == 1, done.stderr
    assert "Yield: 0 of 2 devices (0 %); not good: G-1, G-2." in done.stdout
    assert done.stdout.count("FAIL") == 2
    assert "\nLimits: non-linearity, of the span 0 to 1 ppm.\n" in done.stdout
    assert "\nNot kept: G-2 (non-linearity, of the span: fail).\n" in done.stdout


@pytest.mark.exhaustive
def test_devices_are_listed_in_order_of_plan(folder: Path) -> None:
    batch(folder)
    (folder / "plan.toml").write_text(PLAN.replace('"G-1", "G-2"', '"G-3", "G-2", "G-1"'), encoding="utf-8")
    rows = read_batch(folder / "plan.toml").rows(folder / "runs", {})
    assert [each.device for each in rows] == ["G-2", "G-1", "G-3"]


def row_of(device: str, *values: Value) -> SheetRow:
    """The row of a complete run."""
    began = datetime(2026, 5, 1, tzinfo=UTC)
    made: dict[str, Any] = {"operator": None, "simulated": True, "status": Status.COMPLETE, "verdict": None}
    return SheetRow(device=device, procedure="own", run=f"r-{device}", started=began, values=values, **made)


def test_mean_of_a_batch_has_common_errors() -> None:
    """Table, meter and room are common to all: three devices with u 0.27 had a mean with u 0.015."""
    slopes = [
        Value("scale_factor", -0.0125 - 1e-6 * n, "V/(deg/s)", 1e-6 * (25 + n), kind="scale_factor") for n in (1, 2, 3)
    ]
    rows = [row_of(f"G-{n}", slope) for n, slope in enumerate(slopes)]
    assert "mean -12.502(27) mV/(deg/s) (errors as common to all)" in text_of(batch_sheet("b7", rows))


def test_sheet_of_records_at_rest_has_noise_and_no_drift() -> None:
    values = (
        Value("output_v", -0.0414, "V", 2e-5, kind="bias_at_rest"),
        Value("angle_random_walk", 0.21, "deg/sqrt(h)", 0.003),
        Value("bias_instability", 5.8, "deg/h", form="below", high=9.5),
        Value("trend", 1.0, "(deg/h)/h", 2.0),
    )
    text = text_of(batch_sheet("b7", [row_of("G-1", *values)]))
    assert re.search(r"device +bias +N +B +verdict", text)
    assert "below 9.5" in text
    assert "drift" not in text


@pytest.mark.parametrize(
    ("verdict", "passed"),
    few([(None, True), ("pass", True), ("marginal", False), ("fail", False)], ("marginal", False)),
)
def test_a_marginal_device_is_not_in_the_yield(folder: Path, verdict: str | None, *, passed: bool) -> None:
    batch(folder)
    (first, _) = sheet_rows("b7", folder / "runs")
    judged = structs.replace(first, verdict=verdict)
    assert judged.passed is passed
    assert f"Yield: {int(passed)} of 1 devices" in text_of(batch_sheet("b7", [judged]))


def test_failed_device_does_not_end_batch(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = _with_error(folder, monkeypatch, MeasurementError("the meter does not answer"))
    assert code == MeasurementError.exit_code
    assert [each.dut for each in summaries(folder)] == ["G-2"]
    said = capsys.readouterr()
    assert "G-1: turntable: the meter does not answer; the batch goes on" in said.err
    assert "Yield: 1 of 2 devices (50 %); not good: G-1." in said.out
    assert "no record" in said.out
    assert "G-1, turntable: the meter does not answer" in said.out


def test_untried_devices_are_named_and_not_counted(folder: Path) -> None:
    asked = read_batch(folder / "plan.toml")
    first, second = asked.rows(folder / "runs", {"G-1": "it does not answer"})
    text = text_of(batch_sheet("b7", [first, second]))
    assert not [line for line in text.splitlines() if line.strip() == "."]  # of no values nothing is said
    assert "Yield: 0 of 1 devices" in text
    assert "Not measured yet: G-2." in text
    assert "No device has been measured yet." in text_of(batch_sheet("b7", [second]))


@pytest.mark.exhaustive
def test_incomplete_u95_is_marked(folder: Path) -> None:
    batch(folder)
    (first, _) = sheet_rows("b7", folder / "runs")
    row = structs.replace(
        first, missing=("temperature",), verdict="marginal", drift_ppm=5371.2, u95_drift_ppm=2826.0, e_n=1.9
    )
    text = text_of(batch_sheet("b7", [row]), 80)
    assert max(map(len, text.splitlines())) <= 80
    assert "MARGINAL*" in text
    assert "* U95 is incomplete: without temperature." in text
    assert "+5371±2826 (1.90)" in text
    slope = first.scale_factor
    assert slope is not None
    assert f"{1e6 * (slope.u95 or 0.0) / abs(slope.value or 1.0):.0f}*" in text


def test_a_bench_that_is_not_safe_ends_the_batch(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _with_error(folder, monkeypatch, NotSafe("the table turns")) == NotSafe.exit_code
    assert not summaries(folder)


def _with_error(folder: Path, monkeypatch: pytest.MonkeyPatch, error: Exception) -> int:
    """Run the command in this process, its first run ended by `error`; return its exit code."""
    attended, errors = module.attended, [error]

    def failing(*arguments: Any) -> Any:
        if errors:
            raise errors.pop()
        return attended(*arguments)

    monkeypatch.setattr(module, "attended", failing)
    monkeypatch.chdir(folder)
    return app(["batch", "plan.toml", "--quiet"], standalone_mode=False) or 0


def test_serial_numbers_are_read_until_an_empty_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "plan.toml").write_text(PLAN.replace('devices = ["G-1", "G-2"]', ""), encoding="utf-8")
    monkeypatch.setattr(sys, "stdin", io.StringIO("S1\nS2\n\nS3\n"))
    monkeypatch.chdir(folder)
    assert not app(["batch", "plan.toml", "--quiet"], standalone_mode=False)
    assert [each.dut for each in summaries(folder)] == ["S1", "S2"]


@pytest.mark.parametrize(("piped", "words"), [("", "expected at least one device"), ("G 1\nG-2\n", "'G 1'")])
def test_impossible_serial_numbers_of_a_pipe_end_with_2(
    folder: Path, piped: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "plan.toml").write_text(PLAN.replace('devices = ["G-1", "G-2"]', ""), encoding="utf-8")
    monkeypatch.setattr(sys, "stdin", io.StringIO(piped))
    monkeypatch.chdir(folder)
    assert app(["batch", "plan.toml", "--quiet"], standalone_mode=False) == 2
    assert (words in capsys.readouterr().err, summaries(folder)) == (True, ())


@pytest.mark.parametrize(
    ("was", "now", "words"),
    [
        ('"G-2"]', '"G-1"]', "devices: G-1 is listed twice"),
        ('"G-2"]', '"G-2,G-3"]', "plan.toml: devices[1]: serial number 'G-2,G-3': expected letters A to Z"),
        ('"G-1"', '"../G"', "plan.toml: devices[0]: serial number '../G': expected letters A to Z"),
        ("samples = 3", "sample = 3", "runs[0].settings"),
        ("[[runs]]", "[[run]]", "run"),
        ("[[runs]]", '[[runs]]\nprocedure = "turntable"\n[[runs]]', "runs: turntable is listed twice"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_with_its_key(folder: Path, was: str, now: str, words: str) -> None:
    (folder / "plan.toml").write_text(PLAN.replace(was, now), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        read_batch(folder / "plan.toml").check("G-1", folder / "runs")
    assert words in str(refused.value)


def test_step_beyond_limit_is_refused_before_first_measurement(folder: Path) -> None:
    (folder / "plan.toml").write_text(PLAN.replace("[100, 50", "[100000, 50"), encoding="utf-8")
    done = batch(folder)
    assert done.returncode == 2, done.stderr
    assert "turntable of device G-1" in done.stderr
    assert not (folder / "runs").exists()


@pytest.mark.parametrize(("high", "word"), [(1.0, "PASS"), (0.05, "MARGINAL")])
def test_a_verdict_by_an_incomplete_guard_band_says_so(
    high: float, word: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bias = Value("bias", 0.0, "V", u95=0.1, missing=("temperature",))
    verdict = Acceptance((Verdict.of(Limit("bias_v", -1.0, high, guarded=True), bias),))
    run = vcfbench.Run("turntable", vcfbench.Status.COMPLETE, verdict=verdict)
    monkeypatch.setattr(module, "attended", lambda *_: run)
    asked = read_batch(folder / "plan.toml")
    outcome = module.measured(asked, "G-1", RunOptions(bench=None, runs=folder / "runs"))
    said = f"turntable: {word} with an incomplete U95, without temperature"
    assert (outcome.word, outcome.why) == (word, said)
    assert said in capsys.readouterr().err
