"""What all benchmarks share: fresh processes with their wall time and peak memory, loops, one JSON line a figure."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

COMMAND = (sys.executable, "-c", "from vcfbench.cli.main import main; main()")
"""`vcfbench` in this very interpreter, without the launcher's own start-up."""


@dataclass(frozen=True)
class Figure:
    """One figure; `bar` is what it should come to, `gross` what it must (a regression nobody can overlook)."""

    figure: str
    value: float
    unit: str
    bar: float | None = None
    gross: float | None = None
    at_least: bool = False

    @property
    def holds(self) -> bool:
        """Tell whether the gross bar holds."""
        if self.gross is None:
            return True
        return self.value >= self.gross if self.at_least else self.value <= self.gross


def report(figure: Figure) -> Figure:
    """Print the figure as one JSON line."""
    print(json.dumps({**asdict(figure), "value": float(f"{figure.value:.5g}")}), flush=True)
    return figure


@dataclass(frozen=True)
class Child:
    """A process that has ended."""

    wall_s: float
    out: str
    cpu_s: float | None = None


WARM = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Environment of what is timed: with that variable each process compiles all modules anew, a second of CPU."""


def child(command: Sequence[str]) -> Child:
    """Run `command` in an empty working directory; its CPU time is None where the system does not tell."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        started = time.perf_counter()
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=errors, cwd=folder, env=WARM)
        cpu_s = _wait(process)
        wall_s = time.perf_counter() - started
        if process.returncode:
            errors.seek(0)
            raise SystemExit(f"{' '.join(command)}: exit {process.returncode}\n{errors.read().decode()}")
        out.seek(0)
        return Child(wall_s, out.read().decode(), cpu_s)


def _wait(process: subprocess.Popen[bytes]) -> float | None:
    """Wait; return the CPU time, s, where the system tells."""
    if not hasattr(os, "wait4"):
        process.wait()
        return None
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime


_LAUNCHER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def peak_mb(command: Sequence[str]) -> float:
    """Return the peak memory of `command`, MB; what begins it is small, for Linux counts that of its parent to it."""
    in_a_mb = 2**20 if sys.platform == "darwin" else 2**10
    return float(child([sys.executable, "-S", "-c", _LAUNCHER, *command]).out) / in_a_mb


def median_child(command: Sequence[str], runs: int) -> Child:
    """Run `command` once to warm the caches, then `runs` times; return the one with the median wall time."""
    child(command)
    return sorted((child(command) for _ in range(runs)), key=lambda done: done.wall_s)[runs // 2]


def per_second(call: Callable[[], object], *, seconds: float = 0.5, repeats: int = 3) -> float:
    """Return the median number of calls a second."""
    call()
    found = []
    for _ in range(repeats):
        done, started = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - started) < seconds:
            for _ in range(20):
                call()
            done += 20
        found.append(done / elapsed)
    return statistics.median(found)


def seconds_of(call: Callable[[], object], repeats: int = 5) -> float:
    """Return the median wall time of one call, s."""
    found = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        found.append(time.perf_counter() - started)
    return statistics.median(found)


def here() -> Path:
    """Return the folder of the benchmarks."""
    return Path(__file__).parent
