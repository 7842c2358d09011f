"""Sign pairs, drives, quadratures and splits, one at a time: how each procedure ends, and what its values are.

    python experiments/kinds.py --lines kinds.jsonl                      all, with noise
    python experiments/kinds.py split=-80 drive=12000 --procedures kvc,phase
    python experiments/kinds.py --summary kinds.jsonl                    the table alone

A line a gyroscope, as drawn_gyroscopes.py has it. A cell of the table is the largest |z| of the values that have a
closed form, "complete" where none has, or how the run ended. What stands in the file of --lines is not run again. The
exit code is 1 where a run has ended without results after it had switched something on.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from drawn_gyroscopes import ORDER, lines_of, tried
from procedures_truth import MEMORY

from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.gyro.data_sheet import DataSheet
from vcfbench.sim.own_gyro import own_gyro_bench

Line = dict[str, Any]
SHEET = {"angle_random_walk_deg_sqrt_h": 0.1, "bias_instability_deg_h": 1.0, "quadrature_deg_s": 20.0}
PROCEDURES = "kvc,bandwidth,resonance,phase,virtual-coriolis,self-calibration,vibration,characterize"
SIGNS = {"+": 1.0, "-": -1.0}
KINDS: dict[str, dict[str, float]] = {
    **{
        f"K_Vc {k_vc}, split {split}": {"k_vc_deg_s_per_v": 150.0 * SIGNS[k_vc], "split_hz": 24.8 * SIGNS[split]}
        for k_vc in SIGNS
        for split in SIGNS
    },
    **{f"drive={1e3 * each:g}": {"drive_hz": 1e3 * each} for each in (1.0, 2.0, 4.1, 5.0, 8.0, 12.0, 18.0, 25.0, 50.0)},
    **{f"quadrature={each:g}": {"quadrature_deg_s": each} for each in (0.0, 60.0, 100.0, 150.0, 300.0)},
    **{
        f"split={sign * each:g}": {"split_hz": sign * each}
        for each in (3.0, 8.0, 24.8, 40.0, 80.0)
        for sign in (1.0, -1.0)
    },
}
"""What is other than in `SHEET`; Q is at least what gives the response a peak."""


def gyroscope(kind: str, procedures: list[str]) -> Line:
    """Return the line of a gyroscope; its records are taken away."""
    figures, usual = {**SHEET, **KINDS[kind]}, DataSheet()
    peak = 3.0 * figures.get("drive_hz", usual.drive_hz) / abs(figures.get("split_hz", usual.split_hz))
    sheet = DataSheet(**figures, q_sense=max(usual.q_sense, peak))
    bench, before = parse_bench(own_gyro_bench(sheet, "kind", imperfections=True), "kind"), Path.cwd()
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as directory:
        os.chdir(directory)  # what is known of the device is kept here
        try:
            return {"kind": kind, "runs": {name: tried(name, bench, 1) for name in ORDER if name in procedures}}
        finally:
            os.chdir(before)


def cell(run: Line) -> str:
    """Return the largest |z| of a run, or how it ended."""
    sizes = [abs(value - truth) / u for _, value, truth, u, _ in run.get("values", ()) if u]
    return f"{max(sizes):.2f}" if sizes else run["end"]


def table(lines: list[Line]) -> str:
    """Return the table: a row a gyroscope, a column a procedure."""
    names = [name for name in ORDER if any(name in line["runs"] for line in lines)]
    rows = [["kind", *names], ["---", *("---:" for _ in names)]]
    rows += [
        [line["kind"], *(cell(line["runs"][name]) if name in line["runs"] else "" for name in names)] for line in lines
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="all without")
    parser.add_argument("--procedures", default=PROCEDURES)
    parser.add_argument("--lines", type=Path, default=Path("kinds.jsonl"))
    parser.add_argument("--summary", type=Path, help="run nothing, show such a file")
    asked = parser.parse_args()
    lines = lines_of(asked.summary or asked.lines)
    had = {line["kind"] for line in lines}
    for kind in () if asked.summary else [each for each in asked.kinds or KINDS if each not in had]:
        lines.append(gyroscope(kind, asked.procedures.split(",")))
        with asked.lines.open("a", encoding="utf-8") as out:
            print(json.dumps(lines[-1]), file=out)
    print(table(lines))
    ended = [
        (line["kind"], name, run.get("why", ""))
        for line in lines
        for name, run in line["runs"].items()
        if run["end"] == "ended"
    ]
    print(*(": ".join(each) for each in ended), sep="\n")
    return int(bool(ended))


if __name__ == "__main__":
    sys.exit(main())
