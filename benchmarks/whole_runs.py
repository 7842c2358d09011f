"""A whole simulated calibration: as a process, again and again in one process, against its third-party imports.

Then an hour of readings, once a second: by a procedure's window, and by a script that knows nothing of vcfbench.

CPU times are steadier than wall times; `taskset -c 0 python benchmarks/whole_runs.py` keeps them to one core.
"""

from __future__ import annotations

import json
import statistics
import sys

from measure import COMMAND, Child, Figure, child, median_child, peak_mb, report

THIRD_PARTY = (
    "import msgspec, numpy.fft, numpy.ma, numpy.polynomial, numpy.random, pyvisa, serial, typer, typer._adapters, "
    "uncertainties.umath"
)
"""All that a run takes from others; `typer._adapters` is what Typer loads when it reads a command line."""
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
MANY = """
import resource, tempfile, time
import vcfbench
peaks_mb = []
with tempfile.TemporaryDirectory() as runs:
    for seed in range(120):
        started = time.process_time()
        vcfbench.run("virtual-coriolis", seed=seed, runs=runs)
        if seed >= 20:  # until then the process takes what it then keeps
            print(time.process_time() - started)
            peaks_mb.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
print(peaks_mb[-1] - peaks_mb[0])
"""
"""A hundred seeds by the public face; the last figure is by how many MB the process has grown."""
CALLS = """
import cProfile, tempfile
import vcfbench
counted = cProfile.Profile(builtins=False)
with tempfile.TemporaryDirectory() as runs:
    vcfbench.run("virtual-coriolis", seed=1, runs=runs)  # pays for what is loaded once
    counted.runcall(vcfbench.run, "virtual-coriolis", seed=1, runs=runs)
print(sum(each.callcount for each in counted.getstats()))
"""
"""What creeps in shows here, whatever else the machine does: the count is the same each time.

The run alone: what the command's answer says that a run cannot see is some sixty evaluations more.
"""
HOUR_OF_A_PROCEDURE = """
import tempfile, time
import vcfbench as vb

def plan(settings):
    return (yield from vb.powered(settings, window(settings)))

def window(settings):
    started = time.process_time()
    yield from vb.take(settings, 1, rate_deg_s=0.0, v_vc_v=0.0, table_deg_s=0.0)
    took_s.append(time.process_time() - started)

took_s = []
one_window = vb.Procedure(
    name="one-window", title="One window at rest.", settings=vb.ProcedureSettings, plan=plan,
    results=lambda settings, points: len(points), report=lambda settings, points, found: vb.Report([]),
)
for samples in (60, 3600):  # the first pays for what is loaded once
    with tempfile.TemporaryDirectory() as runs:
        vb.run(one_window, seed=1, settings={"samples": samples}, runs=runs)
print(took_s[-1])
"""
HOUR_OF_A_SCRIPT = """
import time
import pyvisa

manager = pyvisa.ResourceManager("?speed=max&seed=1@vcfbench")
meter = manager.open_resource("GPIB0::22::INSTR")
meter.write("CONF:VOLT:DC 10")
meter.write("VOLT:DC:NPLC 10")
meter.query("READ?")
started, instant_s = time.process_time(), manager.visalib.clock.now()
for number in range(3600):
    manager.visalib.clock.sleep_until(instant_s + number)
    float(meter.query("READ?"))
print(time.process_time() - started)
"""


def command(procedure: str, seed: int = 1) -> list[str]:
    return [*COMMAND, "run", procedure, "--json", "--quiet", "--seed", str(seed)]


def figures(runs: int = 5) -> list[Figure]:
    found = []
    for procedure in ("turntable", "virtual-coriolis"):
        done = median_child(command(procedure), runs)
        found += [
            report(Figure(f"run {procedure}, whole process", done.wall_s, "s", bar=2, gross=8)),
            report(Figure(f"run {procedure}, peak memory", peak_mb(command(procedure)), "MB", bar=100, gross=150)),
            report(Figure(f"run {procedure}, bench time", json.loads(done.out)["bench_seconds"], "s")),
            _repeated(procedure, done),
            _beyond_imports(procedure),
            *_against_imports(procedure, runs),
        ]
    called = float(child([sys.executable, "-c", CALLS]).out)
    name = "functions of Python called in a run of virtual-coriolis"
    return [*found, report(Figure(name, called, "1", bar=425e3, gross=435e3)), *_hours(runs)]


def _hours(runs: int) -> list[Figure]:
    """Return the CPU time of an hour of readings at 1 Hz."""
    return [
        report(Figure(name, statistics.median(float(out) for out in _answers(code, runs)), "s", bar=bar, gross=8))
        for name, code, bar in (
            ("an hour at 1 Hz, one window of a procedure, CPU", HOUR_OF_A_PROCEDURE, 0.6),
            ("an hour at 1 Hz, a script on @vcfbench, CPU", HOUR_OF_A_SCRIPT, 1.0),
        )
    ]


def _answers(code: str, runs: int) -> list[str]:
    return [child([sys.executable, "-c", code]).out for _ in range(runs)]


def many() -> list[Figure]:
    """Return what a hundred seeds in one process cost, and by how much the process grows."""
    *each, grown_mb = (float(line) for line in child([sys.executable, "-c", MANY]).out.split())
    return [
        report(Figure("each of 100 seeds in one process, CPU", statistics.median(each), "s", bar=0.25, gross=2)),
        report(Figure("memory grown over 100 seeds", grown_mb, "MB", bar=5, gross=50)),
    ]


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
    many()
