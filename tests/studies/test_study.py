"""Studies as they are run: the same bytes however they are done, nothing lost, mistakes of single runs are rows."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few

import vcfbench
from vcfbench.errors import BenchError, ConfigError, MeasurementError
from vcfbench.studies.conduct import Progress
from vcfbench.studies.file import Study, read_study

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.studies.one_run import RunRow

STUDY = """
title = "samples"
procedure = "turntable"
seeds.count = 3
settings = { rates_deg_s = [10, 0, -10], settle_s = 0.5 }
metrics = ["scale_factor", "bias", "acceptance.*"]
[change.acceptance]
bias_v = [-0.0415, 0.0]
[vary]
settings.samples = [3, 4]
"simulation.override.table.rate_error" = { uniform = [-1e-5, 1e-5], label = "rate error" }
"""
QUICK = {"rates_deg_s": [10, 0, -10], "settle_s": 0.5, "samples": 4}
FILES = ("t.csv", "t.summary.json", "t.svg")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study done in this process: what every other way must give, byte for byte."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    vcfbench.study(folder / "study.toml", output=folder / "t.csv", workers=1)
    return folder


def of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


def again(whole: Path, folder: Path, **how: Any) -> vcfbench.StudyResult:
    (folder / "study.toml").write_text((whole / "study.toml").read_text("utf-8"), encoding="utf-8")
    return vcfbench.study(folder / "study.toml", output=folder / "t.csv", **how)


@pytest.mark.exhaustive
def test_a_row_a_run_and_a_case_a_value(whole: Path) -> None:
    with (whole / "t.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["case"], row["seed"], row["settings.samples"]) for row in rows] == [
        *(("0", str(seed), "3") for seed in range(3)),
        *(("1", str(seed), "4") for seed in range(3)),
    ]
    assert {row["status"] for row in rows} == {"complete"}
    assert {row["verdict"] for row in rows} == {"pass"}
    assert rows[0]["rate error"] == rows[3]["rate error"] != rows[1]["rate error"]
    first = rows[0]
    z = (float(first["bias"]) - float(first["bias.truth"])) / float(first["bias.u"])
    assert float(first["bias.z"]) == z
    assert first["bias.covered"] == str(abs(z) * float(first["bias.u"]) <= float(first["bias.u95"])).lower()
    assert "scale_factor.truth" in first
    assert "bias_deg_s" not in first


@pytest.mark.exhaustive
def test_a_run_of_a_study_is_the_run_alone(whole: Path, tmp_path: Path) -> None:
    settings = {"rates_deg_s": [10, 0, -10], "settle_s": 0.5, "samples": 4}
    result = vcfbench.load_study(whole / "t.csv")
    bench = read_study(whole / "study.toml").described(read_study(whole / "study.toml").cases[1], 2)[0]
    run = vcfbench.run("turntable", bench, seed=2, settings=settings, runs=tmp_path)
    assert result.rows[5].metrics["bias"] == run.results.uncertainty.value("bias").value
    assert result.rows[5].bench_seconds == run.bench_seconds


@pytest.mark.exhaustive
def test_the_summary_is_of_the_rows(whole: Path) -> None:
    result = vcfbench.load_study(whole / "t.csv")
    found = [row.metrics["scale_factor"] for row in result.rows if row.case == 1]
    case = result.summary[1]
    assert (case.runs, case.complete, case.pass_rate, case.values) == (3, 3, 1.0, {"settings.samples": 4})
    metric = case.metrics["scale_factor"]
    mean = sum(found) / 3
    assert metric.mean == pytest.approx(mean, rel=1e-12)
    assert metric.sd == pytest.approx((sum((each - mean) ** 2 for each in found) / 2) ** 0.5, rel=1e-9)
    assert (metric.least, metric.most) == (min(found), max(found))
    answer = json.loads((whole / "t.summary.json").read_text("utf-8"))
    assert answer["cases"][1]["metrics"]["scale_factor"]["mean"] == metric.mean
    assert "scale_factor   4" in vcfbench.text_of(result.report())
    assert "<table" in result._repr_html_()


@pytest.mark.exhaustive
def test_the_table_is_a_data_frame(whole: Path) -> None:
    pandas = pytest.importorskip("pandas")
    table = vcfbench.load_study(whole / "t.csv").table()
    read = pandas.read_csv(whole / "t.csv")
    assert list(read["bias"]) == list(table["bias"])
    pandas.testing.assert_frame_equal(read.drop(columns="message"), table.drop(columns="message"), check_dtype=False)


@pytest.mark.exhaustive
@pytest.mark.parametrize("share", few([0.0, 0.02, 0.4, 0.75, 0.999], 0.4))
def test_a_study_that_was_cut_anywhere_goes_on(whole: Path, tmp_path: Path, share: float) -> None:
    journal = (whole / "t.journal.jsonl").read_bytes()
    cut = journal[: int(share * len(journal))]
    (tmp_path / "t.journal.jsonl").write_bytes(cut)
    again(whole, tmp_path, workers=1)
    assert of(tmp_path) == of(whole)
    assert (tmp_path / "t.journal.jsonl").read_bytes() == journal


@pytest.mark.exhaustive
def test_what_is_done_is_not_done_again(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(_: object) -> RunRow:
        raise AssertionError

    before = of(whole)
    with monkeypatch.context() as patched:
        patched.setattr("vcfbench.studies.workers.perform", never)
        vcfbench.study(whole / "study.toml", output=whole / "t.csv", workers=1)
    assert of(whole) == before


@pytest.mark.exhaustive
def test_more_seeds_go_on_and_other_values_are_refused(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "t.journal.jsonl").write_bytes((whole / "t.journal.jsonl").read_bytes())
    file = tmp_path / "study.toml"
    file.write_text(STUDY.replace("count = 3", "count = 4"), encoding="utf-8")
    assert len(vcfbench.study(file, output=tmp_path / "t.csv", workers=1).rows) == 8
    file.write_text(
        STUDY.replace("settle_s = 0.5", "settle_s = 0.6").replace("count = 3", "count = 1"), encoding="utf-8"
    )
    with pytest.raises(ConfigError, match=r"this is the journal of another study.*--restart"):
        vcfbench.study(file, output=tmp_path / "t.csv", workers=1)
    assert len(vcfbench.study(file, output=tmp_path / "t.csv", workers=1, restart=True).rows) == 2


@pytest.mark.parametrize("text", ["not a journal\n", '{"type":"header"}\n', "x"])
def test_what_is_no_journal_is_not_written_over(whole: Path, tmp_path: Path, text: str) -> None:
    (tmp_path / "t.journal.jsonl").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"t\.journal\.jsonl: "):
        again(whole, tmp_path, workers=1)
    assert (tmp_path / "t.journal.jsonl").read_text("utf-8") == text


class Second(Progress):
    """Begins the same study once more while it goes."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.refused: list[str] = []

    def done(self, row: RunRow) -> None:  # noqa: ARG002
        for how in ({}, {"restart": True}):
            with pytest.raises(BenchError) as found:
                vcfbench.study(self.file, output=self.file.with_name("t.csv"), workers=1, **how)  # type: ignore[arg-type]
            self.refused.append(str(found.value))


