"""Holds the budget of each value of a run against the rows of the table of parts."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import structs

from tests.procedures.parts.simulated import Bench, Change, values_of
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import recorded_settings
from vcfbench.steps.measured import Measured
from vcfbench.uncertainty.statement import StatedContribution
from vcfbench.values.value import Measurand

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    Floats = np.ndarray[Any, np.dtype[np.float64]]
    Moves = Callable[["Run"], Mapping[str, float]]

SCATTER_V, V_VC_SCATTER_V = 2e-5, 2e-6
"""Standard deviation that the readings of each window are said to have, V, of the output and of V_Vc."""


class Part(NamedTuple):
    """A row of the table: what a part of the budget of some values must be."""

    source: str
    """As the budget names it, up to a colon."""
    values: str
    """Names of the values that have it, or their beginnings before a ``*``."""
    u: float
    """Standard uncertainty of the source, in its own unit."""
    by: Change | tuple[Change, ...] | Moves | None
    """What is changed in the simulation, for the sensitivity (of several alike sources each); or what gives u of each
    value for a `u` of 1; None: its size is held elsewhere."""
    why: str
    owner: str = ""
    """Role of the instrument whose error it is, where other results may share it, or the end of its name."""
    dof: float | None = None
    rectangle: bool = False
    """Whether any value within a limit is as likely."""
    conditions: str = ""
    """Values that are moved too, but are stated for the condition of the run."""

    def has(self, value: str) -> bool:
        """Tell whether the value has this part."""
        return _among(value, self.values)

    def moves(self, run: Run) -> Mapping[str, float]:
        """Return the sensitivity of each value, or its u, with a sign where one change makes it."""
        if isinstance(self.by, Change):
            return run.slopes(self.by)
        if isinstance(self.by, tuple):
            every = [run.slopes(each) for each in self.by]
            return {name: math.hypot(*(each[name] for each in every)) for name in run.values}
        return {} if self.by is None else self.by(run)

    def free_of(self, value: str) -> bool:
        """Tell whether the value is stated for the condition of the run."""
        return _among(value, self.conditions)


def _among(value: str, names: str) -> bool:
    return any(value == each or (each.endswith("*") and value.startswith(each[:-1])) for each in names.split())


class _Taken(NamedTuple):
    points: list[Any]
    lines: list[Any]
    settings: Any
    windows_s: Floats
    """(n, 2): when the first and the last reading of each point's window were asked for, s."""


class Run:
    """A run without noise, its points said to scatter, and the values of the same run on a changed bench."""

    def __init__(self, bench: Bench, procedure: str, told: Mapping[str, Any]) -> None:
        self.scale_factor = bench.scale_factor
        self._bench, self._procedure, self._told = bench, PROCEDURES[procedure], told
        self._slopes: dict[int, dict[str, float]] = {}
        taken = self._taken(Change(1.0))
        self.settings, self.lines, self.windows_s = taken.settings, taken.lines, taken.windows_s
        self.points = [_scattering(each) for each in taken.points]
        self.measured = Measured(self.points, lambda: self.lines)
        self.results = self._procedure.results(self.settings, self.measured)
        self.report = self._procedure.report(self.settings, self.measured, self.results)
        self.values = dict(values_of(self.results))

    def _taken(self, change: Change) -> _Taken:
        with self._bench.taken(self._procedure.name, self._told, change) as run:
            measured = run.measured
            lines = list(measured._lines())
            of_points = {line["n"] for line in lines if "point" in line}
            windows = [each.t_s[[0, -1]] for each in measured.readings.windows if each.number in of_points]
            settings = recorded_settings(self._procedure, run.header["settings"])
            return _Taken(list(run.points), lines, settings, np.array(windows))

    def slopes(self, change: Change) -> dict[str, float]:
        """Return by how much a unit of what is changed in the simulation moves each value."""
        if (known := self._slopes.get(id(change))) is not None:
            return known
        taken = self._taken(change)
        moved = self._procedure.results(taken.settings, Measured(taken.points, lambda: taken.lines))
        found = dict(values_of(moved))
        by = {
            name: (found[name].value - each.value) / change.step for name, each in self.values.items() if name in found
        }
        self._slopes[id(change)] = by
        return by

    @cached_property
    def by_output(self) -> dict[str, Floats]:
        """What a volt more in each window's output adds to each value."""
        return self._by_windows("output_v")

    @cached_property
    def by_v_vc(self) -> dict[str, Floats]:
        """What a volt more in each window's V_Vc adds to each value."""
        return self._by_windows("v_vc_measured_v")

    def _by_windows(self, key: str) -> dict[str, Floats]:
        rows, step_v = [], 1e-6
        for place, point in enumerate(self.points):
            before, points = getattr(point, key), [*self.points]
            if before is None:
                rows.append(dict.fromkeys(self.values, 0.0))
                continue
            points[place] = structs.replace(point, **{key: before + step_v})
            moved = dict(values_of(self._procedure.results(self.settings, Measured(points, lambda: self.lines))))
            rows.append({name: (moved[name].value - each.value) / step_v for name, each in self.values.items()})
        return {name: np.array([row[name] for row in rows]) for name in self.values}


