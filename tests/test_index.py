"""The index of runs says what the records say, on SQLite and on PostgreSQL, whatever becomes of either."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests import warm
from tests.postgresql import database
from tests.seals import sealed
from tests.test_run_summaries import NAMES, QUICK, TOLD, change
from vcfbench.archive.index import BESIDE, RunIndex
from vcfbench.archive.summary import selection_of
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytest.importorskip("sqlalchemy")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path_factory.mktemp("index"), metadata=TOLD)
    assert run.directory is not None
    return run.directory


@pytest.fixture(scope="module")
def postgresql() -> Iterator[str]:
    with database() as url:
        yield url


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "postgresql":
        return str(request.getfixturevalue("postgresql"))
    return f"sqlite:///{tmp_path / 'named.sqlite'}"


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


def test_the_index_answers_as_the_records_do(runs: Path, url: str) -> None:
    """Every selection, the first time and from what stands in the index."""
    for _ in range(2):
        for asked in ASKED:
            assert vcfbench.run_summaries(runs, **asked, index=url) == vcfbench.run_summaries(runs, **asked), asked


def test_only_what_changed_is_read_again(runs: Path, url: str) -> None:
    index = RunIndex(runs, url)
    assert index.refresh().read == 3
    assert index.refresh().read == 0
    change(runs / NAMES[1], metadata={"dut": "G-7"})
    shutil.rmtree(runs / NAMES[0])
    shutil.copytree(runs / NAMES[1], runs / "20260301T000000Z-turntable-00000a")
    done = index.refresh()
    assert (done.records, done.read, done.gone, done.made_again) == (3, 2, 1, None)
    assert index.select(selection_of()) == vcfbench.run_summaries(runs)
    assert len(index.select(selection_of(dut="G-7"))) == 2
    assert index.refresh(rebuild=True).read == 3
    assert index.select(selection_of()) == vcfbench.run_summaries(runs)
    index.close()


def test_a_change_that_keeps_size_and_time_is_seen(runs: Path, url: str) -> None:
    index = RunIndex(runs, url)
    index.refresh()
    journal = runs / NAMES[0] / "journal.jsonl"
    before = journal.stat()
    changed = journal.read_bytes().replace(b'"dut":"G-1"', b'"dut":"G-8"').replace(b'"G-1"', b'"G-8"')
    journal.write_bytes(sealed(changed))
    os.utime(journal, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert journal.stat().st_size == before.st_size
    assert index.refresh().read == 1
    assert [each.run for each in index.select(selection_of(dut="G-8"))] == [NAMES[0]]
    index.close()


def test_a_verdict_that_is_stored_later_is_seen(runs: Path, url: str) -> None:
    index = RunIndex(runs, url)
    index.refresh()
    stored = runs / NAMES[0] / "result.json"
    values = json.loads(stored.read_text())
    limit = {"key": "bias_v", "value": 0.0, "low": -1.0, "high": 1.0, "verdict": "pass"}
    stored.write_text(json.dumps({**values, "acceptance": {"verdict": "pass", "limits": [limit]}}))
    index.refresh()
    assert index.select(selection_of(dut="G-1"))[0].verdict == "pass"
    index.close()


def test_stations_share_one_index(runs: Path, made: Path, tmp_path: Path, url: str) -> None:
    other = tmp_path / "station-2"
    shutil.copytree(made, other / made.name)
    there = RunIndex(other, url)
    there.refresh()
    here = vcfbench.run_summaries(runs, index=url)
    assert [each.run for each in here] == list(NAMES)
    everywhere = vcfbench.run_summaries(runs, index=url, everywhere=True)
    assert {each.directory for each in everywhere} >= {other / made.name, *(each.directory for each in here)}
    here_again = RunIndex(runs, url)
    here_again.refresh(rebuild=True)  # leaves the other's alone
    assert there.select(selection_of()) == vcfbench.run_summaries(other)
    there.close()
    here_again.close()


def test_programs_that_write_at_the_same_time_take_turns(runs: Path, url: str) -> None:
    summaries = vcfbench.run_summaries(runs)

    def write(_: int) -> bool:
        index = RunIndex(runs, url)
        for again in range(4):
            index.refresh(rebuild=again % 2 == 0)
        found = index.select(selection_of())
        index.close()
        return found == summaries

    with ThreadPoolExecutor(3) as programs:
        assert list(programs.map(write, range(3))) == [True] * 3


def test_tables_of_another_version_are_not_believed(runs: Path, url: str) -> None:
    index = RunIndex(runs, url)
    index.refresh()
    with index._engine.begin() as connection:
        connection.exec_driver_sql("UPDATE vcfbench_index SET value = '0'")
    with pytest.raises(ConfigError, match="those of another version of vcfbench"):
        index.refresh()
    assert index.refresh(rebuild=True).made_again == "its tables are those of another version"
    with index._engine.begin() as connection:
        connection.exec_driver_sql("ALTER TABLE vcfbench_runs DROP COLUMN note")
    with pytest.raises(ConfigError, match="those of another version of vcfbench"):
        index.refresh()
    index.refresh(rebuild=True)
    assert index.select(selection_of()) == vcfbench.run_summaries(runs)
    index.close()


def beside(runs: Path) -> Path:
    index = RunIndex(runs)
    index.refresh()
    index.close()
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
        connection.execute("CREATE TABLE vcfbench_runs (run TEXT, dut TEXT)")
        connection.execute("INSERT INTO vcfbench_runs VALUES ('x', 'G-1')")
    connection.close()


def of_another_version(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE vcfbench_index SET value = '0'")
        connection.execute("UPDATE vcfbench_runs SET dut = 'G-9'")
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
    index.close()


def test_an_index_of_another_directory_is_not_believed(runs: Path, tmp_path: Path) -> None:
    beside(runs)
    moved = tmp_path / "moved"
    shutil.copytree(runs, moved)
    change(moved / NAMES[0], metadata={"dut": "G-5"})
    assert [each.dut for each in vcfbench.run_summaries(moved)] == ["G-5", "G-2", "G-3"]


def test_a_database_that_somebody_named_is_not_thrown_away(runs: Path, tmp_path: Path) -> None:
    precious = tmp_path / "thesis.txt"
    precious.write_bytes(b"words " * 1000)
    with pytest.raises(ConfigError, match="it is no database, or damaged"):
        vcfbench.run_summaries(runs, index=f"sqlite:///{precious}")
    assert precious.read_bytes() == b"words " * 1000


def test_without_the_extra_the_records_are_read(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beside(runs)
    change(runs / NAMES[0], metadata={"dut": "G-5"})
    monkeypatch.setitem(sys.modules, "sqlalchemy", None)
    assert [each.dut for each in vcfbench.run_summaries(runs)] == ["G-5", "G-2", "G-3"]
    with pytest.raises(ConfigError, match="an index of runs needs sqlalchemy") as refused:
        RunIndex(runs)
    assert refused.value.hint == "pip install 'vcfbench[index]'"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("nonsense", "--index: expected a URL"),
        ("mysql://a@b/c", "expected a URL of postgresql or sqlite, came one of mysql"),
        ("postgresql://u:secret@127.0.0.1:1/x", "index postgresql"),
        ("sqlite:////no/such/place/x.sqlite", "unable to open database file"),
    ],
)
def test_an_index_that_cannot_be_reached_is_said_without_its_password(wrong: str, words: str, runs: Path) -> None:
    with pytest.raises(ConfigError, match=words) as refused:
        vcfbench.run_summaries(runs, index=wrong)
    assert "secret" not in str(refused.value)


def test_everywhere_needs_an_index_that_is_shared(runs: Path) -> None:
    with pytest.raises(ConfigError, match="everywhere: expected an index that other stations share"):
        vcfbench.run_summaries(runs, everywhere=True)


def test_the_command_makes_and_asks_the_index(runs: Path, tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "runs", "index"], tmp_path)
    assert done.stdout == "sqlite:///runs/index.sqlite: 3 records, 3 read, 0 gone\n"
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
