"""Several devices of one run under each other: their values, their spread, and the causes that they share."""

import math
from collections.abc import Sequence
from itertools import combinations
from statistics import mean, stdev

from msgspec import Struct

from vcfbench.archive.change import Compared, covariance
from vcfbench.archive.run import Run
from vcfbench.archive.value_columns import ValueColumn, columns_of
from vcfbench.procedures.axes import AxesResult, matrix
from vcfbench.reports.document import Column, Part, Report, Table, Text, heads
from vcfbench.values.printing import shorthand
from vcfbench.values.sources import TEMPERATURE
from vcfbench.values.value import Value


class Spread(Struct, frozen=True):
    """Spread of one value over devices that were measured together.

    `mean` has the uncertainty `u_mean`, of which `u_common` is by the instruments `owners` that all share: it is in
    each value and in the mean, and cancels in differences. The temperature of the room is in full in `u_mean` too.
    `spread` is the standard deviation of the devices (n - 1), `u_own` the part of it by their measurement. `unit` is
    `factor` times that of the numbers.
    """

    unit: str
    factor: float
    devices: int
    mean: float
    u_mean: float
    u_common: float
    u_own: float
    spread: float
    owners: tuple[str, ...]

    def describe(self) -> str:
        """Say it in a few lines, in ppm of the mean."""
        ppm = 1e6 / abs(self.mean) if self.mean else math.nan
        mean = shorthand(self.factor * self.mean, abs(self.factor) * self.u_mean)
        said = [f"Scale factor of {self.devices} devices: mean {mean} {self.unit}."]
        own = f"their measurements alone would make it {ppm * self.u_own:.3g} ppm"
        said.append(f"Standard deviation of the devices {ppm * self.spread:.3g} ppm; {own}.")
        if self.owners:
            common = f"u {ppm * self.u_common:.3g} ppm of each value and of the mean, none of their differences"
            said.append(f"Common to all: {', '.join(self.owners)}: {common}.")
        return "\n".join(said)


def spreads_of(runs: Sequence[Run]) -> list[Spread]:
    """Return the spreads of the scale factors of devices that were measured together.

    There is one for each unit and definition that two devices or more have.
    """
    groups: list[list[tuple[Run, Value]]] = []
    for each in runs:
        if (value := _scale_factor(each)) is None:
            continue
        column = ValueColumn.of(value)
        group = next((one for one in groups if column.holds(one[0][1])), None)
        if group is None:
            groups.append(group := [])
        group.append((each, value))
    return [_spread(each) for each in groups if len(each) > 1]


def _spread(group: Sequence[tuple[Run, Value]]) -> Spread:
    found = [(Compared(run), value) for run, value in group]
    shared = [covariance(a, b, one, other) for (one, a), (other, b) in combinations(found, 2)]
    values = [value.value or 0.0 for _, value in found]
    variances = [(value.u or 0.0) ** 2 for _, value in found]
    common, n = mean(each for each, _ in shared), len(found)
    # one room makes devices of one design warmer alike: in full in the mean; in differences coefficients differ
    room = mean(math.fsum(part.u**2 for part in value.parts if part.source == TEMPERATURE) for _, value in found)
    named = found[0][1].named
    return Spread(
        unit=named.unit,
        factor=named.factor,
        devices=n,
        mean=mean(values),
        u_mean=math.sqrt((mean(variances) + (n - 1) * (common + room)) / n),
        u_common=math.sqrt(max(common, 0.0)),
        u_own=math.sqrt(max(mean(variances) - common, 0.0)),
        spread=stdev(values),
        owners=tuple(dict.fromkeys(owner for _, owners in shared for owner in owners)),
    )


def _scale_factor(run: Run) -> Value | None:
    value = run.values.get("scale_factor")
    return None if value is None or value.value is None or value.u is None else value


def lot_report(run: Run) -> Report:
    """Return the sheet of the devices of a run: values, errors of those that ended, causes that all share."""
    columns = columns_of([list(each.values.values()) for each in run.devices if each.values])
    lacks = dict.fromkeys(name for column in columns for name in column.example.missing)
    rows = []
    for each in run.devices:
        cells = [cell for column in columns for cell in column.cells(tuple(each.values.values()), "*" * bool(lacks))]
        verdict = each.status.value if each.error or each.verdict is None else each.verdict.word.upper()
        rows.append([each.metadata.dut or "", *cells, verdict])
    head = [Column("device", align="left", verbatim=True), *(of for column in columns for of in column.heads)]
    said = "; ".join(column.said for column in columns)
    own = [each for each in run.devices if each.error is not None and str(each.error) != str(run.error)]
    failed = [f"{each.metadata.dut} ended early: {each.error}" for each in own]
    axes = {each.metadata.dut or "": each for each in run.devices if isinstance(each.results, AxesResult)}
    spreads = [] if axes else spreads_of(run.devices)
    below = [f"* U95 is incomplete: without {', '.join(lacks)}."] if lacks else []
    words = [*below, *failed, *(each.describe() for each in spreads)]
    parts: list[Part] = [Table([*head, *heads("<ended")], rows)] if rows else []
    parts += [Text(f"{said[:1].upper()}{said[1:]}.")] if said else []
    parts += [Text("\n".join(words))] if words else []
    if axes:
        unit = next(iter(axes.values())).values["scale_factor"].unit
        parts += matrix({name: each.results for name, each in axes.items()}, unit)
    return Report(parts)