def _scattering(point: Any) -> Any:
    v_vc_std_v = None if point.v_vc_std_v is None else V_VC_SCATTER_V
    return structs.replace(point, std_v=SCATTER_V, v_vc_std_v=v_vc_std_v)


def readings(*steps: int) -> Moves:
    """Return what gives u of each value by the scatter of some steps' readings: what each window adds, squared."""

    def of(run: Run) -> dict[str, float]:
        u_v = np.array([SCATTER_V / math.sqrt(each.n) * (not steps or each.step in steps) for each in run.points])
        return {name: float(np.linalg.norm(by * u_v)) for name, by in run.by_output.items()}

    return of


def readings_of_v_vc(run: Run) -> dict[str, float]:
    """Return the same by the scatter of V_Vc."""
    n = np.array([each.n for each in run.points])
    return {name: V_VC_SCATTER_V * float(np.linalg.norm(by / np.sqrt(n))) for name, by in run.by_v_vc.items()}


def flicker(run: Run) -> dict[str, float]:
    """Return u of each value by a flicker of 1 deg/h: (B^2 / pi) / f, one-sided, by what windows add.

    What does not add up to 0 is compared with the mean of a day about the run. The covariance of two means is that of
    -(B^2 / pi) ln|t - s|, whose second integral is in closed form.
    """
    windows = run.windows_s + np.array([0.0, run.settings.sample_interval_s])
    middle, half = 0.5 * (windows[0, 0] + windows[-1, 1]), 1800.0 * run.settings.station.sources.horizon_h
    begin, end = np.append(windows[:, 0], middle - half), np.append(windows[:, 1], middle + half)

    def twice(x: Floats) -> Floats:
        return 0.5 * x**2 * np.log(np.where(x == 0.0, 1.0, np.abs(x))) - 0.75 * x**2

    outer = np.subtract.outer
    area = twice(outer(end, begin)) - twice(outer(begin, begin)) - twice(outer(end, end)) + twice(outer(begin, end))
    covariance = -area / np.outer(end - begin, end - begin) / math.pi
    found = {}
    for name, by in run.by_output.items():
        weights = np.append(by, -by.sum())
        found[name] = abs(run.scale_factor) / 3600.0 * math.sqrt(max(0.0, float(weights @ covariance @ weights)))
    return found


def parts_of(value: Measurand) -> Iterator[tuple[str, float, float | None, str | None, bool]]:
    """Yield the parts of a budget: source, u with the sign of its sensitivity, degrees of freedom, owner, rectangle."""
    for each in value.parts:
        u = each.sensitivity * each.u_source if isinstance(each, StatedContribution) else each.u
        yield each.source, u, each.dof, each.of, each.rectangular


def grouped(value: Measurand) -> dict[str, float]:
    """Return u of a budget by source up to a colon; what is correlated within a source counts as its shares do."""
    found: dict[str, float] = {}
    for part in value.parts:
        share = part.share if isinstance(part, StatedContribution) else (part.u / value.u) ** 2
        found[_cause(part.source)] = found.get(_cause(part.source), 0.0) + share
    return {name: value.u * math.sqrt(max(0.0, share)) for name, share in found.items()}


def _cause(source: str) -> str:
    return (
        source.partition(": ")[0]
        if source.startswith(("readings: ", "flicker: ", "V_Vc meter readings: ", "generator resolution: "))
        else source
    )
