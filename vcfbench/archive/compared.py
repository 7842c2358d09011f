"""Runs beside each other: differences of their results, points, settings and equipment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

from vcfbench.archive.quantities import values_of
from vcfbench.errors import ConfigError
from vcfbench.records.plain import plain
from vcfbench.reports.document import Axis, Column, Figure, Heading, Notice, Report, Series, Table, Text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from vcfbench.archive.quantities import ResultValue
    from vcfbench.archive.run import Run
    from vcfbench.records.schema import Point
    from vcfbench.reports.document import Part


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of one run's value from that of the first: `u` and `e_n` None where an uncertainty is not known.

    `e_n` is its size over its expanded uncertainty (95 %), both runs' taken as independent; above 1 they disagree.
    """

    value: float
    u: float | None
    e_n: float | None


@dataclass(frozen=True, slots=True)
class SharedResult:
    """One result that all runs have: its value in each, and the differences of the others to the first."""

    name: str
    unit: str
    values: tuple[float, ...]
    u: tuple[float | None, ...]
    differences: tuple[Difference, ...]
    missing: tuple[tuple[str, ...], ...] = ()
    """Contributions missing from each `u`."""


@dataclass(frozen=True, slots=True)
class RunComparison:
    """Two runs or more beside each other; the first is the reference of the others.

    `results` are those that all runs have in the same unit, by name. `points` are the points of each where they can be
    paired, else empty. `settings` (of those that all have) and `equipment` are what is not the same in all, by name,
    as printed. `instruments` says which instruments all runs were made with.
    """

    runs: tuple[Run, ...]
    results: tuple[SharedResult, ...]
    points: tuple[tuple[Point, ...], ...]
    settings: Mapping[str, tuple[str, ...]]
    equipment: Mapping[str, tuple[str, ...]]
    instruments: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the answer of ``vcfbench compare --json``."""
        return {
            "runs": [_name(run) for run in self.runs],
            "results": plain(self.results),
            "points": [[point.as_json() for point in points] for points in self.points],
            "settings": {name: list(each) for name, each in self.settings.items()},
            "equipment": {name: list(each) for name, each in self.equipment.items()},
            "shared_instruments": list(self.instruments),
        }

    def report(self) -> Report:
        """Return tables of common and different values, and the figures of all runs laid over each other."""
        letters = [chr(ord("A") + place) for place in range(len(self.runs))]
        return Report(
            [
                Heading("Comparison of runs"),
                *_notices(self.runs),
                _runs_table(self.runs, letters),
                *_results_part(self, letters),
                *_points_part(self, letters),
                *_differing("Settings that differ", self.settings, letters),
                *_differing("Equipment and conditions that differ", self.equipment, letters),
                *_figures_part(self.runs, letters),
            ]
        )


def compare_runs(*runs: Run) -> RunComparison:
    """Compare runs, of one procedure or of several, with the first of them: ``compare_runs(before, after)``.

    Raises:
        ConfigError: there are fewer than two, more than 26, something else than runs is among them, or they share
            neither results nor points.
    """
    for each in runs:
        if not hasattr(each, "results"):
            kind = type(each).__name__
            raise ConfigError(f"expected runs one after the other, as in compare_runs(before, after), came a {kind}")
    if not 2 <= len(runs) <= 26:
        raise ConfigError(f"expected 2 to 26 runs to compare, came {len(runs)}")
    of_each = [values_of(run) for run in runs]
    shared = [name for name in of_each[0] if _in_each(name, of_each)]
    results = tuple(_shared(name, [values[name] for values in of_each]) for name in shared)
    points = _paired(runs)
    if not results and not points:
        has = "; ".join(
            f"{_name(run)} ({run.procedure}) has {_few(values)}" for run, values in zip(runs, of_each, strict=True)
        )
        raise ConfigError(f"there is nothing to compare, the runs share neither results nor points: {has}")
    headers = [run.header for run in runs]
    settings = [dict(_flat(each.get("settings", {}))) for each in headers]
    keys = [key for key in settings[0] if not key.startswith("station.") and key != "dut"]  # the device is equipment
    alike = [key for key in keys if all(key in each for each in settings)]
    return RunComparison(
        runs,
        results,
        points,
        _unlike([{key: each[key] for key in alike} for each in settings]),
        _unlike([_circumstances(run, header) for run, header in zip(runs, headers, strict=True)]),
        _in_all(runs),
    )


def _name(run: Run) -> str:
    return run.name or run.procedure


def _in_each(name: str, of_each: Sequence[Mapping[str, ResultValue]]) -> bool:
    """Tell whether all runs have a result of that name in one unit: a bias in V is none in deg/s."""
    return all(name in values and values[name].unit == of_each[0][name].unit for values in of_each)


def _few(values: Mapping[str, ResultValue]) -> str:
    names = list(values)
    return f"{', '.join(names[:5])}{', ...' if len(names) > 5 else ''}" if names else "no results"


def _shared(name: str, values: Sequence[ResultValue]) -> SharedResult:
    first, *others = values
    return SharedResult(
        name,
        first.unit,
        tuple(each.value for each in values),
        tuple(each.u for each in values),
        tuple(_difference(first, each) for each in others),
        tuple(each.missing for each in values),
    )


def _difference(first: ResultValue, other: ResultValue) -> Difference:
    value = other.value - first.value
    if first.u is None or other.u is None or first.u95 is None or other.u95 is None:
        return Difference(value, None, None)
    u95 = math.hypot(first.u95, other.u95)
    return Difference(value, math.hypot(first.u, other.u), abs(value) / u95 if u95 > 0.0 else None)


def _paired(runs: Sequence[Run]) -> tuple[tuple[Point, ...], ...]:
    """Return the points of each run where step by step all have as many, at nearly the same rates; else nothing."""
    first, *others = (run.points for run in runs)
    for points in others:
        if [p.step for p in points] != [p.step for p in first] or not all(map(_same_rate, first, points)):
            return ()
    return tuple(run.points for run in runs) if first else ()


def _same_rate(one: Point, other: Point) -> bool:
    """Tell whether both stand for one rate; the rate of a V_Vc depends on the K_Vc that the run has found."""
    return math.isclose(one.rate_deg_s, other.rate_deg_s, rel_tol=0.05, abs_tol=0.05)


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


def _circumstances(run: Run, header: Mapping[str, Any]) -> dict[str, str]:
    """Return the equipment and the conditions of a run, as printed."""
    metadata = run.metadata.as_json()
    found = dict(_flat({key: value for key, value in metadata.items() if key != "note"}))
    found |= {"bench": str(run.bench), "simulated": "yes" if run.simulated else "no", "seed": str(run.seed)}
    for each in run.equipment:
        found[each.role] = f"{each.model}, {each.serial_number or each.inventory_number or 'no serial number'}"
        found[f"{each.role}, calibrated"] = str(each.calibrated or "-")
    return found | {f"version of {name}": str(version) for name, version in header.get("versions", {}).items()}


def _in_all(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the instruments that all runs were made with, as far as their serial numbers tell."""
    known = [
        {f"{e.role} {e.model} {number}" for e in run.equipment if (number := e.serial_number or e.inventory_number)}
        for run in runs
    ]
    return tuple(sorted(set.intersection(*known)))


