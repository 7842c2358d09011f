"""``vcfbench bench new``: finds, asks, checks each answer, writes a file that `bench check` accepts."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.clock import WallClock
from vcfbench.procedures.bench_file import load_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.runs.needs import what_can_run
from vcfbench.station.discovery import Discovery
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Self

    from typer.testing import Result

    from vcfbench.testing import ServedLab


LATITUDE = ("--set", "site.latitude_deg=48.1")


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    monkeypatch.chdir(tmp_path)


def new(*arguments: str, typed: str | None = None) -> Result:
    return CliRunner().invoke(app, ["bench", "new", *arguments, "--library", "paper@vcfbench"], input=typed)


def test_proposals_alone_make_a_bench(tmp_path: Path) -> None:
    done = new("--yes", *LATITUDE)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == "station.toml is written; next: vcfbench bench check --bench station.toml\n"
    assert "check its [limits]" in done.stderr
    assert "paper@vcfbench: simulated, without a rate table" in done.stderr
    bench = load_bench(tmp_path / "station.toml")
    assert bench.multimeter is not None
    assert (bench.multimeter.model, bench.multimeter.resource) == ("34401A", "GPIB0::22::INSTR")
    assert bench.rate_table is None
    assert bench.limits.max_rail_v == 10.5


def test_nobody_but_the_user_knows_the_latitude(tmp_path: Path) -> None:
    done = new("--yes")
    assert done.exit_code == 2
    assert "site.latitude_deg: expected the latitude of the bench" in done.stderr
    assert "--set site.latitude_deg=48.1" in done.stderr
    assert not (tmp_path / "station.toml").exists()


def test_unanswering_table_may_be_turned_by_hand(tmp_path: Path) -> None:
    done = new("hand.toml", *LATITUDE, typed="\n".join([*[""] * 4, "hand", "2", "10", "40", *[""] * 9]))
    assert done.exit_code == 0, done.stderr
    assert "No rate table answers: is there one that a person sets and reads" in " ".join(done.stderr.split())
    bench = load_bench(tmp_path / "hand.toml")
    assert bench.by_hand == ("rate_table",)
    assert bench.limits.max_rate_deg_s == 40.0
    assert max(bench.procedure.rates_deg_s) < 40.0


def test_instrument_by_hand_is_not_searched_on_bus(tmp_path: Path) -> None:
    given = ("--set", "power.by=hand", "--set", "power.model=PL330T")
    done = new("--yes", *given, *LATITUDE)
    assert done.exit_code == 0, done.stderr
    bench = load_bench(tmp_path / "station.toml")
    assert bench.by_hand == ("power",)
    assert bench.power is not None
    assert bench.power.model == "PL330T"
    assert bench.multimeter is not None
    assert bench.multimeter.resource == "GPIB0::22::INSTR"


def test_any_key_of_the_file_can_be_given(tmp_path: Path) -> None:
    given = {
        "name": "cell-2",
        "laboratory.name": "Gyroscope Laboratory",
        "multimeter.calibrated": "2026-02-28",
        "multimeter.certificate": "K-7",
        "rate_source.serial_number": "MY44021876",
        "limits.max_v_vc_v": "5",
        "wiring.oscilloscope.channel_3": "v_vc",
        "site.latitude_deg": "48.1",
        "acceptance.nonlinearity_ppm": "0,1000",
        "acceptance.guard_band": "U95",
        "expected.bias_v": "-0.1,0.1",
        "uncertainty.temperature_k": "1.5",
    }
    done = new("cell.toml", "--yes", *(word for key, value in given.items() for word in ("--set", f"{key}={value}")))
    assert done.exit_code == 0, done.stderr
    bench = load_bench(tmp_path / "cell.toml")
    assert (bench.name, bench.laboratory.name, bench.site.latitude_deg) == ("cell-2", "Gyroscope Laboratory", 48.1)
    assert bench.multimeter is not None
    assert (str(bench.multimeter.calibrated), bench.multimeter.certificate) == ("2026-02-28", "K-7")
    assert bench.rate_source is not None
    assert bench.rate_source.serial_number == "MY44021876"
    assert bench.limits.max_v_vc_v == 5
    assert bench.wiring.oscilloscope.channel_3 == "v_vc"
    assert (bench.acceptance.nonlinearity_ppm, bench.acceptance.guard_band) == ((0.0, 1000.0), "U95")
    written = (tmp_path / "cell.toml").read_text("utf-8")
    assert "\nbias_v = [-0.1, 0.1]" in written
    assert "\ntemperature_k = 1.5" in written
    assert "\n# bias_instability_deg_h = 5.6" in written  # what nobody knows stays switched off


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("limits.max_v_vc_v=50", "limits.max_v_vc_v: expected a number at least 0.001 and at most 10"),
        ("limits.max_v_vc_v=much", "limits.max_v_vc_v: expected a number at least 0.001 and at most 10, got 'much'"),
        ("multimeter.calibrated=soon", "multimeter.calibrated: expected a day, as in 2026-01-15, got 'soon'"),
        ("expected.bias_v=10", "expected.bias_v: expected a list of 2 numbers, got 10"),
        ("limits.min_rail_v=11", "limits.min_rail_v: expected less than"),
        ("name=my bench", "name: expected a text of letters, digits, '_', '-' and '.', got 'my bench'"),
        ("wiring.oscilloscope.channel_1=carrier", "a channel on 'drive'"),
        ("kettle.on=yes", "kettle: "),
        ("procedure.positive_rail_v=five", "procedure.positive_rail_v: expected volts above 0, got 'five'"),
        ("name", "--set name: expected KEY=VALUE"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(answer: str, words: str, tmp_path: Path) -> None:
    done = new("--yes", "--set", answer, *LATITUDE)
    assert done.exit_code == 2
    assert words in " ".join(done.stderr.split())
    assert not (tmp_path / "station.toml").exists()


def test_what_is_refused_is_asked_again(tmp_path: Path) -> None:
    typed = "\n".join(["kettle", *[""] * 5, "2", "10", "50000", "2", *[""] * 9])
    done = new("asked.toml", *LATITUDE, typed=typed)
    assert done.exit_code == 0, done.stderr
    shown = " ".join(done.stderr.split())
    assert "Please select one of the available options" in shown
    assert "no: asked.toml: limits.max_v_vc_v: expected a number at least 0.001 and at most 10, got 50000" in shown
    bench = load_bench(tmp_path / "asked.toml")
    assert bench.limits.max_v_vc_v == 2.0


def test_an_instrument_has_the_role_that_is_chosen(tmp_path: Path) -> None:
    done = new(*LATITUDE, typed="\n".join(["v_vc_meter", "none", *[""] * 9]))
    assert done.exit_code == 0, done.stderr
    bench = load_bench(tmp_path / "station.toml")
    assert (bench.multimeter, bench.power) == (None, None)
    assert bench.v_vc_meter is not None
    assert bench.v_vc_meter.model == "34401A"


def test_what_is_off_today_is_named_all_the_same(tmp_path: Path) -> None:
    answers = {"rate_table.resource": "COM3", "rate_table.dialect": "zaber", "rate_table.steps_per_deg": "1777.8"}
    done = new("--yes", *LATITUDE, *(word for key, value in answers.items() for word in ("--set", f"{key}={value}")))
    assert done.exit_code == 0, done.stderr
    table = load_bench(tmp_path / "station.toml").rate_table
    assert table is not None
    assert (table.dialect, table.resource, table.steps_per_deg) == ("zaber", "COM3", 1777.8)


def test_microsteps_of_a_zaber_stage_are_asked_for(tmp_path: Path) -> None:
    named = (*LATITUDE, "--set", "rate_table.resource=COM3", "--set", "rate_table.dialect=zaber")
    refused = new("--yes", *named)
    assert (refused.exit_code, (tmp_path / "station.toml").exists()) == (2, False)
    assert "--set rate_table.steps_per_deg=NUMBER" in refused.stderr
    done = new(*named, typed="\n".join([*[""] * 4, "0", "many", "1777.8", "2", "10", *[""] * 9]))
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count("no: ") == 2
    table = load_bench(tmp_path / "station.toml").rate_table
    assert table is not None
    assert table.steps_per_deg == 1777.8


@pytest.fixture(scope="module")
def served() -> Iterator[ServedLab]:
    with serve_simulated() as lab:
        yield lab


def test_a_smaller_table_has_smaller_rates(served: ServedLab, tmp_path: Path) -> None:
    given = (*LATITUDE, "--set", "limits.max_rate_deg_s=40")
    asked = ["bench", "new", "--served", str(served.control_port), "--yes", *given]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.stderr
    bench = load_bench(tmp_path / "station.toml")
    assert max(bench.procedure.rates_deg_s) == 20.0
    assert bench.served is not None


@pytest.mark.exhaustive
def test_served_instruments_are_known_without_being_told(
    served: ServedLab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VCFBENCH_CONTROL_PORT", str(served.control_port))
    tries = ("--try", served.resource("multimeter"), "--try", served.resource("power"))
    done = CliRunner().invoke(app, ["bench", "new", "--yes", *LATITUDE, *tries])
    assert done.exit_code == 0, done.stderr
    assert f"simulated, served by 127.0.0.1:{served.control_port}" in done.stderr
    assert load_bench(tmp_path / "station.toml").simulated


def test_no_file_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "station.toml").write_text("mine", "utf-8")
    refused = new("--yes")
    assert (refused.exit_code, refused.stderr) == (
        2,
        "vcfbench: station.toml is there already, and is not written over\n",
    )
    assert (tmp_path / "station.toml").read_text("utf-8") == "mine"
    assert new("nowhere/station.toml", "--yes").exit_code == 2


def test_the_end_of_the_answers_writes_nothing(tmp_path: Path) -> None:
    done = new(typed="\n\n\n")
    assert done.exit_code == 2
    assert "the input ended before the last question; no file was written" in done.stderr
    assert not list(tmp_path.glob("*.toml"))


def test_a_bench_that_nobody_serves() -> None:
    done = CliRunner().invoke(app, ["bench", "new", "--served", "1", "--yes"])
    assert done.exit_code == 3
    assert "no bench is served there" in done.stderr


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_from_a_served_bench_to_a_run_at_a_terminal(served: ServedLab, tmp_path: Path) -> None:
    due = ("--set", "multimeter.calibrated=2025-01-07", "--set", "multimeter.calibration_due=2026-01-07")
    with Terminal(tmp_path, "bench", "new", "lab.toml", "--served", str(served.control_port), *due) as terminal:
        terminal.answer("Supplies of the gyroscope", "2")
        terminal.answer("Volts of each", "10")
        terminal.answer("Highest rate, deg/s (50)", "9000")
        terminal.answer("at most 5000, got 9000", "250")
        terminal.answer("Latitude", "37.9")
        assert terminal.end() == 0
    bench = tmp_path / "lab.toml"
    checked = CliRunner().invoke(app, ["bench", "check", "--bench", str(bench)])
    assert checked.exit_code == 0, checked.output
    assert "OVERDUE since 2026-01-07" in checked.stdout
    assert "max_rate_deg_s 250" in checked.stdout
    assert "can run: turntable, virtual-coriolis" in checked.stdout
    assert "cannot run: vibration needs vibration_source, which bench lab-1 does not have" in checked.stdout
    short = ["--set", "rates_deg_s=10,0,-10", "--set", "samples=2", "--quiet"]
    run = CliRunner().invoke(app, ["run", "turntable", "--bench", str(bench), *short])
    assert run.exit_code == 0, run.output
    assert "scale factor" in run.stdout


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_ctrl_c_leaves_nothing_behind(served: ServedLab, tmp_path: Path) -> None:
    with Terminal(tmp_path, "bench", "new", "lab.toml", "--served", str(served.control_port)) as terminal:
        terminal.answer("Supplies of the gyroscope", "2")
        terminal.answer("Volts of each", "10")
        terminal.answer("Highest V_Vc", "1")
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.process.wait(20) == 4
    assert not list(tmp_path.glob("*.toml"))


class Terminal:
    """A command on a pseudo-terminal: Enter for every question but those that are answered."""

    def __init__(self, folder: Path, *words: str) -> None:
        import pty  # noqa: PLC0415

        self._ours, theirs = pty.openpty()
        command = [sys.executable, "-c", "from vcfbench.cli.main import main; main()", *words]
        environment = {**os.environ, "TERM": "dumb"}
        self.process = subprocess.Popen(  # noqa: S603  # our own command
            command, cwd=folder, env=environment, stdin=theirs, stdout=theirs, stderr=theirs
        )
        os.close(theirs)
        self._shown = ""
        self._clock = WallClock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._ours)

    def _prompt(self) -> str:
        """Return what has been shown up to the next question; empty at the end of the command."""
        shown = ""
        while not shown.endswith(": "):
            assert self._clock.now() < 60.0, self._shown
            if not select.select([self._ours], [], [], 30.0)[0]:
                break
            try:
                shown += os.read(self._ours, 4096).decode()
            except OSError:  # the command is over
                return ""
        self._shown += shown
        return shown

    def answer(self, question: str, line: str) -> None:
        """Press Enter until `question` is there, then type `line`."""
        while question not in (shown := self._prompt()):
            assert shown, f"{question!r} was never asked:\n{self._shown}"
            os.write(self._ours, b"\n")
        os.write(self._ours, line.encode() + b"\n")

    def end(self) -> int:
        """Press Enter until the command is over."""
        while self._prompt():
            os.write(self._ours, b"\n")
        return self.process.wait(20)


@pytest.mark.skipif(sys.platform != "linux", reason="a folder in which nobody can write, for root too")
def test_unwritable_folder_is_refused_before_questions() -> None:
    done = new("/proc/lab.toml", typed="")
    assert done.exit_code == 2
    assert "/proc/lab.toml: cannot be written" in done.stderr
    assert "Looking for instruments" not in done.stderr


@pytest.mark.parametrize(("supplies", "negative_v"), [("2", -5.0), ("1", None)])
def test_supplies_of_the_gyroscope_have_no_proposal(supplies: str, negative_v: float | None, tmp_path: Path) -> None:
    """Of +-10 V, which nobody had asked for, a gyroscope of 5 V would die."""
    roles = [*[""] * 4, "none"]
    refused = new(*LATITUDE, typed="\n".join([*roles, *[""] * 20]))
    assert refused.exit_code == 2
    assert "the input ended before the last question" in refused.stderr
    done = new(*LATITUDE, typed="\n".join([*roles, supplies, "", "5", *[""] * 9]))
    assert done.exit_code == 0, done.stderr
    bench = load_bench(tmp_path / "station.toml")
    assert (bench.limits.min_rail_v, bench.limits.max_rail_v) == (4.75, 5.25)
    rails = settings_of(PROCEDURES["zero"], bench).rails
    assert [each.voltage_v for each in rails] == [5.0, *([] if negative_v is None else [negative_v])]


def test_rails_that_nobody_was_asked_for_are_told(tmp_path: Path) -> None:
    assert "rails of +10 and -10 V were taken" in new("--yes", *LATITUDE).stderr
    (tmp_path / "station.toml").unlink()
    given = new("--yes", *LATITUDE, "--set", "procedure.positive_rail_v=5", "--set", "wiring.rails.negative=none")
    assert given.exit_code == 0
    assert "were taken" not in given.stderr


def test_the_mains_are_asked(tmp_path: Path) -> None:
    done = new(*LATITUDE, typed="\n".join([*[""] * 4, "none", "2", "10", *[""] * 2, "55", "60", ""]))
    assert done.exit_code == 0, done.stderr
    assert "no: " in done.stderr
    assert load_bench(tmp_path / "station.toml").site.mains_hz == 60


STREAMED = ("--set", "gyro.stream.profile=imu.toml", "--set", "gyro.stream.resource=/dev/ttyUSB7")


@pytest.mark.parametrize("unit", ["deg/s", "LSB"])
def test_stream_is_an_output_like_a_meter_and_counts_are_asked_for(
    unit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = Discovery("@py", (), (), ())
    monkeypatch.setattr("vcfbench.station.discovery.discover", lambda *_given, **_named: nothing)
    keys = f'unit = "{unit}"\nsample_rate_hz = 100.0\nheader = "A5"\nlength = 8\nvalue = {{ at = 2 }}\n'
    (tmp_path / "imu.toml").write_text(keys, "utf-8")
    said = CliRunner().invoke(app, ["bench", "new", "a.toml", "--yes", *LATITUDE, *STREAMED])
    assert said.exit_code == 0, said.stderr
    assert ("--set procedure.scale_factor_v_per_deg_s=" in said.stderr) == (unit == "LSB")
    typed = "none\nnone\n48.1\n50\n" + ("131\n" if unit == "LSB" else "")
    asked = CliRunner().invoke(app, ["bench", "new", "b.toml", *STREAMED], input=typed)
    assert asked.exit_code == 0, asked.stderr
    assert "multimeter" not in asked.stderr
    scale_factor = load_bench(tmp_path / "b.toml").procedure_table.get("scale_factor_v_per_deg_s")
    assert scale_factor == (131 if unit == "LSB" else None)
    lacks = what_can_run(load_bench(tmp_path / "a.toml"))
    assert (lacks["zero"] is None) == (unit != "LSB")
    assert "temperature needs rate_source or rate_table" in str(lacks["temperature"])


def test_instruments_useless_beside_a_stream_are_left_out(tmp_path: Path) -> None:
    streamed = ("--set", "gyro.stream.profile=vn100", "--set", "gyro.stream.resource=/dev/ttyUSB7")
    done = new("a.toml", *streamed, "--yes", *LATITUDE)
    assert done.exit_code == 0, done.stderr
    assert "34401A at GPIB0::22::INSTR is left out: the output is a stream" in done.stderr
    assert "33220A at USB0::0x0957::0x0407::MY44021876::0::INSTR is left out: the output is a stream" in done.stderr
    assert "DSO7104B at USB0::0x0957::0x175D::MY49520121::0::INSTR is left out: the output is a stream" in done.stderr
    bench = load_bench(tmp_path / "a.toml")
    assert (bench.rate_source, bench.oscilloscope) == (None, None)


@pytest.mark.exhaustive
def test_served_stream_is_told_as_one(tmp_path: Path) -> None:
    sim = CliRunner().invoke(app, ["sim", "new", "sim.toml", "--stream", "vn100"])
    assert sim.exit_code == 0
    with serve_simulated(load_bench(tmp_path / "sim.toml")) as lab:
        done = CliRunner().invoke(app, ["bench", "new", "--served", str(lab.control_port), "--yes", *LATITUDE])
        assert "a stream: --set gyro.stream.resource=socket://127.0.0.1:" in done.stderr, done.output
