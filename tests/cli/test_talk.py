"""``vcfbench talk``: the whole bench at one prompt."""

from __future__ import annotations

import json
import os
import re
import select
import signal
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from simrack_tests.cells import few
from typer.testing import CliRunner

from vcfbench.bench.console import summary
from vcfbench.cli.main import app
from vcfbench.procedures.bench_file import load_bench
from vcfbench.runs.by_hand import WORDS, ByHand
from vcfbench.station.writing import bench_text
from vcfbench.testing import read_trace

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from typer.testing import Result


def talk(*lines: str, options: tuple[str, ...] = ()) -> Result:
    return CliRunner().invoke(app, ["talk", *options, *(word for line in lines for word in ("-c", line))])


def test_the_bench_is_measured_with_by_hand(tmp_path: Path) -> None:
    trace = tmp_path / "x.trace"
    lines = ("power.on", "multimeter.read", "v_vc.set 0.1", "wait 3", "multimeter.read", "v_vc.off")
    done = talk(*lines, options=("--seed", "1", "--trace", str(trace)))
    assert done.exit_code == 0, done.stderr
    rails, before, _, _, after, _ = done.stdout.splitlines()
    assert re.fullmatch(r"P25V \+(9\.9|10\.0)\d+ V 0\.0\d+ A, N25V -(9\.9|10\.0)\d+ V 0\.0\d+ A", rails)
    change_v = float(after.split()[0]) - float(before.split()[0])
    assert change_v == pytest.approx(-12.5e-3 * 150.0 * 0.1 + 51.7e-3, abs=0.02)  # the switch shifts it by 51.7 mV
    assert "supply outputs on" in done.stderr
    sent = [(line.role, line.data.decode()) for line in read_trace(trace) if line.mark == ">"]
    off_first = sent.index(("rate_source", "OUTP OFF\n"))
    assert off_first < sent.index(("power", "OUTP ON\n")) < sent.index(("rate_source", "OUTP ON\n"))
    levels = [n for n, (role, text) in enumerate(sent) if role == "power" and ":CURR 0.1;:VOLT" in text]
    assert len(levels) == 2
    assert max(levels) < sent.index(("power", "OUTP ON\n"))
    last = {role: text for role, text in sent if text.startswith("OUTP O")}
    assert last == {"power": "OUTP OFF\n", "rate_source": "OUTP OFF\n"}


def test_reading_of_a_stream_has_its_unit_and_no_meter(tmp_path: Path) -> None:
    bench = tmp_path / "own.toml"
    assert CliRunner().invoke(app, ["sim", "new", str(bench), "--stream", "adis16495", "--bias", "3"]).exit_code == 0
    said = talk("multimeter.read", options=("--bench", str(bench)))
    assert said.exit_code == 0, said.stderr
    value, unit = said.stdout.split()
    assert (float(value), unit) == (pytest.approx(3.0, abs=0.1), "deg/s")
    assert "line cycles" not in said.stderr


def test_table_turns_and_stops_and_lines_pass_unchanged() -> None:
    done = talk("table.rate 10", "table.read", "table.stop", "table.read", "multimeter *IDN?", "scope *OPC?", "safe")
    assert done.exit_code == 0, done.stderr
    rate, read, _, at_rest, identity, complete, safe = done.stdout.splitlines()
    assert float(rate.split()[0]) == pytest.approx(10.0, abs=0.01)
    assert read.startswith("+10.0")
    assert abs(float(at_rest.split()[0])) < 0.01
    assert (identity, complete) == ("HEWLETT-PACKARD,34401A,0,11-5-2", "1")
    assert safe == "table at rest, outputs off"


