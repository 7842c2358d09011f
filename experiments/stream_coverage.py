"""Whether U95 holds where the output is a stream of numbers: drawn devices, lines and frames, known true values.

Each seed is three benches, one of each kind of number: 16-bit rates in LSB or deg/s, 32-bit increments. Instruments
and table are drawn, a device clock within 200 ppm, up to 20 ms of delay; of every other one 1 % of the frames are
dropped, 1 % have a wrong bit.
True values are those of the closed form. Records at rest likewise: their mean against the true output, and N.

    python experiments/stream_coverage.py 0:40 0:10                       seeds of turntables, of records at rest
    python experiments/stream_coverage.py 0:400 0:100 --lines lines.jsonl     goes on where it was stopped
"""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from pathlib import Path
from random import Random
from typing import Any

import msgspec
from msgspec import structs

import vcfbench
from vcfbench.errors import BenchError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.sim.gyro.data_sheet import DataSheet, noise_bandwidth_hz
from vcfbench.sim.simulation import physical_parameters, true_output
from vcfbench.station.description import BenchDescription
from vcfbench.studies.truth import turntable_truth

FRAME = {"header": "A5 5A", "length": 12, "counter": {"at": 2, "type": "uint8"}, "checksum": {"name": "crc16-modbus"}}
KINDS: dict[str, dict[str, Any]] = {
    "rate, LSB": {"unit": "LSB", "value": {"at": 6, "type": "int16"}},
    "rate, deg/s": {"unit": "deg/s", "value": {"at": 6, "type": "int16", "scale": 1.0 / 131.0}},
    "increment": {"unit": "deg", "kind": "increment", "value": {"at": 4, "type": "int32", "scale": 1e-6}},
}
RATES_DEG_S = (200.0, 100.0, 20.0, 0.0, -20.0, -100.0, -200.0)
TURNTABLE = {"rates_deg_s": RATES_DEG_S, "samples": 5, "warm_up_s": 5400.0}
BAND_HZ = noise_bandwidth_hz(DataSheet(), 0.5)
"""Noise bandwidth of a reading of half a second, the paper's being that of another."""
AT_REST = {
    "duration_s": 200.0,
    "powered_s": 5400.0,
    "noise_bandwidth_hz": BAND_HZ,
    "u_noise_bandwidth_hz": 0.015 * BAND_HZ,
}
TRUE_OF_LINE = ("scale_factor", "bias")
ALONE = dict.fromkeys(("power", "rate_source", "multimeter", "oscilloscope"))


def drawn_bench(kind: str, seed: int) -> BenchDescription:
    """Return a bench by its seed."""
    random = Random(seed)  # noqa: S311  # no secret
    per_deg_s = random.choice((65.5, 131.0)) if KINDS[kind]["unit"] == "LSB" else 1.0
    values = msgspec.to_builtins(structs.replace(vcfbench.load_bench(), name="drawn", **ALONE))
    values["limits"] = {"max_rate_deg_s": 300.0, "max_acceleration_deg_s2": 200.0}
    values["gyro"] = {"stream": {"resource": "sim", "sample_rate_hz": 100.0, **FRAME, **KINDS[kind]}}
    errors = {"clock_ppm": random.uniform(-200.0, 200.0), "latency_s": random.uniform(0.0, 0.02)}
    errors |= {"dropped": 0.01 * (seed % 2), "flipped": 0.01 * (seed % 2), "lsb_per_deg_s": per_deg_s}
    values["simulation"]["errors"]["multimeter"] = errors
    return checked_bench({key: each for key, each in values.items() if each is not None}, "drawn")


def one_run(procedure: str, kind: str, seed: int) -> dict[str, Any]:
    """Return the distance of each value from its true one in its U95, of N of a bound too."""
    bench = drawn_bench(kind, seed)
    settings: dict[str, Any] = TURNTABLE if procedure == "turntable" else AT_REST
    if procedure == "zero":
        output = true_output(bench)
        settings = settings | {"scale_factor_v_per_deg_s": 0.5 * (output(1.0, None) - output(-1.0, None))}
    try:
        run = vcfbench.run(procedure, bench, seed=seed, settings=settings, runs=None)
    except BenchError as error:
        return {"refused": str(error)}
    rails = run.header["settings"]["positive_rail_v"], run.header["settings"]["negative_rail_v"]
    output = true_output(bench, rails_v=rails)
    truth = {"output_v": output(0.0, None)}
    if procedure == "turntable":
        truth = {key: value for key, value in turntable_truth(output, RATES_DEG_S).items() if key in TRUE_OF_LINE}
    found = {
        key: ((run.values[key].value or 0.0) - true) / (run.values[key].u95 or math.nan) for key, true in truth.items()
    }
    if procedure == "zero":
        n, true = (
            run.results.coefficient("angle random walk"),
            60.0 * physical_parameters(bench).noise.angle_random_walk_deg_sqrt_s,
        )
        if n.value and n.u:
            found["N"] = (n.value - true) / (1.96 * n.u)
        found["N, bound"] = 0.0 if n.upper_95 >= true else 2.0
    return found


def main() -> None:
    """Run all of them and print the shares within U95, by kind, with the largest distances."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("turntables", nargs="?", default="0:40")
    parser.add_argument("records", nargs="?", default="0:10")
    parser.add_argument("--lines", type=Path, default=Path("/dev/null"))
    asked = parser.parse_args()
    with asked.lines.open("a+", encoding="utf-8") as lines:
        lines.seek(0)
        done = dict(json.loads(line) for line in lines)
        for procedure, seeds in (("turntable", asked.turntables), ("zero", asked.records)):
            for seed in range(*map(int, seeds.split(":"))):
                for kind in KINDS:
                    if (key := f"{procedure} {kind} {seed}") not in done:
                        done[key] = one_run(procedure, kind, seed)
                        lines.write(json.dumps([key, done[key]]) + "\n")
                        lines.flush()
    ratios: dict[str, list[float]] = defaultdict(list)
    for name, found in done.items():
        for key, ratio in found.items():
            if key != "refused":
                ratios[f"{name.rpartition(' ')[0]:23s} {key}"].append(ratio)
    for name, of in ratios.items():
        inside, rms = sum(abs(each) <= 1.0 for each in of), math.sqrt(math.fsum(each * each for each in of) / len(of))
        print(
            f"{name:36s} {inside:4d} of {len(of):4d} within U95, rms {rms:.2f} U95, largest {max(map(abs, of)):.2f} U95"
        )
    refused = [f"{name}: {found['refused']}" for name, found in done.items() if "refused" in found]
    print(f"refused: {len(refused)}", *refused[:5], sep="\n  ")


if __name__ == "__main__":
    main()