def _notices(runs: Sequence[Run]) -> Iterator[Notice]:
    simulated = [_name(run) for run in runs if run.simulated]
    if simulated:
        yield Notice(f"SIMULATED: {'all' if len(simulated) == len(runs) else ', '.join(simulated)}. Not measured.")


def _runs_table(runs: Sequence[Run], letters: Sequence[str]) -> Table:
    columns = [Column(name, align="left") for name in ("", "run", "procedure", "device", "bench", "seed", "verdict")]
    rows = [
        (
            *(letter, _name(run), run.procedure, run.metadata.dut, run.bench),
            *(None if run.seed is None else str(run.seed), None if run.verdict is None else run.verdict.word.upper()),
        )
        for letter, run in zip(letters, runs, strict=True)
    ]
    return Table(columns, rows)


def _results_part(comparison: RunComparison, letters: Sequence[str]) -> Iterator[Part]:
    if not comparison.results:
        return
    known = [each for each in comparison.results if any(u is not None for u in each.u)]
    if known:
        yield Heading("Shared results", 2)
        yield _results_table(known, letters)
    for each in comparison.results:
        if any(each.missing):
            lacks = zip(letters, each.missing, strict=True)
            said = (f"{letter} without {', '.join(missing)}" for letter, missing in lacks if missing)
            yield Text(f"INCOMPLETE: u of {each.name}: {'; '.join(said)}")
    if known:
        yield Text(_independence(comparison))
    if len(known) < len(comparison.results):
        yield Heading("Shared results without uncertainty", 2)
        yield _values_table([each for each in comparison.results if each not in known], letters)


