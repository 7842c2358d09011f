"""Benches whose table, supply and meter are in the hands of a person: typed to a record, and to a safe bench."""

from __future__ import annotations

import json
import os
import random
import re
import select
import subprocess
import sys
from pathlib import Path
from threading import Event

import pytest

import vcfbench
from tests import warm
from tests.cells import few
from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.bench.make_safe import safe_bench
from vcfbench.cli import person as at
from vcfbench.clock import WallClock, sleep
from vcfbench.drivers.hands import HandMeter, Hands, HandTable
from vcfbench.errors import ConfigError, LimitError, MeasurementError, NotSafe, PlanError
from vcfbench.interfaces import Request
from vcfbench.page.panel import Panel
from vcfbench.runs.batch import read_batch
from vcfbench.runs.resumed import resume
from vcfbench.safety.control import RunState
from vcfbench.safety.signals import StopSignals
from vcfbench.station.file import read_bench

SCALE_FACTOR, BIAS_V = -0.01254, -0.042
BENCH = """
name = "bench-2"
title = "a table by hand and one meter"

[power]
by = "hand"
model = "PL330T"
inventory_number = "GL-004"

[multimeter]
by = "hand"
model = "34401A"
resolution_v = 1e-4
calibrated = 2026-01-15

[rate_table]
by = "hand"
model = "Genisco 1181"
axis_sign = -1

[limits]
max_rate_deg_s = 60.0
max_acceleration_deg_s2 = 5000.0
min_rail_v = 9.0
max_rail_v = 11.0
max_rail_current_a = 0.1

[site]
latitude_deg = 48.1

[procedure]
rates_deg_s = [-50, -25, 25, 50]
acceleration_deg_s2 = 5000.0
samples = 3
sample_interval_s = 0.05
nplc = 1
settle_s = 0.01
warm_up_s = 0
rate_tolerance_deg_s = 0.1
drive.start_up_s = 0.01
"""


class Person:
    """Who does and types what is asked, the table's display in its own sign; `refuses` finds what gets no answer."""

    def __init__(self, refuses: str = "^$") -> None:
        self.refuses = refuses
        self.shown_deg_s = 0.0
        self.on = False
        self.asked: list[str] = []
        self.read = ""
        self.noise = random.Random(1)  # noqa: S311

    def __call__(self, request: Request) -> str:
        self.asked.append(request.words)
        answer = self.typed(request.words)
        assert bool(answer) == bool(request.types)
        if re.search(self.refuses, request.words):
            raise MeasurementError("the person has gone home")
        return answer

    def typed(self, words: str) -> str:
        """Do what the words say, and return what is typed."""
        if found := re.search(r"turn the rate table at (\S+) deg/s", words):
            self.shown_deg_s = float(found[1])
        elif "to rest" in words or "once it is stopped" in words:
            self.shown_deg_s = 0.0
        elif "outputs of the supply" in words:
            self.on = "supply on" in words
        elif words.startswith("type the multimeter") and "again" not in words:
            output_v = BIAS_V - SCALE_FACTOR * self.shown_deg_s + self.noise.gauss(0.0, 1e-4)
            self.read = f"{output_v if self.on else 0.0:.4f}".replace(".", ",")
        for asked, answer in (
            ("rate", f"{self.shown_deg_s:g}"),
            ("reading", self.read),
            ("type off", "off"),
            ("voltage of the positive", "10.0"),
            ("voltage of the negative", "-10.0"),
            ("current of", "0.03"),
            ("(cv)", "CV"),
        ):
            if asked in words and "type" in words:
                return answer
        return ""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))
    file = tmp_path / "hand.toml"
    file.write_text(BENCH, encoding="utf-8")
    return file


def lines_of(run: vcfbench.Run) -> list[dict[str, object]]:
    assert run.directory is not None
    return [json.loads(line) for line in (run.directory / "journal.jsonl").read_text(encoding="utf-8").splitlines()]


