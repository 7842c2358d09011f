"""Whether several gyroscopes in one run are each as alone: bench time, values, shared causes, faults, kills.

``python -m experiments.several [eight] [shared] [faults] [kill] [axes] [--seeds N]``, all without words; a table each.
"""

from __future__ import annotations

import math
import signal
import statistics
import subprocess
import sys
from argparse import ArgumentParser
from itertools import combinations
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import sleep
from typing import TYPE_CHECKING, Any

from msgspec import to_builtins

import vcfbench
from tests.test_streams import FAULTS, LEFT_ALONE
from vcfbench.archive.change import Compared, covariance
from vcfbench.archive.verified import verify_run
from vcfbench.interfaces import Request as Asked
from vcfbench.procedures.axes import between_axes
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.procedures.layers import asked_in_python
from vcfbench.records.schema import Status
from vcfbench.runs.conduct import conduct
from vcfbench.runs.request import Request
from vcfbench.safety.signals import StopSignals
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.writing import bench_text

if TYPE_CHECKING:
    from vcfbench.archive.run import Run
    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

QUICK = {"rates_deg_s": [100.0, 0.0, -100.0], "samples": 5}
MOST_PPM = 200.0
"""Largest error of the table's rate, ppm: any within is as likely."""


def lot(count: int, rate_hz: float = 20.0, table_error: float | None = None) -> BenchDescription:
    """Return the paper's table with so many streams on it, each of a gyroscope of its own gain."""
    paper = to_builtins(vcfbench.load_bench())
    kept = {
        key: {k: v for k, v in paper[key].items() if v is not None} for key in ("rate_table", "site", "uncertainty")
    }
    values: dict[str, Any] = {
        **kept,
        "name": "lot",
        "limits": {"max_rate_deg_s": 300.0, "max_acceleration_deg_s2": 200.0},
        "gyro": {"stream": {"profile": "adis16495", "sample_rate_hz": rate_hz, "aperture_s": 0.4, "timeout_s": 1.0}},
        "simulation": {"errors": {"rate_table": "none"}},
        "device": [
            {
                "name": f"G-{number}",
                "resource": f"/dev/ttyUSB{number}",
                "simulation": {"override": {"output_stage": {"gain": 9.5 * (1.0 + 0.01 * number)}}},
            }
            for number in range(1, count + 1)
        ],
    }
    if table_error is not None:
        values["simulation"]["override"] = {"table": {"rate_error": table_error}}
        values["uncertainty"]["table_rate_error"] = MOST_PPM * 1e-6
    return checked_bench(values, "lot.toml")


def eight(seeds: int, runs: Path) -> bool:
    """Hold eight devices in one run against eight runs of one: bench time, values, U95."""
    bench, well = lot(8), True
    settings = {"samples": 5, "rates_deg_s": [100.0, 50.0, 20.0, 0.0, -20.0, -50.0, -100.0]}
    print("seed   bench time   worst |difference| / U95   U95 together / alone")
    for seed in range(seeds):
        run = vcfbench.run("turntable", bench, seed=seed, runs=runs, settings=settings)
        times, apart, ratios = [], [], []
        for name, each in zip(bench.several, run.devices, strict=True):
            alone = vcfbench.run("turntable", bench.of_device(name), seed=seed + 1000, runs=runs, settings=settings)
            times.append(alone.bench_seconds or 0.0)
            for key in ("scale_factor", "bias"):
                one, other = each.values[key], alone.values[key]
                apart.append(
                    abs((one.value or 0.0) - (other.value or 0.0)) / math.hypot(one.u95 or 0.0, other.u95 or 0.0)
                )
                ratios.append((one.u95 or 0.0) / (other.u95 or 1.0))
        ratio = (run.bench_seconds or 0.0) / statistics.mean(times)
        print(
            f"{seed:4d}   {ratio:10.3f}   {max(apart):24.2f}   {min(ratios):.2f} to {max(ratios):.2f}, "
            f"mean {statistics.mean(ratios):.3f}",
            flush=True,
        )
        well &= ratio <= 1.05 and sum(each > 1.0 for each in apart) <= 2 and abs(statistics.mean(ratios) - 1.0) < 0.05
    return well


