from __future__ import annotations

import os
import re
from contextlib import nullcontext
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.records import directory
from vcfbench.records.directory import create_run, find_run, list_runs
from vcfbench.records.journal import Journal

if TYPE_CHECKING:
    from pathlib import Path


def test_a_run_is_named_by_start_procedure_and_six_digits(tmp_path: Path) -> None:
    run = create_run(tmp_path / "deep" / "runs", "virtual-coriolis")
    assert re.fullmatch(r"\d{8}T\d{6}Z-virtual-coriolis-[0-9a-f]{6}", run.run)
    assert run.path.is_dir()


def test_two_runs_in_one_second_have_two_directories(tmp_path: Path) -> None:
    assert len({create_run(tmp_path, "turntable").path for _ in range(20)}) == 20


def test_runs_are_found_by_any_unambiguous_end(tmp_path: Path) -> None:
    for name in ("20260821T142530Z-turntable-0a1b2c", "20260822T142530Z-turntable-ffffff"):
        (tmp_path / name).mkdir()
        Journal(tmp_path / name / "journal.jsonl").close()
    assert [run.run[-6:] for run in list_runs(tmp_path)] == ["0a1b2c", "ffffff"]
    assert find_run(tmp_path, "0a1b2c").run.startswith("20260821")
    assert find_run(tmp_path, "last").run.endswith("ffffff")
    with pytest.raises(ConfigError, match="2 runs are called '202608'"):
        find_run(tmp_path, "202608")
    with pytest.raises(ConfigError, match="there is no run 'nope'"):
        find_run(tmp_path, "nope")


def test_no_directory_is_no_runs(tmp_path: Path) -> None:
    assert list_runs(tmp_path / "none") == ()


def test_a_place_where_nothing_can_be_kept_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="no record can be written there"):
        create_run(tmp_path / "file", "turntable")


def test_runs_of_one_second_are_listed_by_their_end(tmp_path: Path) -> None:
    names = [f"20260821T142530Z-turntable-{digits}" for digits in ("ffffff", "000000", "888888")]
    for number, name in enumerate(names):
        (tmp_path / name).mkdir()
        journal = tmp_path / name / "journal.jsonl"
        journal.touch()
        os.utime(journal, ns=(0, number))
    assert [run.run for run in list_runs(tmp_path)] == names


def begun(runs: Path, name: str, utc: str) -> None:
    (runs / name).mkdir()
    (runs / name / "journal.jsonl").write_text(f'{{"type":"header","format":1,"utc":"{utc}"}}\n')


def test_runs_are_listed_by_their_headers_whatever_they_are_called(tmp_path: Path) -> None:
    begun(tmp_path, "20260821T142530Z-turntable-renamed", "2024-01-01T00:00:00+00:00")
    begun(tmp_path, "first", "2023-01-01T00:00:00.5+00:00")
    begun(tmp_path, "20200101T000000Z-turntable-000000", "not a time")
    assert [run.run for run in list_runs(tmp_path)] == [
        "20200101T000000Z-turntable-000000",
        "first",
        "20260821T142530Z-turntable-renamed",
    ]
    assert find_run(tmp_path, "last").run.endswith("renamed")


def test_last_run_is_refused_after_clock_was_set_back(tmp_path: Path) -> None:
    begun(tmp_path, "before", "2999-01-01T00:00:00+00:00")
    begun(tmp_path, "after", "2024-01-01T00:00:00+00:00")
    with pytest.raises(ConfigError, match="before began at 2999-01-01 00:00:00 UTC, which is in the future"):
        find_run(tmp_path, "last")
    assert find_run(tmp_path, "after").run == "after"


def test_run_that_may_not_be_read_is_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = tmp_path / "20260821T142530Z-turntable-0a1b2c"
    for each in (closed, tmp_path / "lost+found"):
        each.mkdir()
    stat = os.stat

    def refused(path: Any, *arguments: Any, **keywords: Any) -> os.stat_result:
        if "journal" in str(path):
            raise PermissionError(13, "Permission denied", str(path))
        return stat(path, *arguments, **keywords)

    monkeypatch.setattr(os, "stat", refused)
    assert [each.run for each in list_runs(tmp_path)] == [closed.name]
    for name in ("0a1b2c", closed.name, "last"):
        assert find_run(tmp_path, name).path == closed


def test_runs_that_may_not_be_listed_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(path: object) -> object:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "scandir", refused)
    with pytest.raises(ConfigError, match="cannot be listed: Permission denied"):
        list_runs(tmp_path)


def test_no_name_is_no_run(tmp_path: Path) -> None:
    begun(tmp_path, "only", "2024-01-01T00:00:00+00:00")
    with pytest.raises(ConfigError, match=r"or .last.$"):
        find_run(tmp_path, "")


def test_unwritable_disk_is_found_at_once_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("vcfbench.records.directory.os.fsync", full)
    with pytest.raises(ConfigError, match="no record can be written there: No space left on device"):
        create_run(tmp_path / "runs", "turntable")
    assert list((tmp_path / "runs").iterdir()) == []


def test_only_directory_without_record_is_removed(tmp_path: Path) -> None:
    empty, kept = create_run(tmp_path, "turntable"), create_run(tmp_path, "turntable")
    Journal(kept.journal).close()
    empty.discard()
    kept.discard()
    assert list(tmp_path.iterdir()) == [kept.path]


def test_a_run_that_is_named_is_found_without_reading_any(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("20260101T000000Z-zero-000001", "20260102T000000Z-zero-000002"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "journal.jsonl").write_text("")
    monkeypatch.setattr(directory, "read_header", None)
    for name in ("20260102T000000Z-zero-000002", "20260102", "000002"):
        assert find_run(tmp_path, name).run == "20260102T000000Z-zero-000002"


@pytest.mark.parametrize("set_back_s", [30.0, 120.0])
def test_run_after_one_of_the_future_is_refused(
    set_back_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pass under a clock two days ahead would count after the failure of the day after."""
    newest, now = create_run(tmp_path, "turntable"), utc_now() - timedelta(seconds=set_back_s)
    (tmp_path / "20991231-notes").mkdir()
    monkeypatch.setattr(directory, "utc_now", lambda: now)
    refused = pytest.raises(ConfigError, match=f"{newest.run} began in the future")
    with refused if set_back_s > 60.0 else nullcontext():
        create_run(tmp_path, "turntable")
