"""Summaries that are kept beside the records are never told of a record that is another by now."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

import vcfbench
from tests.seals import another, sealed
from vcfbench.archive import summary
from vcfbench.archive.amending import amend_run

if TYPE_CHECKING:
    from collections.abc import Callable

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
NAMES = ("20260101T000000Z-turntable-000001", "20260115T100000Z-turntable-000002", "20260116T000000Z-turntable-000003")

needs_change_times = pytest.mark.skipif(os.name == "nt", reason="nothing is kept there")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    told = {"dut": "G-1", "tags": {"batch": "7"}}
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path_factory.mktemp("kept"), metadata=told)
    assert run.directory is not None
    return run.directory


@pytest.fixture
def runs(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a directory of three records whose summaries are kept."""
    monkeypatch.setattr(summary, "_WORTH_KEEPING", 1)
    monkeypatch.setattr(summary, "_SETTLED_NS", -1_000_000_000)
    for name in NAMES:
        another(made, tmp_path / "runs" / name)
    vcfbench.run_summaries(tmp_path / "runs")
    assert (tmp_path / "runs" / ".summaries").is_file() is (os.name != "nt")
    return tmp_path / "runs"


def in_place(path: Path, old: bytes, new: bytes) -> None:
    """Change a file such that size, number and time stay as they were."""
    before, data = path.stat(), path.read_bytes()
    assert len(old) == len(new)
    assert old in data
    path.write_bytes(sealed(data.replace(old, new)) if path.suffix == ".jsonl" else data.replace(old, new))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def tampered(runs: Path) -> None:
    journal = runs / NAMES[0] / "journal.jsonl"
    before, data = journal.stat(), bytearray(journal.read_bytes())
    data[len(data) // 2] ^= 1
    journal.write_bytes(data)
    os.utime(journal, ns=(before.st_atime_ns, before.st_mtime_ns))


def amended(runs: Path) -> None:
    amend_run(runs / NAMES[1], {"dut": "G-9"}, reason="misread", by="A. Person")


def swapped(runs: Path) -> None:
    in_place(runs / NAMES[0] / "journal.jsonl", b'"dut":"G-1"', b'"dut":"G-8"')
    vcfbench.run_summaries(runs)
    (runs / NAMES[0]).rename(runs / "aside")
    (runs / NAMES[1]).rename(runs / NAMES[0])
    (runs / "aside").rename(runs / NAMES[1])


CHANGES: dict[str, Callable[[Path], object]] = {
    "nothing": lambda _: None,
    "another device": lambda runs: in_place(runs / NAMES[0] / "journal.jsonl", b'"dut":"G-1"', b'"dut":"G-8"'),
    "a byte amid the readings": tampered,
    "another result": lambda runs: in_place(runs / NAMES[0] / "result.json", b'"name": "bias"', b'"name": "bais"'),
    "no result": lambda runs: (runs / NAMES[0] / "result.json").unlink(),
    "no record": lambda runs: shutil.rmtree(runs / NAMES[0]),
    "one more": lambda runs: another(runs / NAMES[0], runs / NAMES[0].replace("000001", "000009")),
    "amended": amended,
    "swapped": swapped,
    "the file is gone": lambda runs: (runs / ".summaries").unlink(missing_ok=True),
    "the file is cut": lambda runs: (runs / ".summaries").write_bytes((runs / ".summaries").read_bytes()[:-9]),
    "the file is another": lambda runs: (runs / ".summaries").write_bytes(b"\x93" * 100),
}


@needs_change_times
@pytest.mark.parametrize("change", few(CHANGES.values(), every=4), ids=CHANGES)
def test_a_list_is_that_of_the_records_whatever_was_changed(change: Callable[[Path], object], runs: Path) -> None:
    change(runs)
    found = vcfbench.run_summaries(runs)
    plain = sorted(map(summary.summary_of, summary.recorded_runs(runs)), key=lambda each: (each.started, each.run))
    assert list(found) == plain
    assert [each.as_json() for each in found] == [each.as_json() for each in plain]


@needs_change_times
def test_no_record_is_read_of_which_a_summary_is_kept(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = vcfbench.run_summaries(runs)
    monkeypatch.setattr(summary, "outline_of", None)
    moved = runs.rename(runs.with_name("moved"))
    assert [each.run for each in vcfbench.run_summaries(moved)] == [each.run for each in before]
    assert vcfbench.run_summaries(moved)[0].directory == moved / NAMES[0]


def test_file_changed_a_moment_ago_is_read_again(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second change within a tick of the file system's clock would look like the first."""
    monkeypatch.setattr(summary, "_SETTLED_NS", 2_000_000_000)
    (runs / ".summaries").unlink(missing_ok=True)
    vcfbench.run_summaries(runs)
    monkeypatch.setattr(summary, "outline_of", None)
    with pytest.raises(TypeError):
        vcfbench.run_summaries(runs)


def test_what_another_version_kept_is_read_again(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(summary, "EVALUATION", -1)
    monkeypatch.setattr(summary, "outline_of", None)
    with pytest.raises(TypeError):
        vcfbench.run_summaries(runs)


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize("make", [Path.mkdir, pytest.param(a_pipe, marks=needs_change_times)])
def test_a_folder_of_another_is_listed_too(make: Callable[[Path], None], runs: Path) -> None:
    (runs / ".summaries").unlink(missing_ok=True)
    make(runs / ".summaries")
    assert [each.run for each in vcfbench.run_summaries(runs)] == list(NAMES)
    assert sorted(each.name for each in runs.iterdir()) == [".summaries", *NAMES]
