"""The index of runs says what the records say, whatever becomes of either."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests import warm
from tests.seals import sealed
from tests.test_run_summaries import NAMES, QUICK, TOLD, change
from vcfbench.archive.index import BESIDE, RunIndex
from vcfbench.archive.summary import RunSummary, Selection, ordered, summary_of
from vcfbench.records.directory import RunDirectory

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path_factory.mktemp("index"), metadata=TOLD)
    assert run.directory is not None
    return run.directory


@pytest.fixture
def runs(made: Path, tmp_path: Path) -> Path:
    """Return a directory of three records: of two devices, one that was cut, with words that are hard to keep."""
    runs = tmp_path / "runs"
    for name in NAMES:
        shutil.copytree(made, runs / name)
    change(runs / NAMES[0], utc="2026-01-01T00:00:00+00:00")
    hard = {"dut": "G-2", "note": "'; DROP TABLE vcfbench_runs; -- %s Ω", "tags": {"batch": "7"}}
    change(runs / NAMES[1], utc="2026-01-15T10:00:00+02:00", metadata=hard, seed=2**63 - 1)
    change(runs / NAMES[2], utc="2026-01-16T00:00:00+00:00", metadata=None, procedure="zero", settings={"dut": "G-3"})
    cut = runs / NAMES[2] / "journal.jsonl"
    cut.write_bytes(cut.read_bytes()[:-50])
    return runs


ASKED: list[dict[str, Any]] = [
    {},
    {"dut": "G-2"},
    {"dut": "G-9"},
    {"since": "2026-01-15T08:00:00"},
    {"since": "2026-01-15T08:00:01"},
    {"status": "incomplete"},
    {"procedure": "zero"},
    {"tags": {"batch": "7"}},
    {"tags": {"batch": "7", "wafer": "W3"}},
    {"tags": {"batch": "8"}},
    {"dut": "G-1", "status": "complete", "procedure": "turntable", "since": "2026-01-01", "tags": {"wafer": "W3"}},
]


def from_records(runs: Path) -> tuple[RunSummary, ...]:
    return ordered(summary_of(RunDirectory(each.parent)) for each in runs.glob("*/journal.jsonl"))


def test_the_index_answers_as_the_records_do(runs: Path) -> None:
    """Every selection, the first time and from what stands in the index."""
    expected = {str(asked): vcfbench.run_summaries(runs, **asked) for asked in ASKED}
    for _ in range(2):
        for asked in ASKED:
            index = RunIndex(runs)
            index.refresh()
            assert index.select(Selection.of(**asked)) == expected[str(asked)], asked
            assert vcfbench.run_summaries(runs, **asked) == expected[str(asked)], asked


def test_only_what_changed_is_read_again(runs: Path) -> None:
    index = RunIndex(runs)
    assert index.refresh().read == 3
    assert index.refresh().read == 0
    change(runs / NAMES[1], metadata={"dut": "G-7"})
    shutil.rmtree(runs / NAMES[0])
    shutil.copytree(runs / NAMES[1], runs / "20260301T000000Z-turntable-00000a")
    done = index.refresh()
    assert (done.records, done.read, done.gone, done.made_again) == (3, 2, 1, None)
    assert index.select(Selection.of()) == from_records(runs)
    assert len(index.select(Selection.of(dut="G-7"))) == 2
    assert index.refresh(rebuild=True).read == 3
    assert index.select(Selection.of()) == from_records(runs)


def test_a_change_that_keeps_size_and_time_is_seen(runs: Path) -> None:
    index = RunIndex(runs)
    index.refresh()
    journal = runs / NAMES[0] / "journal.jsonl"
    before = journal.stat()
    changed = journal.read_bytes().replace(b'"dut":"G-1"', b'"dut":"G-8"').replace(b'"G-1"', b'"G-8"')
    journal.write_bytes(sealed(changed))
    os.utime(journal, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert journal.stat().st_size == before.st_size
    assert index.refresh().read == 1
    assert [each.run for each in index.select(Selection.of(dut="G-8"))] == [NAMES[0]]


def test_a_verdict_that_is_stored_later_is_seen(runs: Path) -> None:
    index = RunIndex(runs)
    index.refresh()
    stored = runs / NAMES[0] / "result.json"
    values = json.loads(stored.read_text())
    limit = {"key": "bias_v", "value": 0.0, "low": -1.0, "high": 1.0, "verdict": "pass"}
    stored.write_text(json.dumps({**values, "acceptance": {"verdict": "pass", "limits": [limit]}}))
    index.refresh()
    assert index.select(Selection.of(dut="G-1"))[0].verdict == "pass"


def test_programs_that_write_at_the_same_time_take_turns(runs: Path) -> None:
    summaries = vcfbench.run_summaries(runs)

    def write(_: int) -> bool:
        index = RunIndex(runs)
        for again in range(4):
            index.refresh(rebuild=again % 2 == 0)
        found = index.select(Selection.of())
        return found == summaries

    with ThreadPoolExecutor(3) as programs:
        assert list(programs.map(write, range(3))) == [True] * 3


def beside(runs: Path) -> Path:
    index = RunIndex(runs)
    index.refresh()
    return runs / BESIDE


def no_database(path: Path) -> None:
    path.write_bytes(b"no database at all" * 100)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def spoilt(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:8192] = bytes(4096)
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-5000])


def foreign(path: Path) -> None:
    path.unlink()
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE runs (run TEXT, dut TEXT)")
        connection.execute("INSERT INTO runs VALUES ('x', 'G-1')")
    connection.close()


def of_another_version(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 3")
        connection.execute("UPDATE runs SET summary = '{}'")
    connection.close()


@pytest.mark.exhaustive
@pytest.mark.parametrize("spoil", [no_database, empty, spoilt, cut, foreign, of_another_version])
def test_an_index_beside_the_records_that_is_none_is_made_again(spoil: Callable[[Path], None], runs: Path) -> None:
    summaries = vcfbench.run_summaries(runs)
    spoil(beside(runs))
    assert vcfbench.run_summaries(runs) == summaries
    assert vcfbench.run_summaries(runs, dut="G-2") == summaries[1:2]
    index = RunIndex(runs)
    assert index.refresh().read == 0  # it is whole again


def test_an_index_of_another_directory_is_not_believed(runs: Path, tmp_path: Path) -> None:
    beside(runs)
    moved = tmp_path / "moved"
    shutil.copytree(runs, moved)
    change(moved / NAMES[0], metadata={"dut": "G-5"})
    assert [each.dut for each in vcfbench.run_summaries(moved)] == ["G-5", "G-2", "G-3"]


def test_the_command_makes_and_asks_the_index(runs: Path, tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "runs", "index"], tmp_path)
    assert done.stdout == "runs/index.sqlite: 3 records, 3 read, 0 gone\n"
    assert json.loads(warm.run(["vcfbench", "runs", "index", "--json"], tmp_path).stdout)["read"] == 0
    listed = json.loads(warm.run(["vcfbench", "runs", "list", "--json", "--dut", "G-2"], tmp_path).stdout)["runs"]
    assert [each["run"] for each in listed] == [NAMES[1]]
    beside_it = runs / BESIDE
    no_database(beside_it)
    again = warm.run(["vcfbench", "runs", "index"], tmp_path)
    assert (again.returncode, again.stdout) == (0, done.stdout)
    assert "runs/index.sqlite was made again: file is not a database" in again.stderr
    missing = warm.run(["vcfbench", "runs", "index", "--runs", "nowhere"], tmp_path)
    assert (missing.returncode, "there are no records" in missing.stderr) == (2, True)
