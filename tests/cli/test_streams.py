"""What was found out about the bench stands, whatever has become of stdout, stderr and the terminal."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import pytest
from simrack_tests.cells import few

from tests import warm
from tests.cli.streams import ENDINGS, QUICK
from vcfbench.cli import ending
from vcfbench.cli.answer import given
from vcfbench.errors import Aborted, BenchError, NotSafe
from vcfbench.reports.progress import NoProgress
from vcfbench.reports.shielded import Shielded
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from subprocess import CompletedProcess

ROOT = Path(__file__).parents[2]
posix = pytest.mark.skipif(sys.platform == "win32", reason="processes are forked, and have signals and terminals")


@pytest.fixture(scope="module", params=few(["few", "all"], "few"))
def ended(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Mapping[str, Any]]:
    """How runs ended, each with streams of its own."""
    folder = tmp_path_factory.mktemp("streams")
    command = [sys.executable, "-m", "tests.cli.streams", str(folder), request.param]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)  # noqa: S603
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.exhaustive
@posix
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_code_journal_and_words_are_right_whatever_the_streams_are(ended: list[Mapping[str, Any]]) -> None:
    for case in ended:
        unwritten = case["ending"] == "done" and case["out"] == "full"
        assert case["code"] == (3 if unwritten else ENDINGS[case["ending"]]), case
        assert "Traceback" not in case["said"]["err"], case
        if case["err"] == "open":
            assert ("NOT SAFE: power at GPIB0::5" in case["said"]["err"]) == ("unsafe" in case["ending"]), case
        if case["ending"] == "usage":
            assert case["last"] is None
            continue
        last = case["last"]
        assert last["type"] == "footer", case
        assert last["files"] == ["journal.jsonl", "points.csv", "result.json"], case
        assert [report["safe"] for report in last["safe"]].count(False) == ("unsafe" in case["ending"]), case
        assert last["status"] == ("complete" if case["ending"] in {"done", "limit", "unsafe"} else "aborted"), case
        kind = {"done": None, "limit": None, "instrument": "MeasurementError", "aborted": "Aborted"}.get(
            case["ending"], "NotSafe"
        )
        assert (last["error"] or {}).get("kind") == kind, case


@pytest.mark.exhaustive
@posix
def test_closed_terminal_is_code_4_with_complete_record(tmp_path: Path) -> None:
    """The terminal goes away amid the live display, as when its window is closed."""
    import pty  # noqa: PLC0415  # Windows has none

    quick = embedded_text("paper").replace("\n[procedure.drive]", QUICK)
    (tmp_path / "quick.toml").write_text(quick, encoding="utf-8")
    process, terminal = pty.fork()
    if process == 0:
        os.chdir(tmp_path)
        words = ["-m", "vcfbench", "run", "turntable", "--bench", "quick.toml", "--speed", "5"]
        os.execv(sys.executable, [sys.executable, *words])  # noqa: S606
    shown = b""
    while b"deg/s" not in shown:
        shown += os.read(terminal, 4096)
    os.close(terminal)
    _, status = os.waitpid(process, 0)
    assert os.waitstatus_to_exitcode(status) == 4
    (journal,) = tmp_path.glob("runs/*/journal.jsonl")
    last = json.loads(journal.read_bytes().splitlines()[-1])
    assert (last["type"], last["error"]["kind"]) == ("footer", "Aborted")
    assert [report["safe"] for report in last["safe"]] == [True] * 5


LATE = """
import os, signal, sys
from vcfbench.safety.signals import StopSignals
from vcfbench.cli import conduct, main
left = StopSignals.__exit__
def leave(self, *what):
    left(self, *what)
    for name in ("SIGHUP", "SIGTERM", "SIGINT"):
        os.kill(os.getpid(), getattr(signal, name))
StopSignals.__exit__ = leave
try:
    main.main()
finally:
    print([signal.getsignal(getattr(signal, name)).name for name in ("SIGHUP", "SIGTERM", "SIGINT")], file=sys.stderr)
"""


def scripted(folder: Path, script: str, *words: str) -> CompletedProcess[str]:
    """Run `script` as a program of its own."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    return warm.run(["python", "script.py", *words], folder)


@posix
def test_a_signal_in_the_last_milliseconds_changes_nothing(tmp_path: Path) -> None:
    quick = embedded_text("paper").replace("\n[procedure.drive]", QUICK)
    (tmp_path / "quick.toml").write_text(quick, encoding="utf-8")
    done = scripted(tmp_path, LATE, "run", "turntable", "--bench", "quick.toml", "--quiet", "--json")
    assert (done.returncode, done.stderr) == (0, "['SIG_IGN', 'SIG_IGN', 'SIG_IGN']\n")
    assert json.loads(done.stdout)["status"] == "complete"


# --- what is not safe wins over what came after it ---


