"""Whether stated uncertainties tell the truth: calibrations on simulated benches whose instruments are drawn.

Each seed draws a gyroscope of the kind and every instrument from its accuracy, the generator and the table's rate too,
and runs both calibrations. The ends of the generator's ranges are drawn as well, and the bench file does not know them.
The truth is a closed form of the gyroscope's parameters, which the simulation does not use (vcfbench/studies/truth.py):
demodulated modes at the temperature of a warm gyroscope, modulator, output amplifier, a meter that does not load it.
For every value with an uncertainty the study prints z = (value - truth) / u over the seeds, and how often U95 holds the
truth; the exit code is 1 where one is beyond its limits.

    python experiments/truth.py 0 1000 --lines truth.jsonl         seeds 0 to 999, a line each
    python experiments/truth.py 0 200 --v-vc measured              V_Vc by a second meter
    python experiments/truth.py 0 200 --order abba --zero bracket  other orders, with zeros between
    python experiments/truth.py 0 200 --kvc curve                  K_Vc from both signs: plus-minus, curve
    python experiments/truth.py 0 200 --ranges known               the generator's ranges are known
    python experiments/truth.py 0 200 --phase 0.5                  carrier and demodulator up to 0.5 deg off, as given
    python experiments/truth.py --summary first.jsonl second.jsonl

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
from typing import TYPE_CHECKING, Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from limits import outside
from msgspec import structs

import vcfbench
from vcfbench.errors import MeasurementError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.simulation import physical_parameters, true_output
from vcfbench.studies.truth import truth_of
from vcfbench.testing.gyroscopes import drawn_bench

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from vcfbench.station.description import BenchDescription
    from vcfbench.uncertainty.statement import Statement

    Line = dict[str, Any]

BEYOND = "  * "
"""Before what is beyond the limits."""
WARM_UP_S = 1800.0
"""Six of the gyroscope's thermal time constants: what is left of the warm-up is no part of this study."""
V_VC = ("set", "measured")
K_VC_BY = ("one-point", "plus-minus", "curve")
USUAL_RANGES_V = (0.1, 0.316, 1.0, 3.16, 10.0)
MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile


def bench_of(seed: int, v_vc: str = "set", ranges: str = "drawn") -> BenchDescription:
    """Return the bench of the gyroscope of a seed, all instruments drawn, its table too."""
    bench = parse_bench(drawn_bench(seed), f"gyroscope-{seed}")
    known = USUAL_RANGES_V if ranges == "known" else None  # by the bench file; it does not know those that are drawn
    return structs.replace(
        bench,
        v_vc_meter=bench.v_vc_meter if v_vc == "measured" else None,
        uncertainty=structs.replace(bench.uncertainty, generator_ranges_v=known),
    )


def phases_off(bench: BenchDescription, limit_deg: float, seed: int) -> BenchDescription:
    """Return a bench whose carrier and demodulator are off by up to a limit, and which knows how far they may be."""
    draws = np.random.default_rng([seed, 9]).uniform(-limit_deg, limit_deg, 2).tolist()
    here, step_deg = Small.of(bench), 0.1
    carrier, demodulator = (Small.of(_turned(bench, *off)) for off in ((step_deg, 0.0), (0.0, step_deg)))
    known = {
        "carrier_phase_deg": limit_deg,
        "demodulator_phase_deg": limit_deg,
        "k_vc_ppm_carrier_deg": 1e6 * (carrier.k_vc / here.k_vc - 1.0) / step_deg,
        "k_vc_ppm_demodulator_deg": 1e6 * (demodulator.k_vc / here.k_vc - 1.0) / step_deg,
        "scale_factor_ppm_demodulator_deg": 1e6 * (demodulator.slope / here.slope - 1.0) / step_deg,
        "bias_deg_s_demodulator_deg": (demodulator.bias_v - here.bias_v) / here.slope / step_deg,
    }
    return structs.replace(_turned(bench, *draws), uncertainty=structs.replace(bench.uncertainty, **known))


