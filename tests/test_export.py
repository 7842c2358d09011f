"""Exports are read back by the libraries that people read them with."""

from __future__ import annotations

import json
import math
import os
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import pytest
from scipy.io import loadmat

import vcfbench
from benchmarks.export import record
from tests import warm
from tests.seals import sealed
from vcfbench.archive import export, export_formats
from vcfbench.archive.export import FORMATS, export_run
from vcfbench.archive.export_formats import ExportColumn, ExportTable
from vcfbench.errors import ConfigError
from vcfbench.values.value import Form, Value

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

h5py = pytest.importorskip("h5py")
openpyxl = pytest.importorskip("openpyxl")
pd = pytest.importorskip("pandas")
pq = pytest.importorskip("pyarrow.parquet")

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
TOLD = {"dut": "G-1", "operator": "A. Person", "note": "=1+1", "tags": {"batch": "7"}, "humidity_percent": 41.0}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return vcfbench.run("turntable", "lab", settings=QUICK, runs=tmp_path_factory.mktemp("export"), metadata=TOLD)


def read_back(path: Path, name: str) -> dict[str, Any]:
    """Return the columns of a file, by the library of its kind."""
    match path.suffix:
        case ".csv":
            return pd.read_csv(path).to_dict("list")
        case ".parquet":
            return pd.read_parquet(path).to_dict("list")
        case ".xlsx":
            return pd.read_excel(path, sheet_name=name).to_dict("list")
        case ".mat":
            table = loadmat(path, simplify_cells=True)[name]
            return {key: np.atleast_1d(values) for key, values in table.items()}
    with h5py.File(path) as file:
        return {key: data[()] for key, data in file[name].items()}


@pytest.mark.parametrize("kind", FORMATS)
def test_every_reading_comes_back_in_full_precision(kind: str, run: Run, tmp_path: Path) -> None:
    done = export_run(run, tmp_path / f"out.{kind}", raw=True)
    readings = run.readings
    assert (done.format, done.table, done.rows) == (kind, "readings", len(readings))
    found = read_back(done.file, "readings")
    assert set(found) == set(done.columns)
    last_digit = 1e-15 if kind == "xlsx" else 0.0  # a spreadsheet has 16 digits
    for name in ("number", "step", "t_s", "voltage_v", "table_rate_deg_s"):
        expected = [getattr(each, name) for each in readings]
        np.testing.assert_allclose(found[name], expected, rtol=last_digit, atol=0.0, err_msg=name)


@pytest.mark.parametrize("kind", FORMATS)
def test_every_point_comes_back_in_full_precision(kind: str, run: Run, tmp_path: Path) -> None:
    done = export_run(run, tmp_path / f"out.{kind}")
    found = read_back(done.file, "points")
    for name in ("step", "rate_deg_s", "v_vc_v", "output_v", "std_v", "n"):
        last_digit = 1e-15 if kind == "xlsx" else 0.0
        expected = [getattr(each, name) for each in run.points]
        np.testing.assert_allclose(found[name], expected, rtol=last_digit, atol=0.0, err_msg=name)


def test_parquet_has_units_and_what_the_record_says(run: Run, tmp_path: Path) -> None:
    schema = pq.read_schema(export_run(run, tmp_path / "out.parquet", raw=True).file)
    assert schema.field("table_rate_deg_s").metadata[b"unit"] == b"deg/s"
    assert schema.field("voltage_v").metadata[b"unit"] == b"V"
    assert schema.field("number").type == "int64"
    assert schema.metadata[b"dut"] == b"G-1"
    assert schema.metadata[b"tag.batch"] == b"7"
    assert json.loads(schema.metadata[b"equipment"])[0]["role"] == "power"


