from __future__ import annotations

import io
from typing import TYPE_CHECKING

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.executor import Executor
from vcfbench.report.progress import LineProgress, LiveProgress

if TYPE_CHECKING:
    import pytest


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def follow(bench: FakeBench, kind: type[LineProgress | LiveProgress]) -> str:
    stream = Terminal()
    with kind(stream, 221.0) as progress:
        Executor(bench, MemoryJournal(), [progress]).execute(PROCEDURES["turntable"].plan(make_settings()))
    return stream.getvalue()


def test_one_plain_line_a_step_with_bench_time_and_time_left() -> None:
    lines = follow(FakeBench(), LineProgress).splitlines()
    assert lines[0] == "     0.0 s     221 s left  * Start-up"
    averaged = next(line for line in lines if "average" in line)
    assert averaged.startswith(
        "    16.0 s     205 s left  average 10 readings, one every 1 s: +200 deg/s, V_Vc +0 V -> "
    )
    assert averaged.endswith("-> -2.54200 V, s 0.0e+00 V")
    assert len(lines) == 11 + 1 + 17 * 4 + 2 + 6
    assert all(line.isascii() for line in lines)


def test_a_failed_step_is_told() -> None:
    bench = FakeBench()
    bench.multimeter.overload_at = 3
    assert "FAILED: multimeter at FAKE::22: overload" in follow(bench, LineProgress)


def test_on_a_terminal_two_lines_are_drawn_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    text = follow(FakeBench(), LiveProgress)
    assert "supply outputs off" in text
    assert text.count("supply outputs on") <= 1  # drawn at its own pace, not once a step
