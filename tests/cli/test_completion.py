"""What shells are offered, and ``-h``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from vcfbench.cli.main import COMMANDS, app
from vcfbench.procedures.catalogue import PROCEDURES

if TYPE_CHECKING:
    from pathlib import Path


def offered(line: str) -> list[str]:
    """Return what bash is offered at the end of `line`."""
    environment = {
        "_VCFBENCH_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(line.split(" ")) - 1),
    }
    done = CliRunner().invoke(app, [], prog_name="vcfbench", env=environment)
    assert done.exit_code == 0, done.output
    return done.stdout.split()


def test_commands_and_procedures_although_they_are_not_loaded() -> None:
    assert set(offered("vcfbench ")) >= set(COMMANDS)
    assert set(offered("vcfbench run ")) >= set(PROCEDURES)
    assert offered("vcfbench bench ch") == ["check"]
    assert "--seed" in offered("vcfbench run turntable --se")


def test_runs_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert offered("vcfbench resume ") == []
    for name in ("20260101T000000Z-zero-aaaaaa", "20260102T000000Z-zero-bbbbbb"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "journal.jsonl").touch()
    (tmp_path / "runs" / "20260103-no-run").mkdir()
    newest_first = ["20260102T000000Z-zero-bbbbbb", "20260101T000000Z-zero-aaaaaa"]
    for command in ("resume", "runs show", "runs export", "report", "plot", "compare", "compare last"):
        assert offered(f"vcfbench {command} ") == ["last", *newest_first]
        assert offered(f"vcfbench {command} 20260101") == newest_first[1:]
    assert offered("vcfbench resume --runs nowhere ") == []


def test_devices_by_serial_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert offered("vcfbench device ") == []
    (tmp_path / "devices" / "G-0042").mkdir(parents=True)
    (tmp_path / "devices" / "G-0042" / "0001.json").write_text("{}", "utf-8")
    assert offered("vcfbench device G-") == ["G-0042"]


@pytest.mark.parametrize(
    ("shell", "words"),
    [("bash", "complete_bash"), ("zsh", "#compdef vcfbench"), ("fish", "complete --command vcfbench")],
)
def test_the_script_for_a_shell_is_shown(shell: str, words: str) -> None:
    environment = {"_VCFBENCH_COMPLETE": f"source_{shell}"}
    assert words in CliRunner().invoke(app, [], prog_name="vcfbench", env=environment).stdout


@pytest.mark.parametrize(
    "command", ["", "run", "run turntable", "runs", "runs show", "bench", "bench check", "sim serve", "talk", "safe"]
)
def test_short_help(command: str) -> None:
    words = command.split()
    short, long = (CliRunner().invoke(app, [*words, option]) for option in ("-h", "--help"))
    assert (short.exit_code, short.stdout) == (0, long.stdout)
    assert "-h, --help" in short.stdout


def test_help_lists_each_command_on_one_line() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    for name, words in COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(words)}$", shown, re.MULTILINE)
