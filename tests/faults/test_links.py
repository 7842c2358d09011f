"""What is left turning, or hangs, on real wires: by a link that is down, a stopped watchdog, another program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from simrack_tests.cells import few
from simrack_tests.ports import PLENTY_S

from tests.bench.test_holding import SCRIPT, what_is_on
from vcfbench.clock import WallClock, sleep
from vcfbench.station.writing import bench_text
from vcfbench.testing.benches import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the system has no SIGKILL")
REST_S = 5.0
"""Within this time all is at rest and off, once it can be told."""
FROZEN = "os.kill(bench.watchdog._process.pid, signal.SIGSTOP)\n"
FULL = f"{FROZEN}[bench.watchdog.step('x' * 2000, 5.0) for _ in range(200)]\n"
TURNING = "with bench:\n    sleep(bench.clock, 600.0)\n"
BECOMES = "os.execv('/bin/sleep', ['sleep', '600'])\n"
CASES: dict[str, tuple[str, float, int | None]] = {
    # what the script does, for how long the link of its table is down, and the signal to it meanwhile
    "killed, 3 s": (TURNING, 3.0, signal.SIGKILL),
    "killed, 8 s": (TURNING, 8.0, signal.SIGKILL),
    "stopped by a person, 8 s": (TURNING, 8.0, signal.SIGTERM),
    "watchdog stopped": (FROZEN + TURNING, 0.0, None),
    "watchdog stopped, pipe full": (FULL + TURNING, 0.0, None),
    "becomes another program": (BECOMES, 0.0, None),
}


@pytest.mark.parametrize("case", few([*CASES], "killed, 3 s"))
def test_the_table_comes_to_rest(case: str, tmp_path: Path) -> None:
    does, down_s, number = CASES[case]
    with serve_simulated(speed=1.0) as lab:
        bench = structs.replace(lab.on_wires(), served=None)
        quick = {role: structs.replace(getattr(bench, role), timeout_s=1.0) for role in ("rate_table", "power")}
        (tmp_path / "bench.toml").write_text(bench_text(structs.replace(bench, **quick)), encoding="utf-8")
        command = [sys.executable, "-c", SCRIPT + does, str(tmp_path / "bench.toml")]
        with (
            (tmp_path / "said").open("w") as said,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True) as process,  # noqa: S603
        ):
            assert process.stdout is not None
            assert process.stdout.readline() == "<Bench paper, open> 50\n"
            if number is not None:
                lab.fault("rate_table", "unreachable", duration_s=down_s)
                os.kill(process.pid, number)
                sleep(WallClock(), down_s)
                assert what_is_on(lab) != []
            clock = WallClock()
            while (on := what_is_on(lab)) and clock.now() < PLENTY_S:
                sleep(clock, 0.05)
            assert clock.now() < REST_S + (3.0 if "watchdog" in case else 0.0), (tmp_path / "said").read_text()
            assert on == []
            process.kill()
