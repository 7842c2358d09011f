"""Whether another calculator finds the same uncertainties: ten values of the four steps, propagated by GTC.

Every window of a run is a number of GTC (MSL New Zealand) with the scatter of its readings, every instrument is one
number that all windows share, and the lines are fitted to such numbers: GTC differentiates, not vcfbench. Taken from
the run's own budget are only inputs: limits of the instruments, kelvins that are left of a warm-up, and what flicker
does to a line, a match or an asymmetry.

    pip install GTC
    python experiments/foreign_budget.py 0:10
    python experiments/foreign_budget.py 0:10 --csv foreign.csv

For each value it prints the least and the largest ratio of both u over the seeds; the exit code is 1 where one is more
than 1 % away from 1.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import GTC as gtc  # noqa: N811  # its own documentation spells it so
import numpy as np

import vcfbench

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from vcfbench.records.schema import Point

LIMIT = 0.01
"""Both u agree so well."""
KNOWN = vcfbench.load_bench("lab").uncertainty
B_DEG_H, SCALE_FACTOR_PER_K, BIAS_DEG_S_PER_K = (
    (KNOWN.bias_instability_deg_h or 0.0),
    1e-6 * (KNOWN.scale_factor_ppm_k or 0.0),
    (KNOWN.bias_deg_h_k or 0.0) / 3600.0,
)
"""What the bench file tells."""
ZERO = 8
"""Place of 0 deg/s among the 17 rates, from the largest to the smallest."""
SETTLE_S, ACCELERATION_DEG_S2 = 2.0, 100.0
V_VC_STEPS = 2, 4
"""The table stands in them."""
DAY_S = 86400.0
"""A bias is the mean of so long a time around the run."""


class Inputs:
    """The inputs of a run's budget by their names, each an uncertain number whose value is 0."""

    def __init__(self, stated: Iterable[Any]) -> None:
        self._u = {part.source: part.u_source for value in stated for part in value.parts}
        self._numbers: dict[str, Any] = {}

    def __getitem__(self, source: str) -> Any:
        if source not in self._numbers:
            self._numbers[source] = gtc.ureal(0.0, self._u[source])
        return self._numbers[source]


def flicker_v(run: Any) -> float:
    """Return B of the bench file at the output of a run, V."""
    slope = run.results.uncertainty.value(
        "turntable.scale_factor" if run.procedure == "virtual-coriolis" else "scale_factor"
    ).value
    return float(B_DEG_H / 3600.0 * abs(slope))


def windows(run: Any, b_v: float) -> list[Any]:
    """Return the output of each window, V, with the scatter of the readings of all of them and with flicker.

    Args:
        run: whose points these are.
        b_v: B, the bias instability, V.
    """
    variance = math.fsum((p.n - 1) * p.std_v**2 for p in run.points) / sum(p.n - 1 for p in run.points)
    ends = instants(run.points)
    middle = (ends[0][0] + ends[-1][1]) / 2.0
    flicker = np.linalg.cholesky(deviations([*ends, (middle - DAY_S / 2.0, middle + DAY_S / 2.0)]))
    modes = [gtc.ureal(0.0, 1.0) for _ in ends]
    return [
        gtc.ureal(point.output_v, math.sqrt(variance / point.n))
        + b_v * sum(float(row[k]) * mode for k, mode in enumerate(modes) if row[k])
        for point, row in zip(run.points, flicker, strict=True)
    ]


def instants(points: Sequence[Point]) -> list[tuple[float, float]]:
    """Return when the windows begin and end, s: ramps, settling and readings in turn (docs/uncertainty.md)."""
    found, now, rate = [], 0.0, points[0].rate_deg_s
    for point in points:
        turns = 0.0 if point.step in V_VC_STEPS else point.rate_deg_s
        now += SETTLE_S + abs(turns - rate) / ACCELERATION_DEG_S2
        found.append((now, now + point.n * 1.0))
        now, rate = found[-1][1], turns
    return found


def deviations(times: Sequence[tuple[float, float]]) -> Any:
    """Return the covariance of means over some times, less the mean over the last of them, of flicker of B = 1.

    A two-sided spectrum 1 / (2 pi f) has the covariance -ln(t) / pi and a constant, which differences do not have. The
    mean of ln over two intervals is the second difference of F(t) = t^2 ln(t) / 2 - 3 t^2 / 4 at their ends.
    """

    def twice(t: Any) -> Any:
        size = np.maximum(np.abs(t), 1e-12)
        return size**2 * np.log(size) / 2.0 - 0.75 * size**2

    begin, end = np.array(times).T
    spans = np.outer(end - begin, end - begin)
    first, last = begin[:, None], end[:, None]
    ln = (twice(last - begin) - twice(last - end) - twice(first - begin) + twice(first - end)) / spans
    whole = -ln / math.pi
    return whole[:-1, :-1] - whole[:-1, -1:] - whole[-1:, :-1] + whole[-1, -1]


def fitted(x: Sequence[Any], y: Sequence[Any]) -> tuple[Any, Any]:
    """Return slope and intercept of the least-squares line of uncertain numbers, both of which may err."""
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    slope = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / sum((a - mean_x) ** 2 for a in x)
    return slope, mean_y - slope * mean_x


