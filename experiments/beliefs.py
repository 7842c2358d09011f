"""Whether a run believes what cannot be true: faults in each gap between windows, outputs that do not answer, no fault.

    python experiments/beliefs.py jumps --lines jumps.jsonl          steps and pulses of the meter's reading
    python experiments/beliefs.py dead --lines dead.jsonl            leads off and what does not work, role by role
    python experiments/beliefs.py clean --count 2000 --lines c.jsonl drawn benches without a fault: none may be refused
    python experiments/beliefs.py jumps --summary jumps.jsonl

`jumps`: a step of 3 mV, 20 mV, 0.1 V and 0.5 V of either sign in each gap between two windows, and pulses that cover
one, two and three windows, in every procedure that goes from level to level, every order and every choice of zeros. A
run that ends complete is held against the run of the same seed without the fault: no value with an uncertainty may
differ by more than its U95. `--only` takes the cases whose names hold a text, `--share` every n-th. What stands in the
file of --lines is not run again. A case takes 0.2 to 1 s of processor time.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
import zlib
from collections import Counter
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from msgspec import structs
from simrack.faults import Fault
from simrack.faulty_device import FaultInjector

import vcfbench
from vcfbench.errors import BenchError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.stated import values_of
from vcfbench.sim.builder import SimulatedBench
from vcfbench.steps import Acquire, Window
from vcfbench.steps.events import StepFinished
from vcfbench.testing.gyroscopes import drawn_bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    Line = dict[str, Any]
    Prepare = Callable[[SimulatedBench], None]

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile
SIZES_V = (3e-3, 20e-3, 0.1, 0.5)
PULSES = (1, 2, 3)
WARM = {"warm_up_s": 1800.0}


class Case:
    """A procedure with its settings on an embedded bench, cold or warm."""

    def __init__(self, procedure: str, bench: str = "paper", **settings: Any) -> None:
        self.procedure, self.settings = procedure, settings
        self.bench: Any = bench
        said = "".join(f" {key}={value}" for key, value in settings.items() if key not in {"warm_up_s", "dut"})
        self.name = f"{procedure} {bench}{said}"


ORDERS = ("paper", "alternate", "abba", "loop")
ZEROS = ("none", "ends", "bracket")
SWEEPS = [
    *(Case("turntable", order=order, zeros=zeros) for order in ORDERS for zeros in ZEROS),
    Case("turntable", repeat=2),
    *(
        Case("virtual-coriolis", bench, order=order, zeros=zeros)
        for bench in ("paper", "lab")
        for order in ORDERS
        for zeros in ZEROS
    ),
    *(Case("virtual-coriolis", "paper", k_vc_by=by) for by in ("plus-minus", "curve")),
    *(Case("virtual-coriolis", "lab", k_vc_by=by) for by in ("plus-minus", "curve")),
    Case("virtual-coriolis", "lab", match="absolute"),
    Case("kvc", "lab"),
    Case("kvc", "lab", cycles=1),
    Case("kvc", "paper"),
    Case("self-calibration", "lab"),
    Case("self-calibration", "paper"),
]


@contextmanager
def spoilt(prepare: Prepare) -> Iterator[None]:
    """Have what is built of a bench file meanwhile prepared; faults stand around its instruments."""
    plain = SimulatedBench.__dict__["build"]

    def build(_kind: Any, description: Any, seed: int, clock: Any) -> SimulatedBench:
        built: SimulatedBench = plain.__func__(SimulatedBench, description, seed, clock)
        faults = FaultInjector(built.devices, built.clock, seed)
        built.clock.attend(*faults.devices.values())  # type: ignore[attr-defined] # what is planned comes at its instant
        made = structs.replace(built, devices=faults.devices)
        prepare(made)
        return made

    setattr(SimulatedBench, "build", classmethod(build))  # noqa: B010 - it is put back
    try:
        yield
    finally:
        setattr(SimulatedBench, "build", plain)  # noqa: B010


def with_fault(fault: Fault) -> Prepare:
    """Return what lets a fault happen."""
    return lambda bench: bench.devices[fault.instrument].add(fault)  # type: ignore[attr-defined]


class Windows:
    """Keeps when each window of a run began and ended, bench time."""

    def __init__(self) -> None:
        self.times_s: list[tuple[float, float]] = []

    def handle(self, event: Any) -> None:
        if isinstance(event, StepFinished) and isinstance(event.step, Acquire) and isinstance(event.result, Window):
            begin_s = event.result.readings[0].t_s if event.result.readings else event.t_s
            self.times_s.append((begin_s, begin_s + event.step.physical_s))


def stated_by(results: Any) -> dict[str, tuple[float, float]]:
    """Return every value that is stated with an uncertainty: value and U95."""
    found = values_of(results).items()
    return {name: (each.value, each.u95) for name, each in found if each.value is not None and each.u95 is not None}


def run(case: Case, seed: int, devices: str, observers: Sequence[Any] = ()) -> Any:
    """Return the results of a run, or the error that ended it."""
    settings = dict(case.settings)
    if case.procedure in {"kvc", "self-calibration", "online"}:
        settings |= {"dut": "G", "devices": devices}
    try:
        return vcfbench.run(
            case.procedure, case.bench, seed=seed, settings=settings, runs=devices, observers=observers
        ).results
    except BenchError as error:
        return error


def faults_of(times_s: Sequence[tuple[float, float]], settle_s: float = 1.0) -> Iterator[tuple[str, Fault]]:
    """Yield the faults with their names: each gap, each stretch of windows, each size, either sign."""
    begins = [
        begin - min(settle_s, 0.5 * max(begin - before, 0.2))
        for (_, before), (begin, _) in zip([(0.0, times_s[0][0] - 2.0), *times_s[:-1]], times_s, strict=True)
    ]
    begins.append(times_s[-1][1] + 0.05)
    for size_v in SIZES_V:
        for sign in (1.0, -1.0):
            offset = sign * size_v
            for gap in range(1, len(times_s)):
                yield f"step {offset:+g} V, gap {gap}", Fault("multimeter", "offset", at_s=begins[gap], offset=offset)
                for covers in PULSES:
                    if gap - 1 + covers <= len(times_s) - (gap == 1):
                        lasts = begins[gap - 1 + covers] - begins[gap - 1]
                        name = f"pulse {offset:+g} V over {covers} from window {gap}"
                        yield name, Fault("multimeter", "offset", at_s=begins[gap - 1], offset=offset, duration_s=lasts)


def judged(results: Any, clean: dict[str, tuple[float, float]]) -> Line:
    """Return how a run ended: refused with its words, or by how much of its U95 its worst value is off."""
    if isinstance(results, BenchError):
        return {"end": "refused", "kind": type(results).__name__, "why": str(results)[:300]}
    stated = {name: each for name, each in stated_by(results).items() if name in clean}
    off = {name: abs(value - clean[name][0]) / u95 for name, (value, u95) in stated.items()}
    worst = max(off, key=off.__getitem__)
    return {"end": "complete", "worst": worst, "off": off[worst]}


def jumps(only: str, share: int, had: set[str], seed: int = 3) -> Iterator[Line]:
    """Yield how each faulty run ended."""
    for case in SWEEPS:
        if only not in case.name:
            continue
        with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as devices:
            if case.procedure == "self-calibration":
                vcfbench.run("kvc", case.bench, seed=1, settings={"dut": "G", "devices": devices}, runs=devices)
            seen = Windows()
            first = run(case, seed, devices, [seen])
            if isinstance(first, BenchError):
                yield {"case": case.name, "fault": "none", **judged(first, {})}
                continue
            clean = stated_by(first)
            for number, (name, fault) in enumerate(faults_of(seen.times_s)):
                if f"{case.name} / {name}" in had or zlib.crc32(f"{case.name}{number}".encode()) % share:
                    continue
                with spoilt(with_fault(fault)):
                    yield {"case": case.name, "fault": name, **judged(run(case, seed, devices), clean)}


class _Unfed:
    """The World behind the leads of a supply that go nowhere."""

    def __init__(self, world: Any) -> None:
        self._world = world

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def move_rail(self, *_: Any) -> None:
        pass

    def set_ripple(self, *_: Any) -> None:
        pass

    def rail_current_a(self, *_: Any) -> float:
        return 0.0


def _no_supply(bench: SimulatedBench) -> None:
    for output in bench.devices["power"].device.outputs.values():  # type: ignore[attr-defined]
        output._world = _Unfed(output._world)  # noqa: SLF001 - the leads end there


def _no_lead(role: str, name: str) -> Prepare:
    return lambda bench: bench.world.leads[role].connect(name, None)


def _no_source(generator: str) -> Prepare:
    def undone(bench: SimulatedBench) -> None:
        drive = bench.world.drive  # both generators come through it

        def through(node: str, source: Any) -> None:
            drive(node, None if node == generator else source)

        setattr(bench.world, "drive", through)  # noqa: B010 - in place of a method

    return undone


def _nothing(_bench: SimulatedBench) -> None:
    pass


DEAD: dict[str, tuple[Prepare, dict[str, Any]]] = {
    "output lead off": (_no_lead("multimeter", "input"), {}),
    "supply's leads off": (_no_supply, {}),
    "no demodulator": (_nothing, {"sense_path": {"multiplier_per_v": 0.0}}),
    "V_Vc lead off": (_no_source("v_vc"), {}),
    "no carrier": (_nothing, {"virtual_path": {"left_comb_n_per_v2": 0.0, "right_comb_n_per_v2": 0.0}}),
    "V_Vc meter's lead off": (_no_lead("v_vc_meter", "input"), {}),
    "vibration lead off": (_no_source("vibration"), {}),
    **{f"scope channel {n} off": (_no_lead("oscilloscope", f"channel_{n}"), {}) for n in (1, 2, 3, 4)},
}
"""What does not work, what makes it so, and which parameters."""
ALL: dict[str, dict[str, Any]] = {
    "turntable": {},
    "virtual-coriolis": {},
    "kvc": {"cycles": 1},
    "self-calibration": {"cycles": 1},
    "zero": {"powered_s": 60.0, "duration_s": 300.0},
    "warmup": {"shortest_s": 300.0, "longest_s": 600.0},
    "bandwidth": {"warm_up_s": 60.0},
    "resonance": {"warm_up_s": 60.0},
    "phase": {},
    "power": {},
    "temperature": {"temperatures_c": [20.0, 25.0, 30.0]},
    "vibration": {},
    "polarity": {},
    "online": {},
}
"""All procedures, short."""


def dead(only: str, had: set[str]) -> Iterator[Line]:
    """Yield how each run ended in which something did not work from the first reading to the last."""
    plain = vcfbench.load_bench("lab")
    blind = structs.replace(plain, oscilloscope=None)
    for procedure, settings in ALL.items():
        for where, bench in (("lab", plain), ("no scope", blind)):
            with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as devices:
                if procedure in {"self-calibration", "online"}:
                    vcfbench.run("kvc", plain, seed=1, settings={"dut": "G", "devices": devices}, runs=devices)
                for name, (prepare, override) in {"nothing": (_nothing, {}), **DEAD}.items():
                    case = Case(procedure, "lab", **settings)
                    label = f"{procedure}, {where} / {name}"
                    if only not in label or label in had or (bench is blind and "scope" in name):
                        continue
                    assert bench.simulation is not None  # noqa: S101 - its file has one
                    case.bench = structs.replace(bench, simulation=structs.replace(bench.simulation, override=override))
                    with spoilt(prepare):
                        ended = run(case, 3, devices)
                    line = judged(ended, {}) if isinstance(ended, BenchError) else {"end": "complete"}
                    yield {"case": f"{procedure}, {where}", "fault": name, **line}


def drawn(seed: int, name: str) -> Any:
    """Return the bench of a drawn gyroscope, with the meter on V_Vc that `lab` has and `paper` has not."""
    bench = parse_bench(drawn_bench(seed), f"gyroscope-{seed}")
    return bench if name == "lab" else structs.replace(bench, v_vc_meter=None)


CLEAN = (
    *(Case("turntable", "paper", order=order, zeros=zeros) for order in ORDERS for zeros in ZEROS),
    Case("virtual-coriolis", "paper"),
    Case("virtual-coriolis", "lab"),
    Case("virtual-coriolis", "lab", order="abba", zeros="bracket", k_vc_by="curve"),
    Case("kvc", "lab"),
    Case("self-calibration", "lab"),
)


def clean(start: int, count: int, only: str, had: set[str]) -> Iterator[Line]:
    """Yield how each run without a fault ended; procedures and benches in turn."""
    cases = [case for case in CLEAN if only in case.name]
    for seed in range(start, start + count):
        case = cases[seed % len(cases)]
        if f"{case.name} / seed {seed}" in had:
            continue
        warm = {"warm_up_s": 1800.0} if seed // len(cases) % 2 else {}
        one = Case(case.procedure, case.bench, **case.settings, **warm)
        one.bench = drawn(seed, case.bench)
        with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as devices:
            if case.procedure == "self-calibration":
                run(Case("kvc", one.bench), seed, devices)
            ended = run(one, seed, devices)
        line = {"end": "complete"} if not isinstance(ended, BenchError) else judged(ended, {})
        yield {"case": case.name, "fault": f"seed {seed}", **line}


def summary(lines: Sequence[Line]) -> list[str]:
    """Return the table: of each case how many runs were refused, complete within and beyond U95."""
    rows = [f"{'case':66} {'runs':>6} {'refused':>8} {'within':>7} {'BEYOND':>7} {'largest':>8}"]
    for case in dict.fromkeys(line["case"] for line in lines):
        own = [line for line in lines if line["case"] == case]
        ends = Counter(line["end"] for line in own)
        off = [line.get("off", 0.0) for line in own if line["end"] == "complete"]
        far = sum(each > 1.0 for each in off)
        largest = max(off, default=math.nan)
        rows.append(f"{case:66} {len(own):6} {ends['refused']:8} {ends['complete'] - far:7} {far:7} {largest:8.2f}")
    beyond = (line for line in lines if line.get("off", 0.0) > 1.0)
    return rows + [
        f"  beyond: {line['case']}: {line['fault']}: {line['worst']} {line['off']:.2f} U95" for line in beyond
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["jumps", "dead", "clean"])
    parser.add_argument("--only", default="", help="cases whose names hold this")
    parser.add_argument("--share", type=int, default=1, help="of jumps: one in so many")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--lines", type=Path, help="file that keeps a line a run")
    parser.add_argument("--summary", action="store_true", help="run nothing, sum up the file of --lines")
    asked = parser.parse_args()
    old = asked.lines.read_text(encoding="utf-8").splitlines() if asked.lines and asked.lines.exists() else []
    lines = [json.loads(line) for line in old if line.endswith("}")]
    if not asked.summary:
        had = {f"{line['case']} / {line['fault']}" for line in lines}
        if asked.what == "jumps":
            new = jumps(asked.only, asked.share, had)
        elif asked.what == "dead":
            new = dead(asked.only, had)
        else:
            new = clean(asked.start, asked.count, asked.only, had)
        for line in new:
            lines.append(line)
            if asked.lines:
                with asked.lines.open("a", encoding="utf-8") as out:
                    print(json.dumps(line), file=out)
    if asked.what == "dead":
        print(
            "\n".join(f"{line['case']:28} {line['fault']:24} {line['end']:9} {line.get('why', '')}" for line in lines)
        )
        return int(any((line["end"] == "complete") != (line["fault"] == "nothing") for line in lines if _tells(line)))
    print("\n".join(summary(lines)))
    refused = asked.what == "clean" and any(line["end"] == "refused" for line in lines)
    return int(refused or any(line.get("off", 0.0) > 1.0 for line in lines))


def _tells(line: Line) -> bool:
    """Tell whether a fault must end a run: one that takes the output away does, and none must not."""
    return line["fault"] in {"nothing", "output lead off", "supply's leads off", "no demodulator"}


if __name__ == "__main__":
    sys.exit(main())
