"""``vcfbench run`` on a bench of fakes; the simulated bench has its turn in test_run_simulated.py."""

from __future__ import annotations

import errno
import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from unittest.mock import ANY

import pytest
import typer
from msgspec import structs
from typer.testing import CliRunner

from tests.procedures.fakes import FakeBench, Gyro
from vcfbench.cli import run as run_module
from vcfbench.cli import runs as runs_module
from vcfbench.errors import BenchError, ConfigError, ConnectFailed, NotSafe, PlanError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.interfaces import SafeReport
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.file import template

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from typer.testing import Result

KEYS = [
    *("run", "procedure", "status", "bench", "simulated", "seed", "metadata", "equipment", "bench_seconds"),
    *("points", "results", "values", "acceptance", "asked_again", "not_seen"),
]
POINT_KEYS = ["step", "rate_deg_s", "v_vc_v", "output_v", "std_v", "n"]


class Station:
    """Stands in for :func:`vcfbench.bench.bench.open_bench`."""

    def __init__(self) -> None:
        self.spoil: Callable[[FakeBench], None] = lambda _: None
        self.refuses: BenchError | None = None
        self.ends_with: BenchError | None = None
        self.opened: list[dict[str, Any]] = []

    @contextmanager
    def open_bench(self, description: Any, **options: Any) -> Iterator[Any]:
        self.opened.append(options)
        if self.refuses is not None:
            raise self.refuses
        bench: Any = FakeBench(Gyro(noise_v=1e-4))
        bench.description, bench.simulated, bench.seed = description, description.simulated, options["seed"]
        bench.identities = {"power": bench.power.identify()}
        bench.safe_reports, bench.adjust = [], None
        drive = description.procedure.drive
        bench.oscilloscope.amplitude_v = sum(drive.amplitude_v) / 2.0
        bench.oscilloscope.phase_deg = sum(drive.phase_deg) / 2.0
        self.spoil(bench)
        try:
            yield bench
        finally:
            bench.safe_reports.append(SafeReport("power", "FAKE::5", safe=True, detail="outputs off"))
            if self.ends_with is not None:
                raise self.ends_with


@pytest.fixture
def station(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Station:
    station = Station()
    monkeypatch.setattr("vcfbench.runs.conduct.open_bench", station.open_bench)
    monkeypatch.chdir(tmp_path)
    return station


app = typer.Typer(rich_markup_mode=None, pretty_exceptions_enable=False)
app.add_typer(run_module.app, name="run")
app.add_typer(runs_module.app, name="runs")


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments)


