"""A figure of all numbers that a run states, kept: golden's hashes of results hold on one processor, these on all.

``python -m tests.procedures.parts.values [PART OF A KEY ...]`` writes them anew, after a change that was meant.
"""

from __future__ import annotations

import json
import math
import sys
from datetime import datetime
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from zlib import crc32

import vcfbench
from tests.evaluation import require_raised
from tests.procedures.parts.procedures import PROCEDURES
from tests.procedures.parts.simulated import Bench, Change, quiet
from vcfbench.archive.unseen import unseen_of
from vcfbench.records.journal import lines_of
from vcfbench.records.plain import plain
from vcfbench.reports.document import Figure, Table
from vcfbench.version import EVALUATION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from tests.procedures.parts.held import Run
    from vcfbench.reports.document import Report

FILE = Path(__file__).with_name("values.json")
_EVALUATION = "evaluation"
_NOTHING, _MANY = 1e-9, 1e6
"""What rounding leaves of none, and degrees of freedom from which on there are as many as one likes."""

Figures = dict[str, float]


def _logarithms(value: Any, name: str) -> Iterator[float]:
    """Yield the logarithm of each number below, signed, each with a weight that goes with its place; words likewise."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _logarithms(each, f"{name}.{key}")
    elif isinstance(value, list):
        parts = [each for each in value if isinstance(each, dict) and "source" in each and "u" in each]
        least = 1e-6 * max((abs(each["u"]) for each in parts), default=0.0)  # below that it is what rounding leaves
        for place, each in enumerate(value):
            if each not in parts:
                yield from _logarithms(each, f"{name}[{place}]")
            elif abs(each["u"]) > least:  # parts are in the order of their size
                yield from _logarithms(each, f"{name}[{each['source']}]")
    else:
        if isinstance(value, str) and any(map(str.isdigit, value)):
            return  # rounded numbers
        number = float(crc32(str(value).encode())) if value is None or isinstance(value, str | bool) else float(value)
        size = min(abs(number), _MANY) if name.endswith("dof") else abs(number)
        sized = math.log(size / _NOTHING) if size > _NOTHING else 0.0
        yield math.copysign(sized, number) * Random(name).uniform(1.0, 2.0)  # noqa: S311  # weights, not secrets


def figures_of(values: Mapping[str, Any]) -> Figures:
    """Return a number for each field of results: it moves by at least what any number in it moves by, relatively."""
    found = json.loads(json.dumps(values))
    found.pop("residual", None)  # what a fit leaves of a quiet response is a machine's last digits
    return {name: round(math.fsum(_logarithms(each, name)), 5) for name, each in found.items()}


def figure_of_report(report: Report) -> float:
    """Return a number of all numbers in the figures and tables of a report, likewise."""
    groups: list[Sequence[Any]] = []
    for part in report.parts:
        if isinstance(part, Table):
            groups += zip(*part.rows, strict=True)
        elif isinstance(part, Figure):
            groups += (each or () for of in part.series for each in (of.x, of.y, of.u_y, of.low, of.high))
    return _sized(groups)


def figure_of_steps(lines: Iterable[Mapping[str, Any]]) -> float:
    """Return a number of all numbers in the steps that were done, likewise."""
    return _sized([*_numbers(line["step"])] for line in lines if "step_kind" in line)


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _numbers(each)
    elif isinstance(value, int | float):
        yield float(value)


def _sized(groups: Iterable[Sequence[Any]]) -> float:
    """Return the sum of all logarithms in groups of numbers, weighed by place; what rounding leaves is none."""
    total = 0.0
    for row, group in enumerate(groups):
        held = [getattr(each, "value", each) for each in group]
        numbers = [each if isinstance(each, int | float) else 0.0 for each in held]
        least = max(1e-6 * max(map(abs, numbers), default=0.0), _NOTHING)
        weights = Random(row)  # noqa: S311  # no secrets
        total += math.log(least / _NOTHING) * weights.uniform(1.0, 2.0)  # else a column could be in any unit
        total += math.fsum(
            math.copysign(math.log(max(abs(each), least) / least), each) * weights.uniform(1.0, 2.0) for each in numbers
        )
    return round(total, 5)


def differing(came: Figures, kept: Figures) -> list[str]:
    """Return the fields that are not as they were, to some parts in ten thousand of one of their numbers."""
    return [
        f"{name}: was {kept.get(name)}, got {came.get(name)}"
        for name in {**kept, **came}
        if not abs(came.get(name, math.inf) - kept.get(name, 0.0)) <= 3e-4
    ]


_SHORT: Mapping[str, Any] = MappingProxyType({"samples": 4, "cycles": 1})
_SWEEP: Mapping[str, Any] = MappingProxyType(
    {"samples": 4, "rates_deg_s": [200.0, 50.0, 10.0, 0.0, -10.0, -50.0, -200.0]}
)
NOISY: Mapping[str, tuple[tuple[str, str, Mapping[str, Any]], ...]] = MappingProxyType(
    {
        "turntable, a loop between zeros": (
            ("turntable", "paper", {**_SWEEP, "order": "loop", "zeros": "bracket", "earth": "rate"}),
        ),
        "turntable, there and back": (
            ("turntable", "paper", {**_SWEEP, "order": "abba", "zeros": "ends", "repeat": 2}),
        ),
        "four steps, levels as they are set": (("virtual-coriolis", "paper", _SWEEP),),
        "four steps, outputs as they are": (("virtual-coriolis", "lab", {**_SWEEP, "match": "absolute"}),),
        "four steps, by a curve": (("virtual-coriolis", "lab", {**_SWEEP, "k_vc_by": "curve", "zeros": "bracket"}),),
        "four steps, by both signs": (("virtual-coriolis", "paper", {**_SWEEP, "k_vc_by": "plus-minus"}),),
        "K_Vc, levels as they are set": (
            ("kvc", "paper", {**_SHORT, "v_vc": "set", "health": False}),
            ("self-calibration", "paper", {**_SHORT, "v_vc": "set", "health": False}),
        ),
        "K_Vc, and a self-calibration by it": (
            ("kvc", "quiet", {**_SHORT, "temperature_c": 20.0}),
            ("self-calibration", "quiet", {**_SHORT, "temperature_c": 21.5}),
            ("online", "quiet", {"duration_s": 300.0, "warm_up_s": 60.0}),
        ),
        "polarity": (("polarity", "lab", {}),),
        "zero, with flicker": (
            ("zero", "paper", {"warm_up_s": 60.0, "powered_s": 60.0, "duration_s": 3600.0}),
            ("turntable", "paper", _SWEEP),
        ),
        "bandwidth": (("bandwidth", "lab", {"warm_up_s": 60.0}),),
        "axes": (("axes", "lab", {"samples": 4}),),
        "power, rails moved": (("power", "paper", {**_SHORT, "warm_up_s": 60.0}),),
        "repeatability": (
            ("repeatability", "paper", {"samples": 4, "power_cycles": 4, "off_s": 300.0, "warm_up_s": 60.0}),
        ),
        "threshold by the table": (
            ("threshold", "paper", {**_SHORT, "by": "table", "at_most_s": 60.0, "steps_deg_s": [2.0, 1.0, 0.5, 0.1]}),
        ),
        "rate limits by the table": (("rate-limits", "lab", {"warm_up_s": 60.0, "samples": 4, "by": "table"}),),
        "temperature with the split": (
            (
                "temperature",
                "lab",
                {**_SHORT, "warm_up_s": 60.0, "temperatures_c": [0.0, 40.0, 20.0, 0.0], "split": True},
            ),
        ),
    }
)
"""Runs on embedded benches with all their noise, one after another with one device."""


def kept() -> dict[str, Figures]:
    """Return the figures that are kept, by the names of their runs."""
    found: dict[str, Figures] = json.loads(FILE.read_text(encoding="utf-8"))
    return {key: each for key, each in found.items() if key != _EVALUATION}


def evaluation() -> int:
    """Return the version of the evaluation that gave them."""
    return int(json.loads(FILE.read_text(encoding="utf-8"))[_EVALUATION])


def of_run(run: Run) -> Figures:
    """Return the figures of a run of the table of parts."""
    found, steps = plain(run.results), figure_of_steps(run.lines)
    quiet_response = "residual" in found  # so that its report holds last digits
    more = {"steps": steps} if quiet_response else {"steps": steps, "report": figure_of_report(run.report)}
    return figures_of(found) | more


def noisy_runs(name: str) -> Figures:
    """Return the figures of runs on a bench, one after another, and of what is kept of their device."""
    found, more = dict[str, Any](), Figures()
    with TemporaryDirectory() as folder:
        for procedure, bench, settings in NOISY[name]:
            one = Bench("lab", "paper's", quiet).described(Change(1.0)) if bench == "quiet" else bench
            of_device = {"dut": "G", "devices": folder} if len(NOISY[name]) > 1 else {}
            run = vcfbench.run(procedure, one, seed=5, settings={**settings, **of_device}, runs=folder)
            found |= {f"{procedure}: {key}": each for key, each in plain(run.results).items()}
            assert run.directory is not None
            more[f"{procedure}: report"] = figure_of_report(run.report())
            more[f"{procedure}: steps"] = figure_of_steps(lines_of(run.directory / "journal.jsonl"))
            # sizes are of two digits: one on an edge falls either way, as the processor rounds
            more[f"{procedure}: not seen"] = round(_sized([*_numbers(plain(each))] for each in unseen_of(run)), 2)
            if run.device_entry is not None:
                entry = json.loads(run.device_entry.read_text(encoding="utf-8"))
                begins, ends = (entry.get(key) for key in ("issued" if "issued" in entry else "done", "valid_until"))
                if ends is not None:
                    valid = datetime.fromisoformat(ends) - datetime.fromisoformat(begins)
                    more[f"{procedure}: valid"] = valid.total_seconds()
                found[f"{procedure}: kept"] = {key: each for key, each in entry.items() if isinstance(each, dict)}
    return figures_of(found) | more


def jobs() -> dict[str, Callable[[], Figures]]:
    """Return what makes the figures, by the key that they are kept under."""
    quiet_ones = {
        held.key(gyroscope): (lambda held=held, gyroscope=gyroscope: of_run(held.run(gyroscope)))
        for held in PROCEDURES
        for gyroscope in held.gyroscopes[: 1 if held.slow else 2]
    }
    return {**quiet_ones, **{name: (lambda name=name: noisy_runs(name)) for name in NOISY}}


if __name__ == "__main__":
    every, wanted = jobs(), sys.argv[1:]
    made = {key: make() for key, make in every.items() if not wanted or any(word in key for word in wanted)}
    moved = [key for key, figures in made.items() if key in kept() and differing(figures, kept()[key])]
    require_raised(evaluation(), moved)
    whole = {_EVALUATION: EVALUATION, **kept(), **made}
    lines = (f"{json.dumps(key)}: {json.dumps(whole[key])}" for key in (_EVALUATION, *every))
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
