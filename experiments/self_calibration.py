"""Whether `run kvc` and `run self-calibration` tell the truth, on simulated gyroscopes whose instruments are drawn.

    python experiments/self_calibration.py --seeds 0:100 > first.jsonl
    python experiments/self_calibration.py --seeds 100:200 > second.jsonl        the rest, perhaps at the same time
    python experiments/self_calibration.py --summary first.jsonl second.jsonl

Each seed draws meters, generator and table from their accuracy; they stay the same for the calibration on the table and
for both self-calibrations, while the noise goes on. Between the two the gyroscope ages: output stage, split and drive
amplitude (its carrier with it) by amounts drawn up to some parts in a thousand. The truth is the scale factor at rest
by the closed forms of the tests. Records are kept in memory where there is a /dev/shm. A seed takes 2 s of processor
time.

`--field own` does the self-calibrations on the bench of `examples/field-bench.toml`, whose instruments are drawn apart
from those of `lab` though they have the same models and addresses; `--field same` carries those of `lab` there, with
inventory numbers on both benches that say so.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import msgspec
import numpy as np
from limits import outside
from msgspec import structs

import vcfbench
from tests.procedures.test_kvc import truth, warm
from vcfbench.sim.builder import instrument_errors
from vcfbench.sim.simulation import physical_parameters

LAB = vcfbench.load_bench("lab")
FIELD = vcfbench.load_bench(Path(__file__).resolve().parent.parent / "examples" / "field-bench.toml")
assert LAB.simulation is not None  # noqa: S101 - its file has one
SIMULATION = LAB.simulation
PAPER_RATES = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0]
TABLE_PPM = 10.0
MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile


def field_of(seed: int, errors: str, ageing: dict[str, Any], field: str) -> Any:
    """Return the bench of the self-calibrations: `lab`, or the one in the field with its own or the same meters."""
    if field == "lab":
        return bench_of(seed, errors, ageing)
    simulation = bench_of(seed if field == "same" else 1_000_000 + seed, errors, ageing).simulation
    return _numbered(structs.replace(FIELD, simulation=simulation), field)


def _numbered(bench: Any, field: str) -> Any:
    if field != "same":
        return bench
    numbered = {
        role: structs.replace(getattr(bench, role), inventory_number=f"K-{role}")
        for role in ("multimeter", "v_vc_meter")
    }
    return structs.replace(bench, **numbered)


def bench_of(seed: int, errors: str, ageing: dict[str, Any]) -> Any:
    """Return the bench of a seed: its specimens by name, so that they stay while the noise's seed changes."""
    rng = np.random.default_rng([seed, 1])
    drawn = structs.replace(LAB, simulation=structs.replace(SIMULATION, errors=_all("drawn")))
    specimens = {role: _plain(each) for role, each in instrument_errors(drawn, seed).items()}
    rate_error = 1e-6 * TABLE_PPM * float(rng.uniform(-1.0, 1.0))
    if errors == "none":
        specimens, rate_error = dict.fromkeys(specimens, "none"), 0.0
    specimens["rate_table"] = "drawn" if errors != "none" else "none"  # the read-back alone, which gets into no result
    specimens["power"] = specimens["oscilloscope"] = "drawn"
    table = {"table": {"rate_error": rate_error}}
    simulation = structs.replace(SIMULATION, errors=structs.replace(_all("drawn"), **specimens))
    return structs.replace(LAB, simulation=structs.replace(simulation, override={**table, **ageing}))


def _all(how: str) -> Any:
    kind = type(SIMULATION.errors)
    fields: dict[str, Any] = dict.fromkeys(kind.__struct_fields__, how)
    return kind(**fields)


def _plain(errors: Any) -> Any:
    return json.loads(json.dumps(msgspec.to_builtins(errors)).replace("Infinity", "1e15"))


def ageing_of(seed: int) -> dict[str, Any]:
    """Return how far the gyroscope of a seed ages between its two self-calibrations."""
    rng = np.random.default_rng([seed, 2])
    fresh = physical_parameters(LAB)
    gain, split, drive = (float(rng.uniform(-1.0, 1.0)) for _ in range(3))
    amplitude = 1.0 + 2e-3 * drive
    return {
        "output_stage": {"gain": fresh.output_stage.gain * (1.0 + 2e-3 * gain)},
        "sense_anti_phase": {"frequency_hz": fresh.sense_anti_phase.frequency_hz + 0.05 * split},
        "drive_loop": {"amplitude_m": fresh.drive_loop.amplitude_m * amplitude},
        "sense_path": {"reference_amplitude_v": fresh.sense_path.reference_amplitude_v * amplitude},
    }