class Small(NamedTuple):
    """What is true of small signals."""

    bias_v: float
    slope: float
    k_vc: float

    @classmethod
    def of(cls, bench: BenchDescription) -> Small:
        """Return it by the closed form of the warm gyroscope."""
        output = true_output(bench, at_input=True)
        slope = (output(0.01, None) - output(-0.01, None)) / 0.02
        return cls(output(0.0, None), slope, (output(0.0, 1e-4) - output(0.0, -1e-4)) / 2e-4 / slope)


def _turned(bench: BenchDescription, carrier_deg: float, demodulator_deg: float) -> BenchDescription:
    """Return the bench with carrier and demodulator turned."""
    true, simulation = physical_parameters(bench), bench.simulation
    assert simulation is not None  # noqa: S101 - a drawn one is
    phases = {
        "virtual_path": {"carrier_phase_rad": true.virtual_path.carrier_phase_rad + math.radians(carrier_deg)},
        "sense_path": {"demodulator_phase_rad": true.sense_path.demodulator_phase_rad + math.radians(demodulator_deg)},
    }
    override = {**simulation.override}
    for group, values in phases.items():
        override[group] = {**override.get(group, {}), **values}
    return structs.replace(bench, simulation=structs.replace(simulation, override=override))


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
        true = bench_of(seed, v_vc, ranges)
        bench = phases_off(true, phase_deg, seed) if phase_deg else true
        arguments: dict[str, Any] = {"bench": bench, "seed": seed, "runs": directory}
        arguments["settings"] = {"warm_up_s": WARM_UP_S, **settings}
        try:
            table = vcfbench.run("turntable", **arguments)
            arguments["settings"]["k_vc_by"] = k_vc_by
            four = vcfbench.run("virtual-coriolis", **arguments)
        except MeasurementError as error:
            return {"seed": seed, "refused": str(error)}
        return {
            "seed": seed,
            **_scored("turntable: ", table.results.uncertainty, truth_of(table, true)),
            **_scored("virtual-coriolis: ", four.results.uncertainty, truth_of(four, true)),
            "e_n": four.results.uncertainty.e_n,
        }


def _scored(prefix: str, statement: Statement, truth: Mapping[str, float]) -> Line:
    return {
        prefix + each.name: [
            (each.value - truth[each.name]) / each.u,
            abs(each.value - truth[each.name]) <= each.u95,
        ]
        for each in statement.values
        if each.name in truth  # of the asymmetry `procedures_truth.py turntable` has it
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
    refused = [f"seed {line['seed']} refused: {line['refused']}" for line in lines if "refused" in line]
    rows = [
        f"{len(lines)} seeds, {lines[0]['seed']} to {lines[-1]['seed']}",
        *refused,
        f"{'value':48} {'mean z':>7} {'sd z':>6} {'max |z|':>7} {'in U95':>7}",
    ]
    lines = [line for line in lines if "refused" not in line]
    if not lines:
        return rows
    for name in dict.fromkeys(each for line in lines for each in line if each not in {"seed", "e_n"}):
        stated = [line[name] for line in lines if name in line]  # a non-linearity within its U95 is not stated
        z = np.array([each[0] for each in stated])
        held = np.mean([each[1] for each in stated])
        beyond = outside([each[1] for each in stated], z.tolist())
        mark = f"{BEYOND}{beyond}" if beyond else ""
        mark += "" if len(stated) == len(lines) else f"  in {len(stated)} seeds"
        rows.append(f"{name:48} {z.mean():+7.3f} {z.std(ddof=1):6.3f} {abs(z).max():7.2f} {100 * held:6.1f}%{mark}")
    ratios = np.array([line["e_n"] for line in lines])
    rows.append(
        f"E_n of the methods: {ratios.min():.2f} to {ratios.max():.2f}, {100 * np.mean(ratios > 1.0):.1f}% above 1"
    )
    error = 1.0 / math.sqrt(len(lines))
    chance = f"the mean varies by {error:.3f}, the sd by {error / math.sqrt(2):.3f}, the share by {22 * error:.1f}%"
    rows.append(f"by chance alone {chance}")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("start", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=60)
    parser.add_argument("--v-vc", choices=V_VC, default="set", help="how V_Vc is known")
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
    rows = summary(sorted(lines, key=lambda line: line["seed"]))
    print("\n".join(rows))
    return int(any(BEYOND in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
