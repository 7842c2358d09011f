"""Gyroscopes drawn by seed, each with every procedure that applies: how each run ends, and whether its values are true.

    python experiments/drawn_gyroscopes.py 0:300 --lines drawn.jsonl              with noise
    python experiments/drawn_gyroscopes.py 0:100 --lines silent.jsonl --no-noise
    python experiments/drawn_gyroscopes.py 7:8 --procedures kvc,phase --keep here keep the records
    python experiments/drawn_gyroscopes.py --summary drawn.jsonl

A line a gyroscope: its data sheet, and of each procedure the end ("complete", "refused" before anything is switched on,
with the reason, or "ended" without results after that, with the error) and of each value with a closed form its name,
value, truth, u, U95. The truth is that of the parameters (docs/theory.md), which the simulation does not use. What u
allows for has to come about: before `online`, which measures none of K_Vc's causes, they change by as much as its u
says they may have, and what it is told of the modes is off by its u. What stands in the file of --lines is not run
again. The exit code is 1 where a run has ended without results, or where a
value is beyond the limits of limits.py.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from limits import outside, scores
from msgspec import structs
from procedures_truth import MEMORY, Modes, Stated, Truth, changed, stated, vibration_truth

import vcfbench
from vcfbench import steps
from vcfbench.errors import Aborted, BenchError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.health.check import MAY_HAVE
from vcfbench.procedures.online.settings import OnlineSettings
from vcfbench.sim.simulation import physical_parameters
from vcfbench.studies.truth import truth_of
from vcfbench.testing.gyroscopes import drawn_bench, drawn_sheet

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from vcfbench.archive.run import Run
    from vcfbench.station.description import BenchDescription

    Line = dict[str, Any]

FIRST = ("electrical", "polarity", "turntable", "kvc", "bandwidth", "resonance", "phase")
"""What others build on; then the rest."""
ORDER = (*FIRST, *(name for name in BUILT_IN if name not in FIRST))
WARM = {"warm_up_s": 1800.0}
"""The truth is that of a warm gyroscope."""
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    **dict.fromkeys(("turntable", "virtual-coriolis", "kvc", "self-calibration"), WARM),
    "repeatability": {"off_s": 600.0},
}
U_SHARE = 0.05
"""Standard uncertainty of what `online` is told of the in-phase mode's share: its own assumption."""
DUT = "G"
SWITCHES_ON: tuple[type, ...] = (steps.EnableSupply, *steps.EnableSupply.__subclasses__())
"""Steps from which on a run has done something; `warmup` and `power` log at the same time."""


def truths(bench: BenchDescription, run: Run) -> Mapping[str, Mapping[str, float]]:
    """Return what is true of the values of each procedure that have a closed form, by their names."""
    true, modes = Truth.of(bench), Modes.of(bench)
    of_gyro = {"bias": true.bias_v, "scale_factor": true.scale_factor, "k_vc": true.k_vc}
    q, split_hz = modes.sense_q[0], modes.split_hz
    return {
        "kvc": of_gyro,
        "self-calibration": of_gyro,
        "online": {"scale_factor": true.scale_factor},
        "zero": {"output_v": true.bias_v, "bias": true.bias_v / true.scale_factor},
        "warmup": {"bias_end": true.bias_v / true.scale_factor},
        "bandwidth": {"split_hz": split_hz, "q": q},
        "resonance": {
            "drive_hz": modes.drive_hz,
            "drive_q": modes.drive_q,
            "sense_hz": modes.sense_hz[0],
            "sense_q_ring_down": q,
            "sense_q_sweep": q,
            "split_ring_down_hz": split_hz,
            "split_sweep_hz": split_hz,
            "in_phase_hz": modes.sense_hz[1],
        },
        "phase": {"carrier_from_velocity_deg": math.remainder(math.degrees(modes.carrier_rad), 180.0)},
        "turntable": truth_of(run, bench),
        "virtual-coriolis": truth_of(run, bench),
    }


