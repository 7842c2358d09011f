"""Whether `run online` tells the truth: scale factor, windows and disturbance against a closed form, over seeds.

    python benchmarks/online.py [SEEDS [FIRST_SEED [SECONDS]]]

Every instrument is drawn, the gyroscope is warm, K_Vc is told. The truth is the slope of the closed form that the tests
have (tests/sim/gyro/plain.py), no part of the program.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from pathlib import Path
from statistics import fmean, stdev

sys.path.insert(0, str(Path(__file__).parents[1]))

from msgspec import structs

import vcfbench
from tests.procedures.test_k_vc import LAB, truth, warm
from vcfbench.bench.simulated import physical_parameters


def main() -> None:
    """Print a line for each seed, and the scatter of all."""
    seeds, first, seconds = (float(each) for each in (*sys.argv[1:], *("30", "1", "300")[len(sys.argv) - 1 :]))
    errors = structs.replace(LAB.simulation.errors, rate_source="drawn")
    bench = structs.replace(LAB, simulation=structs.replace(LAB.simulation, errors=errors))
    scale_factor, k_vc = truth(warm(physical_parameters(bench)))
    told = {"warm_up_s": 7200.0, "k_vc": repr(k_vc), "duration_s": seconds}
    z, felt, squares, of_windows, held = [], [], [], [], []
    for seed in range(int(first), int(first + seeds)):
        with tempfile.TemporaryDirectory() as runs:
            found = vcfbench.run("online", bench, seed=seed, settings=told, runs=runs).results
        z.append((found.scale_factor.value - scale_factor) / found.scale_factor.u)
        felt.append(found.disturbance.value / found.disturbance.u)
        held.append(abs(found.disturbance.value) <= found.disturbance.expanded_u)
        squares.append(found.chi_square / found.dof)
        of_windows += [(each.scale_factor_v_per_deg_s - scale_factor) / each.u for each in found.windows]
        off_ppm = 1e6 * (found.scale_factor.value / scale_factor - 1.0)
        u_ppm = 1e6 * abs(found.scale_factor.u / scale_factor)
        line = {"seed": seed, "off_ppm": round(off_ppm, 1), "u_ppm": round(u_ppm, 1), "z": round(z[-1], 2)}
        less = found.disturbed_by_less_than_deg_s
        print(json.dumps({**line, "z_disturbance": round(felt[-1], 2), "less_than_deg_s": round(less, 5)}), flush=True)
    for name, values in (("scale factor", z), ("windows", of_windows), ("disturbance", felt)):
        within = sum(abs(each) <= 1.96 for each in values) / len(values)
        scatter = {"mean": fmean(values), "sd": stdev(values), "sd_of_sd": 1.0 / math.sqrt(2.0 * len(values) - 2.0)}
        print(json.dumps({"z of": name, **{key: round(each, 2) for key, each in scatter.items()}, "within": within}))
    print(json.dumps({"chi-square a degree": round(fmean(squares), 3), "disturbance within U95": fmean(held)}))


if __name__ == "__main__":
    main()
