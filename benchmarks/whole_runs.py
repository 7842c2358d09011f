"""A whole simulated calibration as a process: wall time, peak memory, the same results for the same seed."""

from __future__ import annotations

import json

from measure import COMMAND, Child, Figure, child, median_child, report


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
        ]
    return found


def _repeated(procedure: str, done: Child) -> Figure:
    first, second = (json.loads(each.out) for each in (done, child(command(procedure))))
    different = sum(first[key] != second[key] for key in ("points", "results", "bench_seconds"))
    return report(Figure(f"run {procedure}, parts that differ for one seed", different, "1", bar=0, gross=0))


if __name__ == "__main__":
    figures()
