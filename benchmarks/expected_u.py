"""U95 that a dry run expects beside that which the run then states, on the embedded benches.

    python benchmarks/expected_u.py [--benches lab,paper] [--procedures turntable,kvc] [--seed 3]

A line a result: expected, stated, their ratio; those that are said not to be known, those of which nothing is said.
`self-calibration` and `online` go by a certificate that `kvc` makes first. `zero` takes 20 minutes instead of its hour.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import vcfbench
from vcfbench.archive.quantities import named_values
from vcfbench.errors import BenchError
from vcfbench.procedures.titles import BUILT_IN

if TYPE_CHECKING:
    from vcfbench import Run

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
        done = stated_by(vcfbench.run(procedure, bench, seed=seed, settings=settings, runs=where))
    except BenchError as error:
        print(f"{bench} {procedure}: {error}")
        return
    unknown = {name for name, _ in expected.unknown}
    for each in expected.values:
        stated = done.pop(each.name, None)
        ratio = f"{each.u95 / stated:6.2f}" if stated else "  none"
        beyond = "" if stated and 0.8 <= stated / each.u95 <= 1.2 else "   beyond 20 %"
        print(f"{bench} {procedure} {each.name}: expected {each.u95:.3g}, stated {stated or 0:.3g}, {ratio}{beyond}")
    for name, stated in done.items():
        said = "said not to be known" if name in unknown else "NOT EXPECTED"
        print(f"{bench} {procedure} {name}: {said}, stated {stated:.3g}")


def stated_by(run: Run) -> dict[str, float]:
    """Return each U95 that the results of a run state, those of its parts too."""
    parts = getattr(run.results, "parts", None)
    named = [(f"{each.name}.", each.results) for each in parts] if parts else [("", run.results)]
    found = {before + name: value for before, of in named for name, value in named_values(of).items()}
    return {
        name: each.stated_u95
        for name, each in found.items()
        if each.stated_u95 and each.stated_u95 > 1e-9 * abs(each.value)
    }


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
