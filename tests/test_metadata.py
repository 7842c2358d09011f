"""Device, operator, conditions and the equipment's dates: told to a run, in its record, in what it came to."""

from __future__ import annotations

import json
import time
from datetime import UTC, date, datetime, timedelta
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

import vcfbench
from tests import warm
from tests.cells import few
from vcfbench import clock
from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.runs.needs import with_ambient
from vcfbench.station.equipment import equipment_on, overdue_words
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
TOLD = {
    "dut": "G-0042",
    "note": "after the new solder",
    "tags": {"batch": "7", "wafer": "W3"},
    "ambient_temperature_c": 23.1,
    "humidity_percent": 41.0,
}
METER = 'model = "34401A"\n'
OVERDUE = METER + 'calibrated = 2019-01-15\ncalibration_due = 2020-01-15\ncertificate = "K-7"\n'


def bench_file(folder: Path, meter: str = OVERDUE) -> Path:
    path = folder / "station.toml"
    text = embedded_text("ideal").replace(METER, meter) + '\n[laboratory]\noperator = "A. Person"\n'
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("metadata")


@pytest.fixture(scope="module")
def run(place: Path) -> Run:
    with pytest.warns(
        UserWarning, match=r"multimeter \(34401A, GPIB0::22::INSTR\): its calibration was due 2020-01-15"
    ):
        return vcfbench.run("turntable", bench_file(place), settings=QUICK, runs=place / "runs", metadata=TOLD)


def test_a_run_says_what_it_was_told(run: Run) -> None:
    assert run.metadata == vcfbench.RunMetadata(operator="A. Person", **TOLD)  # type: ignore[arg-type]
    assert run.as_json()["metadata"] == {**TOLD, "operator": "A. Person"}


def test_a_run_names_its_equipment_and_marks_what_is_overdue(run: Run) -> None:
    found = {each.role: each for each in run.equipment}
    assert list(found) == ["power", "rate_source", "multimeter", "oscilloscope", "rate_table"]
    meter = found["multimeter"]
    assert (meter.calibrated, meter.calibration_due) == (date(2019, 1, 15), date(2020, 1, 15))
    assert (meter.certificate, meter.overdue, meter.serial_number) == ("K-7", True, None)  # it answers 0, which is none
    assert meter.identity is not None
    assert meter.identity.model == "34401A"
    assert found["rate_source"].serial_number == "MY44021876"
    assert [each.role for each in run.equipment if each.overdue] == ["multimeter"]


def test_all_of_it_is_in_the_record(run: Run) -> None:
    assert run.directory is not None
    again = vcfbench.load_run(run.directory)
    assert (again.metadata, again.equipment) == (run.metadata, run.equipment)
    assert again == run
    stored = json.loads((run.directory / "result.json").read_text(encoding="utf-8"))
    assert stored["metadata"] == run.metadata.as_json()
    assert "equipment" not in stored  # what is overdue goes by the day


def test_resume_keeps_what_the_run_was_told(run: Run, place: Path) -> None:
    assert run.directory is not None
    lines = (run.directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    cut = place / "runs" / "20260821T142530Z-turntable-0a1b2c"
    cut.mkdir()
    (cut / "journal.jsonl").write_bytes(b"".join(lines[:30]))
    recalibrated = bench_file(place, METER + "calibration_due = 2999-01-15\n")
    resumed = vcfbench.resume(cut, recalibrated)
    assert resumed.metadata == run.metadata
    assert not any(each.overdue for each in resumed.equipment)  # the bench is that of today


CHAMBER = """
[chamber]
model = "ATS-545"
resource = "GPIB0::18::INSTR"
[limits]
min_temperature_c = -40
max_temperature_c = 85
max_ramp_k_min = 60
"""


def test_the_chamber_tells_the_temperature_of_the_room(tmp_path: Path) -> None:
    path = bench_file(tmp_path, METER)
    path.write_text(path.read_text(encoding="utf-8").replace("[limits]\n", CHAMBER.lstrip()), encoding="utf-8")
    asked = {"ambient_from": "chamber", "humidity_percent": 41.0}
    run = vcfbench.run("turntable", path, settings=QUICK, runs=tmp_path, metadata=asked)
    room_c = run.metadata.ambient_temperature_c
    assert room_c is not None
    assert abs(room_c - 20.0) < 1.0  # that of the simulated room
    assert (run.metadata.ambient_from, run.header["metadata"]["ambient_temperature_c"]) == ("chamber", room_c)


def test_chamber_temperature_without_chamber_is_refused_before_opening(tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "run", "turntable", "--ambient-temperature-c", "chamber"], tmp_path)
    assert (done.returncode, "ambient_from: the chamber should read" in done.stderr) == (2, True)
    assert list(tmp_path.iterdir()) == []
    done = warm.run(["vcfbench", "run", "turntable", "--dry-run", "--ambient-temperature-c", "warm"], tmp_path)
    assert "--ambient-temperature-c warm: expected degC, as in 23.1, or chamber" in done.stderr