def test_hdf5_has_units_and_what_the_record_says(run: Run, tmp_path: Path) -> None:
    with h5py.File(export_run(run, tmp_path / "out.h5", raw=True).file) as file:
        assert (file["readings/t_s"].attrs["unit"], file["readings/rate_deg_s"].attrs["unit"]) == ("s", "deg/s")
        assert (file.attrs["operator"], file.attrs["humidity_percent"]) == ("A. Person", 41.0)
        assert file.attrs["run"] == run.name
        for name, each in run.values.items():
            u95 = math.nan if each.u95 is None else each.u95  # a bound has none
            found = file.attrs[f"value.{name}"], file.attrs[f"value.{name}.u95"]
            assert found == pytest.approx((each.value, u95), rel=0.0, nan_ok=True)
            assert file.attrs[f"value.{name}.unit"] == each.unit


STATED = {
    "bias": Value("bias", -0.0125, "V", u=1e-4),
    "gain": Value("gain", 3.0),
    "delay": Value("delay", 2.0, "s", form="interval", low=1.5, high=2.5, missing=("K_Vc", "clock")),
    "dead_band": Value("dead_band", None, "V", form="size-below", high=8e-4),
    "walk": Value("walk", 1e-5, "V", form="below", high=2e-5),
    "least": Value("least", None, "V", form="at-least", low=0.5),
}
"""A stated value of each form."""


def facts(path: Path) -> dict[str, Any]:
    """Return the facts of a run as the libraries read them; MATLAB's names have _ for a point."""
    match path.suffix:
        case ".mat":
            return loadmat(path, simplify_cells=True)["about"]
        case ".xlsx":
            return {row[0]: row[1] for row in openpyxl.load_workbook(path)["about"].iter_rows(values_only=True)}
        case ".parquet":
            return {key.decode(): value.decode() for key, value in pq.read_schema(path).metadata.items()}
    with h5py.File(path) as file:
        return dict(file.attrs)


