"""Comparison of runs: differences of their results, points, settings and equipment."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from itertools import chain, groupby
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.archive.change import Coefficients, Compared, Difference, Pair
from vcfbench.archive.output_unit import unit_of_record
from vcfbench.archive.run import Run
from vcfbench.errors import ConfigError
from vcfbench.records.plain import plain
from vcfbench.records.schema import Point, Status
from vcfbench.reports.document import Axis, Column, Figure, Heading, Notice, Part, Report, Series, Table, Text, texts
from vcfbench.values.kinds import named
from vcfbench.values.printing import grouped


class SharedResult(Struct, frozen=True):
    """One common result of all runs: its value in each, and the differences of the others to the first."""

    name: str
    unit: str
    values: tuple[float, ...]
    u: tuple[float | None, ...]
    differences: tuple[Difference, ...]
    missing: tuple[tuple[str, ...], ...] = ()  # Contributions missing from each `u`
    words: str = ""


class RunComparison(Struct, frozen=True):
    """Comparison of two runs or more; the first is the reference.

    `results` are those that all runs have in the same unit, by name. `points` are the points of each where they can be
    paired, else empty. `settings` (of those that all have) and `equipment` are what is not the same in all, by name,
    as printed. `instruments` are those that runs have in common with the first: their errors cancel.

    >>> [shared.name for shared in vcfbench.compare_runs(run, run).results]
    ['scale_factor', 'bias', 'bias_deg_s', 'asymmetry', 'nonlinearity']
    """

    runs: tuple[Run, ...]
    results: tuple[SharedResult, ...]
    points: tuple[tuple[Point, ...], ...]
    settings: Mapping[str, tuple[str, ...]]
    equipment: Mapping[str, tuple[str, ...]]
    instruments: tuple[str, ...]
    of_others: tuple[str, ...] = ()
    """Results of one name that cannot be compared, each with the reason: another measurand, or other conditions."""

    def as_json(self) -> dict[str, Any]:
        """Return the answer of ``vcfbench compare --json``."""
        return {
            "runs": [_name(run) for run in self.runs],
            "results": plain(self.results),
            "points": [[point.as_json() for point in points] for points in self.points],
            "settings": {name: list(each) for name, each in self.settings.items()},
            "equipment": {name: list(each) for name, each in self.equipment.items()},
            "shared_instruments": list(self.instruments),
            "of_other_measurands": list(self.of_others),
        }

    def _copies(self, letters: Sequence[str]) -> Iterator[str]:
        """Yield the letters of runs that are copies of one, whatever their directories are called."""
        alike = defaultdict[str, list[str]](list)
        for letter, run in zip(letters, self.runs, strict=True):
            alike[run.header.get("run", "")].append(letter)
        return (" and ".join(own) for name, own in alike.items() if name and len(own) > 1)

    def report(self) -> Report:
        """Return tables of common and different values, and the figures of all runs laid over each other."""
        letters = [chr(ord("A") + place) for place in range(len(self.runs))]
        simulated = [_name(run) for run in self.runs if run.simulated]
        of_all = "all" if len(simulated) == len(self.runs) else ", ".join(simulated)
        rows = []
        few = "its points are not all"
        unfinished = [each for each in zip(letters, self.runs, strict=True) if each[1].status is not Status.COMPLETE]
        for letter, run in zip(letters, self.runs, strict=True):
            seed = None if run.seed is None else str(run.seed)
            verdict = None if run.verdict is None else run.verdict.word.upper()
            rows.append((letter, _name(run), run.procedure, run.metadata.dut, run.bench, seed, verdict))
        return Report(
            [
                Heading("Comparison of runs"),
                *([Notice(f"SIMULATED: {of_all}. Not measured.")] if simulated else []),
                *(Notice(f"{copies} are one record, which agrees with itself.") for copies in self._copies(letters)),
                *(Notice(f"{of} is {run.status}, not complete: {run.error or few}.") for of, run in unfinished),
                Table(texts("", "run", "procedure", "device", "bench", "seed", "verdict"), rows),
                *_results_part(self, letters),
                *_points_part(self, letters),
                *_differing("Settings that differ", self.settings, letters),
                *_differing("Equipment and conditions that differ", self.equipment, letters),
                *_figures_part(self.runs, letters),
                *_explained(self, letters),
            ]
        )


def compare_runs(*runs: Run, devices: str | Path = "devices") -> RunComparison:
    """Compare runs, of one procedure or of several, with the first of them: ``compare_runs(before, after)``.

    What is known in `devices` of their device corrects for another temperature, or other rails.

    Raises:
        ConfigError: there are fewer than two, more than 26, something else than runs is among them, or they share
            neither results nor points.

    >>> compared = vcfbench.compare_runs(vcfbench.load_run("last"), run)
    >>> compared.instruments
    ('34401A at GPIB0::22::INSTR of paper, seed 3', 'acl at sim://paper of paper, seed 3')
    """
    for each in runs:
        if not hasattr(each, "results"):
            kind = type(each).__name__
            raise ConfigError(f"expected runs one after the other, as in compare_runs(before, after), got a {kind}")
    require_comparable(len(runs))
    seen = [Compared(run) for run in runs]
    of_each = [{name: each for name, each in run.values.items() if each.value is not None} for run in runs]
    known = cache(partial(Coefficients.kept, runs, devices))
    results, others, cancelled = [], [], list[str]()
    for name, first in of_each[0].items():
        found = [each[name] for each in of_each if name in each]
        if len(found) < len(runs):
            continue
        if len(units := dict.fromkeys(each.named.unit for each in found)) > 1:  # V is not deg/s
            others.append(f"{first.named.words}: in {', '.join(units)}")
            continue
        pairs = zip(found[1:], seen[1:], strict=True)
        unlike = tuple(Pair(seen[0], run, known, seen).change(first, value) for value, run in pairs)
        if reasons := dict.fromkeys(each.reason for each in unlike if each.reason):
            others.append(f"{first.named.words}: {'; '.join(reasons)}")
        if all(each.reason for each in unlike):
            continue
        cancelled += [owner for each in unlike for owner in each.cancelled]
        numbers, u = tuple(each.value or 0.0 for each in found), tuple(each.u for each in found)
        missing = tuple(tuple(each.missing) for each in found)
        results.append(SharedResult(name, first.unit, numbers, u, unlike, missing, first.named.words))
    one_unit = len({unit_of_record(run.header) for run in runs}) == 1
    points = tuple(run.points for run in runs) if one_unit and _alike(*(run.points for run in runs)) else ()
    if not results and not points and not others:
        has = []
        for run, values in zip(runs, of_each, strict=True):
            few = f"{', '.join([*values][:5])}{', ...' if len(values) > 5 else ''}" if values else "no results"
            has.append(f"{_name(run)} ({run.procedure}) has {few}")
        raise ConfigError(f"the runs have no common results and no common points: {'; '.join(has)}")
    settings = [dict(_flat(run.header.get("settings", {}))) for run in runs]
    keys = [key for key in settings[0] if not key.startswith("station.") and key != "dut"]  # the device is equipment
    alike = [key for key in keys if all(key in each for each in settings)]
    return RunComparison(
        runs,
        tuple(results),
        points,
        _unlike([{key: each[key] for key in alike} for each in settings]),
        _unlike([_circumstances(run) for run in runs]),
        tuple(dict.fromkeys(cancelled)),
        tuple(others),
    )


def require_comparable(count: int) -> None:
    """Refuse more runs than there are letters for, and fewer than two."""
    if not 2 <= count <= 26:
        raise ConfigError(f"expected 2 to 26 runs to compare, got {count}")


def _name(run: Run) -> str:
    return run.name or run.procedure


def _alike(first: Sequence[Point], *others: Sequence[Point]) -> bool:
    """Return True if step by step all have as many points, at nearly the same rates: that of a V_Vc goes by K_Vc."""
    for points in others:
        pairs = list(zip(first, points, strict=False))
        if [p.step for p in points] != [p.step for p in first] or not all(
            math.isclose(one.rate_deg_s, other.rate_deg_s, rel_tol=0.05, abs_tol=0.05) for one, other in pairs
        ):
            return False
    return bool(first)


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _flat(each, f"{name}.{key}" if name else key)
    else:
        yield name, "-" if value is None else str(value)


def _unlike(of_each: Sequence[Mapping[str, str]]) -> dict[str, tuple[str, ...]]:
    names = dict.fromkeys(name for values in of_each for name in values)
    rows = {name: tuple(values.get(name, "-") for values in of_each) for name in names}
    return {name: row for name, row in rows.items() if len(set(row)) > 1}


def _circumstances(run: Run) -> dict[str, str]:
    """Return the equipment and the conditions of a run, as printed."""
    metadata = run.metadata.as_json()
    found = dict(_flat({key: value for key, value in metadata.items() if key != "note"}))
    found |= {"bench": str(run.bench), "simulated": "yes" if run.simulated else "no", "seed": str(run.seed)}
    for each in run.equipment:
        found[each.role] = f"{each.model}, {each.serial_number or each.inventory_number or 'no serial number'}"
        found[f"{each.role}, calibrated"] = str(each.calibrated or "-")
    return found | {f"version of {name}": str(version) for name, version in run.header.get("versions", {}).items()}


def _results_part(comparison: RunComparison, letters: Sequence[str]) -> Iterator[Part]:
    known = [each for each in comparison.results if any(u is not None for u in each.u)]
    if known:
        yield Heading("Shared results", 2)
        columns = texts("result", "unit")
        for letter in letters:
            columns += [Column(letter, format=".7g"), Column(f"u({letter})", format=".2g")]
        for letter in letters[1:]:
            columns += [Column(f"{letter} - A", format="+.3g"), Column("u", format=".2g"), Column("E_n", format=".2f")]
        rows = []
        for each in known:
            pairs = zip(each.values, each.u, strict=True)
            unlike = ((d.value, d.u, d.e_n) for d in each.differences)
            rows.append((*_named(each), *chain.from_iterable(pairs), *chain.from_iterable(unlike)))
        yield Table(columns, rows)
    for each in comparison.results:
        if any(each.missing):
            lacks = zip(letters, each.missing, strict=True)
            said = (f"{letter} without {', '.join(missing)}" for letter, missing in lacks if missing)
            yield Text(f"INCOMPLETE: u of {_named(each)[0]}: {'; '.join(said)}")
    if known:
        yield Text(
            "E_n is the difference over its expanded uncertainty (95 %); above 1 the runs disagree. "
            f"{_said_of_instruments(comparison)}"
        )
        notes = [(_named(each)[0], d.note) for each in known for d in each.differences if d.note]
        yield from (Text(f"{words}: {note}") for words, note in dict.fromkeys(notes))
    if comparison.of_others:
        yield Text("\n  ".join(["Not compared:", *comparison.of_others]))
    names = {_named(each) for each in known}
    unknown = [each for each in comparison.results if each not in known and _named(each) not in names]
    if unknown:
        yield Heading("Shared results without uncertainty", 2)
        columns = texts("result", "unit")
        columns += [Column(letter, format=".7g") for letter in letters]
        columns += [Column(f"{letter} - A", format="+.3g") for letter in letters[1:]]
        yield Table(columns, [(*_named(e), *e.values, *(d.value for d in e.differences)) for e in unknown])


def _said_of_instruments(comparison: RunComparison) -> str:
    if not comparison.instruments:
        return "No instrument that reaches them is known to be in several runs: their uncertainties are independent."
    return f"Errors of instruments that both runs have cancel: {', '.join(comparison.instruments)}."


def _named(shared: SharedResult) -> tuple[str, str]:
    """Return the words of a result, and the unit of its values."""
    of = named(shared.name, shared.unit)
    return shared.words or of.words, shared.unit or of.unit


def _explained(comparison: RunComparison, letters: Sequence[str]) -> Iterator[Text]:
    """Yield for each scale factor the explained part of its change, and the rest."""
    for each in (one for one in comparison.results if one.unit.endswith("/(deg/s)") and one.values[0]):
        ppm, words = 1e6 / each.values[0], _named(each)[0]
        for letter, value, d in zip(letters[1:], each.values[1:], each.differences, strict=True):
            if d.value is not None and d.u95 is not None and d.e_n is not None:
                parts = [f"{round(ppm * part):+d} ppm by {why}" for why, part in d.explained]
                left = f"{round(ppm * d.value):+d}±{grouped(abs(ppm) * d.u95)} ppm"
                if parts:
                    changed = f"changed by {round(ppm * (value - each.values[0])):+d} ppm"
                    left = "; ".join([changed, *parts, f"left are {left}"])
                else:
                    left = f"changed by {left}"
                seen = "more than its U95" if d.e_n > 1.0 else "within its U95"
                yield Text(f"{words}, A to {letter}: {left}, {seen}.")


def _points_part(comparison: RunComparison, letters: Sequence[str]) -> Iterator[Part]:
    if not comparison.points:
        return
    first, *others = comparison.points
    yield Heading("Points", 2)
    unit = unit_of_record(comparison.runs[0].header)
    factor, small, digits = (1e3, "mV", ".3f") if unit == "V" else (1.0, unit, ".5f")
    columns = [Column("step"), Column("rate", "deg/s", ".6g"), Column("output A", unit, ".5f")]
    for letter in letters[1:]:
        columns += [Column(f"{letter} - A", small, f"+{digits}"), Column("u of readings", small, digits)]
    rows = []
    for place, point in enumerate(first):
        unlike = [_of_points(point, points[place], factor) for points in others]
        rows.append((point.step, point.rate_deg_s, point.output_v, *(value for each in unlike for value in each)))
    yield Table(columns, rows)
    series = []
    for letter, points in zip(letters[1:], others, strict=True):
        for step, pairs in groupby(zip(first, points, strict=True), key=lambda pair: pair[0].step):
            of_step = [(a.rate_deg_s, *_of_points(a, b, factor)) for a, b in pairs]
            rates, values, u = zip(*of_step, strict=True)
            series.append(Series(f"{letter} - A, step {step}", rates, values, u))
    yield Figure("Differences of the points", Axis("rate", "deg/s"), Axis("output", small), series)


def _of_points(one: Point, other: Point, factor: float) -> tuple[float, float]:
    """Return `factor` times the difference of two points and its u from the scatter of the readings alone."""
    u = math.hypot(one.std_v / math.sqrt(max(one.n, 1)), other.std_v / math.sqrt(max(other.n, 1)))
    return factor * (other.output_v - one.output_v), factor * u


def _differing(title: str, rows: Mapping[str, tuple[str, ...]], letters: Sequence[str]) -> Iterator[Part]:
    if rows:
        yield Heading(title, 2)
        yield Table(texts("", *letters), [(name, *values) for name, values in rows.items()])


def _figures_part(runs: Sequence[Run], letters: Sequence[str]) -> Iterator[Part]:
    """Lay those figures of the reports over each other that have the same title and axes in all runs."""
    of_each = [
        {(part.title, part.x, part.y): part for part in run.report().parts if isinstance(part, Figure)} for run in runs
    ]
    shared = [key for key in of_each[0] if all(key in figures for figures in of_each)]
    if shared:
        yield Heading("Figures of all runs", 2)
    for key in shared:
        figures = zip(letters, (figures[key] for figures in of_each), strict=True)
        series = [replace(one, label=f"{letter}: {one.label}") for letter, figure in figures for one in figure.series]
        yield Figure(*key, series, of_each[0][key].caption)
