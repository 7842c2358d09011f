"""Whether a run tells what it cannot see: faults of 13 kinds and many sizes in every procedure that takes windows.

    python experiments/unseen.py --lines unseen.jsonl                  all procedures, kinds and sizes
    python experiments/unseen.py --only turntable,kvc --sizes 5 --draws 1
    python experiments/unseen.py --just-above 500 --only turntable     what lies 1.5 times above the list
    python experiments/unseen.py --summary unseen.jsonl

A clean run of a simulated bench is taken once. Then its windows are moved by a fault, and the plan is gone through
again with them: it refuses the run, or the run is evaluated again. Sizes go from 0.03 to 10 times that of the run's own
list (vcfbench.archive.unseen); the fault begins, and ends, at drawn times. A complete run with a value beyond its U95
must have kind and size in its list; and of what lies 1.5 times above a size of the list 95 % must be refused, or move
nothing by a third of its U95. What records of the oscilloscope show (`phase`, `resonance`) is changed, or creeps, from
a drawn visit on. The exit code is 1 where one of the two does not hold. What stands in the file of --lines
is not tried again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from msgspec import structs

import vcfbench
from vcfbench.archive.unseen import in_records, refusable, unseen_of
from vcfbench.belief.jumps import GAIN, OFFSET, V_VC_GAIN, V_VC_OFFSET, require_no_jump
from vcfbench.belief.walk import Walk
from vcfbench.errors import BenchError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.steps import ModulatedRecord, SineResponse
from vcfbench.steps.step import StepResult, abandon

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from vcfbench.archive.run import Run
    from vcfbench.archive.unseen import Refusable

    Line = dict[str, Any]
    InTime = Callable[[Any, float, float], Any]

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile
PROCEDURES = tuple(name for name in BUILT_IN if name != "characterize")
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "kvc": {"match_rates_deg_s": [20.0, 100.0, 200.0]},
    "temperature": {"split": False},
}


RECORDS = (SineResponse, ModulatedRecord)

_SHORT = 0.04
"""Share of a run that a short fault takes."""


def _after(t: Any, begin: float, _end: float) -> Any:
    return (t >= begin).astype(float)


def _while(t: Any, begin: float, end: float) -> Any:
    return ((t >= begin) & (t < end)).astype(float)


def _shortly(t: Any, begin: float, _end: float) -> Any:
    return ((t >= begin) & (t < begin + _SHORT)).astype(float)


def _rising(t: Any, begin: float, _end: float) -> Any:
    return np.maximum(0.0, t - begin) / max(1.0 - begin, 1e-9)


def _risen(t: Any, begin: float, end: float) -> Any:
    return np.clip((t - begin) / max(end - begin, 1e-9), 0.0, 1.0)


KINDS: Mapping[str, tuple[str, InTime, tuple[str, ...]]] = {
    "step": (OFFSET, _after, ("step",)),
    "shift for a while": (OFFSET, _while, ("pulse", "step")),
    "short shift": (OFFSET, _shortly, ("pulse", "step")),
    "ramp": (OFFSET, _rising, ("ramp",)),
    "ramp that ends": (OFFSET, _risen, ("ramp", "step")),
    "gain": (GAIN, _after, ("change",)),
    "gain for a while": (GAIN, _while, ("change",)),
    "gain, shortly": (GAIN, _shortly, ("change", "pulse")),
    "creeping gain": (GAIN, _rising, ("creep",)),
    "V_Vc's offset": (V_VC_OFFSET, _after, ("step",)),
    "V_Vc's gain": (V_VC_GAIN, _after, ("change",)),
    "V_Vc's gain for a while": (V_VC_GAIN, _while, ("change",)),
    "creeping V_Vc's gain": (V_VC_GAIN, _rising, ("creep",)),
}
"""Kinds: unit, course in time (of the share of the run that is over), and the kinds of the list that tell it."""


class Tried:
    """A clean run, its list, and what faults make of it."""

    def __init__(self, run: Run) -> None:
        found = refusable(run)
        assert found is not None  # noqa: S101 - runs without windows are not tried
        self.run, self.of = run, found
        self.rows = unseen_of(run)
        none = np.zeros(len(run.points))
        self.clean = found.values(none, none)
        self.records = [each for each in found.measured.found(StepResult) if isinstance(each[1], RECORDS)]
        if self.of_records:  # one after the other, as long as each other
            shares = np.linspace(0.0, 1.0, len(self.records) + 1)
            self.in_windows = [np.linspace(*each, 10) for each in pairwise(shares)]
        else:
            begin, end = self.of.course.windows[0].begin_s, self.of.course.windows[-1].end_s
            self.in_windows = [
                (np.linspace(each.begin_s, each.end_s, 10) - begin) / max(end - begin, 1e-9)
                for each in self.of.course.windows
            ]

        ends = [each[-1] for each in self.in_windows[:-1]]
        self.gaps = [0.5 * (end + each[0]) for end, each in zip(ends, self.in_windows[1:], strict=True)]

    @property
    def of_records(self) -> bool:
        """True if there are records of sines and no windows: then a step is one within each record."""
        return not self.of.course.windows and bool(self.records)

    def has(self, unit: str) -> bool:
        """Tell whether there is anything that a fault of `unit` moves."""
        points = (each.point.v_vc_measured_v is not None for each in self.of.course.windows)
        records = (bool(getattr(each, "v_vc_v", ())) for _, each in self.records)
        return unit in {OFFSET, GAIN} or any(records if self.of_records else points)

    def times(self, rng: np.random.Generator) -> tuple[float, float]:
        """Draw beginning and end of a fault: in gaps, because one in the first window is nearly one all through."""
        begin, end = np.sort(rng.choice(self.gaps, 2, replace=False)).tolist()
        return begin, end

    def sizes(self, kind: str) -> tuple[float, float]:
        """Return the size from which on the run's list says that such a fault is refused, and where none does 1e-3."""
        unit, _, told = KINDS[kind]
        sizes = [each.size for each in self.rows if each.unit == unit and each.kind in told and each.size is not None]
        return (max(sizes), max(sizes)) if sizes else (0.0, 1e-3)

    def told(self, kind: str, size: float) -> bool:
        """Tell whether kind and size are in the run's own list."""
        unit, _, told = KINDS[kind]
        own = [each for each in self.rows if each.unit == unit and each.kind in told]
        return any(each.size is None or abs(size) <= each.size for each in own)

    def with_fault(self, kind: str, size: float, begin: float, end: float) -> Line:
        """Return how the run ends with a fault, times as shares of the run."""
        unit, in_time, _ = KINDS[kind]
        course = [size * float(np.mean(in_time(t, begin, end))) for t in self.in_windows]
        line = {"kind": kind, "size": size, "begin": round(begin, 4), "end": round(end, 4)}
        if self.of_records:
            return {**line, **self._ended(kind, size, lambda: self._of_records(unit, course))}
        points = [each.point for each in self.of.course.windows]
        of = {GAIN: [each.output_v for each in points], V_VC_GAIN: [each.v_vc_measured_v or 0.0 for each in points]}
        moves = np.multiply(course, of.get(unit, [1.0] * len(points))).tolist()
        none = [0.0] * len(points)
        output_v, v_vc_v = (none, moves) if unit in {V_VC_OFFSET, V_VC_GAIN} else (moves, none)

        def values() -> Mapping[str, float]:
            self._go_through(output_v, v_vc_v)
            place = [at for at, each in enumerate(self.of.course.places) if each is not None]
            return self.of.values(np.array(output_v)[place], np.array(v_vc_v)[place])

        return {**line, **self._ended(kind, size, values)}

    def _of_records(self, unit: str, course: Sequence[float]) -> Mapping[str, float]:
        return self.of.evaluated(self.of.settings, self.of.measured.changed(in_records(unit, course)))

    def _ended(self, kind: str, size: float, evaluated: Callable[[], Mapping[str, float]]) -> Line:
        try:
            values = evaluated()
        except BenchError as error:
            return {"outcome": "refused", "why": error.what[:80]}
        off = {name: abs(values[name] - self.clean[name]) / u95 for name, u95 in self.of.u95.items()}
        worst = max(off, key=off.__getitem__)
        return {"outcome": "complete", "worst": worst, "off": round(off[worst], 3), "told": self.told(kind, size)}

    def _go_through(self, output_v: Sequence[float], v_vc_v: Sequence[float]) -> None:
        """Go through the plan; where it asks for something else now, what it watches is asked alone."""
        plan = self.of.procedure.plan(self.of.settings)
        moves = iter(zip(output_v, v_vc_v, strict=True))
        try:
            step = next(plan)
            for recorded, result in self.of.steps:
                if type(step) is not type(recorded):
                    break
                step = plan.send(result.moved(*next(moves)) if hasattr(result, "point") else result)
        except StopIteration:
            return
        finally:
            abandon(plan)
        for walk, places in self.of.course.walks:
            again = Walk(walk.settings, walk.limits)
            for each, at in zip(walk.windows, places, strict=True):
                again.add(structs.replace(each, point=each.point.moved(output_v[at], v_vc_v[at])))
                again.require_same(again.windows[-1])
            require_no_jump(again)