def test_turntable_by_hand_gives_values_and_record(bench: Path, tmp_path: Path) -> None:
    person = Person()
    run = vcfbench.run("turntable", bench, operator=person, runs=tmp_path / "runs", metadata={"dut": "G9"})
    stated = run.results.uncertainty
    assert abs(run.results.scale_factor.value - SCALE_FACTOR) <= stated.value("scale_factor").u95 < 1e-4
    assert abs(run.results.bias.value - BIAS_V) <= stated.value("bias").u95
    assert not run.simulated
    assert (person.on, person.shown_deg_s) == (False, 0.0)
    header, *lines = lines_of(run)
    assert header["identities"]["rate_table"] == {
        "maker": "by hand",
        "model": "Genisco 1181",
        "serial": "",
        "firmware": "",
    }  # type: ignore[index]
    assert header["settings"]["station"]["meter_resolution_v"] == 1e-4  # type: ignore[index]
    [on] = [line for line in lines if line.get("step_kind") == "EnableSupply"]
    assert on["by_hand"] == [["switch the outputs of the supply on", ""]]
    asked = [words for line in lines for words, _ in line.get("by_hand", ())]  # type: ignore[attr-defined]
    assert asked == person.asked[:-2]  # all but what made it safe, which is in the footer
    details = {each["instrument"]: each["detail"] for each in lines[-1]["safe"]}  # type: ignore[attr-defined,index]
    assert details["power"] == "off, as typed by the operator"
    assert details["rate_table"] == "0 deg/s, as typed by the operator"
    loaded = vcfbench.load_run(run.directory)
    assert loaded.results.scale_factor == run.results.scale_factor
    assert {each.role: each.model for each in loaded.equipment}["rate_table"] == "Genisco 1181"


@pytest.mark.parametrize(
    ("gone", "named"),
    few(
        [("once it is stopped", "rate_table"), ("type off", "power"), ("switch .* supply off$", "")],
        ("type off", "power"),
    ),
)
def test_what_nobody_confirms_is_not_safe(bench: Path, tmp_path: Path, gone: str, named: str) -> None:
    said = rf"NOT SAFE: {named} at hand://bench-2/{named}: could not be told .*not confirmed as safe"
    with pytest.raises(NotSafe if named else MeasurementError, match=said if named else "gone home"):
        vcfbench.run("turntable", bench, operator=Person(gone), runs=tmp_path / "runs")


@pytest.mark.exhaustive
def test_a_person_who_does_not_answer_leaves_it_unsafe(bench: Path) -> None:
    bench.write_text(BENCH.replace('"PL330T"', '"PL330T"\ntimeout_s = 0.1'), encoding="utf-8")
    gone, person = Event(), Person()

    def asleep(request: Request) -> str:
        if "type off" in request.words:
            gone.wait(60.0)
        return person(request)

    failure = safe_bench(bench, operator=asleep).failure()
    gone.set()
    assert "power at hand://bench-2/power" in str(failure)
    assert "still busy after 2.4 s" in str(failure)
    assert "rate_table" not in str(failure)


@pytest.mark.exhaustive
def test_a_run_that_was_broken_off_goes_on_by_hand(bench: Path, tmp_path: Path) -> None:
    first = Person(r"turn the rate table at -25")
    with pytest.raises(MeasurementError, match="gone home") as caught:
        vcfbench.run("turntable", bench, operator=first, runs=tmp_path / "runs")
    second = Person()
    run = resume(caught.value.run, bench, operator=second, runs=tmp_path / "runs")
    assert abs(run.results.scale_factor.value - SCALE_FACTOR) <= 1e-4
    assert len(run.points) == 4
    read = [
        sum(words.startswith("type the multimeter's reading (") for words in each.asked) for each in (first, second)
    ]
    assert read[0] + read[1] == 6 * 3
    assert min(read) >= 6


def test_nobody_to_ask_is_found_before_the_bench_is_touched(bench: Path, tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="asks a person to set and read the power by hand, and 2 more, but no operator"):
        vcfbench.run("turntable", bench, runs=tmp_path / "runs")
    assert "no operator can be asked" in str(safe_bench(bench).failure())


