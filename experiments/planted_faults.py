"""Whether `vcfbench analyze` tells of a fault in a record before the fault moves a result by its U95.

    python experiments/planted_faults.py               12 kinds x 20 sizes x 3 records, and 500 clean records
    python experiments/planted_faults.py --clean 50    fewer clean ones

A record has white noise, flicker and a random walk of drawn sizes, 20 000 readings at 100 a second. A fault is planted
with 20 sizes over four decades; of each the largest change of a stated N, B or K, or of the mean, over its U95 is
taken; the mean's is 1.96 times the Allan deviation of the longest average. A fault that moves a result by more than its
U95 without a notice is missed; a notice for a clean record is false. The exit code is 1 where one is missed or false.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import vcfbench

if TYPE_CHECKING:
    from collections.abc import Mapping

READINGS, RATE_HZ = 20_000, 100.0
SIZES = np.geomspace(0.01, 100.0, 20)
"""In standard deviations of a reading; kinds that have a length or a share take what fits."""


def clean(draw: np.random.Generator) -> Any:
    """Return a record at rest, deg/s: white noise, flicker and a random walk whose sizes are drawn."""
    white = 0.05 * draw.standard_normal(READINGS)
    spectrum = np.fft.rfft(draw.standard_normal(READINGS))
    hz = np.fft.rfftfreq(READINGS, 1.0 / RATE_HZ)
    flicker = np.fft.irfft(spectrum / np.sqrt(np.maximum(hz, hz[1])), READINGS)
    walk = np.cumsum(draw.standard_normal(READINGS)) / math.sqrt(READINGS)
    sizes = 0.05 * 10.0 ** draw.uniform(-3.0, -1.0, 2)
    return draw.uniform(-2.0, 2.0) + white + sizes[0] * flicker / flicker.std() + sizes[1] * walk


def place(draw: np.random.Generator, length: int = 1) -> slice:
    """Return so many readings, anywhere but at the ends."""
    begin = int(draw.integers(READINGS // 10, READINGS - READINGS // 10 - length))
    return slice(begin, begin + length)


def glitch(record: Any, size: float, draw: np.random.Generator) -> Any:
    record[place(draw)] += size
    return record


def glitches(record: Any, size: float, draw: np.random.Generator) -> Any:
    record[draw.integers(0, READINGS, 40)] += size * draw.choice([-1.0, 1.0], 40)
    return record


def turned(record: Any, size: float, draw: np.random.Generator) -> Any:
    record[place(draw, 200)] += size
    return record


def stepped(record: Any, size: float, draw: np.random.Generator) -> Any:
    record[place(draw).start :] += size
    return record


def swung(record: Any, size: float, draw: np.random.Generator) -> Any:
    where = place(draw, 2000)
    record[where] += size * np.sin(2.0 * math.pi * 0.5 * np.arange(2000) / RATE_HZ)
    return record


def stuck(record: Any, size: float, draw: np.random.Generator) -> Any:
    where = place(draw, int(min(0.7 * READINGS, 2 + READINGS * size / 5.0)))
    record[where] = record[where.start]
    return record


def zeros(record: Any, size: float, draw: np.random.Generator) -> Any:
    record[place(draw, int(min(0.7 * READINGS, 2 + READINGS * size / 5.0)))] = 0.0
    return record


def clipped(record: Any, size: float, _draw: np.random.Generator) -> Any:
    limit = np.quantile(record, 1.0 - min(0.49, size / 10.0))
    return np.minimum(record, limit)


def wrapped(record: Any, size: float, _draw: np.random.Generator) -> Any:
    top = np.quantile(record, 1.0 - min(0.49, size / 10.0))
    span = 20.0 * 0.05
    return np.where(record > top, record - span, record)


def held(record: Any, size: float, _draw: np.random.Generator) -> Any:
    times = round(1 + min(size * 10.0, 50.0))
    return np.repeat(record[::times], times)[: record.size]


def other_gain(record: Any, size: float, draw: np.random.Generator) -> Any:
    begin = place(draw).start
    record[begin:] *= 1.0 + size / 0.05 / 10.0
    return record


def noisy(record: Any, size: float, draw: np.random.Generator) -> Any:
    where = place(draw, 2000)
    record[where] += size * draw.standard_normal(2000)
    return record


KINDS: Mapping[str, Any] = {
    each.__name__: each
    for each in (
        glitch, glitches, turned, stepped, swung, stuck, zeros, clipped, wrapped, held, other_gain, noisy,
    )
}  # fmt: skip


def analysed(record: Any, folder: Path) -> Any:
    """Return what `vcfbench analyze --rate 100` says of a record."""
    file = folder / "record.csv"
    file.write_text("rate / (deg/s)\n" + "\n".join(f"{each:.6f}" for each in record) + "\n")
    return vcfbench.analyze_record(file, RATE_HZ)


def results(found: Any) -> dict[str, tuple[float, float]]:
    """Return value and U95 of each result: coefficients that are stated, and the mean as such means scatter."""
    stated = {each.name: (each.value, 1.96 * each.u) for each in found.noise if each.value and each.u}
    return {**stated, "mean": (found.mean_deg_s, 1.96 * found.allan_deg_h[-1].high / 3600.0)}


def moved(before: Any, after: Any) -> float:
    """Return the largest change of a result over its U95 of before."""
    was, now = results(before), results(after)
    return max((abs(now[name][0] - value) / u95 for name, (value, u95) in was.items() if name in now), default=0.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clean", type=int, default=500)
    parser.add_argument("--records", type=int, default=3)
    asked = parser.parse_args()
    missed = false = 0
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        for name, kind in KINDS.items():
            told, untold = 0, []
            for seed in range(asked.records):
                base = clean(np.random.default_rng([seed, 1]))
                before = analysed(base, folder)
                for size in SIZES:
                    after = analysed(kind(base.copy(), 0.05 * size, np.random.default_rng([seed, 2])), folder)
                    by = moved(before, after)
                    if after.notices:
                        told += 1
                    elif by > 1.0:
                        untold.append(f"{size:.2g}: {by:.1f}")
            missed += len(untold)
            print(
                f"{name:10} told {told:3} of {len(SIZES) * asked.records}, missed {len(untold):2}: {'; '.join(untold)}"
            )
        for seed in range(asked.clean):
            found = analysed(clean(np.random.default_rng([seed, 3])), folder)
            if found.notices:
                false += 1
                print(f"clean record {seed}: {found.notices}")
    print(f"{missed} missed, {false} of {asked.clean} clean records told of")
    return int(bool(missed or false))


if __name__ == "__main__":
    sys.exit(main())
