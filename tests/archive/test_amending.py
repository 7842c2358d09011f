"""Records amended by lines of their own; runs that go on, and resumes that come in each other's way."""

from __future__ import annotations

import json
import shutil
import threading
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from vcfbench.archive.amending import amend_run
from vcfbench.archive.reported import full_report
from vcfbench.archive.summary import summary_of
from vcfbench.cli.main import app
from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.directory import RunDirectory
from vcfbench.records.journal import Journal, read_journal

if TYPE_CHECKING:
    from pathlib import Path

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
TOLD = {"dut": "G-017", "operator": "A. Person", "tags": {"batch": "7"}}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of a complete run."""
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path_factory.mktemp("runs"), metadata=TOLD)
    assert run.directory is not None
    return run.directory


@pytest.fixture
def record(whole: Path, tmp_path: Path) -> Path:
    return shutil.copytree(whole, tmp_path / "runs" / whole.name)


def call(*arguments: object) -> Any:
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.mark.parametrize("killed", few([False, True], every=2))
def test_amendment_is_visible_everywhere_and_keeps_earlier_lines(record: Path, *, killed: bool) -> None:
    journal = record / "journal.jsonl"
    if killed:
        data = journal.read_bytes()
        journal.write_bytes(data[: data.rindex(b"\n", 0, -1) + 1])
    before = journal.read_bytes()
    done = call("runs", "amend", record, "--set", "dut=G-018", "--set", "tags.batch=", "--reason", "label", "--by", "B")
    assert done.exit_code == 0, done.output
    assert journal.read_bytes().startswith(before)
    run, summary = vcfbench.load_run(record), summary_of(RunDirectory(record))
    assert (run.damage, run.metadata.dut, dict(run.metadata.tags), run.revision) == (None, "G-018", {}, 2)
    assert (summary.dut, summary.tags, summary.revision, summary.amended) == ("G-018", {}, 2, ("dut", "tags.batch"))
    assert summary.status == ("incomplete" if killed else "complete")
    [amendment] = run.amendments
    said = [(each.field, each.was, each.now) for each in amendment.changes]
    assert (amendment.by, amendment.reason) == ("B", "label")
    assert said == [("dut", "G-017", "G-018"), ("tags.batch", "7", None)]
    assert "dut G-017 -> G-018" in call("runs", "show", record.name, "--runs", record.parent).stdout
    assert "G-018 (amended)" in call("runs", "list", "--runs", record.parent).stdout
    assert [each.run for each in vcfbench.run_summaries(record.parent, dut="G-018")] == [record.name]


def test_a_check_is_of_its_revision(record: Path) -> None:
    amend_run(record, {"checked_by": "B. Person"}, reason="read")
    checked = str(full_report(vcfbench.load_run(record)))
    assert "B. Person" in checked
    assert "is not checked" not in checked
    amend_run(record, {"customer": "ACME"}, reason="told later")
    run = vcfbench.load_run(record)
    assert run.metadata.tags == {"batch": "7", "customer": "ACME"}
    assert "revision 2; revision 3 is not checked" in str(full_report(run))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seed": "3"}, "seed: expected a field that a person gave"),
        ({"points": "[]"}, "points: expected a field that a person gave"),
        ({"ambient_temperature_c": "23"}, "ambient_temperature_c: expected a field that a person gave"),
        ({"dut": "a b"}, "dut: serial number 'a b'"),
        ({"dut": "G-017"}, "dut: it is G-017 already"),
        ({}, "name a field to amend"),
    ],
)
def test_what_cannot_be_amended_is_refused_by_name(changes: dict[str, str], words: str, record: Path) -> None:
    before = (record / "journal.jsonl").read_bytes()
    with pytest.raises(ConfigError, match=words):
        amend_run(record, changes, reason="label")
    assert (record / "journal.jsonl").read_bytes() == before


def test_an_amended_record_goes_on_under_its_new_name(record: Path) -> None:
    journal = record / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[: len(lines) // 2]))
    amend_run(record, {"dut": "G-018"}, reason="label")
    run = vcfbench.resume(record)
    assert (run.status, run.metadata.dut) == ("complete", "G-018")
    assert run.header["resumed_from"]["seal"] == read_journal(journal).seal


def test_running_run_is_neither_resumed_nor_amended(record: Path) -> None:
    lines = (record / "journal.jsonl").read_bytes().splitlines()
    header = {key: value for key, value in json.loads(lines[0]).items() if key not in {"type", "format", "utc", "seal"}}
    (record / "journal.jsonl").unlink()
    journal = Journal(record / "journal.jsonl")
    journal.header(header)
    try:
        assert (vcfbench.load_run(record).status, summary_of(RunDirectory(record)).status) == ("running", "running")
        assert [each.run for each in vcfbench.run_summaries(record.parent, status="running")] == [record.name]
        with pytest.raises(ConfigError, match="is still running: resume it after its end"):
            vcfbench.resume(record)
        with pytest.raises(BenchError, match="is being written: its run goes on"):
            amend_run(record, {"dut": "G-018"}, reason="label")
    finally:
        journal.close()
    assert summary_of(RunDirectory(record)).status == "incomplete"


def test_list_shows_run_killed_after_last_list(record: Path) -> None:
    kept = (record / "journal.jsonl").read_bytes()
    (record / "journal.jsonl").unlink()
    journal = Journal(record / "journal.jsonl")
    (record / "journal.jsonl").write_bytes(b"".join(kept.splitlines(keepends=True)[:5]))
    assert [each.status for each in vcfbench.run_summaries(record.parent)] == ["running"]
    journal.close()  # as by a kill: size and time of the file stay
    assert [each.status for each in vcfbench.run_summaries(record.parent)] == ["incomplete"]


def test_two_resumes_of_one_record_at_once_are_refused(record: Path) -> None:
    journal = record / "journal.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:20]))
    second: list[BenchError] = []

    class Second:
        def handle(self, _: object) -> None:
            if not second:
                with pytest.raises(ConfigError, match="is being resumed already") as refused:
                    vcfbench.resume(record)
                second.append(refused.value)

    first = threading.Thread(target=lambda: vcfbench.resume(record, observers=[Second()]))
    first.start()
    first.join()
    assert len(second) == 1
    assert vcfbench.resume(record).status == "complete"  # later it may be


def test_same_person_checks_a_later_revision_but_no_revision_twice(record: Path) -> None:
    amend_run(record, {"checked_by": "B. Person"}, reason="read")
    with pytest.raises(ConfigError, match=r"checked_by: it is B\. Person already"):
        amend_run(record, {"checked_by": "B. Person"}, reason="read")
    amend_run(record, {"customer": "ACME"}, reason="told later")
    amend_run(record, {"checked_by": "B. Person"}, reason="read again")
    text = str(full_report(vcfbench.load_run(record)))
    assert "revision 4" in text
    assert "is not checked" not in text
    with pytest.raises(ConfigError, match="already"):
        amend_run(record, {"checked_by": "B. Person"}, reason="read")
