from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from typer.testing import CliRunner

from tests.bench.fakes import FakeRack
from vcfbench.bench import check as check_module
from vcfbench.cli.main import app
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.station.file import EMBEDDED, template

if TYPE_CHECKING:
    from collections.abc import Callable

    from typer.testing import Result


@pytest.fixture(autouse=True)
def _state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))


@pytest.fixture
def bench_file(tmp_path: Path) -> str:
    path = tmp_path / "lab.toml"
    path.write_text(template(), "utf-8")
    return str(path)


@pytest.fixture
def rack(monkeypatch: pytest.MonkeyPatch) -> Callable[..., FakeRack]:
    def make(**behaviours: str) -> FakeRack:
        fakes = FakeRack(**behaviours)
        monkeypatch.setattr(check_module, "open_role", fakes.open_role)
        return fakes

    return make


def vcfbench(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def test_the_template_is_printed_as_it_is() -> None:
    assert vcfbench("bench", "show", "--template").stdout == template()


@pytest.mark.parametrize("name", EMBEDDED)
def test_bench_show_prints_bench_file_of_same_bench(name: str) -> None:
    shown = vcfbench("bench", "show", "--bench", name)
    assert shown.exit_code == 0
    again, bench = parse_bench(shown.stdout, "shown"), load_bench(name)
    assert structs.replace(again, procedure_table=bench.procedure_table) == bench
    for procedure in PROCEDURES.values():
        asked = asked_in_python({"k_vc": "150"} if procedure.name in {"online", "self-calibration"} else {})
        assert settings_of(procedure, again, asked) == settings_of(procedure, bench, asked)


def test_bench_show_without_file_prints_paper_bench() -> None:
    shown = json.loads(vcfbench("bench", "show", "--json").stdout)
    assert shown["name"] == "paper"
    assert shown["procedure"]["samples"] == 10
    assert shown["wiring"]["oscilloscope"]["channel_1"] == "drive"


def test_check_reports_every_instrument(rack: Callable[..., FakeRack], bench_file: str) -> None:
    fakes = rack()
    done = vcfbench("bench", "check", "--bench", bench_file)
    assert (done.exit_code, done.stderr) == (0, "")
    for role in fakes.instruments:
        (row,) = [line.split() for line in done.stdout.splitlines() if line.startswith(role)]
        assert row[1] == "ok"
    assert all(not instrument.energised for instrument in fakes.instruments.values())
    assert all(f"{role} errors" in fakes.log for role in fakes.instruments)


def test_check_starts_the_watchdog_process_and_says_what_instruments_have(
    rack: Callable[..., FakeRack], bench_file: str
) -> None:
    rack()
    watchdog = json.loads(vcfbench("bench", "check", "--bench", bench_file, "--json").stdout)["watchdog"]
    assert 0.0 < watchdog["ready_s"] < 10.0
    assert {**watchdog, "ready_s": 0} == {
        "ok": True,
        "ready_s": 0,
        "problem": None,
        "instruments": {
            "power": {"armed": False, "why": "no command for it is known"},
            "rate_source": {"armed": False, "why": "no command for it is known"},
            "rate_table": {"armed": False, "why": "its time-out is for TRACK mode, a run uses rate mode"},
        },
    }


def test_check_says_that_the_watchdog_process_does_not_start(
    rack: Callable[..., FakeRack], bench_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rack()
    monkeypatch.setattr("vcfbench.safety.watchdog._MAIN", "raise SystemExit")
    done = vcfbench("bench", "check", "--bench", bench_file)
    assert done.exit_code == 3
    assert done.stderr == "vcfbench: not ready: watchdog\n"
    [row] = [line for line in done.stdout.splitlines() if line.startswith("process")]
    assert row.split(maxsplit=2)[1:] == [
        "FAILED",
        "the watchdog did not start, so the bench would not be made safe if this program died",
    ]


def test_check_of_a_bench_in_this_process_needs_no_watchdog() -> None:
    done = vcfbench("bench", "check", "--bench", "ideal")
    assert done.exit_code == 0
    [row] = [line for line in done.stdout.splitlines() if line.startswith("process")]
    assert row.split(maxsplit=2) == ["process", "none", "simulated in this process: nothing outlives it"]


def test_bench_check_shows_station_and_possible_procedures(tmp_path: Path) -> None:
    bench = tmp_path / "small.toml"
    meter = '[multimeter]\nmodel = "34401A"\nresource = "GPIB0::22::INSTR"\ncalibration_due = 2020-01-01\n'
    judged = "[acceptance]\nbias_v = [-0.1, 0.1]\n"
    bench.write_text(f'name = "small"\n{meter}{judged}[site]\nlatitude_deg = 0.0\n[simulation]\n', "utf-8")
    done = vcfbench("bench", "check", "--bench", str(bench))
    assert done.exit_code == 0
    assert "34401A" in done.stdout
    assert "OVERDUE since 2020-01-01" in done.stdout
    assert "limits: none\nacceptance: bias_v -0.1 to 0.1\ncan run: zero, " in done.stdout
    assert (
        "cannot run: vibration needs rate_source and vibration_source, which bench small does not have\n" in done.stdout
    )
    assert (
        "cannot run: warmup, power, repeatability: each needs power, which bench small does not have\n" in done.stdout
    )
    answer = json.loads(vcfbench("bench", "check", "--json").stdout)
    assert answer["limits"]["max_rate_deg_s"] == 300
    assert answer["procedures"]["turntable"] is None
    assert answer["procedures"]["vibration"] == "vibration needs vibration_source, which bench paper does not have"


def test_check_goes_on_past_what_fails(rack: Callable[..., FakeRack], bench_file: str) -> None:
    fakes = rack(rate_source="missing", rate_table="turns")
    done = vcfbench("bench", "check", "--bench", bench_file, "--json")
    assert done.exit_code == 3
    assert done.stderr == "vcfbench: not ready: rate_source, rate_table\n"
    answer = json.loads(done.stdout)
    assert not answer["ok"]
    opened = {role: each["ok"] for role, each in answer["instruments"].items()}
    assert opened == {
        "power": True,
        "rate_source": False,
        "multimeter": True,
        "oscilloscope": True,
        "rate_table": False,
    }
    assert "nobody answers" in answer["instruments"]["rate_source"]["problem"]
    assert "it turns at 12.5 deg/s" in answer["instruments"]["rate_table"]["problem"]
    assert {role for role, each in answer["instruments"].items() if each["safe"]} == set(fakes.instruments)
    assert set(answer["procedures"].values()) >= {"turntable opens rate_source and rate_table, not ready"}
    assert None not in answer["procedures"].values()
    said = vcfbench("bench", "check", "--bench", bench_file).stdout
    assert "can run: no procedure: rate_source, rate_table not ready\n" in said
    assert "cannot run" not in said


def test_what_needs_no_instrument_that_fails_can_run(rack: Callable[..., FakeRack], bench_file: str) -> None:
    rack(oscilloscope="missing")
    answer = json.loads(vcfbench("bench", "check", "--bench", bench_file, "--json").stdout)
    assert answer["procedures"]["electrical"] is None
    assert answer["procedures"]["turntable"] == "turntable opens oscilloscope, not ready"


def test_check_says_what_it_could_not_make_safe(rack: Callable[..., FakeRack], bench_file: str) -> None:
    rack(power="lies")
    done = vcfbench("bench", "check", "--bench", bench_file)
    assert done.exit_code == 5
    state = "told to switch off, not proved; last read back: on 3 s ago"
    assert f"NOT SAFE: power at FAKE::power: {state}; reported safe, but its outputs are on" in done.stderr


@pytest.mark.parametrize("simulated", [True, False])
def test_a_wrong_profile_is_a_wrong_bench_file(tmp_path: Path, *, simulated: bool) -> None:
    folder = Path(__file__).parents[2] / "examples" / "own-table"
    bench = (folder / "bench.toml").read_text("utf-8")
    (tmp_path / "bench.toml").write_text(bench if simulated else bench[: bench.index("[simulation]")], "utf-8")
    table = (folder / "table.toml").read_text("utf-8")
    asks_itself = table.replace('send = "1MO?",', 'send = "1MO?", until = "enabled",')
    (tmp_path / "table.toml").write_text(asks_itself, "utf-8")
    checked = vcfbench("bench", "check", "--bench", str(tmp_path / "bench.toml"))
    assert checked.exit_code == 2
    assert "table.toml: commands.status[0].until" in checked.stderr
