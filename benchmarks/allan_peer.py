"""The Allan curve beside allantools.oadev: the same averaging times, by turns, each in a fresh process for its memory.

The curve alone is compared: allantools gives deviations and a rule of thumb for their errors, and so do we here, who
leave out the exact degrees of freedom. The bars are 1.5 times its time at ten million samples, and less memory; 2 s for
the whole curve with its confidence intervals.
"""

from __future__ import annotations

import statistics
import subprocess
import sys

from measure import Figure, report

SAMPLES = (10_000, 1_000_000, 10_000_000)
CHILD = """
import resource, sys, time
import numpy as np
name, samples = sys.argv[1], int(sys.argv[2])
from vcfbench.analysis.allan import _deviation, allan_deviation, averaging_factors
import allantools
record = np.random.default_rng(1).standard_normal(samples)
factors = averaging_factors(samples)
def ours():
    phase = np.concatenate([[0.0], np.cumsum(record - record.mean())])
    return [_deviation(phase, factor) for factor in factors]
def curve():
    return [point.deviation for point in allan_deviation(record, 1.0)]
def theirs():
    return allantools.oadev(record, rate=1.0, data_type="freq", taus=np.array(factors, float))[1]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
started, cpu = time.perf_counter(), time.process_time()
found = {"ours": ours, "curve": curve, "theirs": theirs}[name]()
cpu, wall = time.process_time() - cpu, time.perf_counter() - started
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(cpu, wall, peak / 1024.0, *(repr(float(each)) for each in found))
"""


def measured(name: str, samples: int) -> list[float]:
    """Return processor seconds, wall seconds, megabytes beyond the record, and the deviations."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD, name, str(samples)], stdout=subprocess.PIPE, text=True, check=True
    )
    return [float(each) for each in done.stdout.split()]


def figures(rounds: int = 3) -> list[Figure]:
    said = []
    for samples in SAMPLES:
        taken: dict[str, list[list[float]]] = {"ours": [], "theirs": [], "curve": []}
        for _ in range(rounds):
            for name, rows in taken.items():
                rows.append(measured(name, samples))
        apart = max(abs(a / b - 1) for a, b in zip(taken["ours"][0][3:], taken["theirs"][0][3:], strict=True))
        ours, theirs, curve = (min(row[0] for row in taken[name]) for name in ("ours", "theirs", "curve"))
        megabytes = {name: statistics.median(row[2] for row in rows) for name, rows in taken.items()}
        large = samples == SAMPLES[-1]
        said += [
            report(Figure(f"Allan of {samples}: ours", ours, "s")),
            report(Figure(f"Allan of {samples}: allantools", theirs, "s")),
            report(Figure(f"Allan of {samples}: against allantools", ours / theirs, "ratio", 1.5 if large else None)),
            report(Figure(f"Allan of {samples}: curve with its intervals", curve, "s", 2.0 if large else None)),
            report(Figure(f"Allan of {samples}: memory", megabytes["ours"], "MB", megabytes["theirs"])),
            report(Figure(f"Allan of {samples}: memory of allantools", megabytes["theirs"], "MB")),
            report(Figure(f"Allan of {samples}: largest difference", apart, "relative", 1e-9)),
        ]
    return said


if __name__ == "__main__":
    figures()
