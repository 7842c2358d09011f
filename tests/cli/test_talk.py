from __future__ import annotations

import os
import select
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from vcfbench.cli.main import app

if TYPE_CHECKING:
    from pathlib import Path

    from typer.testing import Result


def talk(*arguments: str, typed: str | None = None) -> Result:
    return CliRunner().invoke(app, ["talk", *arguments], input=typed)


def test_answers_on_stdout_the_rest_on_stderr() -> None:
    done = talk("multimeter", "-c", "*IDN?", "-c", "CONF:VOLT:DC 10", "--command", "SYST:VERS?")
    assert (done.exit_code, done.stdout) == (0, "HEWLETT-PACKARD,34401A,0,11-5-2\n1991.0\n")
    assert done.stderr == "no error\n"


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
            "rail window of 9.5 to 10.5 V, either sign, command 'APPL P25V,12'; nothing was sent",
        ),
        ("rate_source", "VOLT:OFFS 20", 3, "peak voltage"),
        ("rate_table", ":Demand:Rate 1,400", 3, "rate 400 deg/s is beyond the bench's limit of 300 deg/s"),
        (
            "multimeter",
            "FOO",
            3,
            "multimeter at GPIB0::22::INSTR: refused with -113 \"Undefined header\", command 'FOO'",
        ),
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


def test_unguarded_says_so() -> None:
    done = talk("power", "--unguarded", "-c", "APPL P25V,12", "-c", "APPL? P25V")
    assert (done.exit_code, done.stdout) == (0, '"12.000000,1.000000"\n')
    assert done.stderr.splitlines()[0].startswith("NOT guarded")


def test_the_seed_is_the_benchs() -> None:
    lines = ["-c", "READ?"]
    first, again, other = (talk("multimeter", "--seed", seed, *lines).stdout for seed in ("1", "1", "2"))
    assert first == again
    assert first != other


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_person_at_a_terminal(tmp_path: Path) -> None:
    """Refusals do not end it, typed lines are kept for the next time, Ctrl-D leaves."""
    import pty  # noqa: PLC0415

    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", "from vcfbench.cli.main import main; main()", "talk", "power"],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "XDG_STATE_HOME": str(tmp_path), "TERM": "dumb"},
    ) as process:
        os.close(theirs)
        try:
            text = "".join(typed(ours, line) for line in (b"VOLT 30\n", b"SYST:BEEP 5\n", b"*IDN?\n", b"\x04"))
            assert process.wait(20) == 0
        finally:
            process.kill()
            os.close(ours)
    assert "power at GPIB0::5::INSTR: HEWLETT-PACKARD E3631A" in text
    assert "P6V 30 V: the output feeds no rail" in text
    assert "-108" in text
    assert "HEWLETT-PACKARD,E3631A,0" in text
    assert "*IDN?" in (tmp_path / "vcfbench" / "talk-history").read_text("utf-8")


def typed(terminal: int, line: bytes) -> str:
    """Type a line once the prompt is there; return what has been shown up to it."""
    shown = b""
    while not shown.endswith(b"power> "):
        assert select.select([terminal], [], [], 20)[0], shown
        shown += os.read(terminal, 4096)
    os.write(terminal, line)
    return shown.decode()