@pytest.mark.parametrize("kind", [each for each in FORMATS if each != "csv"])
def test_every_number_of_every_form_of_a_value_is_a_number(
    kind: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert {each.form for each in STATED.values()} == {*get_args(Form)}
    monkeypatch.setattr(export, "summary_of", lambda _: SimpleNamespace(results=STATED))
    found = facts(export_run(run, tmp_path / f"out.{kind}").file)
    point = "_" if kind == "mat" else "."
    for name, each in STATED.items():
        own = f"value{point}{name}"
        for key, number in (
            ("", each.value),
            ("u", each.u),
            ("u95", each.u95),
            *zip(("low", "high"), each.ends, strict=True),
        ):
            came = found[f"{own}{point}{key}" if key else own]
            assert kind == "parquet" or not isinstance(came, str), (name, key)
            expected = number if number is not None and (kind != "xlsx" or np.isfinite(number)) else np.nan
            found_number = np.nan if came is None else float(came)
            np.testing.assert_allclose(found_number, expected, rtol=1e-15 if kind == "xlsx" else 0.0, atol=0.0)
        texts = {key: found[f"{own}{point}{key}"] for key in ("unit", "form", "missing")}
        said = {"unit": each.unit, "form": each.form, "missing": ", ".join(each.missing)}
        assert {key: "" if text is None or np.size(text) == 0 else text for key, text in texts.items()} == said
    assert found["simulated"] == ("true" if kind == "parquet" else 1)  # a text would count as true where it says false


def test_a_long_text_fits_into_hdf5(tmp_path: Path) -> None:
    column = ExportColumn("output_v", "V", "mean output", np.array([1.0]))
    table = ExportTable("points", (column,), {"settings": "s" * 100_000})
    export_formats.WRITERS["hdf5"](table, tmp_path / "out.h5")
    with h5py.File(tmp_path / "out.h5") as file:
        assert file["about/settings"].asstr()[()] == "s" * 100_000


def test_a_spreadsheet_has_units_and_what_the_record_says(run: Run, tmp_path: Path) -> None:
    book = openpyxl.load_workbook(export_run(run, tmp_path / "out.xlsx").file)
    columns = {row[0]: row[1:] for row in book["columns"].iter_rows(values_only=True)}
    assert columns["output_v"] == ("V", "mean output")
    about = {row[0].value: row[1] for row in book["about"].iter_rows()}
    assert (about["dut"].value, about["note"].value, about["note"].data_type) == ("G-1", "=1+1", "s")  # no formula


def test_matlab_has_units_and_what_the_record_says(run: Run, tmp_path: Path) -> None:
    found = loadmat(export_run(run, tmp_path / "out.mat").file, simplify_cells=True)
    assert found["units"]["rate_deg_s"] == "deg/s"
    assert (found["about"]["dut"], found["about"]["tag_batch"]) == ("G-1", "7")


def test_tags_alike_in_matlab_keep_different_names(tmp_path: Path) -> None:
    about = {"tag a-b": "1", "tag a_b": "2", "tag a.b": "3", "x" * 70: "4", f"{'x' * 70}y": "5"}
    table = ExportTable("points", (ExportColumn("t_s", "s", "time", np.array([0.0, 1.0])),), about)
    export_formats.WRITERS["mat"](table, tmp_path / "out.mat")
    found = loadmat(tmp_path / "out.mat", simplify_cells=True)["about"]
    assert sorted(found.values()) == ["1", "2", "3", "4", "5"]
    assert found["tag_a_b"] == "1"


def test_points_as_csv_are_those_of_the_record(run: Run, tmp_path: Path) -> None:
    assert run.directory is not None
    done = export_run(run, tmp_path / "out.csv")
    assert done.file.read_bytes() == (run.directory / "points.csv").read_bytes()


@pytest.mark.exhaustive
def test_v_vc_that_was_measured_is_a_column(tmp_path: Path) -> None:
    quick = {**QUICK, "virtual_rates_deg_s": [10.0, 20.0], "cycles": 1, "k_vc": "150"}
    run = vcfbench.run("self-calibration", "lab", settings=quick, runs=tmp_path)
    found = read_back(export_run(run, tmp_path / "out.parquet", raw=True).file, "readings")
    measured = [np.nan if each.v_vc_v is None else each.v_vc_v for each in run.readings]
    np.testing.assert_array_equal(found["v_vc_measured_v"], measured)
    assert not np.isnan(measured).all()
    assert "v_vc_measured_v" in export_run(run, tmp_path / "points.csv").columns


def test_samples_of_sines_and_v_vc_are_readings(tmp_path: Path) -> None:
    directory = record(tmp_path, 2)
    lines = (directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    header = json.loads(lines[0]) | {"began_s": 10.0}
    sine = {"interval_s": 0.5, "aperture_s": 0.2, "voltages_v": [0.1, 0.2]}
    lock_in = {"interval_s": 0.5, "output_t_s": 20.0, "output_v": [0.3, 0.4], "v_vc_t_s": 20.25, "v_vc_v": [1.0, 1.1]}
    v_vc = {"v_vc": [{"t_s": 30.0, "voltage_v": 1.2}], "mean_v": 1.2, "std_v": 0.0}
    results = {"SineResponse": sine, "ModulatedRecord": {**lock_in, "table_rate_deg_s": 5.0}, "VvcMeasured": v_vc}
    steps = [
        {"type": "step", "n": n, "step": {}, "t_s": n, "end_s": n + 0.5, "result_kind": kind, "result": result}
        for n, (kind, result) in enumerate(results.items(), start=1)
    ]
    footer = {**json.loads(lines[-1]), "points": 0}
    written = "".join(json.dumps(line) + "\n" for line in (header, *steps, footer))
    (directory / "journal.jsonl").write_bytes(sealed(written.encode()))
    found = read_back(export_run(directory, tmp_path / "out.csv", raw=True).file, "readings")
    nan = np.nan
    assert found["number"] == [1, 1, 2, 2, 2, 2, 3]
    assert found["t_s"] == [11.0, 11.5, 20.0, 20.25, 20.5, 20.75, 30.0]
    np.testing.assert_array_equal(found["voltage_v"], [0.1, 0.2, 0.3, nan, 0.4, nan, nan])
    np.testing.assert_array_equal(found["v_vc_measured_v"], [nan, nan, nan, 1.0, nan, 1.1, 1.2])
    np.testing.assert_array_equal(found["table_rate_deg_s"], [nan, nan, 5.0, 5.0, 5.0, 5.0, nan])


def test_run_cut_in_window_keeps_readings(tmp_path: Path) -> None:
    directory = record(tmp_path, 2500)
    journal = directory / "journal.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:3]))
    found = read_back(export_run(directory, tmp_path / "out.csv", raw=True).file, "readings")
    assert len(found["t_s"]) == 2000
    assert np.isnan(found["table_rate_deg_s"]).all()  # it is read back when the window is over


def test_nothing_measured_is_a_table_without_rows(tmp_path: Path) -> None:
    directory = record(tmp_path, 100)
    journal = directory / "journal.jsonl"
    journal.write_bytes(journal.read_bytes().splitlines(keepends=True)[0])
    for kind in FORMATS:
        assert export_run(directory, tmp_path / f"out.{kind}", raw=True).rows == 0


def test_a_long_table_says_how_far_it_is(tmp_path: Path) -> None:
    column = ExportColumn("n", "", "counts", np.arange(25_000))
    received: list[tuple[int, int]] = []
    table = ExportTable("readings", (column,), {}, progress=lambda rows, of: received.append((rows, of)))
    export_formats.WRITERS["csv"](table, tmp_path / "x.csv")
    assert received == [(10_000, 25_000), (20_000, 25_000), (25_000, 25_000)]


def test_a_damaged_record_is_not_exported(tmp_path: Path) -> None:
    directory = record(tmp_path, 2500)
    journal = directory / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:2] + lines[3:]))
    with pytest.raises(ConfigError, match="so it is not exported: line 3 was changed"):
        export_run(directory, tmp_path / "out.csv", raw=True)
    assert not (tmp_path / "out.csv").exists()


