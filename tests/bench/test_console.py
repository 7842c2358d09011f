"""Conversations with the simulated instruments, and what is physically there when they are left."""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

import pytest
from msgspec import structs

from vcfbench.bench.console import open_console, summary
from vcfbench.errors import Aborted, ConfigError, DeadlineExceeded, InterlockError, LimitError
from vcfbench.procedures.bench_file import load_bench
from vcfbench.records.raw import RawRecord
from vcfbench.sim.builder import SimulatedBench
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.bench.console import Console
    from vcfbench.clock import Clock
    from vcfbench.sim.world import World
    from vcfbench.station.description import BenchDescription

PAPER = load_bench(None)
PROVED_V = 0.5
"""Below this the supply's driver takes an output as off; its last tenths of a volt go by themselves."""


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> list[World]:
    made: list[World] = []
    build = SimulatedBench.build

    def remember(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = build(description, seed, clock)
        made.append(bench.world)
        return bench

    monkeypatch.setattr(SimulatedBench, "build", remember)
    return made


def feed(console: Console, world: World) -> None:
    console.say("APPL P25V,10,0.1;:OUTP ON")
    console.wait(1.0)
    assert world.value_v("rail_positive") == pytest.approx(10.0, abs=0.1)


def test_answers_and_the_error_queue(tmp_path: Path) -> None:
    with open_console("multimeter", PAPER, raw=RawRecord(tmp_path, "paper")) as console:
        assert console.identity.model == "34401A"
        said = console.say("*IDN?")
        assert said.answer is not None
        assert (summary(said.answer), said.refusal) == ("HEWLETT-PACKARD,34401A,0,11-5-2", None)
        assert console.say("CONF:VOLT:DC 10").answer is None
        refused = console.say("VOLT:DC:RANG 1E9")
        assert (refused.answer, refused.refusal) == (None, 'refused with -222 "Data out of range"')
        assert console.errors() is None


def test_a_question_that_is_not_known_says_why_there_is_no_answer() -> None:
    with open_console("multimeter", PAPER) as console:
        with pytest.raises(DeadlineExceeded, match="Undefined header"):
            console.say("WHAT?")
        assert console.say("*OPC?").answer == b"1"


def test_blocks_come_whole(tmp_path: Path) -> None:
    with open_console("oscilloscope", PAPER, raw=RawRecord(tmp_path, "paper")) as console:
        answer = console.say(":DIG;:WAV:POIN 1000;:WAV:DATA?").answer
        assert answer is not None
        assert answer[:10] == b"#800001000"
        assert len(answer) == 1010
        assert summary(answer).startswith("block of 1000 bytes: ")
        assert console.say("*OPC?").answer == b"1"


def test_a_table_driven_raw_is_left_at_rest(worlds: list[World], tmp_path: Path) -> None:
    with open_console("rate_table", PAPER, raw=RawRecord(tmp_path, "paper")) as console:
        for message in (":Limit:Acceleration R,1,100;:Demand:Rate 1,20", ":Mode:Rate 1", ":Interlock:Close 1"):
            assert console.say(message).refusal is None
        console.wait(3.0)
        assert worlds[0].table.rate_deg_s() == pytest.approx(20.0, abs=0.1)
        assert float(console.say(":Read:Rate? 1").answer or b"nan") == pytest.approx(20.0, abs=0.1)
        assert console.say(":Read:Rate 1").answer is not None
        refusal = console.say(":Utility:Lockout MAYBE").refusal
        assert refusal is not None
        assert refusal.startswith("refused with")
    assert worlds[0].table.rate_deg_s() == 0.0
    assert not worlds[0].table.servo_closed


def test_a_supply_is_switched_off_when_left_whatever_happened(worlds: list[World], tmp_path: Path) -> None:
    def break_off(console: Console) -> None:
        feed(console, worlds[0])
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), open_console("power", PAPER, raw=RawRecord(tmp_path, "paper")) as console:
        break_off(console)
    assert abs(worlds[0].value_v("rail_positive")) < PROVED_V


@pytest.mark.parametrize(
    "message",
    ["OUTP ON", "*IDN?;:OUTP ON", "VOLT 1 ?", "*TST?", "CAL?", "*CAL?", "MEAS:RES?", ":MEASURE:SCALAR:FRES? 1", "?;A"],
)
def test_a_line_that_is_not_one_question_needs_raw(message: str) -> None:
    with open_console("power", PAPER) as console, pytest.raises(LimitError, match="nothing was sent"):
        console.say(message)


