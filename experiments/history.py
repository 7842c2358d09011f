"""Whether a change of scale factor is told from one of plan or conditions: runs over drawn rates, on drawn gyroscopes.

    python experiments/history.py                    100 plans on each of 4 gyroscopes, 5 minutes on 2 processors
    python experiments/history.py --devices 20 --processes 8

Each gyroscope has a curve of its own. Half of its plans are as people choose them, half are drawn: 3 to 21 rates up to
20 to 300 deg/s, on one side or both. Each run has a seed, and so a meter and a table, of its own. Pairs of runs are
compared as `vcfbench device` does it, alone and with a run of 17 rates beside them. The truth of an unaged gyroscope is
no change, that of an aged one is put into its output stage. Then the paper's printed column against itself by nine
pairs of sub-plans, and runs at another temperature and with other rails. The exit code is 1 where a share is beyond
what must be (`BARS`).
"""

from __future__ import annotations

import argparse
import csv
import math
import multiprocessing
import os
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from random import Random
from statistics import fmean
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import vcfbench
from vcfbench.analysis.shared_curve import Windows, slopes_over
from vcfbench.archive.change import Coefficients, Compared, Difference, Pair
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.device_values import Measured
from vcfbench.station.settings import PAPER_RATES_DEG_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from vcfbench.archive.run import Run

PEOPLES = (
    *(PAPER_RATES_DEG_S, (200, 150, 100, 50, 0, -50, -100, -150, -200), (100, 50, 20, 0, -20, -50, -100)),
    *((50, 0, -50), (200, 0, -200), (100, 0, -100), (200, 100, 50, 20, 0), (300, 200, 100, 0, -100, -200, -300)),
    *((200, 100, 0, -100, -200), (100, 50, 0, -50, -100)),
)
AGED_PPM = 500.0
BARS: Mapping[str, tuple[float, float]] = {
    "stated": (0.75, 1.0),
    "unaged: |E_n| < 1": (0.94, 0.995),
    "unaged: rms of z": (0.8, 1.2),
    "aged, with a run of 17 rates: found": (0.90, 1.0),
    "aged: truth in U95": (0.90, 1.0),
    "other conditions: truth in U95": (0.90, 1.0),
    "Table 1: sub-plans that agree": (1.0, 1.0),
}
PAPER = Path(vcfbench.__file__).parent / "station" / "paper.toml"
TABLE_1 = Path(__file__).parents[1] / "examples" / "paper-table1.csv"
WHITE_DEG_S = 2.8e-3
SUB_PLANS: Sequence[tuple[Sequence[float], Sequence[float]]] = (
    *((PAPER_RATES_DEG_S, (50, 0, -50)), (PAPER_RATES_DEG_S, (200, 0, -200)), (PAPER_RATES_DEG_S, (100, 0, -100))),
    *((PAPER_RATES_DEG_S, (200, 100, 50, 20, 0)), (PAPER_RATES_DEG_S, (20, 10, 0, -10, -20))),
    *(((100, 50, 0, -50, -100), (200, 20, 0, -20, -200)), ((200, 0, -200), (50, 0, -50))),
    *(((200, 100, 0, -100, -200), (50, 20, 0, -20, -50)), ((200, 50, 0, -50, -200), (100, 10, 0, -10, -100))),
)


def drawn_plan(random: Random) -> tuple[float, ...]:
    """Return the rates of a run, falling."""
    if random.random() < 0.5:
        return random.choice(PEOPLES)
    reach, count = float(random.randint(20, 300)), random.randint(3, 21)
    low = -reach if random.random() < 0.8 else 0.0
    rates = {round(random.uniform(low, reach), 1) for _ in range(count - 2)} | {low, reach}
    return tuple(sorted(rates | ({0.0, 0.5 * reach} if len(rates) < 3 else set()), reverse=True))


def bench_of(device: int, *, aged_ppm: float = 0.0, ambient_c: float | None = None) -> Any:
    """Return the paper's bench with a gyroscope whose output stage has a curve of its own, and has aged."""
    random, aged = Random(f"curve {device}"), 1.0 + 1e-6 * aged_ppm  # noqa: S311  # curves, no secrets
    second, third = (random.choice((-1.0, 1.0)) * math.exp(random.uniform(-1.2, 0.7)) for _ in range(2))
    stage = {
        "gain": aged,
        "second_order_per_v": 4e-4 * second / aged,
        "third_order_per_v2": 2e-4 * third / aged**2,
    }
    text = PAPER.read_text(encoding="utf-8")
    text += "\n[simulation.override.output_stage]\n" + "".join(f"{key} = {each!r}\n" for key, each in stage.items())
    if ambient_c is not None:
        text += f"[simulation.override.thermal]\nambient_c = {ambient_c!r}\n"
    return parse_bench(text, f"gyroscope-{device}")


def ran(device: int, seed: int, rates: Sequence[float], bench: Any, **settings: Any) -> Run:
    """Return a calibration of a gyroscope on the table."""
    asked = {"rates_deg_s": list(rates), "warm_up_s": 1800.0, **settings}
    temperature = bench.simulation.override.get("thermal", {}).get("ambient_c", 20.0)
    told = {"dut": f"G{device}", "ambient_temperature_c": temperature}
    return vcfbench.run("turntable", bench, seed=seed, settings=asked, runs=None, metadata=told)