@pytest.fixture(params=["turntable", "virtual-coriolis"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_json_is_one_object_with_the_agreed_keys(station: Station, name: str, tmp_path: Path) -> None:
    result = call("run", name, "--json", "--seed", "7", "--quiet")
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    assert list(answer) == KEYS
    assert (answer["procedure"], answer["status"], answer["seed"]) == (name, "complete", 7)
    assert (answer["bench"], answer["simulated"]) == ("paper", True)
    assert all(list(point) == POINT_KEYS for point in answer["points"])
    assert len(answer["points"]) == {"turntable": 17, "virtual-coriolis": 51}[name]
    assert (tmp_path / "runs" / answer["run"] / "journal.jsonl").exists()
    opened = {
        "seed": 7,
        "speed": None,
        "signals": ANY,
        "build": None,
        "needs": ANY,
        "now_s": None,
        "trust": True,
        "operator": None,
    }
    assert station.opened == [opened]
    assert result.stderr == ""


def test_results_of_a_turntable_run(station: Station) -> None:
    results = json.loads(call("run", "turntable", "--json").stdout)["results"]
    assert results["scale_factor"]["unit"] == "V/(deg/s)"
    assert results["scale_factor"]["value"] == pytest.approx(-0.0125, rel=1e-4)
    assert results["bias"]["unit"] == "V"
    assert {"max_span", "max_span_rounded", "max_fs"} <= set(results["nonlinearity_ppm"])
    assert station.opened


def test_results_of_a_virtual_coriolis_run(station: Station) -> None:
    results = json.loads(call("run", "virtual-coriolis", "--json").stdout)["results"]
    assert results["k_vc"]["unit"] == "(deg/s)/V"
    assert results["k_vc"]["value"] == pytest.approx(40.0, rel=3e-3)
    assert results["v_vc10_v"] == pytest.approx(0.25, rel=3e-3)
    assert set(results["turntable"]) == set(results["virtual"])
    assert abs(results["scale_factor_error_percent"]) < 0.3
    assert station.opened


def test_match_absolute_is_passed_on(station: Station) -> None:
    results = json.loads(call("run", "virtual-coriolis", "--json", "--match", "absolute").stdout)["results"]
    assert results["scale_factor_error_percent"] == pytest.approx(41.36, abs=1.0)
    assert station.opened


def test_table_and_record_without_json_and_progress_on_stderr(station: Station, name: str) -> None:
    result = call("run", name)
    assert result.exit_code == 0
    assert "quantity  " in result.stdout
    assert "complete:" in result.stdout
    assert "record: runs/" in result.stdout.replace("\\", "/")
    assert "table to +200 deg/s" in result.stderr
    assert "table to +200 deg/s" not in result.stdout
    assert station.opened


def test_dry_run_opens_nothing_and_writes_nothing(station: Station, name: str, tmp_path: Path) -> None:
    result = call("run", name, "--dry-run")
    assert result.exit_code == 0
    assert station.opened == []
    assert list(tmp_path.iterdir()) == []
    assert "table to +200 deg/s" in result.stdout
    assert "estimated bench time" in result.stdout.splitlines()[-1]


def test_dry_run_as_json(station: Station) -> None:
    answer = json.loads(call("run", "turntable", "--dry-run", "--json").stdout)
    assert answer["dry_run"] is True
    assert answer["physical_minimum_s"] <= answer["estimated_bench_seconds"]
    assert answer["steps"][0]["what"] == "Start-up"
    assert station.opened == []


def test_an_aborted_run_keeps_its_points_and_says_so(station: Station) -> None:
    def overload(bench: FakeBench) -> None:
        bench.multimeter.overload_at = 44

    station.spoil = overload
    result = call("run", "turntable", "--json", "--quiet")
    answer = json.loads(result.stdout)
    assert answer["status"] == "aborted"
    assert len(answer["points"]) == 3
    assert answer["results"] == {}
    assert answer["exit_code"] == 3
    assert "multimeter at FAKE::22: overload on the 10 V range, step 32" in answer["error"]
    assert isinstance(result.exception, BenchError)
    assert result.exception.exit_code == 3
    assert "aborted" in call("runs", "list").stdout


@pytest.mark.parametrize(("overload_at", "tables"), [(5, 0), (44, 1)])
def test_aborted_run_says_how_to_resume_it(overload_at: int, tables: int, station: Station) -> None:
    def overload(bench: FakeBench) -> None:
        bench.multimeter.overload_at = overload_at

    station.spoil = overload
    said = call("run", "turntable", "--quiet").stdout
    name = json.loads(call("runs", "list", "--json").stdout)["runs"][0]["run"]
    assert f"the rest: vcfbench resume {name}, once the cause is removed" in said
    assert said.count("output / V") == tables


def test_an_unreachable_instrument_is_an_aborted_run_without_record(station: Station, tmp_path: Path) -> None:
    station.refuses = ConnectFailed("nobody answers", instrument="multimeter", resource="GPIB0::22::INSTR")
    result = call("run", "turntable", "--json")
    answer = json.loads(result.stdout)
    assert (answer["run"], answer["status"], answer["points"]) == (None, "aborted", [])
    assert result.exception is station.refuses
    assert list((tmp_path / "runs").iterdir()) == []


def test_bench_found_unsafe_at_opening_has_record(station: Station, tmp_path: Path) -> None:
    unsafe = SafeReport("rate_table", "COM1", safe=False, detail="it turns at 12 deg/s")
    station.refuses = NotSafe("NOT SAFE: rate_table at COM1: it turns at 12 deg/s")
    station.refuses.reports = (unsafe,)
    result = call("run", "turntable", "--json")
    assert result.exception is station.refuses
    (journal,) = (tmp_path / "runs").glob("*/journal.jsonl")
    header, footer = (json.loads(line) for line in journal.read_text().splitlines())
    assert (header["identities"], footer["error"]["kind"], footer["status"]) == ({}, "NotSafe", "aborted")
    assert footer["safe"] == [structs.asdict(unsafe)]


def test_error_at_close_does_not_hide_unsafe_instrument(station: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    """With no file descriptor left a run on a bench that stayed live ended with code 3 and no word of it."""

    def no_more_files(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    station.refuses = NotSafe("NOT SAFE: rate_table at COM1: it turns at 12 deg/s")
    monkeypatch.setattr("vcfbench.runs.under_way.UnderWay.close", no_more_files)
    assert call("run", "turntable").exception is station.refuses


def test_unwritable_record_is_found_before_an_instrument_is_opened(station: Station, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for runs in ("file", "file/runs", ""):
        result = call("run", "turntable", "--runs", runs)
        assert isinstance(result.exception, ConfigError)
        assert "no record can be written there" in str(result.exception) or "got an empty name" in str(result.exception)
    assert station.opened == []


def test_failed_display_is_recorded_and_run_continues(
    station: Station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("I/O operation on closed file")

    monkeypatch.setattr("vcfbench.reports.progress.LineProgress.handle", fail)
    assert call("run", "turntable").exit_code == 0
    (journal,) = (tmp_path / "runs").glob("*/journal.jsonl")
    footer = json.loads(journal.read_text().splitlines()[-1])
    assert (footer["status"], footer["display_lost"]) == ("complete", "ValueError: I/O operation on closed file")
    assert station.opened


def test_a_mistake_of_ours_leaves_a_record_that_is_ended(station: Station, tmp_path: Path) -> None:
    def breaks(bench: FakeBench) -> None:
        bench.power.enable_outputs = lambda: 1 / 0  # type: ignore[assignment, return-value]

    station.spoil = breaks
    assert isinstance(call("run", "turntable", "--quiet").exception, ZeroDivisionError)
    (journal,) = (tmp_path / "runs").glob("*/journal.jsonl")
    footer = json.loads(journal.read_text().splitlines()[-1])
    assert footer["error"]["what"] == "the program has a mistake: ZeroDivisionError: division by zero"
    assert [report["safe"] for report in footer["safe"]] == [True]
    assert (journal.parent / "points.csv").exists()


def test_not_safe_comes_before_everything(station: Station) -> None:
    def overload(bench: FakeBench) -> None:
        bench.multimeter.overload_at = 44

    station.spoil, station.ends_with = overload, NotSafe("NOT SAFE: rate_table at COM1: turns")
    result = call("run", "turntable", "--json", "--quiet")
    assert result.exception is station.ends_with
    assert "before that: multimeter at FAKE::22: overload" in str(result.exception)
    assert len(json.loads(result.stdout)["points"]) == 3


def test_plan_broken_by_bug_has_no_results(station: Station) -> None:
    """An error that is none of the bench's: what was measured until then is no calibration, even when it would fit."""

    def breaks(bench: FakeBench) -> None:
        read, left = bench.multimeter.read_voltage_v, iter(range(95))

        def read_or_break() -> float:
            if next(left, None) is None:
                raise ZeroDivisionError("a bug")
            return read()

        bench.multimeter.read_voltage_v = read_or_break  # type: ignore[method-assign]

    station.spoil, station.ends_with = breaks, NotSafe("NOT SAFE: rate_table at COM1: turns")
    result = call("run", "turntable", "--json", "--quiet")
    answer = json.loads(result.stdout)
    assert result.exception is station.ends_with
    assert len(answer["points"]) == 8
    assert (answer["status"], answer["results"]) == ("aborted", {})


def test_same_seed_same_bytes_of_results(station: Station, name: str, tmp_path: Path) -> None:
    for runs in ("a", "b"):
        call("run", name, "--runs", runs, "--quiet")
    first, second = (next((tmp_path / runs).iterdir()) for runs in ("a", "b"))
    for derived in ("result.json", "points.csv"):
        assert (first / derived).read_bytes() == (second / derived).read_bytes()
    assert station.opened


def test_an_unknown_procedure_is_one_line_with_the_known_ones(station: Station) -> None:
    result = call("run", "spin")
    assert isinstance(result.exception, PlanError)
    assert str(result.exception) == f"there is no procedure 'spin'; known are {', '.join(BUILT_IN)}"
    assert station.opened == []


@pytest.mark.parametrize("more", [(), ("--dry-run",), ("--json",)])
@pytest.mark.parametrize("options", [("--match", "nearly"), ("--bench", "nowhere.toml"), ("--speed", "fast")])
def test_bad_options_are_errors_of_usage(station: Station, options: tuple[str, str], more: tuple[str, ...]) -> None:
    result = call("run", "virtual-coriolis", *options, *more)
    assert isinstance(result.exception, BenchError)
    assert result.exception.exit_code == 2
    assert station.opened == []


def test_the_journal_has_everything(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--seed", "3", "--quiet")
    directory = next((tmp_path / "runs").iterdir())
    lines = [json.loads(line) for line in (directory / "journal.jsonl").read_text().splitlines()]
    header, footer = lines[0], lines[-1]
    assert header["bench"]["name"] == load_bench().name
    assert header["identities"]["power"]["maker"] == "fake"
    assert header["seed"] == 3
    assert header["options"] == {
        "bench": None,
        "seed": 3,
        "json": False,
        "dry_run": False,
        "runs": "runs",
        "speed": None,
        "quiet": True,
        "plain": False,
        "page": False,
        "port": 0,
        "yes": False,
        "settings": {},
        "metadata": {},
    }
    assert {"vcfbench", "simrack", "python", "numpy", "scipy", "pyvisa"} <= set(header["versions"])
    assert footer["status"] == "complete"
    assert [report["safe"] for report in footer["safe"]] == [True]
    assert footer["bench_seconds"] <= 1.05 * footer["physical_minimum_s"]
    windows = [line for line in lines if line.get("step_kind") == "Acquire"]
    assert all(len(line["result"]["readings"]) == 10 for line in windows)
    assert all(len(line["result"]["rails"]) == 2 for line in windows)
    assert station.opened


@pytest.mark.parametrize("options", [("--speed", "max"), ("--speed", "1"), ("--seed", "3")])
@pytest.mark.parametrize("more", [(), ("--dry-run",)])
def test_a_real_bench_has_neither_speed_nor_seed(
    station: Station, options: tuple[str, str], more: tuple[str, ...], tmp_path: Path
) -> None:
    file = tmp_path / "station.toml"
    file.write_text(template(), encoding="utf-8")
    result = call("run", "turntable", "--bench", str(file), *options, *more)
    assert isinstance(result.exception, ConfigError)
    assert f"lab-1 has no [simulation], only such a bench has a {options[0][2:]}" in str(result.exception)
    assert station.opened == []


@pytest.mark.usefixtures("station")
def test_answer_fits_one_screen_and_verbose_has_the_points(name: str) -> None:
    short = call("run", name, "--quiet").stdout.splitlines()
    assert len(short) <= 40
    assert all(len(line) <= 80 for line in short if not line.startswith("record:"))
    assert any(line.startswith("U95 of ") for line in short)
    assert "Omega_z / (deg/s)" in call("run", name, "--quiet", "-v").stdout
