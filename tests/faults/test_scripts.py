"""A script that raises while its bench is open leaves the table at rest and every output off, on every Python.

`VCFBENCH_PYTHONS` names further interpreters that have the package, as in a path.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests.faults.benches import SPEED, Served, bench_text, serving
from vcfbench.clock import WallClock, sleep

if TYPE_CHECKING:
    from pathlib import Path

PYTHONS = [sys.executable, *filter(None, os.environ.get("VCFBENCH_PYTHONS", "").split(os.pathsep))]
SCRIPT = """
import sys
from vcfbench.bench.bench import open_bench
from vcfbench.procedures.bench_file import load_bench
from vcfbench.clock import sleep

bench = open_bench(load_bench(sys.argv[1]))
bench.power.configure_output("P25V", 10.0, 0.1)
bench.power.configure_output("N25V", -10.0, 0.1)
bench.power.enable_outputs()
bench.rate_table.enable()
bench.rate_table.set_rate(100.0, 500.0)
sleep(bench.clock, 1.0)
print(bench.rate_table.rate_deg_s(), flush=True)
{ends}
"""
ENDS = {  # of this Python the others are in tests/bench/test_holding.py
    "raises": "raise ValueError('a mistake in the script')",
    "leaves": "sys.exit(7)",
    "ends": "",
    "forgets": "bench = None; raise ValueError('a mistake in the script')",
}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals"),
]


def performed(served: Served, command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a script that has come as far as it should: again if this machine is too slow for its time-outs."""
    for _ in range(5):
        served.reset()
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120.0)  # noqa: S603 - ours
        if done.stdout:
            return done
    raise AssertionError(done.stderr)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("python", "how"), [(PYTHONS[0], "forgets"), *((python, how) for python in PYTHONS[1:] for how in ENDS)]
)
def test_a_script_that_ends_with_its_bench_open(python: str, how: str, tmp_path: Path) -> None:
    text = bench_text("acl", name=f"scripts-{tmp_path.parent.name}"[:60])
    with serving(tmp_path, text, speed=SPEED["acl"]) as served:
        bench, script = tmp_path / "served.toml", tmp_path / "script.py"
        bench.write_text(served.bench_file(served.resources("tcp")))
        script.write_text(SCRIPT.format(ends=ENDS[how]))
        done = performed(served, [python, str(script), str(bench)])
        assert float(done.stdout.split()[0]) == pytest.approx(100.0, abs=5.0), done.stderr
        clock = WallClock()
        while not (physics := served.physics()).safe and clock.now() < 20.0:
            sleep(clock, 0.1)
        assert physics.safe, (how, physics, done.stderr)
        assert ("a mistake in the script" in done.stderr) == (how in {"raises", "forgets"}), done.stderr
