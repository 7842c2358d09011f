"""Whether `run online` tells the truth: scale factor, windows, disturbance and drift against closed forms, over seeds.

    python experiments/online.py [SEEDS [FIRST_SEED [SECONDS]]]
    python experiments/online.py --aged [SEEDS [FIRST_SEED [SECONDS]]]

Every instrument is drawn, and so is what the run is told of split and share of the modes; the gyroscope is warm. The
truth is the slope of the closed form that the tests have
(tests/sim/gyro/plain.py), no part of the program. K_Vc is told; with `--aged` it is that of a certificate which
`run kvc` makes with the same specimens before, and the gyroscope ages between two runs as in self_calibration.py. The
exit code is 1 where a scatter, or what lies within 1.96, is beyond limits.py.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from limits import outside
from msgspec import structs
from self_calibration import LAB, SIMULATION, ageing_of, bench_of

import vcfbench
from tests.procedures.test_kvc import truth, warm
from tests.procedures.test_self_calibration import looked_after
from vcfbench.sim.simulation import physical_parameters


def with_known_k_vc(seed: int, seconds: float) -> dict[str, list[float]]:
    """Return the z of one run with a K_Vc that is exact, and its chi-square a degree of freedom."""
    errors = structs.replace(SIMULATION.errors, rate_source="drawn")
    bench = structs.replace(LAB, simulation=structs.replace(SIMULATION, errors=errors))
    scale_factor, k_vc = truth(warm(physical_parameters(bench)))
    bench = looked_after(bench)
    settings: dict[str, Any] = {"warm_up_s": 7200.0, "k_vc": repr(k_vc), "duration_s": seconds, **_believed(seed)}
    with tempfile.TemporaryDirectory() as runs:
        found = vcfbench.run("online", bench, seed=seed, settings=settings, runs=runs).results
    return {
        "scale factor": [_z(found.scale_factor, scale_factor)],
        "windows": [(each.scale_factor_v_per_deg_s - scale_factor) / each.u for each in found.windows],
        "disturbance": [_z(found.disturbance, 0.0)],
        "disturbance over U95": [found.disturbance.value / found.disturbance.u95 * 1.96],
        "chi-square a degree": [found.chi_square / found.dof],
    }


def _believed(seed: int) -> dict[str, float]:
    """Return what a run is told of the modes, as far from the truth as its u says: one gyroscope has one response."""
    off = np.random.default_rng([seed, 3]).standard_normal(2)
    return {"split_hz": 24.8 + 0.5 * float(off[0]), "in_phase_share": 0.147 + 0.05 * float(off[1])}


def aged(seed: int, seconds: float) -> dict[str, list[float]]:
    """Return the z of a run with a certificate, of one after ageing, and of the drift that the second finds."""
    fresh, old = (looked_after(bench_of(seed, "drawn", each)) for each in ({}, ageing_of(seed)))
    (before, _), (after, _) = (truth(warm(physical_parameters(each))) for each in (fresh, old))
    with tempfile.TemporaryDirectory() as where:
        settings: dict[str, Any] = {"dut": "G", "devices": f"{where}/devices", "warm_up_s": 1800.0}
        vcfbench.run("kvc", fresh, seed=3 * seed, settings=settings, runs=where)
        settings["duration_s"] = seconds
        first = vcfbench.run("online", fresh, seed=3 * seed + 1, settings=settings, runs=where).results
        second = vcfbench.run("online", old, seed=3 * seed + 2, settings=settings, runs=where).results
    return {
        "scale factor": [_z(first.scale_factor, before)],
        "scale factor, aged": [_z(second.scale_factor, after)],
        "drift, none": [_z(first.drift.change_ppm, 0.0)],
        "drift, aged": [_z(second.drift.change_ppm, 1e6 * (after / before - 1.0))],
        "u of the scale factor, ppm": [1e6 * abs(first.scale_factor.u / before)],
    }


def _z(found: Any, true: float) -> float:
    return float((found.value - true) / found.u)


NO_ERROR = "chi-square a degree", "u of the scale factor, ppm", "disturbance", "windows"
"""What is no error of one run over its U95: of each run many windows share what is common to them."""


def main() -> int:
    """Print a line for each seed, and the scatter of all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--aged", action="store_true")
    parser.add_argument("seeds", nargs="?", type=int, default=30)
    parser.add_argument("first", nargs="?", type=int, default=1)
    parser.add_argument("seconds", nargs="?", type=float, default=300.0)
    asked = parser.parse_args()
    found: dict[str, list[float]] = {}
    for seed in range(asked.first, asked.first + asked.seeds):
        one = (aged if asked.aged else with_known_k_vc)(seed, asked.seconds)
        for name, values in one.items():
            found.setdefault(name, []).extend(values)
        line = {name: round(values[0], 2) for name, values in one.items() if len(values) == 1}
        print(json.dumps({"seed": seed, **line}), flush=True)
    good = True
    for name, values in found.items():
        held = [abs(each) <= 1.96 for each in values]
        good = good and (name in NO_ERROR or not outside(held, values))
        within = sum(held) / len(values)
        scatter = {"mean": fmean(values), "sd": stdev(values), "sd of sd": 1.0 / math.sqrt(2.0 * len(values) - 2.0)}
        print(json.dumps({"of": name, **{key: round(each, 2) for key, each in scatter.items()}, "within 1.96": within}))
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