def in_turn(run: Run, of: Refusable, rng: np.random.Generator, asked: argparse.Namespace) -> Iterator[Line]:
    """Yield how the run ends where what its records of the oscilloscope showed changed, or crept, from a visit on."""
    before, rows = of.evaluated(of.settings, of.measured), unseen_of(run)
    for each in () if of.procedure.in_turn is None else of.procedure.in_turn(of.settings, of.measured):
        at = np.arange(len(each.visits))
        for kind in ("change", "creep"):
            own = [row.size for row in rows if (row.what, row.kind) == (each.what, kind)]
            told = max((size for size in own if size), default=0.0)
            above = [1.5 * told] * (asked.just_above if told else 0)
            for size in above if asked.just_above else np.geomspace(0.03, 10.0, asked.sizes) * (told or 1e-3):
                begin, end = np.sort(rng.choice(at[1:], 2, replace=False)).tolist()
                course = (
                    np.maximum(0, at - begin + 1) / (at.size - 1) if kind == "creep" else (at >= begin) & (at < end)
                )
                line = {"told_size": told, "kind": f"{kind} of {each.what}", "size": float(size), "begin": begin}
                try:
                    after = of.with_records(each, float(rng.choice([-1.0, 1.0])) * size * course)
                except BenchError as error:
                    yield {**line, "outcome": "refused", "why": error.what[:80]}
                    continue
                off = max(abs(after[name] - before[name]) / u95 for name, u95 in of.u95.items())
                is_told = None in own or float(size) <= told
                yield {**line, "outcome": "complete", "off": round(off, 3), "told": is_told}