@pytest.mark.parametrize(
    ("line", "code", "words"),
    few(
        [
            (
                "table.rate 400",
                3,
                "rate_table: rate 400 deg/s is beyond the bench's limit of 300 deg/s; limits.max_rate_deg_s",
            ),
            ("v_vc.set 11", 3, "rate_source: voltage 11 V is beyond the bench's limit of 10 V; limits.max_v_vc_v"),
            ("v_vc.sine 10 11", 3, "peak voltage 11 V is beyond the bench's limit of 10 V; limits.max_v_vc_v"),
            ("v_vc.set 1", 3, "the PCB has no power, nothing was sent; type power.on first"),
            ("power APPL P25V,12,0.1", 3, "the limits of the bench are not checked for a raw command"),
            ("multimeter FOO?", 3, "Undefined header"),
            ("multimeter", 2, "expected a command to send, as in multimeter *IDN?"),
            ("table.rate fast", 2, "table.rate DEG_S: DEG_S: expected a number, got 'fast'"),
            ("table.rate", 2, "expected 'table.rate DEG_S', got 'table.rate'"),
            ("wait -1", 2, "expected seconds, from 0 to 86400"),
            ("table.rat 10", 2, "there is no command 'table.rat' ('table.rate'?)"),
            ("chamber.read", 2, "'chamber.read': bench paper has no chamber"),
        ],
        every=4,
    ),
)
def test_what_is_refused_ends_it_with_the_reason(line: str, code: int, words: str) -> None:
    done = talk(line, "multimeter *IDN?")
    assert (done.exit_code, done.stdout) == (code, "")
    assert words in done.stderr


@pytest.mark.parametrize(
    "message",
    few(
        [
            "OUTP ON",
            "*IDN?;:OUTP ON",
            "VOLT 1 ?",
            "*TST?",
            "CAL?",
            "*CAL?",
            "MEAS:RES?",
            ":MEASURE:SCALAR:FRES? 1",
            "?;A",
        ],
        every=3,
    ),
)
def test_a_line_that_is_not_one_question_needs_raw(message: str) -> None:
    done = talk(f"power {message}")
    assert done.exit_code == 3
    assert "nothing was sent" in done.stderr
    assert "--raw sends it and writes it down" in done.stderr


def test_a_raw_command_is_written_down_before_it_is_sent(tmp_path: Path) -> None:
    options = ("--raw", "--runs", str(tmp_path))
    done = talk("power APPL P25V,12", "power APPL? P25V", "power FOO", options=options)
    assert (done.exit_code, done.stdout) == (3, '"12.000000,1.000000"\n')
    assert done.stderr.startswith("raw commands: nothing is compared with the limits")
    assert "reports -113" in done.stderr
    lines = [json.loads(line) for line in (tmp_path / "raw.jsonl").read_text("utf-8").splitlines()]
    assert [line["command"] for line in lines] == ["APPL P25V,12", "FOO"]
    assert {(line["bench"], line["role"], line["resource"]) for line in lines} == {
        ("paper", "power", "GPIB0::5::INSTR")
    }


def test_raw_command_is_not_sent_if_log_fails(tmp_path: Path) -> None:
    (tmp_path / "raw.jsonl").mkdir()
    done = talk("power APPL P25V,12", options=("--raw", "--runs", str(tmp_path)))
    assert done.exit_code == 3
    assert "raw.jsonl cannot be written: Is a directory" in done.stderr


def test_what_instruments_do_not_know_is_not_sent() -> None:
    done = talk("scope :CHAN1:LAB 'µ'")
    assert done.exit_code == 2
    assert "nothing was sent" in done.stderr


def test_blocks_are_said_by_their_size(tmp_path: Path) -> None:
    lines = ("scope :DIG;:WAV:POIN 1000;:WAV:DATA?", "scope *OPC?")
    done = talk(*lines, options=("--raw", "--runs", str(tmp_path)))
    assert done.stdout.startswith("block of 1000 bytes: ")
    assert done.stdout.endswith("\n1\n")


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


def test_raw_commands_leave_table_at_rest_and_supply_off(tmp_path: Path) -> None:
    lines = (
        *("power APPL P25V,10,0.1;:OUTP ON", "table :Limit:Acceleration R,1,100;:Demand:Rate 1,20"),
        *("table :Mode:Rate 1", "table :Interlock:Close 1", "wait 3", "table :Read:Rate? 1", "table :Read:Rate 1"),
    )
    trace = tmp_path / "x.trace"
    done = talk(*lines, options=("--raw", "--runs", str(tmp_path), "--trace", str(trace)))
    assert done.exit_code == 0, done.stderr
    assert [float(line) for line in done.stdout.splitlines()[1:]] == [pytest.approx(20.0, abs=0.1)] * 2
    sent = [(line.role, line.data) for line in read_trace(trace) if line.mark == ">"]
    assert ("power", b"OUTP OFF\n") in sent
    assert any(role == "rate_table" and b":Demand:Rate 1,0" in data for role, data in sent)


