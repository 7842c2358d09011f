"""Whether stated uncertainties tell the truth: calibrations on simulated benches whose instruments are drawn.

Each seed draws every instrument from its accuracy, the generator and the table's rate too, and runs both calibrations.
The ends of the generator's ranges are drawn as well, and the bench file does not know them.
The truth is a closed form of the gyroscope's parameters, which the simulation does not use (vcfbench/studies/truth.py):
demodulated modes at the temperature of a warm gyroscope, modulator, output amplifier, a meter that does not load it.
For every value with an uncertainty the study prints z = (value - truth) / u over the seeds, and how often U95 holds the
truth.

    python benchmarks/truth.py 0 1000 --lines truth.jsonl         seeds 0 to 999, a line each
    python benchmarks/truth.py 0 200 --v-vc measured              V_Vc by a second meter (the bench `lab`)
    python benchmarks/truth.py 0 200 --order abba --zero bracket  other orders, with zeros between
    python benchmarks/truth.py 0 200 --kvc curve                  K_Vc from both signs: plus-minus, curve
    python benchmarks/truth.py 0 200 --ranges known               the generator's ranges are known
    python benchmarks/truth.py 0 200 --phase 0.5                  carrier and demodulator up to 0.5 deg off, and told so
    python benchmarks/truth.py --summary first.jsonl second.jsonl

The same seeds give the same bytes, whatever the number of processes. What stands in the file of --lines is not run
again, so a study that was ended goes on where it was. A thousand seeds are the study that counts: 0.7 s of processor
time each. Records are kept in memory where there is a /dev/shm, since a disk takes longer than the calibration.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import vcfbench
from vcfbench.sim.simulation import physical_parameters
from vcfbench.studies.truth import truth_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from vcfbench.procedures.shared.budget.statement import Statement

    Line = dict[str, Any]

WARM_UP_S = 1800.0
"""Six of the gyroscope's thermal time constants: what is left of the warm-up is no part of this study."""
TABLE_RATE_ERROR = 1e-5

BENCHES = {"set": "paper", "measured": "lab"}
"""The embedded benches by how V_Vc is known."""
K_VC_BY = ("one-point", "plus-minus", "curve")
MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile


PHASE_KEYS = """
k_vc_ppm_carrier_deg = -1107      # of the embedded gyroscope, from its closed form
k_vc_ppm_demodulator_deg = 90
scale_factor_ppm_demodulator_deg = 1022
bias_deg_s_demodulator_deg = -0.3134
"""


def bench_of(seed: int, v_vc: str = "set", phase_deg: float = 0.0, ranges: str = "drawn") -> str:
    """Return an embedded bench with all instruments drawn; its table's rate error and ripple are drawn here.

    Ripple of one phase would put the same 0.8 ppm into the non-linearity of every seed, 0.14 u of it. Phases of carrier
    and demodulator are drawn up to `phase_deg` away from those that the truth is for.
    """
    file = Path(str(vcfbench.__path__[0])) / "station" / f"{BENCHES[v_vc]}.toml"
    text, _ = file.read_text(encoding="utf-8").split("# The generator's errors are chosen", 1)
    if ranges == "drawn":  # and not known
        text = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("generator_ranges_v"))
    draws = np.random.default_rng([seed, 9])
    error = float(draws.uniform(-TABLE_RATE_ERROR, TABLE_RATE_ERROR))
    phases = draws.uniform(-math.pi, math.pi, 2).tolist()
    if phase_deg:
        text = _phases_off(text, phase_deg, draws.uniform(-phase_deg, phase_deg, 2).tolist(), v_vc)
    return f"""{text}
[simulation.errors]
rate_source = "drawn"
[simulation.override.table]
rate_error = {error!r}
ripple_phase_rad = {phases!r}
"""


def _phases_off(text: str, limit_deg: float, off_deg: Sequence[float], v_vc: str) -> str:
    """Return a bench file whose carrier and demodulator are off, and which knows how far they may be."""
    true = physical_parameters(vcfbench.load_bench(BENCHES[v_vc]))
    known = f"[uncertainty]\ncarrier_phase_deg = {limit_deg}\ndemodulator_phase_deg = {limit_deg}{PHASE_KEYS}"
    return f"""{text.replace("[uncertainty]", known, 1)}
[simulation.override.virtual_path]
carrier_phase_rad = {true.virtual_path.carrier_phase_rad + math.radians(off_deg[0])!r}
[simulation.override.sense_path]
demodulator_phase_rad = {true.sense_path.demodulator_phase_rad + math.radians(off_deg[1])!r}
"""


