from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from tests.drivers.servers import answering, serving
from vcfbench.cli.main import app
from vcfbench.station.file import template

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator
    from pathlib import Path

    from typer.testing import Result


def talk(*arguments: str, typed: str | None = None) -> Result:
    return CliRunner().invoke(app, ["talk", *arguments], input=typed)


def raw(runs: Path) -> list[str]:
    return ["--raw", "--runs", str(runs)]


def test_answers_on_stdout_the_rest_on_stderr(tmp_path: Path) -> None:
    done = talk("multimeter", *raw(tmp_path), "-c", "*IDN?", "-c", "CONF:VOLT:DC 10", "--command", "SYST:VERS?")
    assert (done.exit_code, done.stdout) == (0, "HEWLETT-PACKARD,34401A,0,11-5-2\n1991.0\n")
    assert done.stderr.startswith("raw commands: nothing is compared with the limits")
    assert done.stderr.endswith("raw.jsonl\nno error\n")


def test_lines_come_from_stdin_and_some_are_the_consoles() -> None:
    typed = "// a remark\n\n.help\n*OPC?\n.errors\n.clear\n.wait 1.5\n.quit\n*IDN?\n"
    done = talk("power", typed=typed)
    assert (done.exit_code, done.stdout) == (0, "1\n")
    assert ".wait SECONDS" in done.stderr
    assert done.stderr.endswith("no error\n")


@pytest.mark.parametrize(
    ("role", "line", "code", "words"),
    [
        (
            "power",
            "APPL P25V,12",
            3,
            "raw command is compared with no limit of the bench, command 'APPL P25V,12'; nothing was sent",
        ),
        ("rate_table", ":Demand:Rate? 1;:Mode:Rate 1", 3, "--raw sends it and writes it down"),
        ("power", "*TST?", 3, "nothing was sent"),
        ("multimeter", "FOO?", 3, "no answer, command 'FOO?'"),
        ("multimeter", ".wait long", 2, ".wait long: expected seconds"),
        ("multimeter", ".what", 2, "there are .wait SECONDS"),
        ("kettle", "*IDN?", 2, "there is no 'kettle'; there are power"),
        ("vibration_source", "*IDN?", 2, "there is no 'vibration_source' on this bench"),
    ],
)
def test_the_first_line_that_is_refused_or_fails_ends_it(role: str, line: str, code: int, words: str) -> None:
    done = talk(role, "-c", line, "-c", "*OPC?")
    assert done.exit_code == code
    assert words in done.stderr
    assert done.stdout == ""


def test_a_raw_command_is_written_down_before_it_is_sent(tmp_path: Path) -> None:
    done = talk("power", *raw(tmp_path), "-c", "APPL P25V,12", "-c", "APPL? P25V", "-c", "FOO")
    assert (done.exit_code, done.stdout) == (3, '"12.000000,1.000000"\n')
    assert "power at GPIB0::5::INSTR: refused with -113" in done.stderr
    lines = [json.loads(line) for line in (tmp_path / "raw.jsonl").read_text("utf-8").splitlines()]
    assert [line["command"] for line in lines] == ["APPL P25V,12", "FOO"]
    assert {(line["bench"], line["role"], line["resource"]) for line in lines} == {
        ("paper", "power", "GPIB0::5::INSTR")
    }


def test_a_raw_command_that_cannot_be_written_down_is_not_sent(tmp_path: Path) -> None:
    (tmp_path / "raw.jsonl").mkdir()
    done = talk("power", *raw(tmp_path), "-c", "APPL P25V,12")
    assert done.exit_code == 3
    assert "raw.jsonl cannot be written: Is a directory" in done.stderr


def test_the_seed_is_the_benchs() -> None:
    lines = ["-c", "READ?"]
    first, again, other = (talk("multimeter", "--seed", seed, *lines).stdout for seed in ("1", "1", "2"))
    assert first == again
    assert first != other


def test_the_last_answer_is_saved(tmp_path: Path) -> None:
    block, line = tmp_path / "screen.bin", tmp_path / "line.txt"
    lines = [":DIG", ":WAV:POIN 1000", ":WAV:DATA?", f".save {block}", "*OPC?", f".save {line}"]
    done = talk("oscilloscope", *raw(tmp_path), *(word for each in lines for word in ("-c", each)))
    assert done.exit_code == 0, done.stderr
    assert block.stat().st_size == 1000
    assert f"1000 bytes written to {block}" in done.stderr
    assert line.read_bytes() == b"1"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([".save x"], ".save x: no answer has come yet"),
        (["*OPC?", ".save"], ".save: expected the name of a file"),
        (["*OPC?", ".save nowhere/x"], ".save nowhere/x: No such file"),
    ],
)
def test_what_cannot_be_saved_is_a_mistake_of_usage(lines: list[str], words: str) -> None:
    done = talk("power", *(word for each in lines for word in ("-c", each)))
    assert done.exit_code == 2
    assert words in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_ctrl_c_breaks_off_what_is_awaited_and_goes_on(tmp_path: Path) -> None:
    asked = threading.Event()

    def stalls(connection: socket.socket, line: str) -> bool:
        del connection
        if line == "READ?":
            asked.set()
        return line == "READ?"

    with serving(answering(stalls)) as resource:
        bench = tmp_path / "lab.toml"
        bench.write_text(template().replace('"GPIB0::22::INSTR"', f'"{resource}"\ntimeout_s = 60.0'), "utf-8")
        with at_terminal(tmp_path, "multimeter", "--bench", str(bench)) as (process, ours):
            typed(ours, b"READ?\n", "multimeter> ")
            assert asked.wait(20)
            process.send_signal(signal.SIGINT)
            text = typed(ours, b"*IDN?\n", "multimeter> ") + typed(ours, b"\x04", "multimeter> ")
            assert process.wait(20) == 0
    assert "broken off by a device clear" in text
    assert "HEWLETT-PACKARD,34401A,0,10-5-2" in text


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_person_at_a_terminal(tmp_path: Path) -> None:
    """Refusals do not end it, typed lines are kept for the next time, Ctrl-D leaves."""
    with at_terminal(tmp_path, "power") as (process, ours):
        lines = (b"VOLT 30\n", b"FOO? 5\n", b"*IDN?\n", b"\x04")
        text = "".join(typed(ours, line, "power> ") for line in lines)
        assert process.wait(20) == 0
    assert "power at GPIB0::5::INSTR: HEWLETT-PACKARD E3631A" in text
    assert "a raw command is compared with no limit" in text
    assert "-113" in text
    assert "HEWLETT-PACKARD,E3631A,0" in text
    assert "*IDN?" in (tmp_path / "vcfbench" / "talk-history").read_text("utf-8")


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