def test_a_raw_command_passes_the_limits_and_the_supply_is_off_afterwards(worlds: list[World], tmp_path: Path) -> None:
    with open_console("power", PAPER) as console, pytest.raises(LimitError, match="compared with no limit"):
        console.say("OUTP ON;:VOLT 25")
    with open_console("power", PAPER, raw=RawRecord(tmp_path, "paper")) as console:
        console.say("INST P25V;:VOLT 15;:OUTP ON")
        console.wait(1.0)
        assert worlds[1].value_v("rail_positive") == pytest.approx(15.0, abs=0.1)
    assert abs(worlds[1].value_v("rail_positive")) < PROVED_V


@pytest.mark.parametrize("role", ["vibration_source", "kettle"])
def test_roles_that_are_not_there_are_named(role: str) -> None:
    with pytest.raises(ConfigError, match="there are power, rate_source"), open_console(role, PAPER):
        pytest.fail("it opened")


def test_what_instruments_do_not_know_is_not_sent() -> None:
    with open_console("oscilloscope", PAPER) as console, pytest.raises(ConfigError, match="nothing was sent"):
        console.say(":CHAN1:LAB 'µ'")


def test_a_table_found_turning_is_refused_and_stopped(worlds: list[World], monkeypatch: pytest.MonkeyPatch) -> None:
    build = SimulatedBench.build

    def turning(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = build(description, seed, clock)
        bench.world.table.close_servo()
        bench.world.table.demand_rate(50.0, 100.0)
        clock.sleep_until(2.0)
        return bench

    monkeypatch.setattr(SimulatedBench, "build", turning)
    with pytest.raises(InterlockError, match="before anything"), open_console("rate_table", PAPER):
        pytest.fail("it opened")
    assert worlds[0].table.rate_deg_s() == 0.0


def test_ctrl_c_while_a_person_types_leaves_safely(worlds: list[World], tmp_path: Path) -> None:
    def press() -> str:
        signal.raise_signal(signal.SIGINT)
        return "never sent"

    def type_while_it_is_on(console: Console) -> None:
        feed(console, worlds[0])
        console.read_line(press)

    with (
        pytest.raises(Aborted, match="SIGINT"),
        open_console("power", PAPER, raw=RawRecord(tmp_path, "paper")) as console,
    ):
        type_while_it_is_on(console)
    assert abs(worlds[0].value_v("rail_positive")) < PROVED_V


def test_a_typed_line_is_what_was_typed() -> None:
    with open_console("multimeter", PAPER) as console:
        assert console.read_line(lambda: "*IDN?") == "*IDN?"
        assert not console.closed
        console.clear()
        assert console.say("*OPC?").answer == b"1"


@pytest.mark.parametrize(
    ("answer", "shown"),
    [
        (b"+1.0", "+1.0"),
        (b"#15abcde", "block of 5 bytes: 61 62 63 64 65"),
        (b"#220" + bytes(20), "block of 20 bytes: " + " ".join(["00"] * 16) + " ..."),
        (b"\xff\x00", "2 bytes that are no text: ff 00"),
        (b"", ""),
    ],
)
def test_answers_as_people_read_them(answer: bytes, shown: str) -> None:
    assert summary(answer) == shown


@pytest.mark.parametrize(
    ("role", "lines"),
    [
        ("power", {"APPL P25V,10,0.1;:OUTP ON": None, "OUTP?": b"1", "MEAS:VOLT? P6V": b"+0.00000000E+00"}),
        ("rate_table", {":Demand:Rate 1,0": None, ":Demand:Rate? 1": b"0.00000"}),
    ],
)
def test_a_real_station_is_spoken_to_over_its_wires(
    role: str, lines: dict[str, bytes | None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    with serve_simulated("ideal") as served:
        there = structs.replace(getattr(served.description, role), resource=served.resource(role))
        station = structs.replace(served.description, simulation=None, visa_library="@py", **{role: there})
        with open_console(role, station, raw=RawRecord(tmp_path, "paper")) as console:
            assert {line: console.say(line).answer for line in lines} == lines
        assert served.ask("get", name="rail.positive.current_a") == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("dialect", "settings", "asked", "answer"),
    [
        ("zaber", {"steps_per_deg": 1000.0}, "/1 get deviceid", "@01 0 OK IDLE"),
        ("atl", {}, "PVE", "0.0"),
        ("esp", {}, "1TP?", "0"),
    ],
)
def test_tables_with_other_languages_are_spoken_to_as_well(
    dialect: str, settings: dict[str, float], asked: str, answer: str, tmp_path: Path
) -> None:
    table = structs.replace(PAPER.rate_table, dialect=dialect, **settings)
    described = structs.replace(PAPER, rate_table=table)
    with open_console("rate_table", described) as console, pytest.raises(LimitError, match="nothing was sent"):
        console.say(asked)
    with open_console("rate_table", described, raw=RawRecord(tmp_path, "paper")) as console:
        assert answer in summary(console.say(asked).answer or b"")
