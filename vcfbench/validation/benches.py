"""Checks on simulated benches: uncertainties against the truth, faults, limits, seals, resumption, wires."""

from __future__ import annotations

import math
import random
import shutil
from functools import partial
from pathlib import Path
from statistics import fmean, stdev
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

from msgspec import structs

from vcfbench.archive.recorded import load_run
from vcfbench.archive.verified import verify_run
from vcfbench.errors import BenchError, ConfigError, MeasurementError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.stated import values_of
from vcfbench.runs.conduct import run
from vcfbench.runs.resumed import resume
from vcfbench.safety.control import RunControl
from vcfbench.steps.events import StepFinished
from vcfbench.studies.truth import truth_of
from vcfbench.testing.benches import serve_simulated
from vcfbench.testing.gyroscopes import drawn_bench
from vcfbench.validation.check import Check, Found, check, same

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.archive.run import Run
    from vcfbench.station.description import BenchDescription
    from vcfbench.steps.events import Event
    from vcfbench.testing.benches import ServedLab

RUNS: Final = 100
_SEED: Final = 20_180_000
_VALUES: Final = {
    "virtual-coriolis": ("k_vc", "turntable.scale_factor", "turntable.bias", "virtual.scale_factor", "virtual.bias"),
    "kvc": ("k_vc", "scale_factor", "bias"),
    "self-calibration": ("scale_factor", "bias"),
}
_CHANCE: Final = 1e-4
"""Probability that a sound program has too many, or too few, of one value."""
_NARROW: Final = 2.8, 3.5
"""By how many standard deviations errors over u may scatter less or more than 1: 0.80 to 1.25 of 100."""
_SHORT: Final = {"rates_deg_s": [100, 50, 0, -50, -100], "samples": 4, "warm_up_s": 0.0}
"""A sweep of a minute and a half of bench time."""
_FAULTS: Final = (
    ("a contact of the output jumps by half a volt", {"instrument": "multimeter", "kind": "offset", "offset": 0.5}),
    ("the multimeter's connection breaks", {"instrument": "multimeter", "kind": "unreachable"}),
    ("the multimeter is overloaded", {"instrument": "multimeter", "kind": "overload"}),
    ("the table jams", {"instrument": "rate_table", "kind": "jam"}),
    ("the supply limits the current", {"instrument": "power", "kind": "current_limit"}),
)
_FLIPS: Final = 40
"""Single bits that are turned."""
_AT_S: Final = 30.0
"""Bench time at which a fault begins: the table turns, rails and drive are on."""


class Calibrations:
    """Calibrations of gyroscopes drawn by seed, with instruments drawn from their data sheets.

    By the four steps, of K_Vc as a certificate, and without a table by that; K_Vc does not age between the two.
    """

    def __init__(self, runs: int) -> None:
        self._runs = runs
        self.kept: list[dict[str, Any]] = []

    def rows(self) -> list[dict[str, Any]]:
        """Return errors over u, and True for each U95 that holds the truth; measured on first use."""
        for seed in range(_SEED + len(self.kept), _SEED + self._runs):
            bench = parse_bench(drawn_bench(seed), f"gyroscope-{seed}")
            unaged = structs.replace(
                bench.uncertainty, k_vc_drift_ppm_per_year=0.0, k_vc_on_the_way_ppm=0.0, k_vc_not_measured_ppm=0.0
            )
            bench = structs.replace(bench, uncertainty=unaged)
            with TemporaryDirectory(prefix="validation-") as folder:
                own = {"health": False, "cycles": 1, "dut": "validated", "devices": f"{folder}/devices"}
                row: dict[str, Any] = {}
                for procedure, names in _VALUES.items():
                    asked = {"warm_up_s": 1800.0, **(own if procedure != "virtual-coriolis" else {})}
                    found = run(procedure, bench, seed=seed, runs=folder, settings=asked)
                    row |= _held(found, bench, names, f"{procedure}: ")
            self.kept.append(row)
        return self.kept

    def covered(self, value: str) -> Found:
        """Compare how often U95 of a value held the truth, and how errors over u scatter, with what they should."""
        from scipy.stats import binom  # noqa: PLC0415  # SciPy takes longer to import than all else

        rows = self.rows()
        low, high = map(int, binom.interval(1.0 - 2.0 * _CHANCE, self._runs, 0.95))
        z = [row[f"{value}.z"] for row in rows]
        covered, mean, width = sum(row[f"{value}.covered"] for row in rows), fmean(z), stdev(z)
        off, one = 4.0 / math.sqrt(self._runs), 1.0 / math.sqrt(2.0 * self._runs)  # the latter a standard deviation
        least, most = 1.0 - _NARROW[0] * one, 1.0 + _NARROW[1] * one
        scatter = f"mean 0 +- {off:.2f}, s {least:.2f} to {most:.2f}"
        return Found(
            f"{low} to {high} of {self._runs} within U95; errors over u: {scatter}",
            f"{covered} of {self._runs} within U95; errors over u: mean {mean:+.2f}, s {width:.2f}",
            passed=low <= covered <= high and abs(mean) <= off and least <= width <= most,
        )


