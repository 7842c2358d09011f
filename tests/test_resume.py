"""Runs that were broken off are taken up again on simulated benches, from Python and by the command."""

from __future__ import annotations

import json
import os
import shutil
import signal
from datetime import datetime, timedelta
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from tests import warm
from tests.seals import sealed
from vcfbench.archive.keeping import keep_of_device
from vcfbench.archive.run import breaks
from vcfbench.cli.main import app
from vcfbench.clock import utc_now
from vcfbench.errors import Aborted, BenchError, ConfigError, MeasurementError, PlanError
from vcfbench.records.journal import read_journal
from vcfbench.runs.request import Request
from vcfbench.runs.resumed import Resumed, broken_off
from vcfbench.station.writing import bench_text

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path_factory.mktemp("whole"))


def cut(
    run: Run, runs: Path, points: int, name: str = "20260821T142530Z-turntable-0a1b2c", mark: bytes = b'"point":'
) -> Path:
    """Return a record of `run` that ends in the middle of a line, after so many points; `mark` is in their lines."""
    assert run.directory is not None
    lines = (run.directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    number = [place for place, line in enumerate(lines, 1) if mark in line][points - 1] if points else 3
    directory = runs / name
    directory.mkdir(parents=True)
    (directory / "journal.jsonl").write_bytes(b"".join(lines[:number]) + lines[number][:40])
    return directory


def shift(directory: Path, change: Any) -> None:
    """Change the header of a record."""
    journal = directory / "journal.jsonl"
    header, *rest = journal.read_bytes().splitlines(keepends=True)
    values = json.loads(header)
    change(values)
    journal.write_bytes(sealed(json.dumps(values).encode() + b"\n" + b"".join(rest)))


@pytest.mark.parametrize("points", few([0, 1, 3], every=3))
def test_new_record_is_complete_and_marks_copied_steps(whole: Run, points: int, tmp_path: Path) -> None:
    directory = cut(whole, tmp_path, points)
    before = (directory / "journal.jsonl").read_bytes()
    run = vcfbench.resume(directory.name[:12], runs=tmp_path)
    assert run.status == "complete"
    assert (directory / "journal.jsonl").read_bytes() == before
    assert [point.rate_deg_s for point in run.points] == [10.0, 0.0, -10.0]
    assert [point.output_v for point in run.points] == pytest.approx([each.output_v for each in whole.points], abs=1e-9)
    shutil.rmtree(directory)
    assert run.name is not None
    loaded = vcfbench.load_run(run.name, tmp_path)
    assert loaded.results == run.results
    assert loaded.resumed == run.resumed
    (said,) = run.resumed
    assert said.startswith(f"of 3 points {points} were measured before the break of ")
    assert f"in {directory.name};" in said
    assert said.endswith("the simulated world began anew")
    assert f"resumed: {said}" in " ".join(vcfbench.text_of(loaded.report()).split())
    assert run.as_json()["resumed"] == [said]
    resumed_from = run.header["resumed_from"]
    assert (resumed_from["run"], resumed_from["points"], resumed_from["status"]) == (
        directory.name,
        points,
        "incomplete",
    )
    record = read_journal(run.directory / "journal.jsonl") if run.directory else None
    assert record is not None
    assert record.damage is None
    marks = [line.get("taken_over") for line in record.steps]
    assert marks == [directory.name] * resumed_from["steps"] + [None] * (len(marks) - resumed_from["steps"])
    assert len({line["n"] for line in record.steps}) == len(record.steps)


def test_bench_time_goes_on_and_readings_with_it(whole: Run, tmp_path: Path) -> None:
    run = vcfbench.resume(cut(whole, tmp_path, 2))
    times = [each.t_s for each in run.readings]
    assert times == sorted(times)
    assert len(times) == 5 * 3
    assert times[: 2 * 3] == [each.t_s for each in whole.readings][: 2 * 3]
    assert run.bench_seconds is not None
    assert whole.bench_seconds is not None
    assert run.bench_seconds > whole.bench_seconds


def test_break_on_real_bench_has_its_length(whole: Run, tmp_path: Path) -> None:
    def real(header: dict[str, Any]) -> None:
        header["bench"]["simulation"] = None
        header.update(seed=None, simulated=False)

    directory = cut(whole, tmp_path, 2)
    shift(directory, real)
    broken = broken_off(directory)
    prepared = Resumed(broken, Request(broken.procedure))
    prepared.make_ready()
    last = max(broken.record.steps, key=lambda line: line["n"])
    then = last["end_s"] + broken.record.header["began_s"]
    gone_s = utc_now() - datetime.fromisoformat(last["utc"])
    now_s = prepared.now_s()
    assert now_s is not None
    assert timedelta(0) <= timedelta(seconds=now_s - then) - gone_s < timedelta(seconds=5)


def test_a_run_without_points_says_how_many_records_were_taken() -> None:
    instants = {"ended_utc": "2026-08-21T14:25:30.1+00:00", "resumed_utc": "2026-08-22T08:00:00.2+00:00"}
    settings = {"run": "a", "measurements": 12, "points": 0, **instants}
    (said,) = breaks({"resumed_from": settings}, 0)
    before, after = said.split("; ")
    assert before == "12 records were taken before the break of 2026-08-21 14:25:30 UTC, in a"
    assert after == "the bench was started up again at 2026-08-22 08:00:00 UTC"
    assert breaks({}, 3) == ()
    served = {"resumed_from": settings, "simulated": True, "bench": {"served": {"control": "127.0.0.1:5000"}}}
    assert breaks(served, 0) == (said,)


@pytest.mark.exhaustive
def test_a_resumed_run_is_resumed_again(whole: Run, tmp_path: Path) -> None:
    once = vcfbench.resume(cut(whole, tmp_path, 1))
    twice = vcfbench.resume(cut(once, tmp_path, 2, "20260821T150000Z-turntable-0a1b2d"))
    assert [point.output_v for point in twice.points] == pytest.approx(
        [each.output_v for each in whole.points], abs=1e-9
    )
    assert [said[:37] for said in twice.resumed] == [f"of 3 points {n} were measured before the"[:37] for n in (1, 2)]


def test_what_cannot_be_resumed_is_said_before_anything_is_opened(whole: Run, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="complete: there is nothing to resume"):
        vcfbench.resume(whole)
    other = structs.replace(vcfbench.load_bench("ideal"), name="another")
    with pytest.raises(ConfigError, match="name was 'ideal', is 'another'"):
        vcfbench.resume(cut(whole, tmp_path, 1), other)
    assert len(list(tmp_path.iterdir())) == 1  # nothing was recorded
    slower = structs.replace(other, limits=structs.replace(other.limits, max_rate_deg_s=250.0), name="ideal")
    with pytest.raises(ConfigError, match=r"limits\.max_rate_deg_s was 300"):
        vcfbench.resume(tmp_path / "20260821T142530Z-turntable-0a1b2c", slower)
    (tmp_path / "20260821T142530Z-turntable-0a1b2c" / "journal.jsonl").write_bytes(b"")
    with pytest.raises(ConfigError, match="no whole line"):
        vcfbench.resume("last", runs=tmp_path)


@pytest.mark.parametrize("change", [{"began_s": "x"}, {"began_s": []}, {"settings": {}}])
def test_a_header_that_no_run_wrote_is_one_sentence(change: dict[str, Any], whole: Run, tmp_path: Path) -> None:
    directory = cut(whole, tmp_path, 1)
    shift(directory, lambda header: header.update(change))
    with pytest.raises(ConfigError, match=r"no record of this program|this version cannot read"):
        vcfbench.resume(directory)


def test_the_bench_may_answer_elsewhere(whole: Run, tmp_path: Path) -> None:
    bench = vcfbench.load_bench("ideal")
    assert bench.multimeter is not None
    moved = structs.replace(bench, multimeter=structs.replace(bench.multimeter, resource="GPIB0::23::INSTR"))
    (tmp_path / "moved.toml").write_text(bench_text(moved), encoding="utf-8")
    assert vcfbench.resume(cut(whole, tmp_path, 2), tmp_path / "moved.toml").status == "complete"


def test_changed_settings_are_found_at_first_different_step(whole: Run, tmp_path: Path) -> None:
    def slower(header: dict[str, Any]) -> None:
        header["settings"]["acceleration_deg_s2"] = 20.0

    directory = cut(whole, tmp_path, 2)
    shift(directory, slower)
    with pytest.raises(PlanError, match=r"step \d+ of the record is \(table to \+10 deg/s at 100 deg/s\^2\), the plan"):
        vcfbench.resume(directory)


def test_a_step_that_was_changed_is_refused(whole: Run, tmp_path: Path) -> None:
    """With its key left as it was it was sent to the table."""
    directory = cut(whole, tmp_path, 2)
    journal = directory / "journal.jsonl"
    journal.write_bytes(sealed(journal.read_bytes().replace(b'"rate_deg_s":10.0', b'"rate_deg_s":800.0', 1)))
    with pytest.raises(PlanError, match=r"step \d+ of the record was changed: it says .*800\.0.*, its key is .*10\.0"):
        vcfbench.resume(directory)


def test_other_instruments_are_refused_and_nothing_is_recorded(whole: Run, tmp_path: Path) -> None:
    def swapped(header: dict[str, Any]) -> None:
        header["identities"]["multimeter"]["serial"] = "MY41000001"

    directory = cut(whole, tmp_path, 2)
    shift(directory, swapped)
    with pytest.raises(ConfigError, match=r"another multimeter is on the bench: .*; the record has .*MY41000001"):
        vcfbench.resume(directory)
    assert list(tmp_path.iterdir()) == [directory]


def test_a_warm_up_is_in_one_piece(whole: Run, tmp_path: Path) -> None:
    directory = cut(whole, tmp_path, 1)
    shift(directory, lambda header: header.update(procedure="warmup"))
    with pytest.raises(ConfigError, match="cannot be resumed: a warm-up begins with power-on"):
        vcfbench.resume(directory)


OWN = '''
"""Two windows at rest; the second fails as often as the file beside it says."""
from pathlib import Path
from vcfbench import Note, Procedure, ProcedureSettings, Step, energised, take
from vcfbench.errors import MeasurementError
from vcfbench.steps.step import Effect
from vcfbench.steps import Done
from dataclasses import dataclass
from typing import ClassVar

LEFT = Path(__file__).with_suffix(".txt")

@dataclass(frozen=True, slots=True)
class Shaky(Step):
    effect: ClassVar[Effect] = Effect.SETS
    subject: ClassVar[str] = "nerves"

    def describe(self): return "be steady"

    def predict(self, gyro): return Done()

    def perform(self, context):
        left = int(LEFT.read_text())
        LEFT.write_text(str(left - 1))
        if left == 0:
            raise MeasurementError("it trembles")
        return Done()

def work(settings):
    yield Shaky()
    for _ in range(3):
        yield from take(settings, 1, rate_deg_s=0.0, v_vc_v=0.0)
    yield Shaky()
    yield from take(settings, 1, rate_deg_s=0.0, v_vc_v=0.0)

SHAKY = Procedure(name="shaky", title="shaky", settings=ProcedureSettings,
    plan=lambda settings: energised(settings, work(settings)), results=lambda settings, points: {}, uses={})
'''


@pytest.mark.exhaustive
def test_fault_in_the_new_start_ends_safe_and_resumable(tmp_path: Path) -> None:
    """The file is one's own: where it stands is in the record, and a change of it is found."""
    file, left = tmp_path / "shaky.py", tmp_path / "shaky.txt"
    file.write_text(OWN, encoding="utf-8")
    left.write_text("1")
    with pytest.raises(MeasurementError, match="it trembles") as failed:
        vcfbench.run(file, "ideal", settings={"samples": 3}, runs=tmp_path / "runs")
    left.write_text("0")
    with pytest.raises(ConfigError, match=r"the program .*shaky.py \(SHA-256 \w{64}\): it runs only after you"):
        vcfbench.resume(failed.value.run)
    assert left.read_text() == "0"
    with pytest.raises(MeasurementError, match="it trembles") as again:
        vcfbench.resume(failed.value.run, trust=True)
    assert again.value.step == "starting up again (be steady)"
    assert again.value.run.directory is not None
    record = read_journal(again.value.run.directory / "journal.jsonl")
    assert record.footer is not None
    assert record.footer["status"] == "aborted"
    assert all(each["safe"] for each in record.footer["safe"])
    assert len(record.points) == 3
    left.write_text("9")
    run = vcfbench.resume(again.value.run, trust=True)
    assert (run.status, len(run.points), len(run.resumed)) == ("complete", 4, 2)
    assert failed.value.run.directory is not None
    left.write_text("7")
    asked = CliRunner().invoke(app, ["resume", str(failed.value.run.directory), "--quiet"])
    assert asked.exit_code == ConfigError.exit_code
    assert f"the program {file} (SHA-256 {sha256(OWN.encode()).hexdigest()}): it runs only" in asked.stderr
    assert left.read_text() == "7"
    assert CliRunner().invoke(app, ["resume", str(failed.value.run.directory), "--quiet", "--yes"]).exit_code == 0
    file.write_text(OWN + "\n# changed\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="was changed since"):
        vcfbench.resume(failed.value.run)
    assert vcfbench.resume(failed.value.run, procedure=file).status == "complete"


@pytest.mark.parametrize(
    ("key", "value"), [("identities", [1]), ("identities", {"power": 3}), ("resumed_from", {"before": 3})]
)
def test_a_header_of_another_shape_is_one_sentence(whole: Run, tmp_path: Path, key: str, value: Any) -> None:
    broken = cut(whole, tmp_path, 2)
    header, *rest = (broken / "journal.jsonl").read_bytes().splitlines(keepends=True)
    changed = json.dumps(json.loads(header) | {key: value}).encode() + b"\n"
    (broken / "journal.jsonl").write_bytes(sealed(b"".join([changed, *rest])))
    with pytest.raises(ConfigError, match=rf"{key}: expected "):
        vcfbench.resume(broken)
    if key == "resumed_from":
        with pytest.raises(ConfigError, match=rf"{key}: expected "):
            vcfbench.load_run(broken)


def test_other_versions_are_said(whole: Run, tmp_path: Path) -> None:
    broken = cut(whole, tmp_path, 2)
    journal = broken / "journal.jsonl"
    journal.write_bytes(sealed(journal.read_bytes().replace(b'"vcfbench":"', b'"vcfbench":"0.0.1-', 1)))
    with pytest.warns(UserWarning, match=r"began with other versions: vcfbench 0\.0\.1-\S+, here \S+"):
        assert vcfbench.resume(broken).status == "complete"


@pytest.mark.exhaustive
def test_resumed_run_adds_one_device_entry(tmp_path: Path) -> None:
    devices = tmp_path / "devices"
    settings = {
        "cycles": 1,
        "samples": 4,
        "match_rates_deg_s": [50.0, 100.0, 200.0],
        "dut": "G-1",
        "devices": str(devices),
    }
    run = vcfbench.run("kvc", "lab", settings=settings, runs=tmp_path)
    directory = cut(run, tmp_path, 20, "20260821T142530Z-kvc-0a1b2c")
    shutil.rmtree(devices)
    resumed = vcfbench.resume(directory)
    assert [resumed.device_entry] == [entry.path for entry in vcfbench.load_device("G-1", devices).entries]
    assert resumed.results.k_vc.value == pytest.approx(run.results.k_vc.value, rel=1e-3)
    _what_could_not_be_kept_is_kept_later(resumed, devices)
    for of_another in ({"dut": "g-1"}, {"devices": __file__}):  # known before anything is opened
        with pytest.raises(ConfigError, match=r"differs in case alone|expected a directory of devices"):
            vcfbench.run("kvc", "lab", settings={**settings, **of_another}, runs=tmp_path / "never")
    with pytest.raises(ConfigError, match="differs in case alone"):
        vcfbench.run("zero", "ideal", settings={"dut": "g-1", "devices": str(devices)}, runs=tmp_path / "never")
    assert not (tmp_path / "never").exists()


def _what_could_not_be_kept_is_kept_later(run: Run, devices: Path) -> None:
    (entry,) = vcfbench.load_device("G-1", devices).entries
    with pytest.raises(ConfigError, match=r"has already been added to the device history"):
        keep_of_device(run.directory, devices=devices)
    entry.path.unlink()
    added = CliRunner().invoke(app, ["device", "--add", str(run.directory), "--devices", str(devices)])
    assert (added.exit_code, added.stdout) == (0, f"{entry.path}\n"), added.output
    (again,) = vcfbench.load_device("G-1", devices).entries
    same = {name: getattr(entry.record, name) for name in ("issued", "valid_until", "u95_until")}
    assert structs.replace(again.record, **same) == entry.record
    assert abs(again.record.issued - entry.record.issued) < timedelta(minutes=5)


@pytest.mark.exhaustive
def test_unwritable_store_at_end_is_reported_with_cure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise ConfigError("devices/G-1: no entry can be kept there: No space left on device")

    monkeypatch.setattr("vcfbench.records.devices.DeviceStore.add", full)
    settings = {"rates_deg_s": (100.0, 0.0, -100.0), "samples": 2, "dut": "G-1", "devices": str(tmp_path / "devices")}
    settings |= {"k_vc": "150.0", "v_vc": "set", "cycles": 1}
    with pytest.raises(ConfigError, match=r"; the record has it: vcfbench device --add \S+ keeps it later") as failed:
        vcfbench.run("self-calibration", "ideal", settings=settings, runs=tmp_path / "runs")
    assert failed.value.run.status == "complete"
    with pytest.raises(ConfigError, match="no results for the device history"):
        keep_of_device(cut(failed.value.run, tmp_path, 1))


@pytest.mark.parametrize("when", few(["before", "after"], every=2))
def test_two_signals_within_line_leave_resumable_record(
    when: str, whole: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line is on the disk and counted, or neither: else the step would stand there twice."""
    write = os.write

    def stopped(descriptor: int, data: bytes) -> int:
        last = b'"point":' in data and b'"rate_deg_s":0.0' in data
        if last and when == "before":
            twice()
        written = write(descriptor, data)
        if last and when == "after":
            twice()
        return written

    with monkeypatch.context() as hurried:
        hurried.setattr(os, "write", stopped)
        with pytest.raises(Aborted) as failed:
            vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path)
    broken = failed.value.run
    record = read_journal(broken.directory / "journal.jsonl")
    assert (record.damage, record.status, len(record.points)) == (None, "aborted", 2)
    assert record.points == broken.points
    resumed = vcfbench.resume(broken)
    assert [point.rate_deg_s for point in resumed.points] == [point.rate_deg_s for point in whole.points]


def test_record_after_full_disk_is_resumed(whole: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The failure cannot be written when it comes, the way to rest can: the steps follow each other all the same."""
    write, refused = os.write, []

    def full(descriptor: int, data: bytes) -> int:
        if (b'"point":' in data and b'"rate_deg_s":0.0' in data) or 0 < len(refused) < 3:
            refused.append(data)
            return write(descriptor, data[: len(data) // 2])
        return write(descriptor, data)

    with monkeypatch.context() as filled:
        filled.setattr(os, "write", full)
        with pytest.raises(BenchError, match="cannot be written: the disk took") as failed:
            vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path)
    record = read_journal(failed.value.run.directory / "journal.jsonl")
    assert (record.damage, record.status, len(record.points)) == (None, "aborted", 1)
    assert [line["n"] for line in record.errors] == [record.errors[0]["n"], record.errors[0]["n"] + 1]
    resumed = vcfbench.resume(failed.value.run)
    assert [point.rate_deg_s for point in resumed.points] == [point.rate_deg_s for point in whole.points]


def twice() -> None:
    signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGTERM)


def test_two_signals_while_a_package_is_loaded_are_a_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is said of what could not be loaded then: exit code 4."""

    def stopped(_: object) -> type:
        twice()
        raise AssertionError

    monkeypatch.setattr("vcfbench.sim.simulation.twin_of", stopped)
    with pytest.raises(Aborted, match=r"^stopped by SIGTERM"):
        vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
def test_a_killed_run_is_resumed_by_the_command(tmp_path: Path) -> None:
    command = ["vcfbench", "run", "turntable", "--bench", "ideal", "--speed", "60"]
    for key, value in QUICK.items():
        command += ["--set", f"{key}={list(value) if isinstance(value, tuple) else value}"]
    with warm.running(command, tmp_path, errors=True) as child:
        next(line for line in child.stderr if "average" in line)
        child.kill()
        child.stderr.read()
    done = warm.run(["vcfbench", "resume", "last", "--json", "--quiet"], tmp_path)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert [point["rate_deg_s"] for point in answer["points"]] == [10.0, 0.0, -10.0]
    listed = json.loads(warm.run(["vcfbench", "runs", "list", "--json"], tmp_path).stdout)["runs"]
    assert [each["status"] for each in listed] == ["incomplete", "complete"]
    assert f"in {listed[0]['run']};" in answer["resumed"][0]
    again = warm.run(["vcfbench", "resume", "last"], tmp_path)
    assert again.returncode == 2
    assert "there is nothing to resume" in again.stderr
