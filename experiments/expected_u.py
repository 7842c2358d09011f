"""U95 that a dry run expects beside that which the run then states, on benches of drawn gyroscopes and embedded ones.

    python experiments/expected_u.py [--benches gyroscope-7,lab] [--procedures turntable,kvc] [--seed 3]

A line a result: expected, stated, their ratio; those that are said not to be known, those of which nothing is said.
`self-calibration` and `online` go by a certificate that `kvc` makes first. `zero` takes 20 minutes instead of its hour.
The exit code is 1 where one is beyond 20 %, or stated and not expected.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import vcfbench
from vcfbench.errors import BenchError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.stated import values_of
from vcfbench.testing.gyroscopes import drawn_bench

if TYPE_CHECKING:
    from vcfbench import Run

BY_DEVICE = ("kvc", "self-calibration", "online")


def compared(procedure: str, bench: str, seed: int, where: str) -> bool:
    """Print the lines of one procedure on one bench; return whether there is nothing to be mended in them."""
    drawn, good = bench.removeprefix("gyroscope-"), True
    station = parse_bench(drawn_bench(int(drawn)), bench) if drawn != bench else vcfbench.load_bench(bench)
    settings: dict[str, Any] = {"dut": "G-1", "devices": f"{where}/{bench}"} if procedure in BY_DEVICE else {}
    if procedure == "zero":
        settings["duration_s"] = 1200
    try:
        expected = vcfbench.dry_run(procedure, station, settings=settings).expected
        if expected.why_none is not None:
            print(f"{bench} {procedure}: {expected.why_none}")
        done = stated_by(vcfbench.run(procedure, station, seed=seed, settings=settings, runs=where))
    except BenchError as error:
        print(f"{bench} {procedure}: {error}")
        return False
    unknown = {name for name, _ in expected.unknown}
    for each in expected.values:
        stated = done.pop(each.name, None)
        ratio = f"{each.u95 / stated:6.2f}" if stated else "  none"
        beyond = "" if stated and 0.8 <= stated / each.u95 <= 1.2 else "   beyond 20 %"
        good = good and not beyond
        print(f"{bench} {procedure} {each.name}: expected {each.u95:.3g}, stated {stated or 0:.3g}, {ratio}{beyond}")
    for name, stated in done.items():
        said = "said not to be known" if name in unknown else "NOT EXPECTED"
        good = good and name in unknown
        print(f"{bench} {procedure} {name}: {said}, stated {stated:.3g}")
    return good


def stated_by(run: Run) -> dict[str, float]:
    """Return each U95 that the results of a run state, those of its parts too."""
    found = values_of(run.results).items()
    return {name: each.u95 for name, each in found if each.u95 and each.u95 > 1e-9 * abs(each.value or 0.0)}


def main() -> int:
    """Do what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--benches", default="gyroscope-1,gyroscope-2,gyroscope-3,lab")
    parser.add_argument("--procedures", default=",".join(BUILT_IN))
    parser.add_argument("--seed", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as where:
        good = [
            compared(procedure, bench, asked.seed, where)
            for bench in asked.benches.split(",")
            for procedure in asked.procedures.split(",")
        ]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