def four_steps(run: Any) -> dict[str, Any]:
    """Return nine values of a four-step run whose V_Vc is measured, as uncertain numbers."""
    known = Inputs(run.results.uncertainty.values)
    by_step: dict[int, list[tuple[Point, Any]]] = defaultdict(list)
    for point, output in zip(run.points, windows(run, flicker_v(run)), strict=True):
        by_step[point.step].append((point, (output - known["meter offset"]) / (1.0 + known["meter gain"])))
    rate = 1.0 + known["table rate"]
    kelvins = known["warm-up"]

    def warm(slope: Any, bias: Any) -> tuple[Any, Any, Any]:
        """Return slope, bias and bias as a rate at the temperature of a warm gyroscope (U4 of docs/uncertainty.md)."""
        per_k, drift = SCALE_FACTOR_PER_K * kelvins, BIAS_DEG_S_PER_K * kelvins
        return slope * (1.0 + per_k), bias - drift * slope, bias / slope - drift

    def level(point: Point) -> Any:
        """Return V_Vc as the second meter read it, its gain, offset and readings uncertain."""
        assert point.v_vc_std_v is not None  # noqa: S101 - the bench has a second meter
        reading = gtc.ureal(point.v_vc_measured_v, point.v_vc_std_v / math.sqrt(point.n))
        return reading * (1.0 + known["V_Vc meter gain, 10 V range"]) - known["V_Vc meter offset, 10 V range"]

    slope, bias = fitted([point.rate_deg_s * rate for point, _ in by_step[3]], [output for _, output in by_step[3]])
    table = warm(slope, bias)

    def mean(step: int, chosen: Any) -> Any:
        group = [(point, output) for point, output in by_step[step] if chosen(point)]
        return sum(point.n * output for point, output in group) / sum(point.n for point, _ in group)

    match_rate = max(point.rate_deg_s for point, _ in by_step[1])
    turned = mean(1, lambda p: p.rate_deg_s) - mean(1, lambda p: not p.rate_deg_s)
    best_v = by_step[2][-1][0].v_vc_v
    pushed = mean(2, lambda p: p.v_vc_v == best_v) - mean(2, lambda p: p.v_vc_v == 0.0)
    levels = {p.v_vc_v: level(p) for p, _ in by_step[2]}
    best, zero = levels[best_v], levels[0.0]
    # the level at which both outputs would be alike, by the slope between zero and the match
    alike = (best - zero) * turned / pushed
    k_vc = match_rate * rate / alike

    x = [k_vc * level(point) for point, _ in by_step[4]]
    slope, bias = fitted(x, [output for _, output in by_step[4]])
    virtual = warm(slope, bias)
    return {
        "k_vc": k_vc,
        "turntable.scale_factor": table[0],
        "turntable.bias": table[1],
        "turntable.bias_deg_s": table[2],
        "virtual.scale_factor": virtual[0],
        "virtual.bias": virtual[1],
        "virtual.bias_deg_s": virtual[2],
        "scale_factor_error_percent": 100.0 * (virtual[0] / table[0] - 1.0),
        "bias_difference_v": virtual[1] - table[1],
    }


def asymmetry(run: Any) -> Any:
    """Return the asymmetry of a turntable run, ppm, as an uncertain number."""
    known = Inputs(run.results.uncertainty.values)
    outputs = [(point.rate_deg_s, y) for point, y in zip(run.points, windows(run, flicker_v(run)), strict=True)]
    sides = [fitted(*zip(*side, strict=True))[0] for side in (outputs[: ZERO + 1], outputs[ZERO:])]
    share = 2e6 * (sides[0] - sides[1]) / (sides[0] + sides[1])
    per_k = next(
        part.sensitivity for part in run.results.uncertainty.value("asymmetry").parts if part.source == "warm-up"
    )
    return share + per_k * known["warm-up"]


def ratios(seed: int) -> Mapping[str, float]:
    """Return u of GTC over u of vcfbench, by value."""
    with tempfile.TemporaryDirectory() as runs:
        four = vcfbench.run("virtual-coriolis", bench="lab", seed=seed, runs=runs)
        table = vcfbench.run("turntable", bench="lab", seed=seed, runs=runs)
        theirs = {name: (value, four) for name, value in four_steps(four).items()}
        theirs["asymmetry"] = asymmetry(table), table
    return {
        name: gtc.uncertainty(value) / run.results.uncertainty.value(name).u for name, (value, run) in theirs.items()
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="?", default="0:5", help="first, and the one after the last")
    parser.add_argument("--csv", type=Path, help="file for the table")
    asked = parser.parse_args()
    found = [ratios(seed) for seed in range(*map(int, asked.seeds.split(":")))]
    rows = [(name, min(r[name] for r in found), max(r[name] for r in found)) for name in found[0]]
    for name, least, most in rows:
        print(f"{name:28} {least:.4f} to {most:.4f}{'' if max(1.0 - least, most - 1.0) < LIMIT else '  * apart'}")
    if asked.csv:
        with asked.csv.open("w", newline="", encoding="utf-8") as file:
            out = csv.writer(file)
            out.writerow(["value", "u by GTC over u by vcfbench"])
            out.writerows((f"`{name}`", f"{least:.4f} to {most:.4f}") for name, least, most in rows)
    return int(any(max(1.0 - least, most - 1.0) >= LIMIT for _, least, most in rows))


if __name__ == "__main__":
    sys.exit(main())
