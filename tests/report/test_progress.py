from __future__ import annotations

import errno
import io
import re
import sys

import pytest

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from vcfbench.plans.executor import Executor
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.record.schema import Status
from vcfbench.report.progress import LineProgress, LiveProgress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def follow(bench: FakeBench, kind: type[LineProgress | LiveProgress]) -> str:
    stream = Terminal()
    with kind(stream, 233.0) as progress:
        Executor(bench, MemoryJournal(), [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    return stream.getvalue()


def test_one_plain_line_a_step_with_bench_time_and_time_left() -> None:
    lines = follow(FakeBench(), LineProgress).splitlines()
    assert lines[0] == "     0.0 s     233 s left  * Start-up"
    averaged = next(line for line in lines if "average" in line)
    assert averaged.startswith(
        "    16.0 s     217 s left  average 10 readings, one every 1 s: +200 deg/s, V_Vc +0 V -> "
    )
    assert averaged.endswith("-> -2.54200 V, s 0.0e+00 V")
    assert len(lines) == 13 + 1 + 17 * 4 + 2 + 2 + 6
    assert all(line.isascii() for line in lines)


def test_a_failed_step_is_told() -> None:
    bench = FakeBench()
    bench.multimeter.overload_at = 3
    assert "FAILED: multimeter at FAKE::22: overload" in follow(bench, LineProgress)


def shown(text: str) -> list[str]:
    """Return what was printed on a terminal, line by line, without colours and what moves the cursor."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).replace("\r", "\n").splitlines()


def test_on_a_terminal_every_point_and_heading_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    lines = shown(follow(FakeBench(), LiveProgress))
    assert lines.count("Start-up") == 1
    assert [line for line in lines if "200 deg/s" in line and "V_Vc" in line] == [
        "     +200 deg/s    -2.54200 V  s 0.0e+00 V  V_Vc +0 V",
        "     -200 deg/s    +2.45800 V  s 0.0e+00 V  V_Vc +0 V",
    ]
    assert len({line for line in lines if "V  s " in line}) == 17


def test_below_them_stands_how_far_it_is_and_when_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    lines = shown(follow(FakeBench(), LiveProgress))
    status = [line for line in lines if re.fullmatch(r" *\d+ %  \d+:\d\d left, ends \d\d:\d\d", line)]
    assert status[0].startswith("  0 %  3:53 left")
    assert status[-1].startswith(" 97 %  0:00 left")  # the bench of these tests takes no time to answer


def test_what_stands_below_is_wiped_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    text = follow(FakeBench(), LiveProgress)
    assert text.endswith("\x1b[2K")
    assert "\x1b[?25h" in text  # the cursor is to be seen again


def test_a_narrow_terminal_keeps_rate_and_output(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "30")
    lines = shown(follow(FakeBench(), LiveProgress))
    assert max(map(len, lines)) <= 30
    assert "     +200 deg/s    -2.54200 V " in lines
    assert any(line.startswith(" 97 %") for line in lines)


def test_on_a_terminal_a_failure_is_told_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "30")
    bench = FakeBench()
    bench.multimeter.overload_at = 3
    assert "FAILED: multimeter at FAKE::22: overload" in " ".join(" ".join(shown(follow(bench, LiveProgress))).split())


class BrokenTerminal(Terminal):
    def write(self, text: str) -> int:
        del text
        raise OSError(errno.EIO, "Input/output error")


@pytest.mark.parametrize("kind", [LineProgress, LiveProgress])
@pytest.mark.parametrize("closed", [False, True])
def test_a_terminal_that_is_gone_disturbs_nothing(kind: type[LineProgress | LiveProgress], closed: bool) -> None:  # noqa: FBT001
    stream = Terminal() if closed else BrokenTerminal()
    if closed:
        stream.close()
    journal = MemoryJournal()
    with kind(stream, 233.0) as progress:
        done = Executor(FakeBench(), journal, [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    assert done.status is Status.COMPLETE


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.parametrize("kind", [LineProgress, LiveProgress])
def test_a_terminal_that_stands_still_holds_nothing_up(kind: type[LineProgress | LiveProgress]) -> None:
    """Ctrl-S stops the output: whoever wrote there would wait until Ctrl-Q."""
    import pty  # noqa: PLC0415  # there is none on Windows
    import termios  # noqa: PLC0415

    screen, line = pty.openpty()
    with open(screen, "rb", buffering=0), open(line, "w", encoding="utf-8") as stream:  # noqa: PTH123
        termios.tcflow(line, termios.TCOOFF)
        with kind(stream, 233.0) as progress:
            done = Executor(FakeBench(), MemoryJournal(), [progress]).execute(
                PROCEDURES["turntable"].plan(make_settings())
            )
        termios.tcflow(line, termios.TCOON)
    assert done.status is Status.COMPLETE