@pytest.mark.exhaustive
def test_a_second_study_into_the_same_files_is_refused(whole: Path, tmp_path: Path) -> None:
    """Also with --restart, which would take the journal away from the first; it is free when the first has ended."""
    second = Second(tmp_path / "study.toml")
    again(whole, tmp_path, workers=1, progress=second)
    assert len(second.refused) == 12
    assert all("t.journal.jsonl: another study writes this journal now" in each for each in second.refused)
    assert of(tmp_path) == of(whole)
    again(whole, tmp_path, workers=1)


class Killer(Progress):
    """Kills a process of the study as soon as one run is done."""

    killed = 0

    def done(self, row: RunRow) -> None:  # noqa: ARG002
        children = multiprocessing.active_children()
        if not self.killed and children:
            os.kill(children[0].pid or 0, signal.SIGKILL)
            self.killed += 1


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_process_that_is_killed_costs_nothing(whole: Path, tmp_path: Path) -> None:
    killer = Killer()
    again(whole, tmp_path, workers=2, progress=killer)
    assert killer.killed == 1
    assert of(tmp_path) == of(whole)


@pytest.mark.exhaustive
def test_names_that_fit_no_metric_are_refused_after_one_run(tmp_path: Path) -> None:
    asked = {"procedure": "turntable", "seeds": {"count": 50}, "settings": QUICK, "metrics": ["nothing.*"]}
    with pytest.raises(vcfbench.ConfigError, match=r"study: metrics: expected .*scale_factor, .*got nothing\.\*"):
        vcfbench.study(asked, output=tmp_path / "t.csv", workers=1)
    assert not (tmp_path / "t.csv").exists()


