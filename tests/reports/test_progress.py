from __future__ import annotations

import errno
import io
import re
import sys
from typing import TYPE_CHECKING

import pyte
import pytest
from simrack_tests.cells import few

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.schema import Point, Status
from vcfbench.reports.live_progress import LiveProgress
from vcfbench.reports.progress import LineProgress
from vcfbench.steps import Done, Note, Settle
from vcfbench.steps.events import ReadingTaken, StepFinished, StepStarted
from vcfbench.steps.executor import Executor

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.steps.events import Event


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def follow(bench: FakeBench, kind: type[LineProgress | LiveProgress]) -> str:
    stream = Terminal()
    with kind(stream, 245.0) as progress:
        Executor(bench, MemoryJournal(), [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    return stream.getvalue()


def test_plain_display_has_one_line_per_step() -> None:
    lines = follow(FakeBench(), LineProgress).splitlines()
    assert lines[0] == "     0.0 s     245 s left  * Start-up"
    averaged = next(line for line in lines if "+200 deg/s, V_Vc" in line)
    assert averaged.startswith(
        "    28.0 s     217 s left  average 10 readings, one every 1 s: +200 deg/s, V_Vc +0 V -> "
    )
    assert averaged.endswith("-> -2.54200 V, s 0.0e+00 V")
    assert len(lines) == 13 + 1 + 2 + 17 * 4 + 2 + 2 + 5 + 2  # the drive is looked at before it is off
    assert all(line.isascii() for line in lines)


def test_a_failed_step_is_told() -> None:
    bench = FakeBench()
    bench.multimeter.overload_at = 3
    assert "FAILED: multimeter at FAKE::22: overload" in follow(bench, LineProgress)


def shown(text: str) -> list[str]:
    """Return what was printed on a terminal, line by line, without colours and what moves the cursor."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).replace("\r", "\n").splitlines()


@pytest.fixture
def xterm(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Set the width of the terminal."""

    def set_width(columns: int) -> None:
        monkeypatch.setenv("COLUMNS", str(columns))

    monkeypatch.setenv("TERM", "xterm")
    set_width(80)
    return set_width


@pytest.mark.usefixtures("xterm")
def test_on_a_terminal_every_point_and_heading_stays() -> None:
    lines = shown(follow(FakeBench(), LiveProgress))
    assert lines.count("Start-up") == 1
    assert lines.count("   time  step       rate       V_Vc     output        s      n   residual") == 1
    assert lines.count("                   deg/s          V          V       mV                mV") == 1
    rows = [line for line in lines if re.match(r" +\d+:\d\d +1 ", line)]
    assert rows[1:4] == [
        "   0:28     1       +200   +0.00000   -2.54200    0.000     10          -",
        "   0:41     1       +100   +0.00000   -1.29200    0.000     10          -",
        "   0:54     1        +50   +0.00000   -0.66700    0.000     10     -0.000",
    ]
    assert len(rows) == 17 + 2  # the zero before and after, to compare


@pytest.mark.usefixtures("xterm")
def test_a_part_ends_with_the_line_through_its_points() -> None:
    lines = shown(follow(FakeBench(), LiveProgress))
    place = next(number for number, line in enumerate(lines) if "line through" in line)
    assert lines[place].startswith("  line through 17 points: -12.50000 mV/(deg/s), -42.000 mV; largest residual")
    assert place < lines.index("Shut down")


@pytest.mark.usefixtures("xterm")
def test_percent_and_end_are_below_points() -> None:
    lines = shown(follow(FakeBench(), LiveProgress))
    status = [line for line in lines if re.match(r" *\d+ %  \d+:\d\d left, ends \d\d:\d\d  [#.━─]{40,}$", line)]
    assert status[0].startswith("  0 %  4:05 left")
    assert status[-1].startswith((" 97 %  0:00 left", "100 %  0:00 left"))  # this bench takes no time to answer
    assert max(map(len, status)) <= 80 - len("^C^C")


@pytest.mark.usefixtures("xterm")
def test_step_and_bench_state_are_below_points() -> None:
    seen: list[list[str]] = []

    class Look(LiveProgress):
        def handle(self, event: Event) -> None:
            super().handle(event)
            if isinstance(event, ReadingTaken):
                with self._console.capture() as drawn:
                    self._console.print(self._block.lines(80))
                seen.append([line for line in shown(drawn.get()) if line.startswith(("+200", "table +200"))])

    with Look(Terminal(), 245.0) as progress:
        Executor(FakeBench(), MemoryJournal(), [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    reading, state = seen[12][:2]
    assert reading == "+200 deg/s  -2.54200 V  reading 3 of 10"
    assert state == "table +200, reads +200.0000 deg/s   rails +10.000 -10.000 V   V_Vc off"


@pytest.mark.usefixtures("xterm")
def test_what_stands_below_is_wiped_in_the_end() -> None:
    text = follow(FakeBench(), LiveProgress)
    assert text.endswith("\x1b[2K")
    assert "\x1b[?25h" in text  # the cursor is to be seen again


@pytest.mark.parametrize(
    ("columns", "row"),
    [
        (30, "   0:28       +200   -2.54200"),
        (40, "   0:28       +200   -2.54200          -"),
        (120, "   0:28     1       +200   +0.00000   -2.54200    0.000     10          -    +200.0000"),
    ],
)
def test_a_terminal_has_the_columns_that_it_has_room_for(xterm: Callable[[int], None], columns: int, row: str) -> None:
    xterm(columns)
    lines = shown(follow(FakeBench(), LiveProgress))
    assert max(map(len, lines)) <= columns
    assert row in lines
    assert any(re.match(r" *\d+ %  \d:\d\d left, ends \d\d:\d\d", line) for line in lines)


@pytest.mark.parametrize("columns", [40, 80, 120])
def test_what_is_left_on_the_screen_is_the_table(xterm: Callable[[int], None], columns: int) -> None:
    """The block below goes without a trace, and no row is broken."""
    xterm(columns)
    screen = pyte.HistoryScreen(columns, 200, history=1)
    pyte.Stream(screen).feed(follow(FakeBench(), LiveProgress).replace("\n", "\r\n"))
    left = [line.rstrip() for line in screen.display if line.strip()]
    assert left[0] == "Start-up"
    assert left[-2:] == ["Shut down", "  3488.900 Hz"]
    assert sum(bool(re.search(r"\+200   ", line)) for line in left) == 1
    assert not any("left, ends" in line or "rails" in line for line in left)


def test_without_colour_there_is_none(xterm: Callable[[int], None], monkeypatch: pytest.MonkeyPatch) -> None:
    xterm(80)
    monkeypatch.setenv("NO_COLOR", "1")
    assert not re.search(r"\x1b\[[0-9;]*3[0-7]m", follow(FakeBench(), LiveProgress))


def test_running_fit_contains_points_before_break() -> None:
    stream = Terminal()
    before = [Point(1, rate, 0.0, -0.0125 * rate - 0.042, 0.0, 10) for rate in (300.0, 150.0)]
    with LiveProgress(stream, 233.0, before) as progress:
        Executor(FakeBench(), MemoryJournal(), [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    assert "line through 19 points" in stream.getvalue()


@pytest.mark.usefixtures("xterm")
def test_answers_that_were_asked_for_again_are_told() -> None:
    stream = Terminal()
    with LiveProgress(stream, 10.0) as progress:
        progress.handle(StepStarted(1, 0.0, Note("Start-up")))
        progress.handle(StepFinished(1, 0.0, Settle(1.0, "rest"), Done(), ("P25V reads +3 V",)))
    assert "query repeated: P25V reads +3 V" in shown(stream.getvalue())


def test_on_a_terminal_a_failure_is_told_to_its_end(xterm: Callable[[int], None]) -> None:
    xterm(30)
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
    with kind(stream, 245.0) as progress:
        done = Executor(FakeBench(), journal, [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    assert done.status is Status.COMPLETE


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.parametrize("kind", few([LineProgress, LiveProgress], every=2))
def test_a_terminal_that_stands_still_holds_nothing_up(kind: type[LineProgress | LiveProgress]) -> None:
    """Ctrl-S stops the output: whoever wrote there would wait until Ctrl-Q."""
    import pty  # noqa: PLC0415  # there is none on Windows
    import termios  # noqa: PLC0415

    screen, line = pty.openpty()
    with open(screen, "rb", buffering=0), open(line, "w", encoding="utf-8") as stream:  # noqa: PTH123
        termios.tcflow(line, termios.TCOOFF)
        with kind(stream, 245.0) as progress:
            done = Executor(FakeBench(), MemoryJournal(), [progress]).execute(
                PROCEDURES["turntable"].plan(make_settings())
            )
        termios.tcflow(line, termios.TCOON)
    assert done.status is Status.COMPLETE