def values(name: str, run: Run, bench: BenchDescription) -> Iterator[Stated]:
    """Yield the values of a run that have a closed form."""
    found = run.results
    for key, truth in truths(bench, run).get(name, {}).items():
        if name in {"turntable", "virtual-coriolis"}:
            each = next((one for one in found.uncertainty.values if one.name == key), None)
        else:
            each = getattr(found, key, None)
        if each is not None:  # of a split whose sign nobody tells the size is stated
            yield from stated(key, each, abs(truth) if "split" in key and each.value > 0.0 else truth)
    if name == "vibration":
        at_rest, responses = vibration_truth(bench, run)
        yield from stated("static", found.static_v_per_v, at_rest)
        for each, truth in zip(found.responses, responses, strict=True):
            yield from stated("response", each.response, truth)


def since_certificate(bench: BenchDescription, seed: int) -> tuple[BenchDescription, dict[str, float]]:
    """Return the bench whose gyroscope has changed since its certificate, and what `online` is told of its modes.

    Every cause that `online` leaves unmeasured has moved, to somewhere within the limit that its u has of it; phases
    are known by the bench file.
    """
    draw, of = np.random.default_rng([20261129, seed]), physical_parameters(bench)
    limit = {key: size for _, moved, _ in MAY_HAVE for key, size in moved.items()}
    leak = 1.0 + limit["q_anti_phase"] * float(draw.uniform())  # gas damps both modes
    split, in_phase_split, through, drive = draw.uniform(-1.0, 1.0, 4).tolist()
    more = {
        group: {"frequency_hz": mode.frequency_hz - moved_hz, "quality": mode.quality * leak}
        for group, mode, moved_hz in (
            ("sense_anti_phase", of.sense_anti_phase, limit["split_hz"] * split),
            ("sense_in_phase", of.sense_in_phase, limit["in_phase_split_hz"] * in_phase_split),
        )
    }
    more["drive_loop"] = {"amplitude_m": of.drive_loop.amplitude_m * (1.0 + limit["drive_amplitude_v"] * drive)}
    now, small = changed(bench, more), 1e-6  # V_Vc comes through by a part of what the modes answer
    with_small = changed(now, {"sense_path": {"v_vc_feedthrough": of.sense_path.v_vc_feedthrough + small}})
    times = limit["v_vc_feedthrough"] * through / (Truth.of(with_small).k_vc / Truth.of(now).k_vc - 1.0)
    now = changed(now, {"sense_path": {"v_vc_feedthrough": of.sense_path.v_vc_feedthrough + small * times}})
    modes, (off_hz, off_share) = Modes.of(now), draw.standard_normal(2).tolist()
    split_hz = abs(modes.split_hz) + OnlineSettings().u_split_hz * off_hz
    return now, {"split_hz": split_hz, "in_phase_share": modes.in_phase_share + U_SHARE * off_share}


def tried(name: str, bench: BenchDescription, seed: int) -> Line:
    """Return how a run of a procedure ends, and its values."""
    told: Mapping[str, Any] = SETTINGS.get(name, {})
    if name == "online":
        bench, told = since_certificate(bench, seed)
    began, records = time.perf_counter(), Path("runs") / name
    run = None
    try:
        run = vcfbench.run(name, bench, seed=seed, settings=dict(told), metadata={"dut": DUT}, runs=records)
        why = "" if run.error is None and run.results is not None else str(run.error or run.no_results)
    except Aborted:  # somebody stopped the study: no line of it
        raise
    except BenchError as error:
        why = str(error)
    except Exception as error:  # noqa: BLE001  # a defect, which is told with the others
        why = f"{type(error).__name__}: {error}"
    line: Line = {"end": "complete", "took_s": round(time.perf_counter() - began, 2), **({"why": why} if why else {})}
    if run is None or run.results is None:
        journals = [each.read_text("utf-8") for each in records.rglob("journal.jsonl")]
        live = any(f'"{kind.__name__}"' in each for each in journals for kind in SWITCHES_ON)
        return {**line, "end": "ended" if live else "refused"}
    try:
        line["values"] = [list(each) for each in values(name, run, bench)]
    except Exception as error:  # noqa: BLE001  # a result that is not as this script knows it
        line["why"] = f"not compared: {type(error).__name__}: {error}"
    return line


def gyroscope(seed: int, procedures: Sequence[str], keep: Path | None = None, *, noise: bool = True) -> Line:
    """Return the line of a seed; its records go to a directory that is taken away afterwards, or kept."""
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as directory:
        where = Path(directory) if keep is None else keep / f"{seed}"
        where.mkdir(parents=True, exist_ok=True)
        text = drawn_bench(seed, noise=noise)
        (where / "bench.toml").write_text(text, "utf-8")
        bench = parse_bench(text, f"gyroscope-{seed}")
        before = Path.cwd()
        os.chdir(where)  # what is known of the device is kept here
        try:
            runs = {name: tried(name, bench, seed) for name in ORDER if name in procedures}
        finally:
            os.chdir(before)
    return {"seed": seed, "noise": noise, "sheet": structs.asdict(drawn_sheet(seed)), "runs": runs}