def test_the_bench_is_checked_and_made_safe_by_hand(bench: Path) -> None:
    done = check_bench(read_bench(bench), operator=Person())
    assert done.failure() is None
    assert [each.role for each in done.instruments] == ["power", "multimeter", "rate_table"]
    person = Person()
    person.on, person.shown_deg_s = True, 20.0
    assert safe_bench(bench, operator=person).failure() is None
    assert (person.on, person.shown_deg_s) == (False, 0.0)


def test_nobody_is_asked_for_what_is_beyond_the_limits(bench: Path) -> None:
    person = Person()
    with open_bench(bench, operator=person) as opened:
        person.asked.clear()
        with pytest.raises(LimitError):
            opened.rate_table.set_rate(61.0, 10.0)
        with pytest.raises(LimitError):
            opened.power.configure_output("P25V", 12.0, 0.05)
        assert person.asked == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('by = "hand"\nmodel = "PL', 'by = "foot"\nmodel = "PL'), "power.by: expected 'hand'"),
        (("resolution_v = 1e-4\n", ""), "multimeter.resolution_v: expected the step of the last digit that is typed"),
        (('model = "34401A"', 'model = "F87"'), "multimeter.model: expected '34401A'"),
        (("[site]", '[v_vc_meter]\nby = "hand"\nmodel = "34401A"\n[site]'), "v_vc_meter"),
        (("[site]", "[simulation]\n[site]"), "power.resource: expected a text"),
    ],
)
def test_what_cannot_be_by_hand_is_refused(bench: Path, change: tuple[str, str], said: str) -> None:
    bench.write_text(BENCH.replace(*change), encoding="utf-8")
    with pytest.raises(ConfigError, match=said):
        read_bench(bench)


def test_on_a_simulated_bench_the_program_is_the_hands(tmp_path: Path) -> None:
    text = BENCH.replace('"PL330T"', '"E3631A"\nresource = "GPIB0::5::INSTR"')
    text = text.replace('"34401A"', '"34401A"\nresource = "GPIB0::22::INSTR"')
    text = text.replace('"Genisco 1181"', '"Genisco 1181"\ndialect = "acl"\nresource = "COM3"')
    text = text.replace("5000.0", "50.0")
    (tmp_path / "simulated.toml").write_text(f"{text}\n[simulation]\n", encoding="utf-8")
    run = vcfbench.run("turntable", tmp_path / "simulated.toml", runs=None)
    assert run.results.scale_factor.value == pytest.approx(-SCALE_FACTOR, rel=0.01)  # axis_sign