DEADLY = """
import os
import signal
from vcfbench import Note, Procedure, ProcedureSettings

def plan(settings):
    if settings.samples == 4:
        os.kill(os.getpid(), signal.SIGKILL)
    yield Note("nothing")

DEADLY = Procedure(name="deadly", title="Dies.", settings=ProcedureSettings, plan=plan, results=lambda s, m: {"n": 1})
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_run_that_kills_its_process_ends_the_study_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process dies when the plan is walked, which the check does too: so the check is left out here."""
    (tmp_path / "deadly.py").write_text(DEADLY, encoding="utf-8")
    text = 'procedure = "./deadly.py"\nseeds.count = 4\n[vary]\nsettings.samples = [3, 4, 5]\n'
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(Study, "check", lambda _: iter(()))
    with pytest.raises(vcfbench.BenchError, match=r"die before they have done case 1, seed \d \(and 3 more\)"):
        vcfbench.study(tmp_path / "study.toml", output=tmp_path / "t.csv", workers=2)
    rows = vcfbench.load_study(tmp_path / "t.csv").rows
    assert sorted({row.case for row in rows}) == [0, 2]
    assert len(rows) == 8


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_killed_study_continues_and_leaves_no_process(whole: Path, tmp_path: Path) -> None:
    text = STUDY.replace("count = 3", "count = 300")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "vcfbench", "study", "study.toml", "-o", "t.csv", "--workers", "2", "--quiet"]
    journal = tmp_path / "t.journal.jsonl"
    with subprocess.Popen(command, cwd=tmp_path, process_group=0) as process:  # noqa: S603
        while not journal.exists() or journal.read_bytes().count(b"\n") < 2:
            assert process.poll() is None
            time.sleep(0.02)  # noqa: TID251  # a process of its own has no clock of ours
        process.kill()
    deadline = time.monotonic() + 20.0  # noqa: TID251
    while _alive(process.pid) and time.monotonic() < deadline:  # noqa: TID251
        time.sleep(0.05)  # noqa: TID251
    assert not _alive(process.pid)
    again(whole, tmp_path, workers=1)
    assert of(tmp_path) == of(whole)


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


OWN = """
from vcfbench import Note, Procedure, ProcedureSettings

def plan(settings):
    yield Note("nothing")

def results(settings, measured):
    if settings.samples == 4:
        raise ValueError("four is too many")
    return {"n": settings.samples, "half": settings.samples / 2, "even": settings.samples % 2 == 0, "name": "a text"}

OWN = Procedure(name="own", title="Counts.", settings=ProcedureSettings, plan=plan, results=results)
"""


def test_a_run_that_fails_is_a_row(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    text = 'procedure = "./own.py"\nseeds = { first = 7, count = 2 }\n[vary]\nsettings.samples = [3, 4]\n'
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    result = vcfbench.study(tmp_path / "study.toml", workers=1, keep_records=tmp_path / "records")
    assert [(row.seed, row.status) for row in result.rows] == [
        (7, "complete"),
        (8, "complete"),
        (7, "failed"),
        (8, "failed"),
    ]
    assert "four is too many" in (result.rows[2].message or "")
    assert result.rows[0].metrics == {"n": 3, "half": 1.5, "even": False}
    assert result.summary[1].complete == 0
    assert "2 of 4 runs complete" in vcfbench.text_of(result.report())
    kept = [vcfbench.list_runs(each) for each in sorted((tmp_path / "records").glob("*/*"))]
    assert [[run.seed for run in runs] for runs in kept] == [[7], [8], [7], [8]]


def test_a_study_without_any_result_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    study = {"procedure": str(tmp_path / "own.py"), "seeds": {"count": 2}, "settings": {"samples": 4}}
    with pytest.raises(
        MeasurementError, match=r"none of the 2 runs came to its end; case 0, seed 0: .*four is too many"
    ):
        vcfbench.study(study, output=tmp_path / "t.csv", workers=1)
    assert "four is too many" in (tmp_path / "t.csv").read_text("utf-8")


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"output": "t.xlsx"}, "expected a name that ends in .csv"),
        ({"output": "nowhere/t.csv"}, "the directory nowhere does not exist"),
        ({"workers": 0}, "--workers 0: expected 1 to 1024"),
    ],
)
def test_how_it_is_to_be_done_is_checked_first(whole: Path, how: dict[str, Any], words: str) -> None:
    with pytest.raises(BenchError, match=words):
        vcfbench.study(whole / "study.toml", **how)