def summary(lines: Sequence[Line]) -> tuple[list[str], bool]:
    """Return the tables of ends and of values, and whether there is nothing to be mended."""
    rows, good = [f"{len(lines)} gyroscopes", f"{'procedure':18} complete refused ended  mean s"], True
    for name in ORDER:
        ends = [line["runs"][name]["end"] for line in lines if name in line["runs"]]
        if ends:
            counts = [ends.count(each) for each in ("complete", "refused", "ended")]
            good = good and not counts[2]
            took_s = sum(line["runs"][name]["took_s"] for line in lines if name in line["runs"]) / len(ends)
            mark = "  *" if counts[2] else ""
            rows.append(f"{name:18} {counts[0]:8d} {counts[1]:7d} {counts[2]:5d} {took_s:7.2f}{mark}")
    for line in lines:
        for name, run in line["runs"].items():
            if "why" in run:
                rows.append(f"  {line['seed']} {name}: {run['end']}: {run['why'][:250]}")
    found: dict[str, list[Any]] = {}
    for line in lines:
        for name, run in line["runs"].items():
            for key, value, truth, u, u95 in run.get("values", ()):
                found.setdefault(f"{name}: {key}", []).append((value, truth, u, u95))
    rows.append(f"{'value':48} {'number':>6} {'mean z':>7} {'rms z':>6} {'max |z|':>8} {'in U95':>7}")
    for key, each in found.items():
        z = [(value - truth) / u for value, truth, u, _ in each]
        held = [abs(value - truth) <= (1.96 * u if u95 is None else u95) for value, truth, u, u95 in each]
        share, rms = sum(held) / len(z), math.sqrt(math.fsum(x * x for x in z) / len(z))
        beyond = outside(held, scores(each))
        good = good and not beyond
        mark = f"  * {beyond}" if beyond else ""
        largest = max(map(abs, z))
        rows.append(
            f"{key:48} {len(z):6d} {sum(z) / len(z):+7.2f} {rms:6.2f} {largest:8.2f} {100.0 * share:6.1f}%{mark}"
        )
    return rows, good


def lines_of(file: Path) -> list[Line]:
    """Return the lines of a file, but for one that was cut off at its end."""
    texts = file.read_text("utf-8").splitlines(keepends=True) if file.exists() else []
    return [json.loads(text) for text in texts if text.endswith("\n")]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="?", default="0:10", help="first, and the one after the last: 0:300")
    parser.add_argument("--procedures", default=",".join(ORDER))
    parser.add_argument("--no-noise", action="store_true", help="gyroscopes without noise")
    parser.add_argument("--lines", type=Path, help="file that keeps a line a gyroscope")
    parser.add_argument("--keep", type=Path, help="directory in which the records stay")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--summary", type=Path, nargs="+", metavar="FILE", help="run nothing, sum up such files")
    asked = parser.parse_args()
    if asked.summary:
        lines = [line for file in asked.summary for line in lines_of(file)]
    else:
        first, after = map(int, asked.seeds.split(":"))
        had = {line["seed"]: line for line in (lines_of(asked.lines) if asked.lines else [])}
        if asked.lines:
            asked.lines.write_text("".join(json.dumps(line) + "\n" for line in had.values()), "utf-8")
        todo = [seed for seed in range(first, after) if seed not in had]
        of_seed = partial(gyroscope, procedures=asked.procedures.split(","), keep=asked.keep, noise=not asked.no_noise)
        with multiprocessing.get_context("spawn").Pool(asked.processes) as pool:
            for line in pool.imap(of_seed, todo) if asked.processes > 1 else map(of_seed, todo):
                had[line["seed"]] = line
                if asked.lines:
                    with asked.lines.open("a", encoding="utf-8") as out:
                        print(json.dumps(line), file=out)
        lines = [had[seed] for seed in range(first, after)]
    rows, good = summary(sorted(lines, key=lambda line: line["seed"]))
    print("\n".join(rows))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
