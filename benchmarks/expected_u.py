"""U95 that a dry run expects beside that which the run then states, on the embedded benches.

    python benchmarks/expected_u.py [--benches lab,paper] [--procedures turntable,kvc] [--seed 3]

A line a result: expected, stated, their ratio; where nothing is expected, why. `self-calibration` and `online` go by a
certificate that `kvc` makes first. `zero` takes 20 minutes instead of its hour.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import vcfbench
from vcfbench.errors import BenchError
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.runs.quantities import values_of

BY_DEVICE = ("kvc", "self-calibration", "online")


def compared(procedure: str, bench: str, seed: int, where: str) -> None:
    """Print the lines of one procedure on one bench."""
    settings: dict[str, Any] = {"dut": "G-1", "devices": f"{where}/{bench}"} if procedure in BY_DEVICE else {}
    if procedure == "zero":
        settings["duration_s"] = 1200
    try:
        expected = vcfbench.dry_run(procedure, bench, settings=settings).expected
        if expected.why_none is not None:
            print(f"{bench} {procedure}: {expected.why_none}")
            return
        done = values_of(vcfbench.run(procedure, bench, seed=seed, settings=settings, runs=where))
    except BenchError as error:
        print(f"{bench} {procedure}: {error}")
        return
    for each in expected.values:
        stated = done[each.name].u95 if each.name in done else None
        ratio = f"{each.u95 / stated:6.2f}" if stated else "  none"
        beyond = "" if stated and 0.8 <= stated / each.u95 <= 1.2 else "   beyond 20 %"
        print(f"{bench} {procedure} {each.name}: expected {each.u95:.3g}, stated {stated or 0:.3g}, {ratio}{beyond}")


def main() -> None:
    """Do what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--benches", default="paper,lab,ideal")
    parser.add_argument("--procedures", default=",".join(BUILT_IN))
    parser.add_argument("--seed", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as where:
        for bench in asked.benches.split(","):
            for procedure in asked.procedures.split(","):
                compared(procedure, bench, asked.seed, where)


if __name__ == "__main__":
    main()
