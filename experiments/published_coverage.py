"""The published coverage: how often U95 holds the truth for every kind of value, and every single error, as data.

    python experiments/published_coverage.py DIRECTORY --seeds 5000:5040     all studies, hours of processor time
    python experiments/published_coverage.py DIRECTORY                       of what stands in the directory

DIRECTORY keeps the lines of the studies, a file each; a study that was ended goes on where it was. Written are the
tables of docs/evidence/published-coverage.md: published-coverage.csv (a row a value), published-errors.csv (the data
set: every error over its U95) and published-budgets.csv (u by another calculator). The exit code is 1 where a share or
a scatter is beyond the limits of limits.py; the page names it.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from ageing import ON_TABLE
from limits import outside
from procedures_truth import STUDIES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

HERE = Path(__file__).parent
EVIDENCE = HERE.parent / "docs" / "evidence"
FRESH, AGED = "fresh", "aged"
LEAST_RUNS = 10
"""Fewer say nothing of a share."""


class Error(NamedTuple):
    """One value beside its truth."""

    state: str
    value: str
    seed: int
    z: float | None
    """Error over the standard uncertainty; none of a bound."""
    held: bool
    """Whether U95, or the bound, held the truth."""


def ran(script: str, *arguments: str) -> None:
    """Run a study to its end; its exit code tells of limits, which the table does too."""
    done = subprocess.run([sys.executable, HERE / script, *arguments], check=False, capture_output=True, text=True)
    if done.returncode not in {0, 1}:
        raise SystemExit(f"{script} {' '.join(arguments)} ended with {done.returncode}: {done.stderr[-400:]}")


def ran_all(directory: Path, seeds: str) -> None:
    """Run every study for some seeds; the lines go into the directory."""
    first, last = map(int, seeds.split(":"))
    four = ["--v-vc", "measured", "--lines", str(directory / "four-measured.jsonl")]
    ran("truth.py", str(first), str(last - first), *four)
    for procedure in STUDIES:
        ran("procedures_truth.py", procedure, seeds, "--lines", str(directory / f"{procedure}.jsonl"))
    ran("ageing.py", "--seeds", seeds, "--lines", str(directory / "ageing.jsonl"))


def errors(line: dict[str, Any]) -> Iterator[Error]:
    """Yield what a line of `ageing.py`, `procedures_truth.py` or `truth.py` holds; a refusal has nothing."""
    seed = int(line["seed"])
    if "cause" in line:
        scored = {name: value for name, value in line.items() if isinstance(value, dict) and "z" in value}
        state = FRESH if line["cause"] == ON_TABLE else AGED
        for name, value in scored.items():  # of all causes together
            yield Error(state, f"self-calibration: {name}", seed, value["z"], value["within_95"])
    elif "procedure" in line:
        for name, (value, truth, u, u95) in line["values"].items():
            called = f"{line['procedure']}: {name}"
            if u is None:
                yield Error(FRESH, called, seed, None, truth <= value)
            elif u95 is not None:
                yield Error(FRESH, called, seed, (value - truth) / u, abs(value - truth) <= u95)
    else:
        for name, value in line.items():
            if isinstance(value, list):
                yield Error(FRESH, name, seed, value[0], value[1])


def row(state: str, value: str, found: Sequence[Error]) -> list[str]:
    """Return the row of a value: runs, z, share within U95, and what is beyond the limits."""
    z = [each.z for each in found if each.z is not None]
    held = [each.held for each in found]
    beyond = outside(held, z)
    spread = [f"{np.mean(z):+.2f}", f"{np.std(z):.2f}"] if z else ["", ""]
    quantiles = " ".join(f"{each:+.1f}" for each in np.quantile(z, [0.025, 0.25, 0.5, 0.75, 0.975])) if z else ""
    return [state, value, str(len(found)), *spread, quantiles, f"{100.0 * np.mean(held):.1f} %", beyond]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path)
    parser.add_argument("--seeds", help="run the studies for them, first and the one after the last")
    asked = parser.parse_args()
    asked.directory.mkdir(parents=True, exist_ok=True)
    if asked.seeds:
        ran_all(asked.directory, asked.seeds)
        ran("foreign_budget.py", "0:10", "--csv", str(EVIDENCE / "published-budgets.csv"))
    by_value: dict[tuple[str, str], list[Error]] = defaultdict(list)
    for file in sorted(asked.directory.glob("*.jsonl")):
        for text in file.read_text(encoding="utf-8").splitlines():
            for error in errors(json.loads(text)):
                by_value[error.state, error.value].append(error)
    rows = [row(*value, found) for value, found in sorted(by_value.items()) if len(found) >= LEAST_RUNS]
    with (EVIDENCE / "published-coverage.csv").open("w", newline="", encoding="utf-8") as table:
        csv.writer(table, lineterminator="\n").writerows(
            [["state", "value", "runs", "mean z", "sd z", "z at 2.5 25 50 75 97.5 %", "in U95", "beyond"], *rows]
        )
    with (EVIDENCE / "published-errors.csv").open("w", newline="", encoding="utf-8") as data:
        out = csv.writer(data, lineterminator="\n")
        out.writerow(["state", "value", "seed", "z", "held"])
        for found in by_value.values():
            out.writerows((e.state, e.value, e.seed, "" if e.z is None else f"{e.z:.3f}", int(e.held)) for e in found)
    print("\n".join("  ".join(each) for each in rows))
    return int(any(each[-1] for each in rows))


if __name__ == "__main__":
    sys.exit(main())