def test_more_rows_than_a_sheet_has_are_refused(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export_formats, "_XLSX_ROWS", 9)
    with pytest.raises(ConfigError, match=r"\d+ rows do not fit on a sheet") as refused:
        export_run(run, tmp_path / "out.xlsx", raw=True)
    assert "--format parquet, hdf5 or csv" in str(refused.value.hint)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("kind", "module"), [("parquet", "pyarrow"), ("hdf5", "h5py"), ("xlsx", "openpyxl")])
def test_a_format_without_its_extra_says_which_to_install(
    kind: str, module: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match=f"needs {module}") as refused:
        export_run(run, tmp_path / f"out.{kind}")
    assert f'"{module}>=' in str(refused.value.hint)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"format": "ods"}, "format: expected one of csv, parquet, hdf5, xlsx, mat, got 'ods'"),
        ({"file": "out.txt"}, "which format is not known"),
        ({}, "which format is not known"),
        ({"file": "no/such/place.csv"}, "no/such/place.csv: cannot be written: No such file"),
    ],
)
def test_what_cannot_be_written_is_refused(asked: dict[str, str], words: str, run: Run) -> None:
    with pytest.raises(ConfigError, match=words):
        export_run(run, **asked)  # type: ignore[arg-type]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are POSIX's")
def test_what_is_no_file_is_not_replaced_by_one(run: Run, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ConfigError, match=r"pipe\.csv: expected a regular file to replace, got something else"):
        export_run(run, tmp_path / "pipe.csv")
    assert (tmp_path / "pipe.csv").is_fifo()


@pytest.mark.exhaustive
def test_the_command_says_what_it_wrote(run: Run, tmp_path: Path) -> None:
    assert run.directory is not None
    runs = str(run.directory.parent)
    done = warm.run(["vcfbench", "runs", "export", "last", "--runs", runs, "--raw", "--format", "csv"], tmp_path)
    assert done.stdout == f"{run.name}-readings.csv: {len(run.readings)} readings, 7 columns\n"
    finished = warm.run(["vcfbench", "runs", "export", "last", "--runs", runs, "-o", "p.h5", "--json"], tmp_path)
    answer = json.loads(finished.stdout)
    assert (answer["file"], answer["format"], answer["rows"]) == ("p.h5", "hdf5", len(run.points))