def case(seed: int, errors: str, *, paper_rates: bool, field: str = "lab") -> dict[str, Any]:
    """Calibrate on the table, self-calibrate, age, self-calibrate again; return what was found and what is true."""
    ageing = ageing_of(seed)
    fresh, old = bench_of(seed, errors, {}), bench_of(seed, errors, ageing)
    young_there, old_there = field_of(seed, errors, {}, field), field_of(seed, errors, ageing, field)
    before, k_vc = truth(warm(physical_parameters(fresh)))
    after, _ = truth(warm(physical_parameters(old)))
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as where:
        settings: dict[str, Any] = {"dut": "G", "devices": f"{where}/devices", "warm_up_s": 1800.0}
        runs: dict[str, Any] = {"runs": where}
        on_table = vcfbench.run("kvc", _numbered(fresh, field), seed=3 * seed, settings=settings, **runs).results
        first = vcfbench.run("self-calibration", young_there, seed=3 * seed + 1, settings=settings, **runs).results
        second = vcfbench.run("self-calibration", old_there, seed=3 * seed + 2, settings=settings, **runs).results
        line: dict[str, Any] = {
            "seed": seed,
            "k_vc": _z(on_table.k_vc, k_vc),
            "table": _z(on_table.scale_factor, before),
            "scale_factor": _z(first.scale_factor, before),
            "since_certificate": _z(first.drift.change_ppm, 0.0),
            "drift": _z(second.drift.change_ppm, 1e6 * (after / before - 1.0)),
            "drift_since_last": _z(second.drift.last.change_ppm, 1e6 * (after / before - 1.0)),
            "failed_unaged": first.drift.verdict == "fail",
            "nonlinearity_ppm": first.nonlinearity.value,
        }
        if paper_rates:
            settings = {**settings, "virtual_rates_deg_s": PAPER_RATES}
            line["nonlinearity_17_ppm"] = vcfbench.run(
                "self-calibration", fresh, seed=3 * seed, settings=settings, **runs
            ).results.nonlinearity.value
    return line


def _z(found: Any, true: float) -> dict[str, float]:
    size = abs(true) if abs(true) > 1e-12 and found.unit != "ppm" else 1e6
    return {
        "error_ppm": 1e6 * (found.value - true) / size,
        "u_ppm": 1e6 * found.u / size,
        "z": (found.value - true) / found.u,
        "within_95": abs(found.value - true) <= found.u95,
    }


def summary(files: list[Path]) -> int:
    """Print bias, scatter and coverage of every quantity; return 1 where one is beyond the limits, else 0."""
    beyond = False
    lines = [json.loads(line) for file in files for line in file.read_text(encoding="utf-8").splitlines()]
    print(f"{len(lines)} seeds; sd of z is known to {100 / math.sqrt(2 * len(lines)):.0f} %")
    for name in ("k_vc", "table", "scale_factor", "since_certificate", "drift", "drift_since_last"):
        z = [line[name]["z"] for line in lines]
        errors = [line[name]["error_ppm"] for line in lines]
        u = statistics.fmean(line[name]["u_ppm"] for line in lines)
        held = 100.0 * statistics.fmean(line[name]["within_95"] for line in lines)
        spread = f"mean z {statistics.fmean(z):+.2f}, sd {statistics.stdev(z):.2f}, in U95 {held:.1f} %"
        found = outside([line[name]["within_95"] for line in lines], z)
        beyond = beyond or bool(found)
        mark = f" * {found}" if found else ""
        print(f"{name:18s} {spread}, u {u:.1f} ppm, largest error {max(map(abs, errors)):.0f} ppm{mark}")
    print(f"fresh ones that failed: {sum(line['failed_unaged'] for line in lines)}")
    for name in ("nonlinearity_ppm", "nonlinearity_17_ppm"):
        values = [line[name] for line in lines if name in line]
        if values:
            print(f"{name}: {min(values):.0f} to {max(values):.0f}")
    return int(beyond)


def main() -> int:
    """Do what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seeds", default="0:10")
    parser.add_argument("--errors", choices=["drawn", "none"], default="drawn")
    parser.add_argument("--field", choices=["lab", "own", "same"], default="lab", help="where it is self-calibrated")
    parser.add_argument("--paper-rates", action="store_true", help="the paper's 17 rates as well")
    parser.add_argument("--summary", type=Path, nargs="+", metavar="FILE")
    asked = parser.parse_args()
    if asked.summary is not None:
        return summary(asked.summary)
    first, last = map(int, asked.seeds.split(":"))
    for seed in range(first, last):
        print(json.dumps(case(seed, asked.errors, paper_rates=asked.paper_rates, field=asked.field)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