def shared(seeds: int, runs: Path) -> bool:
    """Hold the covariance of two devices, by the error of their table, against that which is planted."""
    pairs, stated = [], []
    for seed in range(seeds):
        error = MOST_PPM * 1e-6 * (2.0 * (seed + 0.5) / seeds - 1.0)
        run = vcfbench.run("turntable", lot(2, 10.0, error), seed=seed, settings=QUICK, runs=runs)
        one, other = (each.values["scale_factor"] for each in run.devices)
        pairs.append([one.value or 0.0, other.value or 0.0])
        found, _ = covariance(one, other, *(Compared(each) for each in run.devices))
        stated.append(found / (pairs[-1][0] * pairs[-1][1]))
    relative = [[value / statistics.mean(column) for value in column] for column in zip(*pairs, strict=True)]
    seen, planted = statistics.covariance(*relative), (MOST_PPM * 1e-6) ** 2 / 3.0
    print(
        f"{seeds} seeds: covariance planted {planted:.3g}, seen {seen:.3g} ({seen / planted:.3f} of it), "
        f"stated {statistics.mean(stated):.3g} ({statistics.mean(stated) / planted:.3f} of it)"
    )
    return abs(seen / planted - 1.0) < 0.15 and abs(statistics.mean(stated) / planted - 1.0) < 0.15


def faults(seeds: int, runs: Path) -> bool:
    """Give each of eight devices each fault, at the opening and later: the seven others finish as ever."""
    bench, draw = lot(8, 10.0), Random(seeds)  # noqa: S311  (no secret)
    good = _conducted(bench, None, runs)
    touched = unseen = wrong = count = 0
    for fault, errors in FAULTS.items():
        for number in range(1, 9):
            for at_s in (0.0, draw.uniform(1.0, 35.0)):
                run = _conducted(bench, _later(number, errors, at_s), runs)
                count += 1
                for place, (each, as_ever) in enumerate(zip(run.devices, good.devices, strict=True), 1):
                    k, k_good = each.values.get("scale_factor"), as_ever.values["scale_factor"]
                    off = math.inf if k is None else abs((k.value or 0.0) - (k_good.value or 0.0)) / (k_good.u95 or 0.0)
                    if place != number:
                        touched += off > (0.1 if at_s else 2.0)
                    elif each.error is None:
                        unseen += fault not in LEFT_ALONE and not at_s
                        wrong += off > 2.0
        print(f"{fault}: so far {count} runs, {touched} touched, {unseen} not seen, {wrong} wrong", flush=True)
    return touched == unseen == wrong == 0


def kill(seeds: int, runs: Path) -> bool:
    """Kill runs of three devices anywhere, resume them, verify the records of all."""
    bench, well = runs / "lot.toml", True
    bench.write_text(bench_text(lot(3)))
    command = [sys.executable, "-m", "vcfbench", "run", "turntable", "--bench", str(bench), "--speed", "20", "--quiet"]
    for seed in range(seeds):
        folder = runs / f"kill-{seed}"
        process = subprocess.Popen([*command, "--runs", str(folder), "--rates", "100,0,-100", "--samples", "5"])
        journal = _journal(folder)
        steps = 4 + 5 * seed
        while process.poll() is None and journal.read_bytes().count(b'"type":"step"') < steps:
            sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        run = vcfbench.resume(journal.parent, runs=folder)
        wrong = [verify_run(str(each.directory)).wrong for each in (run, *run.devices)]
        ended = [each.status for each in run.devices]
        print(f"killed after {steps} steps: {run.status.value}, {len(ended)} devices, wrong: {wrong}", flush=True)
        well &= ended == [Status.COMPLETE] * 3 and not any(wrong)
    return well


def axes(seeds: int, runs: Path) -> bool:
    """Draw input axes of three outputs of one stream, and mountings: scale factor and angles are within U95."""
    del runs
    shares: dict[str, list[bool]] = {"scale factor": [], "towards": [], "angle of two": []}
    for seed in range(seeds):
        draw = Random(seed)  # noqa: S311  (no secret)
        planted = [
            _unit([float(place == along) + draw.uniform(-0.005, 0.005) for place in range(3)]) for along in range(3)
        ]
        mounted = {
            f"+{name}": _unit([float(place == at) + math.radians(draw.uniform(-0.2, 0.2)) for place in range(3)])
            for at, name in enumerate("xyz")
        }
        found = [each.results for each in _mounted_run(seed, planted, mounted).devices]
        gains = [math.hypot(*each.sensitivity) for each in found]
        for result, axis in zip(found, planted, strict=True):
            k = result.scale_factor
            shares["scale factor"].append(abs(k.value - statistics.mean(gains)) < k.u95)
            along = max(range(3), key=lambda place: abs(axis[place]))
            for name, value in result.towards.items():
                angle = 1e3 * math.atan(axis["xyz".index(name)] / axis[along])
                shares["towards"].append(abs(value.value - angle) < value.u95)
        for (a, one), (b, other) in combinations(zip(found, planted, strict=True), 2):
            angle = -1e3 * math.asin(sum(x * y for x, y in zip(one, other, strict=True)))
            between = between_axes(("one", a), ("other", b))
            shares["angle of two"].append(abs((between.value or 0.0) - angle) < (between.u95 or 0.0))
    for name, each in shares.items():
        print(f"{name}: {sum(each)} of {len(each)} within U95")
    return all(sum(each) > 0.92 * len(each) for each in shares.values())


