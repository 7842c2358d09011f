"""A whole simulated calibration: as a process, again and again in one process, against its third-party imports.

CPU times are steadier than wall times; `taskset -c 0 python benchmarks/whole_runs.py` keeps them to one core.
"""

from __future__ import annotations

import json
import statistics
import sys

from measure import COMMAND, Child, Figure, child, median_child, report

THIRD_PARTY = "import msgspec, numpy, pyvisa, scipy.special, serial, typer"
"""All that a run takes from others."""
AGAIN_AND_AGAIN = """
import contextlib, io, sys, time
from vcfbench.cli.main import main
for seed in range(9):
    sys.argv = ["vcfbench", "run", "{procedure}", "--json", "--quiet", "--seed", str(seed)]
    started = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main()
    print(time.process_time() - started)
"""
"""Runs in one process; the first pays for the imports."""


def command(procedure: str, seed: int = 1) -> list[str]:
    return [*COMMAND, "run", procedure, "--json", "--quiet", "--seed", str(seed)]


def figures(runs: int = 5) -> list[Figure]:
    found = []
    for procedure in ("turntable", "virtual-coriolis"):
        done = median_child(command(procedure), runs)
        found += [
            report(Figure(f"run {procedure}, whole process", done.wall_s, "s", bar=2, gross=8)),
            report(Figure(f"run {procedure}, peak memory", done.peak_mb or 0.0, "MB", bar=200, gross=250)),
            report(Figure(f"run {procedure}, bench time", json.loads(done.out)["bench_seconds"], "s")),
            _repeated(procedure, done),
            _beyond_imports(procedure),
            *_against_imports(procedure, runs),
        ]
    return found


def _beyond_imports(procedure: str) -> Figure:
    each = [
        float(line) for line in child([sys.executable, "-c", AGAIN_AND_AGAIN.format(procedure=procedure)]).out.split()
    ]
    return report(Figure(f"run {procedure}, CPU beyond imports", statistics.median(each[1:]), "s", bar=0.25, gross=2))


def _against_imports(procedure: str, runs: int) -> list[Figure]:
    """Return the CPU time of the whole process, and its ratio to that of the imports, taken in turns."""
    pairs = [(child(command(procedure)).cpu_s, child([sys.executable, "-c", THIRD_PARTY]).cpu_s) for _ in range(runs)]
    known = [(whole, imports) for whole, imports in pairs if whole is not None and imports is not None]
    if not known:
        return []
    whole, ratio = (statistics.median(each) for each in ((w for w, _ in known), (w / i for w, i in known)))
    return [
        report(Figure(f"run {procedure}, CPU of the whole process", whole, "s")),
        report(Figure(f"run {procedure}, whole over third-party imports", ratio, "ratio", bar=2.0)),
    ]


def _repeated(procedure: str, done: Child) -> Figure:
    first, second = (json.loads(each.out) for each in (done, child(command(procedure))))
    different = sum(first[key] != second[key] for key in ("points", "results", "bench_seconds"))
    return report(Figure(f"run {procedure}, parts that differ for one seed", different, "1", bar=0, gross=0))


if __name__ == "__main__":
    figures()
