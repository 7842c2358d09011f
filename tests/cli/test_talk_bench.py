"""``vcfbench talk`` without a role: the whole bench at one prompt."""

from __future__ import annotations

import os
import re
import signal
import sys
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from tests.cli.test_talk import at_terminal, typed
from vcfbench.cli.main import app
from vcfbench.runs.by_hand import WORDS, ByHand
from vcfbench.testing import read_trace

if TYPE_CHECKING:
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


def test_the_table_turns_and_stops_and_lines_go_to_instruments_as_they_are() -> None:
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
    [
        (
            "table.rate 400",
            3,
            "rate_table: rate 400 deg/s is beyond the bench's limit of 300 deg/s; limits.max_rate_deg_s",
        ),
        ("v_vc.set 11", 3, "rate_source: voltage 11 V is beyond the bench's limit of 10 V; limits.max_v_vc_v"),
        ("v_vc.sine 10 11", 3, "peak voltage 11 V is beyond the bench's limit of 10 V; limits.max_v_vc_v"),
        ("v_vc.set 1", 3, "the PCB has no power, nothing was sent; power.on comes first"),
        ("power APPL P25V,12,0.1", 3, "a raw command is compared with no limit of the bench"),
        ("multimeter FOO?", 3, "Undefined header"),
        ("multimeter", 2, "expected what is to be sent, as in multimeter *IDN?"),
        ("table.rate fast", 2, "table.rate DEG_S: DEG_S: expected a number, came 'fast'"),
        ("table.rate", 2, "expected 'table.rate DEG_S', came 'table.rate'"),
        ("wait -1", 2, "expected seconds, from 0 to 86400"),
        ("table.rat 10", 2, "there is no word 'table.rat' ('table.rate'?)"),
        ("chamber.read", 2, "'chamber.read': bench paper has no chamber"),
    ],
)
def test_what_is_refused_ends_it_with_the_reason(line: str, code: int, words: str) -> None:
    done = talk(line, "multimeter *IDN?")
    assert (done.exit_code, done.stdout) == (code, "")
    assert words in done.stderr


def test_a_raw_command_to_one_instrument_is_written_down(tmp_path: Path) -> None:
    options = ("--raw", "--runs", str(tmp_path))
    done = talk("power APPL P25V,9.8,0.1", "power APPL? P25V", options=options)
    assert (done.exit_code, done.stdout) == (0, '"9.800000,0.100000"\n')
    assert '"command":"APPL P25V,9.8,0.1"' in (tmp_path / "raw.jsonl").read_text("utf-8")


def test_help_shows_the_words_of_this_bench() -> None:
    shown = talk("help").stderr
    assert "table.rate DEG_S" in shown
    assert "chamber" not in shown
    assert talk("help", options=("--bench", "lab")).stderr.count("v_vc.read") == 1


def test_every_word_is_done_by_something() -> None:
    for word in WORDS:
        assert callable(getattr(ByHand, f"_{word.name.replace('.', '_')}"))


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_person_at_a_terminal_completes_words_and_leaves_by_ctrl_c(tmp_path: Path) -> None:
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
    assert "power.off" in (tmp_path / "vcfbench" / "talk-bench-history").read_text("utf-8")
    sent = [(line.role, line.data) for line in read_trace(trace) if line.mark == ">"]
    turning = next(n for n, (_, data) in enumerate(sent) if b":Demand:Rate 1,20" in data)
    commanded = [
        role for role, data in sent[turning + 1 :] if b":Demand:Rate 1,0" in data or data.endswith(b"OUTP OFF\n")
    ]
    assert commanded[:3] == ["rate_table", "rate_source", "power"]
