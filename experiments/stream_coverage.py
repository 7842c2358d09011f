"""Whether U95 holds where the output is a stream of numbers: drawn devices, lines and frames, known true values.

Each turntable has a bench of its own: instruments and table drawn, a device clock within 200 ppm, up to 20 ms of delay,
1 % of the frames dropped, 1 % with a wrong bit, 16-bit rates in LSB or deg/s, or 32-bit increments. True values are
those of the closed form. Records at rest likewise, their mean against the true output.

    python experiments/stream_coverage.py [TURNTABLES] [RECORDS]
"""

from __future__ import annotations

import math
import sys
from random import Random
from typing import Any

import msgspec
from msgspec import structs

import vcfbench
from vcfbench.errors import BenchError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.sim.simulation import true_output
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
AT_REST = {"duration_s": 200.0, "powered_s": 5400.0}
ALONE = dict.fromkeys(("power", "rate_source", "multimeter", "oscilloscope"))


def drawn_bench(kind: str, seed: int) -> BenchDescription:
    """Return a bench by its seed."""
    random = Random(seed)  # noqa: S311  # no secret
    per_deg_s = random.choice((65.5, 131.0)) if KINDS[kind]["unit"] == "LSB" else 1.0
    values = msgspec.to_builtins(structs.replace(vcfbench.load_bench(), name="drawn", **ALONE))
    values["limits"] = {"max_rate_deg_s": 300.0, "max_acceleration_deg_s2": 200.0}
    values["gyro"] = {"stream": {"resource": "sim", "sample_rate_hz": 100.0, **FRAME, **KINDS[kind]}}
    errors = {"clock_ppm": random.uniform(-200.0, 200.0), "latency_s": random.uniform(0.0, 0.02)}
    errors |= {"dropped": 0.01, "flipped": 0.01, "lsb_per_deg_s": per_deg_s}
    values["simulation"]["errors"]["multimeter"] = errors
    return checked_bench({key: each for key, each in values.items() if each is not None}, "drawn")


def main(turntables: int, records: int) -> None:
    """Run all of them and print the shares within U95, by kind, with the largest distances."""
    refused: list[str] = []
    for procedure, count in (("turntable", turntables), ("zero", records)):
        for kind in KINDS:
            inside, ratios = dict[str, int](), dict[str, list[float]]()
            for seed in range(count // len(KINDS)):
                bench = drawn_bench(kind, seed)
                settings = TURNTABLE if procedure == "turntable" else AT_REST
                try:
                    run = vcfbench.run(procedure, bench, seed=seed, settings=settings, runs=None)
                except BenchError as error:
                    refused.append(f"{procedure} {kind} {seed}: {error}")
                    continue
                rails = run.header["settings"]["positive_rail_v"], run.header["settings"]["negative_rail_v"]
                output = true_output(bench, rails_v=rails)
                truth = turntable_truth(output, RATES_DEG_S)
                truth = {key: truth[key] for key in ("scale_factor", "bias")}
                if procedure == "zero":
                    truth = {"output_v": output(0.0, None)}
                for key, true in truth.items():
                    found = run.values[key]
                    ratio = ((found.value or 0.0) - true) / (found.u95 or math.nan)
                    ratios.setdefault(key, []).append(ratio)
                    inside[key] = inside.get(key, 0) + (abs(ratio) <= 1.0)
            for key, of in ratios.items():
                most, rms = max(map(abs, of)), math.sqrt(math.fsum(each * each for each in of) / len(of))
                print(
                    f"{procedure:9s} {kind:12s} {key:12s} {inside[key]:4d} of {len(of):4d} within U95, "
                    f"rms {rms:.2f} U95, largest {most:.2f} U95",
                    flush=True,
                )
    print(f"refused: {len(refused)}", *refused[:5], sep="\n  ")


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:3] or (120, 30)))