def _held(found: Run, bench: BenchDescription, names: Sequence[str], before: str) -> dict[str, Any]:
    """Return errors over u, and True for each U95 that holds the truth, of the values called `names`."""
    true, stated, row = truth_of(found, bench), values_of(found.results), dict[str, Any]()
    for name in names:
        each = stated[name]
        if each.value is None or not each.u or each.u95 is None:
            raise MeasurementError(f"{before}{name} has no uncertainty")
        row[f"{before}{name}.z"] = (each.value - true[name]) / each.u
        row[f"{before}{name}.covered"] = abs(each.value - true[name]) <= each.u95
    return row


def _state(lab: ServedLab) -> str:
    """Return the true state of the bench."""
    names = ("applied_rate_deg_s", "node.v_vc", "rail.positive.voltage_v", "rail.negative.voltage_v")
    rate, v_vc, positive, negative = (abs(float(lab.ask("get", name=name))) for name in names)
    live = [
        *([f"the table turns at {rate:.3g} deg/s"] if rate > 0.05 else []),
        *([f"V_Vc is {v_vc:.3g} V"] if v_vc > 0.01 else []),
        *(["the rails are on"] if max(positive, negative) > 0.5 else []),
    ]
    return ", ".join(live) or "at rest and off"


@check("faults", "Is a number given that cannot be true, or the bench left on?", "docs/safety.md")
def _faults() -> Found:
    came, wrong = [], []
    with serve_simulated("paper", seed=_SEED) as lab:
        for words, fault in _FAULTS:
            lab.reset(_SEED)
            lab.fault(**fault, at_s=_AT_S)
            try:
                run("turntable", lab.on_wires(), runs=None, settings=_SHORT)
                ended = "results were given"
            except BenchError as error:
                ended = type(error).__name__
            came.append(f"{words}: {ended}, {_state(lab)}")
            if ended == "results were given" or _state(lab) != "at rest and off":
                wrong.append(words)
    return Found("no result, and the bench at rest and off, after each", "; ".join(came), passed=not wrong)


@check("wires", "Does the bench give the same over TCP as in this process?", "the run in this process")
def _wires() -> Found:
    with serve_simulated("paper", seed=_SEED) as lab:
        over = run("turntable", lab.on_wires(), runs=None, settings=_SHORT)
        left = _state(lab)
    inside = run("turntable", "paper", seed=_SEED, runs=None, settings=_SHORT)
    outputs = [[f"{point.output_v:.7f}" for point in each.points] for each in (inside, over)]
    return same(f"{', '.join(outputs[0])} V; at rest and off", f"{', '.join(outputs[1])} V; {left}")


