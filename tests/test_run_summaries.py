"""Lists of records: what they say of each, and which they are asked for; from Python and by the command."""

from __future__ import annotations

import csv
import io
import json
import shutil
from datetime import UTC, datetime, timedelta, timezone
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests import warm
from tests.seals import sealed
from vcfbench.archive.summary import summary_of
from vcfbench.errors import ConfigError
from vcfbench.records.directory import RunDirectory

if TYPE_CHECKING:
    from pathlib import Path

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
TOLD = {"dut": "G-1", "operator": "A. Person", "note": "n", "tags": {"batch": "7", "wafer": "W3"}}
NAMES = ("20260101T000000Z-turntable-000001", "20260115T100000Z-turntable-000002", "20260116T000000Z-zero-000003")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory of three records: of two devices, one aborted, one that was cut."""
    folder = tmp_path_factory.mktemp("summaries")
    made = vcfbench.run("turntable", "ideal", settings=QUICK, runs=folder / "made", metadata=TOLD)
    assert made.directory is not None
    runs = folder / "runs"
    for name in NAMES:
        shutil.copytree(made.directory, runs / name)
    change(runs / NAMES[0], utc="2026-01-01T00:00:00+00:00")
    change(runs / NAMES[1], utc="2026-01-15T10:00:00+00:00", metadata={"dut": "G-2", "tags": {"batch": "7"}})
    change(runs / NAMES[2], utc="2026-01-16T00:00:00+00:00", metadata={"dut": "G-3"}, procedure="zero")
    cut = runs / NAMES[2] / "journal.jsonl"
    cut.write_bytes(cut.read_bytes()[:-50])
    return runs


def change(directory: Path, **values: Any) -> None:
    """Change the header of a record; what is None is taken out."""
    journal = directory / "journal.jsonl"
    header, *rest = journal.read_bytes().splitlines(keepends=True)
    changed = {key: value for key, value in {**json.loads(header), **values}.items() if value is not None}
    journal.write_bytes(sealed(json.dumps(changed).encode() + b"\n" + b"".join(rest)))


def names(found: tuple[vcfbench.RunSummary, ...]) -> list[int]:
    return [NAMES.index(each.run) for each in found]


def test_pandas_makes_a_table_of_the_summaries(runs: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pip install 'vcfbench[dev]'")
    summaries = vcfbench.run_summaries(runs)
    table = pandas.json_normalize([each.as_json() for each in summaries])
    assert list(table["dut"]) == [each.dut for each in summaries]
    found = [each.results["scale_factor"].u95 for each in summaries if "scale_factor" in each.results]
    assert list(table["results.scale_factor.u95"].dropna()) == found


def test_a_summary_says_what_the_run_does(runs: Path) -> None:
    [summary] = vcfbench.run_summaries(runs, dut="G-1")
    run = vcfbench.load_run(runs / NAMES[0])
    assert (summary.run, summary.directory, summary.status) == (run.name, run.directory, run.status)
    assert (summary.procedure, summary.bench, summary.seed, summary.points) == ("turntable", "ideal", 0, 3)
    assert (summary.dut, summary.operator, summary.note, summary.tags) == tuple(TOLD.values())
    assert summary.started == datetime(2026, 1, 1, tzinfo=UTC)
    slope = summary.results["scale_factor"]
    assert (slope.value, slope.u, slope.u95) == tuple(
        getattr(run.values["scale_factor"], of) for of in ("value", "u", "u95")
    )
    assert list(summary.results) == list(run.values)


def test_what_is_not_stored_is_computed_again(runs: Path, tmp_path: Path) -> None:
    shutil.copytree(runs / NAMES[0], tmp_path / NAMES[0])
    stored = summary_of(RunDirectory(tmp_path / NAMES[0]))
    (tmp_path / NAMES[0] / "result.json").unlink()
    assert summary_of(RunDirectory(tmp_path / NAMES[0])) == stored


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({}, [0, 1, 2]),
        ({"dut": "G-2"}, [1]),
        ({"dut": "G-3"}, [2]),
        ({"since": "2026-01-15"}, [1, 2]),
        ({"since": "2026-01-15T10:00:01"}, [2]),
        ({"since": datetime(2026, 1, 15, 12, 0, tzinfo=timezone(timedelta(hours=2)))}, [1, 2]),
        ({"status": "complete"}, [0, 1]),
        ({"status": "incomplete"}, [2]),
        ({"procedure": "zero"}, [2]),
        ({"tags": {"batch": "7"}}, [0, 1]),
        ({"tags": {"batch": "7", "wafer": "W3"}}, [0]),
        ({"tags": {"batch": "8"}}, []),
        ({"dut": "G-1", "status": "incomplete"}, []),
    ],
)
def test_what_is_asked_for_is_listed_oldest_first(asked: dict[str, Any], expected: list[int], runs: Path) -> None:
    assert names(vcfbench.run_summaries(runs, **asked)) == expected
    assert [run.name for run in vcfbench.list_runs(runs, **asked)] == [NAMES[each] for each in expected]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (
            {"status": "done"},
            "status: expected one of complete, aborted, running, incomplete, damaged, unreadable, got 'done'",
        ),
        ({"since": "yesterday"}, "since: expected a date, as in 2026-01-15, got 'yesterday'"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(asked: dict[str, Any], words: str, runs: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.run_summaries(runs, **asked)


def listed(runs: Path, *options: str) -> str:
    done = warm.run(["vcfbench", "runs", "list", "--runs", runs.name, *options], runs.parent)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_command_lists_device_results_and_verdict(runs: Path) -> None:
    head, _, *lines = listed(runs).splitlines()
    assert head.split() == ["run", "procedure", "status", "bench", "seed", "device", "points", "results", "verdict"]
    assert [line.split()[5] for line in lines] == ["G-1", "G-2", "G-3"]
    assert "scale_factor -12.54" in lines[0]
    assert "no such records in runs" in listed(runs, "--dut", "G-9")


def test_the_command_answers_in_json(runs: Path) -> None:
    [line] = json.loads(listed(runs, "--json", "--tag", "batch=7", "--since", "2026-01-02"))["runs"]
    assert (line["run"], line["dut"], line["tags"]) == (NAMES[1], "G-2", {"batch": "7"})
    assert line["results"]["scale_factor"]["unit"] == "V/(deg/s)"
    assert line["started_utc"] == "2026-01-15T10:00:00+00:00"


def test_the_command_answers_in_csv_that_reads_back(runs: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(listed(runs, "--csv"))))
    summaries = vcfbench.run_summaries(runs)
    assert [row["run"] for row in rows] == list(NAMES)
    assert rows[0]["tags"] == "batch=7;wafer=W3"
    assert float(rows[0]["scale_factor"]) == summaries[0].results["scale_factor"].value
    assert (rows[0]["bias_unit"], rows[2]["bias"], rows[2]["status"]) == ("V", "", "incomplete")
    assert listed(runs, "--csv", "--dut", "G-9").splitlines() == [",".join(list(rows[0])[:14])]


def test_no_text_is_a_formula_in_a_spreadsheet(runs: Path, tmp_path: Path) -> None:
    shutil.copytree(runs / NAMES[0], tmp_path / NAMES[0])
    change(tmp_path / NAMES[0], metadata={"operator": "@SUM(1)", "note": "=cmd|'/c calc'!A1", "dut": "-1"})
    (row,) = csv.DictReader(io.StringIO(listed(tmp_path, "--csv")))
    assert (row["operator"], row["note"], row["dut"]) == ("'@SUM(1)", "'=cmd|'/c calc'!A1", "'-1")
    assert float(row["scale_factor"]) < 0.0


def test_json_and_csv_together_are_refused(runs: Path) -> None:
    done = warm.run(["vcfbench", "runs", "list", "--json", "--csv"], runs)
    assert (done.returncode, "expected one of the two, got both" in done.stderr) == (2, True)


def test_u_is_the_combined_one_everywhere(runs: Path) -> None:
    stored = json.loads((runs / NAMES[0] / "result.json").read_text(encoding="utf-8"))["results"]
    combined = {each["name"]: each["u"] for each in stored["uncertainty"]["values"]}
    for name in ("scale_factor", "bias"):
        assert summary_of(RunDirectory(runs / NAMES[0])).results[name].u == stored[name]["u"] == combined[name]
        assert stored[name]["u_fit"] != combined[name]