@pytest.mark.exhaustive
def test_a_person_types_a_calibration_at_the_panel(bench: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text('name = "lot-9"\nbench = "hand.toml"\n[[runs]]\nprocedure = "turntable"\n', encoding="utf-8")
    panel, person, runs = Panel(read_batch(plan), tmp_path / "runs"), Person(), tmp_path / "runs"
    under_way = vcfbench.start("turntable", bench, operator=panel.person(StopSignals()), runs=runs)
    while under_way.state is not RunState.OVER:
        if (shown := panel.shown())["state"] == "asking":
            panel.answer(person.typed(shown["asked"]))
        sleep(WallClock(), 0.005)
    assert abs(under_way.result().results.scale_factor.value - SCALE_FACTOR) <= 1e-4
    assert (person.on, person.shown_deg_s) == (False, 0.0)


def typed_at_a_terminal(bench: Path, silent: str = "^$") -> tuple[int, str, Person]:
    """Run the calibration at a terminal; return exit code, what it said, and the person, who leaves `silent` alone."""
    main, terminal = os.openpty()
    command = ["-m", "vcfbench", "run", "turntable", "--bench", str(bench), "--runs", str(bench.parent / "runs")]
    process = subprocess.Popen([sys.executable, *command], stdin=terminal, stdout=terminal, stderr=terminal)  # noqa: S603
    os.close(terminal)
    os.write(main, b"9")  # before anything is asked
    person, said, answered, clock = Person(), "", 0, WallClock()
    while process.poll() is None and clock.now() < 60.0:
        if select.select([main], [], [], 0.2)[0]:
            try:
                said += os.read(main, 65536).decode()
            except OSError:
                break
            *earlier, words = re.findall(r"Please (.*), then press Enter:", said) or [""]
            if len(earlier) + 1 > answered and words:
                answered += 1
                if not re.search(silent, words):
                    os.write(main, f"{person.typed(words)}\n".encode())
    os.close(main)
    return process.wait(10.0), said, person


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_a_person_types_a_calibration_at_the_terminal(bench: Path) -> None:
    code, said, person = typed_at_a_terminal(bench)
    assert code == 0, said
    assert "complete: " in said
    assert "shows again" not in said.partition("DC volts")[0]
    assert (person.on, person.shown_deg_s) == (False, 0.0)


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_terminal_without_a_person_is_not_waited_for(bench: Path) -> None:
    bench.write_text(BENCH.replace('by = "hand"', 'by = "hand"\ntimeout_s = 0.2'), encoding="utf-8")
    code, said, _ = typed_at_a_terminal(bench, silent="once it is stopped")
    assert code == 5, said
    assert "NOT SAFE: rate_table at hand://bench-2/rate_table: could not be told to stop" in said


def test_repeated_question_shows_last_entry(bench: Path) -> None:
    asked: list[str] = []
    answers = iter(["done", "", "", "0.5100", "2.5000", "2.5000", "done", "50", "50", "25", "26", "25", "25"])

    def typing(request: Request) -> str:
        asked.append(request.words.removeprefix("type the ").partition(" (")[0] + request.words.partition(")")[2])
        return next(answers)

    hands, description = Hands(), read_bench(bench)
    hands.operator = typing
    meter = HandMeter("multimeter", description.multimeter, hands, {})
    table = HandTable("rate_table", description.rate_table, hands, {"max_rate_deg_s": 60.0})
    meter.configure_dc_voltage(10.0, 1.0)
    assert [meter.read_voltage_v(), meter.read_voltage_v()] == [0.51, 2.5]
    table.set_rate(-25.0, 10.0)
    assert [table.rate_deg_s(), table.rate_deg_s()] == [-50.0, -25.0]
    reading, rate = "multimeter's reading", "rate that the table shows"
    again = f"{reading} again, as it shows now, for it has moved"
    assert asked[1:6] == [reading, *[f"{reading}, not Enter alone"] * 2, reading, again]
    told = (rate, f"{rate}, expected 25, 50 was typed", f"{rate}, 25 and then 26 were typed")
    assert asked[7:] == [words for each in told for words in (each, f"{rate} again")]


def test_enter_alone_is_done_where_nothing_is_to_be_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(at, "somebody_there", lambda: True)
    monkeypatch.setattr(at, "_line", lambda _: "\n")
    ask = at.at_the_terminal(None, None)
    assert ask is not None
    assert [ask(Request("mount it")), ask(Request("type it", types="V"))] == ["done", ""]


@pytest.mark.exhaustive
def test_check_without_terminal_is_refused_before_questions(bench: Path, tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "bench", "check", "--bench", str(bench)], tmp_path)
    assert done.returncode == 2, done.stderr
    assert "bench check asks a person about power, multimeter, rate_table, but no operator can be asked" in done.stderr
    assert "NOT SAFE" not in done.stderr


def test_bus_meter_replaces_meter_by_hand(bench: Path) -> None:
    page = (Path(__file__).parents[1] / "docs" / "howto" / "by-hand.md").read_text(encoding="utf-8")
    by_hand, on_a_bus = re.findall(r"\[multimeter\].*?\n(?=\n|```)", page, re.DOTALL)
    shown = re.search(r'title="hand.toml"\n(.*?)```', page, re.DOTALL)
    assert shown is not None
    bench.write_text(shown[1].replace(by_hand, on_a_bus), encoding="utf-8")
    meter = read_bench(bench).multimeter
    assert meter is not None
    assert (meter.by, meter.resource) == (None, "ASRL/dev/ttyUSB0::INSTR")