def test_not_safe_is_found_wherever_it_is_in_the_chain() -> None:
    def leave() -> NoReturn:
        try:
            raise NotSafe("NOT SAFE: the table turns")
        finally:
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError) as caught:
        leave()
    assert ending.ending_of(caught.value) == ("NOT SAFE: the table turns", 5)
    assert ending.ending_of(BrokenPipeError()) == ("", 4)
    assert ending.ending_of(Aborted("stopped by SIGHUP")) == ("stopped by SIGHUP; the bench was made safe", 4)
    assert ending.ending_of(ZeroDivisionError()) is None


@posix
@pytest.mark.parametrize(("answered", "code"), few([(False, 4), (True, 0)], (False, 4)))
def test_a_signal_ends_a_command_until_it_has_answered(tmp_path: Path, *, answered: bool, code: int) -> None:
    script = f"""
import os, signal, sys, typer
from vcfbench.cli import ending, main
@main.app.command("wait")
def wait(context: typer.Context):
    if {answered}:
        context.find_object(ending.SignalsWithoutBench).answered()
    os.kill(os.getpid(), signal.SIGHUP)
main.main()
"""
    done = scripted(tmp_path, script, "wait")
    assert (done.returncode, done.stderr) == (code, "" if answered else "vcfbench: stopped by SIGHUP\n")


def test_a_mistake_of_ours_is_code_three_with_its_traceback(tmp_path: Path) -> None:
    """Code 1 is a verdict on a gyroscope."""
    script = "from vcfbench.cli import main\n@main.app.command('fail')\ndef fail(): 1 / 0\nmain.main()"
    done = scripted(tmp_path, script, "fail")
    assert done.returncode == 3
    assert done.stderr.endswith("ZeroDivisionError: division by zero\n")


# --- words that stderr does not take ---


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What goes to the terminal and to the system's log."""
    logged: list[str] = []
    monkeypatch.setattr(ending, "_to_terminal", lambda _: False)
    monkeypatch.setattr(ending, "_to_system_log", logged.append)
    return logged


@posix
@pytest.mark.parametrize("broken", [True, False])
def test_an_alarm_that_stderr_does_not_take_goes_elsewhere(
    elsewhere: list[str], monkeypatch: pytest.MonkeyPatch, *, broken: bool
) -> None:
    """Also when nobody reads: a full pipe must not keep the exit code from whoever waits for it."""
    monkeypatch.setattr(ending, "_SAYING_S", 0.1)
    reader, writer = os.pipe()
    with os.fdopen(writer, "w", encoding="utf-8") as stream:
        if broken:
            os.close(reader)
        else:
            os.set_blocking(writer, False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    os.write(writer, bytes(4096))
            os.set_blocking(writer, True)
        monkeypatch.setattr(sys, "stderr", stream)
        ending.say("an instrument does not answer")
        ending.say("NOT SAFE: the table turns", alarm=True)
        if not broken:
            os.close(reader)  # the writers end now
    assert elsewhere == ["NOT SAFE: the table turns"]


def test_a_stderr_that_was_closed_before_the_start_is_none(
    elsewhere: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    ending.say("NOT SAFE: the table turns", alarm=True)
    assert elsewhere == ["NOT SAFE: the table turns"]


def raising(error: Exception) -> NoReturn:
    raise error


def test_answer_that_cannot_be_written_is_an_error_unless_unread() -> None:
    assert given(lambda: None) is None
    assert given(lambda: raising(BrokenPipeError())) is None
    unwritten = given(lambda: raising(OSError(28, "No space left on device")))
    assert str(unwritten) == "the answer could not be written: No space left on device"
    assert "'ascii' codec" in str(given(lambda: raising(UnicodeEncodeError("ascii", "°", 0, 1, "no"))))


# --- the display ---


class Broken(NoProgress):
    def __init__(self, error: Exception) -> None:
        self.events = 0
        self._error = error

    def handle(self, event: object) -> None:
        del event
        self.events += 1
        raise self._error


def test_failed_display_gets_no_more_events() -> None:
    event: Any = None
    broken = Broken(ValueError("I/O operation on closed file"))
    with Shielded(lambda: broken) as shielded:
        shielded.handle(event)
        shielded.handle(event)
    assert broken.events == 1
    assert shielded.lost == "ValueError: I/O operation on closed file"


def test_a_display_that_cannot_be_made_is_none() -> None:
    with Shielded(lambda: raising(OSError(5, "Input/output error"))) as shielded:
        pass
    assert shielded.lost == "OSError: [Errno 5] Input/output error"


def test_stop_during_display_update_reaches_run() -> None:
    event: Any = None
    with Shielded(lambda: Broken(Aborted("stopped by SIGINT"))) as shielded, pytest.raises(BenchError, match="SIGINT"):
        shielded.handle(event)


def test_words_are_printed_without_memory_for_a_thread(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("vcfbench.clock.start_thread", lambda _act: None)
    monkeypatch.setattr(ending, "_SAYING_S", 0.01)
    with (tmp_path / "stderr").open("w", encoding="utf-8") as stderr:
        monkeypatch.setattr("sys.stderr", stderr)
        ending.say("NOT SAFE", alarm=True)
    assert (tmp_path / "stderr").read_text("utf-8") == "NOT SAFE\n"