def tried(name: str, kinds: Sequence[str], asked: argparse.Namespace) -> Iterator[Line]:
    """Yield how each faulty run of a procedure ends."""
    rng, seed, above = np.random.default_rng(asked.seed), asked.seed, asked.just_above
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as directory:
        device = {"dut": "G", "devices": directory}
        if name in ("self-calibration", "online"):
            vcfbench.run("kvc", "lab", seed=1, settings={**SETTINGS["kvc"], **device}, runs=directory)
        settings = dict(SETTINGS.get(name, {}))
        if name in {"kvc", "self-calibration", "online"}:
            settings |= device
        run = vcfbench.run(name, "lab", seed=seed, settings=settings, runs=directory)
        again = refusable(run)
        for line in () if again is None else in_turn(run, again, rng, asked):
            yield {"procedure": name, **line}
        if again is None or not (len(again.course.windows) > 1 or any(again.measured.found(each) for each in RECORDS)):
            yield {"procedure": name, "outcome": "no windows"}
            return
        case = Tried(run)
        yield {"procedure": name, "outcome": "list", "rows": len(case.rows), "windows": len(case.in_windows)}
        for kind, (unit, _, told_as) in KINDS.items():
            no_step = case.of_records and unit in {OFFSET, V_VC_OFFSET} and "step" not in told_as
            if (kinds and kind not in kinds) or not case.has(unit) or no_step:
                continue
            told, largest = case.sizes(kind)
            ladder = [1.5 * told] * (above if told else 0) if above else largest * np.geomspace(0.03, 10.0, asked.sizes)
            for size in ladder:
                for _ in range(1 if above else asked.draws):
                    begin, end = case.times(rng)
                    signed = float(size) * float(rng.choice([-1.0, 1.0]))
                    yield {"procedure": name, "told_size": told, **case.with_fault(kind, signed, begin, end)}