def changed(first: Run, other: Run, known: Coefficients, *witnesses: Run) -> Difference:
    """Return the change of the scale factor, in ppm."""
    pair = Pair(Compared(first), Compared(other), lambda: known, [Compared(each) for each in witnesses])
    found, ppm = pair.change(first.values["scale_factor"], other.values["scale_factor"]), 1e6
    size = first.values["scale_factor"].value or 0.0
    if found.value is None or found.u is None or found.u95 is None:
        return found
    return Difference(ppm * found.value / size, ppm * found.u / abs(size), ppm * found.u95 / abs(size), found.e_n)


def of_device(asked: tuple[int, int]) -> list[tuple[str, float, Difference]]:
    """Return the changes that are found of a gyroscope, each with its kind and the truth."""
    device, plans = asked
    random = Random(f"plans {device}")  # noqa: S311  # plans, no secrets
    seeds = iter(range(1000 * device, 1000 * (device + 1)))
    fresh, aged = bench_of(device), bench_of(device, aged_ppm=AGED_PPM)
    rates = [drawn_plan(random) for _ in range(plans)]
    none = Coefficients()
    witness = ran(device, next(seeds), PAPER_RATES_DEG_S, fresh)
    runs = [ran(device, next(seeds), each, fresh) for each in rates]
    later = [ran(device, next(seeds), each, aged) for each in rates[: plans // 2]]
    found: list[tuple[str, float, Difference]] = []
    for first, other in pairwise(runs):
        found.append(("alone", 0.0, changed(first, other, none)))
        found.append(("with", 0.0, changed(first, other, none, witness)))
    for first, other in zip(runs[1:], later, strict=False):
        found.append(("aged", AGED_PPM, changed(first, other, none, witness)))
    known = Coefficients(Measured(value=-104.0, u=2.0), Measured(value=375.0, u=15.0))
    warm = bench_of(device, ambient_c=25.0)
    for place in range(max(2, plans // 20)):
        first, plan = runs[place], rates[place]
        found.append(("conditions", 0.0, changed(first, ran(device, next(seeds), plan, warm), known, witness)))
        wider = ran(device, next(seeds), plan, fresh, positive_rail_v=10.4, negative_rail_v=-10.4)
        found.append(("conditions", 0.0, changed(first, wider, known, witness)))
    return found


def table_1() -> Iterator[tuple[float, float]]:
    """Yield change and U95, ppm, of the printed column by pairs of sub-plans, of which nothing can have changed."""
    with TABLE_1.open(encoding="utf-8") as file:
        printed = {float(row["rate_deg_s"]): float(row["turntable_v"]) for row in csv.DictReader(file)}
    for pair in SUB_PLANS:
        seen, slopes = [], []
        for rates in pair:
            rate, output = np.array(rates, dtype=float), np.array([printed[float(each)] for each in rates])
            slopes.append(float(np.polyfit(rate, output, 1)[0]))
            seen.append(Windows(rate, output / slopes[-1], WHITE_DEG_S**2 * np.eye(rate.size), WHITE_DEG_S))
        over = min(pair, key=lambda each: max(each) - min(each))
        found = slopes_over(over, seen)
        values = found.values * slopes
        ratio = float(values[1] / values[0])
        by = np.array([-1.0, 1.0]) / found.values
        yield 1e6 * (ratio - 1.0), 1.96e6 * math.sqrt(float(by @ found.covariance @ by))


def shares(found: Sequence[tuple[str, float, Difference]]) -> dict[str, float]:
    """Return by name what `BARS` asks of it."""

    def of(kind: str) -> list[tuple[float, Difference]]:
        return [(true, each) for name, true, each in found if name == kind]

    def stated(kind: str) -> list[tuple[float, float, float, float]]:
        numbers = [(true, each.value, each.u, each.u95) for true, each in of(kind)]
        return [(true, value, u, u95) for true, value, u, u95 in numbers if value is not None and u and u95]

    alone, aged, conditions = stated("alone"), stated("aged"), stated("conditions")
    print(f"unaged pairs: {len(of('alone'))}, stated {len(alone)}, with a run of 17 rates {len(stated('with'))}")
    medians = [float(np.median([each[3] for each in of])) for of in (alone, aged)]
    print("median U95: alone {:.0f} ppm, aged {:.0f} ppm".format(*medians))
    table = list(table_1())
    return {
        "stated": len(alone) / len(of("alone")),
        "unaged: |E_n| < 1": fmean(abs(value) < u95 for _, value, _, u95 in [*alone, *stated("with")]),
        "unaged: rms of z": math.sqrt(fmean((value / u) ** 2 for _, value, u, _ in alone)),
        "aged, with a run of 17 rates: found": sum(abs(value) > u95 for _, value, _, u95 in aged) / len(of("aged")),
        "aged: truth in U95": fmean(abs(value - true) < u95 for true, value, _, u95 in aged),
        "other conditions: truth in U95": fmean(abs(value) < u95 for _, value, _, u95 in conditions),
        "Table 1: sub-plans that agree": fmean(abs(change) < u95 for change, u95 in table),
    }


def main() -> None:
    """Make the runs, print the shares, and end with 1 where one is beyond its bar."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", type=int, default=4)
    parser.add_argument("--plans", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, multiprocessing.Pool(asked.processes) as pool:
        os.chdir(folder)
        found = [each for of in pool.imap(of_device, [(n, asked.plans) for n in range(asked.devices)]) for each in of]
    beyond = False
    for name, share in shares(found).items():
        low, high = BARS[name]
        beyond |= not low <= share <= high
        print(f"{name}: {share:.3f} ({low:g} to {high:g}){'' if low <= share <= high else '  BEYOND'}")
    sys.exit(beyond)


if __name__ == "__main__":
    main()