def _results_table(results: Sequence[SharedResult], letters: Sequence[str]) -> Table:
    columns = [Column("result", align="left"), Column("unit", align="left")]
    for letter in letters:
        columns += [Column(letter, format=".7g"), Column(f"u({letter})", format=".2g")]
    for letter in letters[1:]:
        columns += [Column(f"{letter} - A", format="+.3g"), Column("u", format=".2g"), Column("E_n", format=".2f")]
    rows = []
    for each in results:
        pairs = zip(each.values, each.u, strict=True)
        differences = ((d.value, d.u, d.e_n) for d in each.differences)
        rows.append((each.name, each.unit, *(v for pair in pairs for v in pair), *(v for d in differences for v in d)))
    return Table(columns, rows)


def _values_table(results: Sequence[SharedResult], letters: Sequence[str]) -> Table:
    columns = [Column("result", align="left"), Column("unit", align="left")]
    columns += [Column(letter, format=".7g") for letter in letters]
    columns += [Column(f"{letter} - A", format="+.3g") for letter in letters[1:]]
    rows: list[list[float | str]] = [
        [each.name, each.unit, *each.values, *(d.value for d in each.differences)] for each in results
    ]
    return Table(columns, rows)


def _independence(comparison: RunComparison) -> str:
    said = (
        "E_n is the difference over its expanded uncertainty (95 %); above 1 the runs disagree. Uncertainties of the "
        "runs are taken as independent."
    )
    if not comparison.instruments:
        return f"{said} No instrument is known to be in all runs: serial numbers tell of none."
    return (
        f"{said} They are not where runs share instruments: in all of them are {', '.join(comparison.instruments)}, "
        "whose errors cancel in part, so that u of the difference is too large there and E_n too small."
    )


def _points_part(comparison: RunComparison, letters: Sequence[str]) -> Iterator[Part]:
    if not comparison.points:
        return
    first, *others = comparison.points
    yield Heading("Points", 2)
    columns = [Column("step"), Column("rate", "deg/s", ".6g"), Column("output A", "V", ".5f")]
    for letter in letters[1:]:
        columns += [Column(f"{letter} - A", "mV", "+.3f"), Column("u of readings", "mV", ".3f")]
    rows = []
    for place, point in enumerate(first):
        unlike = [_of_points(point, points[place]) for points in others]
        rows.append((point.step, point.rate_deg_s, point.output_v, *(value for each in unlike for value in each)))
    yield Table(columns, rows)
    series = []
    for letter, points in zip(letters[1:], others, strict=True):
        for step, pairs in groupby(zip(first, points, strict=True), key=lambda pair: pair[0].step):
            of_step = [(a.rate_deg_s, *_of_points(a, b)) for a, b in pairs]
            rates, values, u = zip(*of_step, strict=True)
            series.append(Series(f"{letter} - A, step {step}", rates, values, u))
    yield Figure("Differences of the points", Axis("rate", "deg/s"), Axis("output", "mV"), series)


def _of_points(one: Point, other: Point) -> tuple[float, float]:
    """Return the difference of two points and its standard uncertainty from the scatter of the readings alone, mV."""
    u = math.hypot(one.std_v / math.sqrt(max(one.n, 1)), other.std_v / math.sqrt(max(other.n, 1)))
    return 1e3 * (other.output_v - one.output_v), 1e3 * u


def _differing(title: str, rows: Mapping[str, tuple[str, ...]], letters: Sequence[str]) -> Iterator[Part]:
    if rows:
        yield Heading(title, 2)
        columns = [Column(name, align="left") for name in ("", *letters)]
        yield Table(columns, [(name, *values) for name, values in rows.items()])


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
        series = [_called(f"{letter}: {each.label}", each) for letter, figure in figures for each in figure.series]
        yield Figure(*key, series, of_each[0][key].caption)


def _called(label: str, series: Series) -> Series:
    return Series(label, series.x, series.y, series.u_y, series.kind, series.low, series.high)