def calibrations(
    seed: int,
    v_vc: str = "set",
    k_vc_by: str = "one-point",
    phase_deg: float = 0.0,
    ranges: str = "drawn",
    **settings: Any,
) -> Line:
    """Return the seed, and by the name of each value of both calibrations its z and whether U95 holds the truth."""
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as directory:
        file = Path(directory) / "bench.toml"
        file.write_text(bench_of(seed, v_vc, phase_deg, ranges), encoding="utf-8")
        arguments: dict[str, Any] = {"bench": file, "seed": seed, "runs": directory}
        arguments["settings"] = {"warm_up_s": WARM_UP_S, **settings}
        table = vcfbench.run("turntable", **arguments)
        arguments["settings"]["k_vc_by"] = k_vc_by
        four = vcfbench.run("virtual-coriolis", **arguments)
        for run in (table, four):
            if run.results is None:
                raise SystemExit(f"seed {seed}: {run.procedure} gave no results: {run.error}")
        description = vcfbench.load_bench(BENCHES[v_vc])
        return {
            "seed": seed,
            **_scored("turntable: ", table.results.uncertainty, truth_of(table, description)),
            **_scored("virtual-coriolis: ", four.results.uncertainty, truth_of(four, description)),
            "e_n": four.results.uncertainty.e_n,
        }


def _scored(prefix: str, statement: Statement, truth: Mapping[str, float]) -> Line:
    return {
        prefix + each.name: [
            (each.value - truth[each.name]) / each.u,
            abs(each.value - truth[each.name]) <= each.u95,
        ]
        for each in statement.values
    }


def study(seeds: Sequence[int], how: Mapping[str, Any], processes: int) -> Iterator[Line]:
    """Yield what each seed gave, in their order."""
    score = partial(calibrations, **how)
    if processes < 2:
        yield from map(score, seeds)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap(score, seeds, chunksize=1)


def continued(file: Path | None, seeds: Sequence[int], how: Mapping[str, Any], processes: int) -> list[Line]:
    """Return the lines of `seeds`: those that stand in `file`, and those that are run now and added to it."""
    if file is None:
        return list(study(seeds, how, processes))
    had = {line["seed"]: line for line in lines_of([file])} if file.exists() else {}
    with file.open("w", encoding="utf-8") as out:
        out.writelines(json.dumps(line) + "\n" for line in had.values())
        for line in study([seed for seed in seeds if seed not in had], how, processes):
            print(json.dumps(line), file=out, flush=True)
            had[line["seed"]] = line
    return [had[seed] for seed in seeds]


def lines_of(files: Iterable[Path]) -> list[Line]:
    """Return the lines of some files; one that was cut off at the end of a file is left out."""
    texts = [text for file in files for text in file.read_text(encoding="utf-8").splitlines(keepends=True)]
    return [json.loads(text) for text in texts if text.endswith("\n")]


def summary(lines: Sequence[Line]) -> list[str]:
    """Return the table of the study, a row a value."""
    rows = [
        f"{len(lines)} seeds, {lines[0]['seed']} to {lines[-1]['seed']}",
        f"{'value':48} {'mean z':>7} {'sd z':>6} {'max |z|':>7} {'in U95':>7}",
    ]
    for name in dict.fromkeys(each for line in lines for each in line if each not in {"seed", "e_n"}):
        stated = [line[name] for line in lines if name in line]  # a non-linearity within its U95 is not stated
        z = np.array([each[0] for each in stated])
        held = np.mean([each[1] for each in stated])
        good = abs(z.mean()) <= 0.1 and 0.93 <= z.std(ddof=1) <= 1.07 and 0.93 <= held <= 0.97
        mark = "" if good else "  *"
        mark += "" if len(stated) == len(lines) else f"  in {len(stated)} seeds"
        rows.append(f"{name:48} {z.mean():+7.3f} {z.std(ddof=1):6.3f} {abs(z).max():7.2f} {100 * held:6.1f}%{mark}")
    ratios = np.array([line["e_n"] for line in lines])
    rows.append(
        f"E_n of the methods: {ratios.min():.2f} to {ratios.max():.2f}, {100 * np.mean(ratios > 1.0):.1f}% above 1"
    )
    error = 1.0 / math.sqrt(len(lines))
    chance = f"the mean varies by {error:.3f}, the sd by {error / math.sqrt(2):.3f}, the share by {22 * error:.1f}%"
    rows.append(f"* outside |mean| 0.1, sd 0.93-1.07 or 93-97 %; by chance alone {chance}")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("start", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=60)
    parser.add_argument("--v-vc", choices=sorted(BENCHES), default="set", help="how V_Vc is known")
    parser.add_argument("--ranges", choices=["drawn", "known"], default="drawn", help="the generator's")
    parser.add_argument("--order", default="paper")
    parser.add_argument("--zero", default="none")
    parser.add_argument("--kvc", choices=K_VC_BY, default="one-point")
    parser.add_argument(
        "--phase", type=float, default=0.0, help="carrier and demodulator are off by up to so much, deg"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--lines", type=Path, help="file that keeps a line a seed")
    parser.add_argument("--summary", type=Path, nargs="+", metavar="FILE", help="run nothing, sum up such files")
    asked = parser.parse_args()
    if asked.summary:
        lines = lines_of(asked.summary)
    else:
        how = {"v_vc": asked.v_vc, "order": asked.order, "zeros": asked.zero, "k_vc_by": asked.kvc}
        how |= {"phase_deg": asked.phase, "ranges": asked.ranges}
        lines = continued(asked.lines, range(asked.start, asked.start + asked.count), how, asked.processes)
    print("\n".join(summary(sorted(lines, key=lambda line: line["seed"]))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