def summary(lines: Sequence[Line]) -> bool:
    """Print the outcomes by procedure and kind; tell whether the list holds."""
    table: dict[tuple[str, str], list[Line]] = defaultdict(list)
    for each in lines:
        if "kind" in each:
            table[each["procedure"], each["kind"]].append(each)
    held = all(each["outcome"] != "not run" for each in lines)
    print("procedure             kind                       tried refused beyond-U95 not-told | above: seen of")
    for (name, kind), own in table.items():
        refused = sum(each["outcome"] == "refused" for each in own)
        beyond = [each for each in own if each["outcome"] == "complete" and each["off"] > 1.0]
        above = [each for each in own if each["told_size"] and abs(each["size"]) >= 1.499 * each["told_size"]]
        seen = sum(each["outcome"] == "refused" or each["off"] < 1.0 / 3.0 or each["told"] for each in above)
        loose = [each for each in beyond if not each["told"]]
        bad = len(loose) > 0.05 * max(1, len(above)) or seen < 0.95 * len(above) - 1
        held &= not bad
        print(
            f"{name:21} {kind:26} {len(own):5} {refused:7} {len(beyond):10} {len(loose):8} | {seen:5} {len(above):5}"
            f"{'  <<<' if bad else ''}"
        )
    return held


def main() -> int:
    """Try what was asked for and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="procedures, with commas")
    parser.add_argument("--kinds", default="", help="kinds, with commas")
    parser.add_argument("--sizes", type=int, default=20)
    parser.add_argument("--draws", type=int, default=1, help="drawn times of each size")
    parser.add_argument("--just-above", type=int, default=0, metavar="N", help="N draws 1.5 times above the list")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--lines", type=Path)
    parser.add_argument("--summary", type=Path)
    asked = parser.parse_args()
    if asked.summary:
        return int(not summary([json.loads(line) for line in asked.summary.read_text().splitlines()]))
    had = [] if asked.lines is None or not asked.lines.exists() else asked.lines.read_text().splitlines()
    lines = [json.loads(line) for line in had]
    done = {each["procedure"] for each in lines}
    for name in filter(None, asked.only.split(",")) if asked.only else PROCEDURES:
        if name in done:
            continue
        kinds = [each for each in asked.kinds.split(",") if each]
        try:
            own = list(tried(name, kinds, asked))
        except BenchError as error:
            own = [{"procedure": name, "outcome": "not run", "why": str(error)[:200]}]
        lines += own
        print(name, len(own), own[0]["outcome"], file=sys.stderr, flush=True)
        if asked.lines is not None:
            with asked.lines.open("a", encoding="utf-8") as file:
                file.writelines(f"{json.dumps(each)}\n" for each in own)
    return int(not summary(lines))


if __name__ == "__main__":
    sys.exit(main())
