"""A bench whose program died or hangs is made safe by the watchdog, without a person."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

from tests.bench.test_holding import what_is_on
from tests.cli.test_safe import UNWATCHED, bench_file, left_live
from vcfbench.clock import WallClock, sleep
from vcfbench.record.journal import append_line
from vcfbench.testing.benches import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.testing.benches import ServedLab

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the system has no SIGKILL")
GENEROUS_S = 30.0


def safe_after_s(lab: ServedLab) -> float:
    clock = WallClock()
    while what_is_on(lab) and clock.now() < GENEROUS_S:
        sleep(clock, 0.1)
    return clock.now()


@pytest.mark.parametrize("signal", ["SIGKILL", "SIGSTOP"])
def test_a_bench_whose_program_died_or_hangs_is_made_safe(signal: str, tmp_path: Path) -> None:
    with serve_simulated() as lab:
        path = bench_file(lab, tmp_path)
        with left_live(path, f"os.kill(os.getpid(), signal.{signal})") as process:
            assert safe_after_s(lab) < GENEROUS_S
            assert process.wait(GENEROUS_S) == -9  # one that hangs is ended: it might switch things on again


def test_the_death_of_the_watchdog_stops_a_run(tmp_path: Path) -> None:
    with serve_simulated() as lab:
        wait = "    sleep(vcfbench.clock.WallClock(), 2.0)\n    sleep(bench.clock, 1.0)\n"
        end = f"import vcfbench.clock\nwith bench:\n    {UNWATCHED.splitlines()[0]}\n{wait}"
        with left_live(bench_file(lab, tmp_path), end) as process:
            assert process.wait(GENEROUS_S) != 0
        assert what_is_on(lab) == []


def test_a_torn_line_makes_room_for_the_watchdog_s(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(b'{"type":"header"}\n{"type":"st')
    append_line(journal, {"type": "watchdog", "safe": True})
    first, second = journal.read_bytes().splitlines()
    assert first == b'{"type":"header"}'
    assert second.startswith(b'{"type":"watchdog","safe":true,"utc":"')
