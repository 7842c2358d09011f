"""``vcfbench device``: the history of a gyroscope as table, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import re
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from typer.testing import CliRunner

import vcfbench
from vcfbench.archive.batch_sheet import device_rows
from vcfbench.cli.main import app
from vcfbench.records.device_values import Conditions, Measured
from vcfbench.records.devices import Certificate, DeviceStore, KvcCurve, SelfCalibration

if TYPE_CHECKING:
    from pathlib import Path

    from typer.testing import Result

DAY = datetime(2026, 5, 4, 9, 30, tzinfo=UTC)
HERE = Conditions(bench="lab", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
CURVE = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 1e-6)), v_vc_min_v=-1.3, v_vc_max_v=1.3)


@pytest.fixture
def store(tmp_path: Path) -> DeviceStore:
    kept = DeviceStore(tmp_path / "devices")
    scale = Measured(value=-0.0125, u=2e-7)
    kept.add(
        Certificate(
            serial="G-1", issued=DAY, procedure="kvc", k_vc=CURVE, conditions=HERE, scale_factor_v_per_deg_s=scale
        )
    )
    kept.add(
        SelfCalibration(
            serial="G-1",
            done=DAY + timedelta(days=30),
            procedure="self-calibration",
            certificate="0001",
            scale_factor_v_per_deg_s=Measured(value=-0.01250125, u=3e-7),
            bias_v=Measured(value=-0.042, u=2e-5),
            conditions=HERE,
            drift_ppm=Measured(value=100.0, u=20.0),
            e_n=2.5,
            verdict="fail",
        )
    )
    return kept


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["device", *arguments])


def test_devices_are_listed(store: DeviceStore) -> None:
    none = ("--runs", str(store.root / "none"))
    assert call("--devices", str(store.root), *none).stdout == "G-1\n"
    listed = json.loads(call("--devices", str(store.root), *none, "--json").stdout)
    assert listed == {"devices": ["G-1"], "failed_since": {}}
    assert "no devices in" in call("--devices", str(store.root / "none"), *none).stdout


def test_the_history_is_a_table(store: DeviceStore) -> None:
    shown = call("G-1", "--devices", str(store.root))
    assert shown.exit_code == 0
    assert "2026-06-03T09:30:00+00:00" in shown.stdout
    assert "+100.0" in shown.stdout


def test_the_history_as_csv_and_json(store: DeviceStore) -> None:
    rows = list(csv.DictReader(io.StringIO(call("G-1", "--devices", str(store.root), "--csv").stdout)))
    assert [row["kind"] for row in rows] == ["certificate", "self-calibration"]
    assert float(rows[1]["scale_factor_v_per_deg_s"]) == -0.01250125
    assert (rows[0]["drift_ppm"], rows[1]["drift_ppm"]) == ("", "100.0")
    answer = json.loads(call("G-1", "--devices", str(store.root), "--json").stdout)
    assert [each["entry"] for each in answer["entries"]] == ["0001", "0002"]
    assert answer["entries"][1]["e_n"] == 2.5


@pytest.mark.parametrize("serial", [["G-1"], []])
def test_two_formats_at_once_are_refused(serial: list[str], store: DeviceStore) -> None:
    refused = call(*serial, "--devices", str(store.root), "--csv", "--json")
    said = "--json and --csv: expected one of the two, got both"
    assert (refused.exit_code, json.loads(refused.stdout)) == (2, {"error": said, "exit_code": 2})
    assert said in refused.stderr


def test_unknown_device_error_lists_known_devices(store: DeviceStore) -> None:
    failed = call("G-2", "--devices", str(store.root))
    assert failed.exit_code == 2
    assert "there is no entry of device 'G-2'" in failed.stderr
    assert "known devices: G-1" in failed.stderr


@pytest.mark.exhaustive
def test_the_history_is_drawn_into_a_file(store: DeviceStore, tmp_path: Path) -> None:
    for name, begins in (("history.png", b"\x89PNG"), ("history.svg", b"<?xml")):
        shown = call("G-1", "--devices", str(store.root), "--plot", str(tmp_path / name))
        assert shown.exit_code == 0
        assert (tmp_path / name).read_bytes().startswith(begins)
    assert "time since 2026-05-04" in (tmp_path / "history.svg").read_text(encoding="utf-8")
    refused = call("G-1", "--devices", str(store.root), "--plot", str(tmp_path / "history.xyz"))
    assert refused.exit_code == 2
    assert "no picture can be written" in refused.stderr


@pytest.mark.exhaustive
def test_runs_with_a_device_are_listed_with_their_drift(tmp_path: Path) -> None:
    settings = {"rates_deg_s": [100, 50, 0, -50, -100], "samples": 3, "settle_s": 0.5}
    runs = tmp_path / "runs"
    first, second = (
        vcfbench.run("turntable", seed=seed, settings=settings, metadata={"dut": "G-9"}, runs=runs).results.scale_factor
        for seed in (1, 2)
    )
    words = ("G-9", "--devices", str(tmp_path / "devices"), "--runs", str(runs))
    before, after = json.loads(call(*words, "--json").stdout)["runs"]
    assert (before["drift_ppm"], before["since_first_ppm"]) == (None, 0.0)
    assert (after["since_first_ppm"], after["drift_note"]) == (after["drift_ppm"], "")
    assert after["drift_ppm"] == pytest.approx(1e6 * (second.value / first.value - 1.0))
    assert "Runs with this device" in call(*words).stdout
    assert call(*words, "--plot", str(tmp_path / "drift.svg")).exit_code == 0
    drawn = (tmp_path / "drift.svg").read_text(encoding="utf-8")
    assert re.search(r"time since \d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC / (s|min)<", drawn)  # not in days
    assert f"Scale factor of G-9 (turntable, E_n {after['e_n']:.2f}); bars: 2 u" in drawn
    rows = list(csv.DictReader(io.StringIO(call(*words, "--csv").stdout)))
    assert [float(row["line_scale_factor_v_per_deg_s"]) for row in rows] == [
        each["values"][0]["value"] for each in (before, after)
    ]
    assert [float(row["u_line_scale_factor"]) for row in rows] == pytest.approx([first.u, second.u])
    assert [row["scale_factor_v_per_deg_s"] for row in rows] == ["", ""]  # of small signals, which these are not
    assert call(*words[1:]).stdout == "G-9  no entry, complete runs: 2\n"
    assert json.loads(call(*words[1:], "--json").stdout)["devices"] == ["G-9"]
    assert call("G-9", "--devices", str(tmp_path / "devices"), "--runs", str(tmp_path / "none")).exit_code == 2


def test_a_device_is_loaded_from_python(store: DeviceStore) -> None:
    known = vcfbench.load_device("G-1", store.root)
    assert known.certificate is not None
    assert known.certificate.k_vc == CURVE
    assert [each.e_n for each in known.self_calibrations] == [2.5]
    with pytest.raises(vcfbench.ConfigError, match="there is no entry of device 'G-2'"):
        vcfbench.load_device("G-2", store.root)


def test_withdrawn_entry_shows_reason_in_history(store: DeviceStore) -> None:
    where = ("--devices", str(store.root))
    done = call("G-1", *where, "--withdraw", "0002", "--reason", "the leads were swapped", "--by", "A. Person")
    assert (done.exit_code, done.stdout) == (0, f"{store.root / 'G-1' / '0003.json'}\n")
    shown = call("G-1", *where).stdout
    assert "self-calibration (withdrawn)" in shown
    assert "0002 is withdrawn by A. Person" in shown
    assert ": the leads were swapped" in shown
    answer = json.loads(call("G-1", *where, "--json").stdout)
    assert {each["entry"]: each["counts"] for each in answer["entries"]} == {"0001": True, "0002": False, "0003": False}
    for words, wanted in ((("G-1",), "expected a reason"), ((), "SERIAL: give the serial number of the device")):
        refused = call(*words, *where, "--withdraw", "0001")
        assert refused.exit_code == 2
        assert wanted in refused.stderr


def test_entries_from_a_simulated_bench_are_marked_beside_real_ones(store: DeviceStore) -> None:
    where = ("--devices", str(store.root))
    assert "(simulated)" not in call("G-1", *where).stdout
    real = structs.replace(HERE, simulated=False)
    store.add(Certificate(serial="G-1", issued=DAY, procedure="kvc", k_vc=CURVE, conditions=real))
    assert "self-calibration (simulated)" in call("G-1", *where).stdout


@pytest.mark.exhaustive
def test_older_record_without_values_has_its_row(tmp_path: Path) -> None:
    settings = {"rates_deg_s": [100, 50, 0, -50, -100], "samples": 3, "settle_s": 0.5}
    run = vcfbench.run("virtual-coriolis", seed=1, settings=settings, metadata={"dut": "G-9"}, runs=tmp_path / "runs")
    assert run.directory is not None
    result = run.directory / "result.json"
    stored = json.loads(result.read_text(encoding="utf-8"))
    del stored["values"]
    result.write_text(json.dumps(stored), encoding="utf-8")
    (row,) = device_rows("G-9", tmp_path / "runs", tmp_path / "devices")
    assert row.scale_factor is not None
    assert row.scale_factor.name == "turntable.scale_factor"


def test_history_of_stream_as_csv_is_in_its_unit(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    assert CliRunner().invoke(app, ["sim", "new", str(own), "--stream", "adis16495"]).exit_code == 0
    settings = {"rates_deg_s": [100, 0, -100], "samples": 3, "settle_s": 0.5}
    runs, devices = tmp_path / "runs", tmp_path / "devices"
    found = vcfbench.run("turntable", own, settings=settings, metadata={"dut": "S-1"}, runs=runs).results
    words = ("S-1", "--devices", str(devices), "--runs", str(runs), "--csv")
    (row,) = csv.DictReader(io.StringIO(call(*words).stdout))
    assert row["unit"] == "deg/s"
    assert float(row["line_scale_factor_of_unit_per_deg_s"]) == pytest.approx(found.scale_factor.value)
    assert float(row["line_bias_of_unit"]) == pytest.approx(found.bias.value)
    assert (row["line_scale_factor_v_per_deg_s"], row["line_bias_v"]) == ("", "")
