from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest
import typer
from simrack_tests.cells import few
from typer.testing import CliRunner

from tests import warm
from tests.procedures.test_own_code import GOOD
from vcfbench import __version__
from vcfbench.cli import main
from vcfbench.cli.answer import print_json
from vcfbench.errors import Aborted, BenchError, ConfigError, LimitError, NotSafe

MAIN = [sys.executable, "-m", "vcfbench"]
HEAVY = ("numpy", "scipy", "pyvisa", "serial", "rich", "msgspec")


def vcfbench(*arguments: str, **streams: Any) -> subprocess.CompletedProcess[str]:
    """Run the command with its streams on pipes, or as told."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.run([*MAIN, *arguments], **{**pipes, **streams}, text=True, check=False)  # noqa: S603


def failing(error: BaseException) -> typer.Typer:
    """The root with a command that fails with `error`."""
    app = typer.Typer(cls=main.Commands, pretty_exceptions_enable=False)

    def fail() -> NoReturn:
        raise error

    app.command("fail")(fail)
    app.callback()(lambda: None)
    return app


def test_the_version(tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "--version"], tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"vcfbench {__version__}\n", "")


def test_the_module_tells_the_version_before_anything_is_loaded() -> None:
    told = "import runpy, sys; sys.argv[1:] = ['--version']; runpy.run_module('vcfbench', run_name='__main__'); "
    code = f"{told}print(*{{'typer', 'msgspec'}} & {{*sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)  # noqa: S603
    assert (done.returncode, done.stdout, done.stderr) == (0, f"vcfbench {__version__}\n\n", "")


def test_help_lists_the_commands_and_the_exit_codes(tmp_path: Path) -> None:
    done = warm.run(["vcfbench", "--help"], tmp_path)
    assert done.returncode == 0
    assert all(f"  {command} " in done.stdout for command in ("run", "analyze", "runs", "bench", "sim"))
    assert "5 NOT safe" in done.stdout


def test_nothing_heavy_is_imported_before_a_command_runs() -> None:
    code = f"import sys; from vcfbench.cli import main; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError("the file is not one"), 2),
        (BenchError("the bench is busy"), 3),
        (LimitError("too fast", instrument="rate_table", resource="COM3"), 3),
        (NotSafe("NOT SAFE: rate_table turns"), 5),
    ],
)
def test_an_error_is_one_sentence_and_its_exit_code(error: BenchError, code: int) -> None:
    done = CliRunner().invoke(failing(error), ["fail"])
    assert (done.exit_code, done.stdout, done.stderr) == (code, "", f"vcfbench: {error}\n")


def test_abort_without_unsafe_instrument_reports_safe() -> None:
    done = CliRunner().invoke(failing(Aborted("stopped by SIGINT")), ["fail"])
    assert done.exit_code == 4
    assert done.stderr == "vcfbench: stopped by SIGINT; the bench was made safe\n"


def test_a_keyboard_interrupt_is_an_abort() -> None:
    done = CliRunner().invoke(failing(KeyboardInterrupt()), ["fail"])
    assert done.exit_code == 4
    assert done.stderr == "vcfbench: stopped by the keyboard\n"


def test_a_mistake_of_ours_is_not_hidden() -> None:
    done = CliRunner().invoke(failing(ZeroDivisionError("ours")), ["fail"])
    assert isinstance(done.exception, ZeroDivisionError)


@pytest.mark.parametrize("code", [0, 1])
def test_plan_that_exits_python_is_error_without_verdict(code: int, tmp_path: Path) -> None:
    leaving = (
        f"        walks.append(1)\n        if len(walks) > 2:  # the dry run is over\n            sys.exit({code})\n"
    )
    step = '        yield Settle(1.0, "for nothing")\n'
    (tmp_path / "wait.py").write_text(GOOD.replace(step, step + leaving) + "\nimport sys\n\nwalks = []\n", "utf-8")
    done = warm.run(["vcfbench", "run", "./wait.py", "--quiet"], tmp_path)
    assert done.returncode == 3, done.stderr
    assert "wait.py" in done.stderr
    assert f"SystemExit: {code}\n" in done.stderr
    (journal,) = (tmp_path / "runs").glob("*/journal.jsonl")
    assert f"the program has a mistake: SystemExit: {code}" in journal.read_text("utf-8")


@pytest.mark.parametrize("arguments", [["run", "sing"], ["run", "sing", "--json"]])
def test_an_unknown_procedure_is_answered_with_the_known_ones(arguments: list[str]) -> None:
    done = CliRunner().invoke(main.app, arguments)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert "'sing'" in line
    assert "turntable" in line
    assert "virtual-coriolis" in line


@pytest.mark.parametrize("arguments", [["sing"], ["--sing"], ["bench", "sing"], ["bench", "show", "--sing"]])
def test_usage_errors_have_exit_code_two_and_no_traceback(arguments: list[str]) -> None:
    done = CliRunner().invoke(main.app, arguments)
    assert done.exit_code == 2
    assert "sing" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="pipes break differently there")
@pytest.mark.parametrize(
    ("arguments", "code"),
    few([(["bench", "show", "--template"], 4), (["bench", "check"], 0), (["--help"], 4)], (["bench", "check"], 0)),
)
def test_a_reader_that_leaves_is_left_in_peace(arguments: list[str], code: int) -> None:
    """A pipe without a reader: nothing is said, not even by the interpreter; a check says how the bench is."""
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as pipe:
        done = vcfbench(*arguments, stdout=pipe)
    assert (done.returncode, done.stderr) == (code, "")


FULL_DISK = Path("/dev/full")
NEEDS_FULL_DISK = pytest.mark.skipif(not FULL_DISK.exists(), reason="needs a device that is always full")
ANSWERS = [["--help"], ["--version"], ["bench", "show"], ["bench", "check"], ["runs", "list"], ["sim", "show"]]


@NEEDS_FULL_DISK
@pytest.mark.parametrize("arguments", few(ANSWERS, ["--help"], ["runs", "list"]))
def test_an_answer_that_cannot_be_written_is_one_sentence(arguments: list[str]) -> None:
    with FULL_DISK.open("wb") as full:
        done = vcfbench(*arguments, stdout=full)
    assert done.returncode == 3
    assert done.stderr in {
        "vcfbench: cannot read or write: No space left on device\n",
        "vcfbench: the answer could not be written: No space left on device\n",
    }


@NEEDS_FULL_DISK
def test_an_error_that_cannot_be_told_keeps_its_exit_code() -> None:
    with FULL_DISK.open("wb") as full:
        done = vcfbench("run", "sing", stderr=full)
    assert (done.returncode, done.stdout) == (2, "")


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="no shell to close a stream with")
@pytest.mark.parametrize("closed", few([">&-", "2>&-", "<&-"], ">&-"))
def test_closed_streams_are_no_error(closed: str) -> None:
    command = f"exec {shlex.join(MAIN)} bench show {closed}"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, check=False)  # noqa: S603
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("command", [["bench", "show"], ["bench", "check"], ["sim", "show"], ["run", "turntable"]])
def test_missing_bench_file_is_one_line_and_code_two(command: list[str], tmp_path: Path) -> None:
    done = CliRunner().invoke(main.app, [*command, "--bench", str(tmp_path / "none.toml")])
    assert done.exit_code == 2
    assert done.stderr == f"vcfbench: {tmp_path / 'none.toml'}: expected a bench file, there is no such file\n"
    assert "Traceback" not in done.output


def test_a_command_of_a_group_is_named_with_its_group() -> None:
    root: Any = typer.main.get_command(main.app)
    root.get_command(None, "none of them")  # all are loaded then
    groups = {group: command.commands for group, command in root.commands.items() if hasattr(command, "commands")}
    names = {name for commands in groups.values() for name in commands} - {*main.COMMANDS}
    assert {"show", "list", "serve", "check"} <= names
    for name in [*names, "turntable", "kvc"]:
        done = CliRunner().invoke(main.app, [name])
        assert done.exit_code == 2
        meant = [group for group, commands in groups.items() if name in commands] or ["run"]
        for group in meant:
            assert f"vcfbench {group} {name}" in done.stderr


def test_the_short_option_shows_the_version() -> None:
    assert CliRunner().invoke(main.app, ["-v"]).stdout == f"vcfbench {__version__}\n"


REFUSED = (
    *("run turntabel", "run turntable --nosuch", "run turntable --dry-run --bench nofile", "resume nothing", "safe"),
    *("runs show nothing", "runs verify nothing", "device NONE", "compare last nothing", "analyze nofile.csv"),
    *("study nofile.toml", "batch nofile.csv", "bench check --bench nofile", "runs list --since x", "nosuch", "talk"),
)


@pytest.mark.parametrize("command", REFUSED)
def test_with_json_a_command_that_fails_prints_one_object(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main.app, [*command.split(), "--json"])
    answer = json.loads(done.stdout)
    assert set(answer) == {"error", "exit_code"}
    assert answer["exit_code"] == done.exit_code == 2
    assert " ".join(answer["error"].split()) in " ".join(done.stderr.split())
    assert not CliRunner().invoke(main.app, command.split()).stdout


def test_with_json_an_object_that_was_printed_stays_the_only_one() -> None:
    app = typer.Typer(cls=main.Commands, pretty_exceptions_enable=False)
    app.callback()(lambda: None)

    @app.command("fail")
    def fail(*, json: bool = False) -> NoReturn:
        print_json({"json": json})
        raise NotSafe("live")

    done = CliRunner().invoke(app, ["fail", "--json"])
    assert (done.stdout, done.exit_code) == ('{"json":true}\n', 5)