@check("limits", "Is a rate above the limit refused before anything moves?", "docs/safety.md")
def _limits() -> Found:
    above = {**_SHORT, "rates_deg_s": [100, 0, -5000]}
    with serve_simulated("paper", seed=_SEED) as lab:
        try:
            run("turntable", lab.on_wires(), runs=None, settings=above)
            ended = "it was measured"
        except ConfigError as error:
            ended = f"refused ({error.what})"
        return Found("refused, at rest and off", f"{ended}, {_state(lab)}", passed=ended.startswith("refused"))


class _StopsAfter:
    """Observer that stops a run after some points."""

    def __init__(self, points: int, control: RunControl) -> None:
        self._left, self._control = points, control

    def handle(self, event: Event) -> None:
        """Count the points."""
        if isinstance(event, StepFinished) and event.result.recorded_point is not None:
            self._left -= 1
            if self._left == 0:
                self._control.stop()


@check("resumption", "Is a run that was broken off kept, and gone on with?", "docs/records.md")
def _resumption() -> Found:
    with TemporaryDirectory(prefix="validation-") as folder:
        control = RunControl()
        try:
            stopping = [_StopsAfter(3, control)]
            run("turntable", seed=_SEED, runs=folder, settings=_SHORT, control=control, observers=stopping)
        except BenchError:
            pass
        broken = load_run("last", folder)
        whole = resume("last", runs=folder)
        kept = [point.output_v for point in broken.points] == [point.output_v for point in whole.points[:3]]
    return same(
        "3 points kept, 5 at the end, complete",
        f"{len(broken.points) if kept else 0} points kept, {len(whole.points)} at the end, {whole.status.value}",
    )


@check("seals", "Is a record that was changed by one bit recognised?", "docs/records.md")
def _seals() -> Found:
    with TemporaryDirectory(prefix="validation-") as folder:
        record = run("turntable", seed=_SEED, runs=folder, settings=_SHORT).directory
        assert record is not None  # noqa: S101  # it was asked to record
        sound = verify_run(record).verdict
        files = [record / name for name in ("journal.jsonl", "points.csv", "result.json")]
        draw, unseen = random.Random(_SEED), 0  # noqa: S311  # no secret
        for _ in range(_FLIPS):
            file = draw.choice(files)
            data = bytearray(file.read_bytes())
            place = draw.randrange(len(data))
            whole = bytes(data)
            data[place] ^= 1 << draw.randrange(8)
            file.write_bytes(data)
            unseen += verify_run(record).verdict != "FAIL"
            file.write_bytes(whole)
        cut = Path(folder) / "cut"
        shutil.copytree(record, cut)
        lines = (cut / "journal.jsonl").read_bytes().splitlines(keepends=True)
        (cut / "journal.jsonl").write_bytes(b"".join(lines[:-1]))
        truncated = verify_run(cut).verdict
    return same(
        f"as it was PASS, of {_FLIPS} single bits turned 0 unseen, without its last line FAIL",
        f"as it was {sound}, of {_FLIPS} single bits turned {unseen} unseen, without its last line {truncated}",
    )


def checks(runs: int = RUNS) -> tuple[Check, ...]:
    """Return the checks on simulated benches in their order; `runs` calibrations are held against the truth."""
    calibrations = Calibrations(runs)
    source = "closed form of the simulated gyroscope (docs/theory.md), which neither instruments nor analysis use"
    return (
        *(
            Check(
                f"U95 of {procedure}: {name.replace('_', ' ').replace('.', ', ')}",
                f"Does it hold the truth in 95 % of {runs} calibrations of drawn gyroscopes on drawn benches?",
                source,
                partial(calibrations.covered, f"{procedure}: {name}"),
            )
            for procedure, names in _VALUES.items()
            for name in names
        ),
        *(_faults, _limits, _wires, _resumption, _seals),
    )