def _unit(vector: list[float]) -> list[float]:
    size = math.hypot(*vector)
    return [each / size for each in vector]


def _mounted_run(seed: int, planted: list[list[float]], mounted: dict[str, list[float]]) -> Run:
    """Run ``axes`` on a device whose outputs have the input axes `planted`, `mounted` with so much askew."""
    made: list[SimulatedBench] = []

    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        made.append(SimulatedBench.build(description, seed, clock))
        return made[0]

    def operator(asked: Asked) -> str:
        world: Any = made[0].world
        name = str(asked.adjustments["up_axis"])
        world.set_up_axis(name)
        for each in (world, *world._beside):  # noqa: SLF001  # nobody can adjust that: it is what the operator does not see
            each._gyro.set_up(tuple(mounted[name]))  # noqa: SLF001
        made[0].clock.sleep_until(made[0].clock.now() + asked.takes_s)
        return "done"

    bench = three_axes(planted)
    settings = asked_in_python({"samples": 4, "mounting_deg": 0.2, "mount_s": 10.0})
    request = Request("axes", bench, seed, settings, None, build=build, warn=lambda _: None, operator=operator)
    with StopSignals() as signals:
        return conduct(request, signals)


def three_axes(planted: list[list[float]]) -> BenchDescription:
    """Return a bench with a device of three outputs, each with its input axis."""
    one = to_builtins(lot(2, 10.0).each[0])
    device = [
        {
            "name": f"I-{name}",
            "resource": "/dev/ttyUSB1",
            "stream": {"value": {"column": column}},
            "simulation": {"override": {"site": {"input_axis": axis}}},
        }
        for column, (name, axis) in enumerate(zip("xyz", planted, strict=True), 2)
    ]
    kept = {key: {k: v for k, v in one[key].items() if v is not None} for key in ("rate_table", "limits", "site")}
    stream = {"profile": "vn100", "sample_rate_hz": 10.0, "aperture_s": 0.4}
    values = {**kept, "name": "axes", "gyro": {"stream": stream}, "simulation": {}, "device": device}
    return checked_bench(values, "axes.toml")


def _journal(folder: Path) -> Path:
    while not (found := list(folder.glob("*/journal.jsonl"))):
        sleep(0.02)
    return found[0]


def _later(device: int, errors: dict[str, float], at_s: float) -> Any:
    """Return the builder of a bench of which one device has a fault from an instant on."""

    class Later:
        def __init__(self, bench: SimulatedBench) -> None:
            self._bench = bench

        def wake_at(self) -> float | None:
            if self._bench.clock.now() < at_s:
                return at_s
            own: Any = self._bench.devices["multimeter" if device == 1 else f"multimeter-{device}"]
            for each in own.adjustments():
                if (name := each.name.removeprefix("stream.")) in errors and each.read() != errors[name]:
                    each.write(errors[name])
            return None

    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = SimulatedBench.build(description, seed, clock)
        attended: Any = bench.clock
        attended.attend(Later(bench))
        return bench

    return build


def _conducted(bench: BenchDescription, build: Any, runs: Path) -> Run:
    request = Request("turntable", bench, 1, asked_in_python(QUICK), runs, build=build, warn=lambda _: None)
    with StopSignals() as signals:
        return conduct(request, signals)


def main() -> int:
    """Do the parts that are asked for; return 1 where one is beyond its limits."""
    parts = {"eight": (eight, 3), "shared": (shared, 60), "faults": (faults, 1), "kill": (kill, 5), "axes": (axes, 100)}
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*parts, []])
    parser.add_argument("--seeds", type=int)
    asked = parser.parse_args()
    well = True
    for name in asked.parts or parts:
        part, usual = parts[name]
        with TemporaryDirectory() as folder:
            print(f"--- {name}")
            well &= part(asked.seeds or usual, Path(folder))
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