@pytest.mark.parametrize(
    ("dialect", "settings", "asked", "answer"),
    few(
        [
            ("zaber", {"steps_per_deg": 1000.0}, "/1 get deviceid", "@01 0 OK IDLE"),
            ("atl", {}, "PVE", "0.0"),
            ("esp", {}, "1TP?", "0"),
        ],
        every=3,
    ),
)
def test_tables_with_other_languages_are_spoken_to_as_well(
    dialect: str, settings: dict[str, float], asked: str, answer: str, tmp_path: Path
) -> None:
    paper = load_bench(None)
    table = structs.replace(paper.rate_table, dialect=dialect, **settings)
    file = tmp_path / "bench.toml"
    file.write_text(bench_text(structs.replace(paper, rate_table=table)), "utf-8")
    done = talk(f"table {asked}", options=("--bench", str(file)))
    assert (done.exit_code, "nothing was sent" in done.stderr) == (3, True)
    done = talk(f"table {asked}", options=("--bench", str(file), "--raw", "--runs", str(tmp_path)))
    assert answer in done.stdout


def test_help_shows_the_words_of_this_bench() -> None:
    shown = talk("help").stderr
    assert "table.rate DEG_S" in shown
    assert "chamber" not in shown
    assert talk("help", options=("--bench", "lab")).stderr.count("v_vc.read") == 1


def test_every_word_is_done_by_something() -> None:
    for word in WORDS:
        assert callable(getattr(ByHand, f"_{word.name.replace('.', '_')}"))


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_terminal_completes_words_and_ctrl_c_leaves(tmp_path: Path) -> None:
    trace = tmp_path / "x.trace"
    with at_terminal(tmp_path, "--trace", str(trace)) as (process, ours):
        lines = (b"table.rate 400\n", b"power.of\t\n", b"table.rate 20\n")
        text = "".join(typed(ours, line, "paper> ") for line in lines)
        text += typed(ours, b"", "paper> ")
        process.send_signal(signal.SIGINT)
        os.write(ours, b"\n")  # Python sees a signal between its prompt and its waiting with the next line only
        assert process.wait(20) == 4
    assert "limits.max_rate_deg_s" in text
    assert "supply outputs off" in text
    assert "table at +20 deg/s" in text
    assert "power.off" in (tmp_path / "vcfbench" / "talk-history").read_text("utf-8")
    sent = [(line.role, line.data) for line in read_trace(trace) if line.mark == ">"]
    turning = next(n for n, (_, data) in enumerate(sent) if b":Demand:Rate 1,20" in data)
    commanded = [
        role for role, data in sent[turning + 1 :] if b":Demand:Rate 1,0" in data or data.endswith(b"OUTP OFF\n")
    ]
    assert commanded[:3] == ["rate_table", "rate_source", "power"]


@contextmanager
def at_terminal(state: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """Run the console on a terminal of its own; yield the process and our side of it."""
    import pty  # noqa: PLC0415

    ours, theirs = pty.openpty()
    with subprocess.Popen(  # noqa: S603  # our own command
        [sys.executable, "-c", "from vcfbench.cli.main import main; main()", "talk", *arguments],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "XDG_STATE_HOME": str(state), "TERM": "dumb"},
    ) as process:
        os.close(theirs)
        try:
            yield process, ours
        finally:
            process.kill()
            os.close(ours)


def typed(terminal: int, line: bytes, prompt: str) -> str:
    """Type a line once the prompt is there; return what has been shown up to it."""
    shown = b""
    while not shown.endswith(prompt.encode()):
        assert select.select([terminal], [], [], 20)[0], shown
        shown += os.read(terminal, 4096)
    os.write(terminal, line)
    return shown.decode()
