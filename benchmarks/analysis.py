"""What the analysis costs beside the measurement: one column characterised, an hour's Allan curve."""

from __future__ import annotations

import numpy as np
from measure import COMMAND, Figure, here, median_child, report, seconds_of

from vcfbench.analysis.allan import Sampling, allan_deviation
from vcfbench.analysis.noise_fit import fit_noise
from vcfbench.analysis.scale_factor import characterise

RATE = np.array([200.0, 100, 50, 20, 10, 5, 2, 1, 0, -1, -2, -5, -10, -20, -50, -100, -200])


def figures() -> list[Figure]:
    output = -0.01254 * RATE + 1e-7 * RATE**2
    record = np.random.default_rng(1).standard_normal(3600)
    table = here().parent / "examples" / "paper-table1.csv"
    analyse = median_child([*COMMAND, "analyze", str(table.resolve()), "--json"], 3)
    curve = allan_deviation(record, 1.0)
    sampling = Sampling(1.0, 0.2)
    fit_noise(curve, record.size, sampling)
    long = np.random.default_rng(1).standard_normal(10_000_000)
    return [
        report(Figure("characterise 17 points", 1e3 * seconds_of(lambda: characterise(RATE, output), 25), "ms", bar=2)),
        report(Figure("Allan curve of an hour at 1 Hz", 1e3 * seconds_of(lambda: allan_deviation(record, 1.0)), "ms")),
        report(Figure("its noise coefficients", 1e3 * seconds_of(lambda: fit_noise(curve, 3600, sampling)), "ms")),
        report(
            Figure("Allan curve of ten million samples", seconds_of(lambda: allan_deviation(long, 1.0), 1), "s", bar=2)
        ),
        report(Figure("vcfbench analyze, whole process", analyse.wall_s, "s", bar=0.5, gross=3)),
    ]


if __name__ == "__main__":
    figures()