class Blowing:
    name, resource = "chamber", "GPIB0::18::INSTR"

    def flow_enabled(self) -> bool:
        return True


def test_air_that_flows_is_not_that_of_the_room() -> None:
    bench: Any = SimpleNamespace(chamber=Blowing())
    with pytest.raises(MeasurementError, match="air flows, so the chamber does not read the temperature of the room"):
        with_ambient(vcfbench.RunMetadata(ambient_from="chamber"), bench)
    by_hand = vcfbench.RunMetadata(ambient_from="chamber", ambient_temperature_c=22.0)  # as in the record of a resumed
    assert with_ambient(by_hand, bench) is by_hand


def test_two_devices_are_refused(place: Path) -> None:
    asked = {"metadata": {"dut": "G-1"}, "settings": {"dut": "G-2"}}
    with pytest.raises(ConfigError, match=r"dut: expected one device, got G-1, and G-2 in the settings"):
        vcfbench.dry_run("kvc", "lab", **asked)  # type: ignore[arg-type]
    assert not (place / "devices").exists()


@pytest.mark.parametrize(
    "asked", few([{"settings": {"dut": "G-1"}}, {"metadata": {"dut": "G-1"}}], {"metadata": {"dut": "G-1"}})
)
def test_the_device_of_the_settings_is_that_of_the_run(
    asked: dict[str, dict[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    quick = {**QUICK, "k_vc": "150", "virtual_rates_deg_s": [10.0, 20.0], "cycles": 1}
    settings = {**quick, **asked.get("settings", {})}
    run = vcfbench.run("self-calibration", "lab", settings=settings, metadata=asked.get("metadata"))
    assert run.metadata.dut == "G-1"
    assert run.header["settings"]["dut"] == "G-1"
    assert run.device_entry is not None
    assert run.device_entry.parent.name == "G-1"


def test_the_command_takes_all_of_it_and_warns(place: Path) -> None:
    command = ["vcfbench", "run", "turntable", "--bench", str(bench_file(place)), "--runs", "commanded", "--quiet"]
    quick = ["--set", "rates_deg_s=10,0,-10", "--set", "samples=3", "--set", "settle_s=0.5"]
    options = ["--dut", "G-7", "--operator", "B. Person", "--note", "n", "--tag", "batch=7", "--tag", "wafer=W3"]
    room = ["--ambient-temperature-c", "22.5", "--humidity-percent", "40"]
    done = warm.run([*command, *quick, *options, *room, "--json"], place)
    said = {"dut": "G-7", "operator": "B. Person", "note": "n", "tags": {"batch": "7", "wafer": "W3"}}
    answer = json.loads(done.stdout)
    assert answer["metadata"] == {**said, "ambient_temperature_c": 22.5, "humidity_percent": 40.0}
    assert "vcfbench: warning: multimeter (34401A, GPIB0::22::INSTR): its calibration was due 2020-01-15" in done.stderr
    shown = warm.run(["vcfbench", "runs", "show", "last", "--runs", "commanded"], place).stdout
    assert "device G-7, operator B. Person, 22.5 degC, 40 % relative humidity, batch=7, wafer=W3\n" in shown
    assert "\nnote: n\n" in shown
    assert "\noverdue: multimeter (34401A" in shown
    dry = warm.run(["vcfbench", "run", "turntable", *options, *room, "--dry-run", "--json"], place)
    assert json.loads(dry.stdout)["dry_run"] is True


@pytest.mark.parametrize("asked", [{"note": "Gr\udcfc\udcdfe"}, {"tags": {"a": "\udcfc"}}, {"operator": "\udcfc"}])
def test_bytes_of_another_encoding_are_refused_before_a_record_begins(asked: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected a text in UTF-8"):
        vcfbench.run("turntable", metadata=asked, runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("asked", ["G-1", [("dut", "G-1")]])
def test_what_is_no_mapping_is_refused(asked: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="metadata: expected a mapping of dut, operator, note"):
        vcfbench.run("turntable", metadata=asked, runs=tmp_path)


@pytest.mark.exhaustive
def test_a_directory_with_a_name_of_another_encoding_takes_records(tmp_path: Path) -> None:
    runs = tmp_path / "Gr\udcfc"
    run = vcfbench.run("turntable", settings={"rates_deg_s": [10, 0, -10], "samples": 2}, runs=runs)
    assert vcfbench.load_run("last", runs) == run


@pytest.mark.parametrize("tag", ["batch", "=7", "batch="])
def test_a_tag_without_key_or_value_is_refused(tag: str, tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "run", "turntable", "--dry-run", "--tag", tag], tmp_path)
    assert done.returncode == 2
    assert f"--tag {tag}: expected KEY=VALUE" in done.stderr


def test_a_tag_twice_is_refused(tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "run", "turntable", "--dry-run", "--tag", "a=1", "--tag", "a=2"], tmp_path)
    assert (done.returncode, "a is given twice" in done.stderr) == (2, True)


def test_bench_check_shows_the_calibrations(tmp_path: Path) -> None:
    due = utc_now().date() + timedelta(days=30)
    path = bench_file(tmp_path).read_text(encoding="utf-8").replace('"33220A"', f'"33220A"\ncalibration_due = {due}')
    (tmp_path / "station.toml").write_text(path, encoding="utf-8")
    shown = warm.run(["vcfbench", "bench", "check", "--bench", "station.toml"], tmp_path).stdout
    assert "OVERDUE since 2020-01-15" in shown
    assert f"due {due}" in shown
    answer = json.loads(warm.run(["vcfbench", "bench", "check", "--bench", "station.toml", "--json"], tmp_path).stdout)
    meter = answer["instruments"]["multimeter"]
    assert (meter["calibrated"], meter["certificate"], meter["overdue"]) == ("2019-01-15", "K-7", True)


@pytest.mark.parametrize(("due", "overdue"), [(date(2026, 5, 1), False), (date(2026, 4, 30), True)])
def test_a_calibration_holds_on_the_day_when_it_is_due(due: date, *, overdue: bool) -> None:
    description = parse_bench(embedded_text("ideal").replace(METER, f"{METER}calibration_due = {due}\n"), "station")
    [found] = equipment_on(date(2026, 5, 1), description, ["multimeter"], {})
    assert found.overdue is overdue
    assert len(list(overdue_words([found]))) == overdue


@pytest.mark.parametrize(
    ("dates", "words"),
    [
        ("calibrated = 2026-01-15\ncalibration_due = 2026-01-15", "a day after multimeter.calibrated = 2026-01-15"),
        ('calibrated = "soon"', "multimeter.calibrated: expected a day, as in 2026-01-15, got 'soon'"),
        ("calibrated = 2026-01-15T10:00:00", "multimeter.calibrated: expected a day, as in 2026-01-15"),
        ("calibrated = 20260115", "multimeter.calibrated: expected a day, as in 2026-01-15, got 20260115"),
    ],
)
def test_dates_that_cannot_be_are_refused(dates: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse_bench(embedded_text("ideal").replace(METER, f"{METER}{dates}\n"), "station.toml")


def test_a_day_may_stand_in_quotes() -> None:
    description = parse_bench(embedded_text("ideal").replace(METER, f'{METER}calibrated = "2026-01-15"\n'), "station")
    assert description.multimeter is not None
    assert description.multimeter.calibrated == date(2026, 1, 15)


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="the time zone of the process cannot be set")
@pytest.mark.parametrize(("zone", "day"), [("UTC0", "2026-05-05"), ("XXX8", "2026-05-04"), ("XXX-14", "2026-05-05")])
def test_a_calibration_is_due_by_the_calendar_of_the_station(
    monkeypatch: pytest.MonkeyPatch, zone: str, day: str
) -> None:
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        monkeypatch.setattr(clock, "utc_now", lambda: datetime(2026, 5, 5, 3, 0, tzinfo=UTC))
        assert str(clock.today()) == day
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.parametrize(
    ("key", "given", "kept"),
    [
        ("ambient_temperature_c", np.float64(23.0), 23.0),
        ("humidity_percent", np.int64(41), 41),
        ("dut", np.str_("G-1"), "G-1"),
        ("operator", np.str_("A. Person"), "A. Person"),
        ("note", np.str_("soldered"), "soldered"),
        ("tags", {np.str_("batch"): np.str_("7")}, {"batch": "7"}),
    ],
)
def test_numpys_numbers_and_texts_are_told_as_pythons(key: str, given: Any, kept: Any) -> None:
    found = vcfbench.RunMetadata(**{key: given}).as_json()[key]
    assert found == kept
    assert msgspec.json.decode(msgspec.json.encode(found)) == kept  # which refuses numpy's


def test_header_that_cannot_be_written_leaves_no_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vcfbench.RunMetadata, "as_json", lambda _: {"note": object()})
    with pytest.raises(TypeError):
        vcfbench.run("turntable", "lab", settings=QUICK, runs=tmp_path)
    assert list(tmp_path.iterdir()) == []
