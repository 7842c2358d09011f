"""Scale factor and bias over temperature, from a file that was taken elsewhere: a table, or a log at rest."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from shlex import quote
from typing import Any, Final

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.column_names import Kind, Unit
from vcfbench.analysis.csv_table import Head, Layout, read_head, read_numbers
from vcfbench.analysis.regression import slope
from vcfbench.archive.analyzed import TableColumn, read_table
from vcfbench.archive.analyzed_record import factor_to_rate, is_record, record_place
from vcfbench.archive.table_files import opened_table, with_unit_of_record
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records.plain import plain
from vcfbench.records.schema import POINT_COLUMNS
from vcfbench.reports.document import Axis, Figure, Notice, Report, Series, Table, Text, heads
from vcfbench.uncertainty.measurand import value_table
from vcfbench.uncertainty.over_temperature import (
    Cause,
    Parabola,
    Temperatures,
    most,
    over_temperature,
    relative_over_temperature,
)
from vcfbench.values.value import Value

_ROOM_C: Final = 25.0
_ICE_K: Final = 273.15
_COLDEST_C: Final = -200.0
_HOTTEST_C: Final = 300.0
"""Between them gyroscopes are used, down-hole and in liquid nitrogen (ours)."""
_NEAR_K: Final = 0.5
_SHARE: Final = 0.02
"""Part of the range within which temperatures count as one."""
_BRIEF: Final = 0.25
"""Part of the usual number of rows below which a temperature was only passed through."""
_FEWEST: Final = 5
_LASTS: Final = 6.0
"""What a parabola leaves lasts for so many-th a part of all temperatures (ours)."""
_HELD: Final = (
    "u contains the scatter from one temperature to the next, and the deviation from the parabola as an error that "
    "lasts for a sixth of them. It does not contain errors of the instruments, or of the temperature sensor. A bias is "
    "the output at rest over the scale factor at its temperature, or over the one that was given."
)


class OverTemperature(Struct, frozen=True):
    """A quantity of one column over temperature: its values at the reference, coefficients and hysteresis; its points.

    `rows` are those of the file in each point; `rising` says whether its temperature was come to from below.
    """

    name: str
    unit: str
    stated: tuple[Value, ...]
    temperature_c: tuple[float, ...]
    rising: tuple[bool, ...]
    rows: tuple[int, ...]
    value: tuple[float, ...]


class TemperatureAnalysis(Struct, frozen=True):
    """Scale factors and biases over temperature, stated at `reference_c`.

    >>> found = vcfbench.analyze_temperature("over-temperature.csv", "temperature_c")
    >>> [each.name for each in found.found]
    ['scale factor of output_v', 'bias of output_v']
    """

    reference_c: float
    found: tuple[OverTemperature, ...]
    notes: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as ``vcfbench analyze --json`` prints it."""
        found: dict[str, Any] = plain(self)
        return found

    def report(self) -> Report:
        """Return the coefficients, every temperature, and the figures over it."""
        parts: list[Any] = [*map(Notice, self.notices), *map(Text, (_HELD, *self.notes))]
        for each in self.found:
            parts.append(value_table(each.stated, f"{each.name}, at {self.reference_c:g} degC"))
            columns = heads(f"temperature [degC]:.2f | <direction | rows:g | value [{each.unit}]:.7g")
            ways = ["up" if rising else "down" for rising in each.rising]
            parts.append(Table(columns, list(zip(each.temperature_c, ways, each.rows, each.value, strict=True))))
            points = list(zip(ways, each.temperature_c, each.value, strict=True))
            drawn = [
                Series(way, [x for up, x, _ in points if up == way], [y for up, _, y in points if up == way])
                for way in dict.fromkeys(ways)
            ]
            parts.append(Figure(each.name, Axis("temperature", "degC"), Axis("value", each.unit), drawn))
        return Report(parts)


def analyze_temperature(
    file: Path | str,
    temperature: str,
    *,
    scale_factor_per_deg_s: float | None = None,
    layout: Layout | None = None,
) -> TemperatureAnalysis:
    """Analyse a file over temperature, as ``vcfbench analyze --temperature`` does.

    A table of rates and outputs gives scale factor and bias, a log at rest its bias. Rows stand in the order in which
    they were measured, those of one temperature together; going up and down again tells the hysteresis.

    Args:
        file: its first line names the columns, with their units.
        temperature: the column of temperatures.
        scale_factor_per_deg_s: of a log at rest in volts or counts, V or LSB a deg/s.
        layout: how the file is to be read, where it does not tell by itself, and which columns are meant.

    Raises:
        ConfigError: file, line and column of what cannot be read; fewer than five temperatures; of a table one with
            fewer than two rates.

    >>> found = vcfbench.analyze_temperature("over-temperature.csv", "temperature_c")
    >>> f"{found.reference_c:g} degC", found.found[0].temperature_c
    ('25 degC', (-20.0, 0.0, 25.0, 50.0, 70.0))
    """
    path, notes = Path(file), list[str]()
    layout = with_unit_of_record(path, layout)
    with opened_table(path) as raw:
        head = read_head(raw, shown(path), layout)
        if tuple(each.written for each in head.names[: len(POINT_COLUMNS)]) == POINT_COLUMNS and not layout.columns:
            layout = replace(layout, columns=("rate_deg_s", "output_v"))
        at, unit = _temperature_place(head, temperature)
        if scale_factor_per_deg_s is not None or is_record(head, layout, temperature):
            place = record_place(head, layout)
            factor, taken_as = factor_to_rate(head.names[place], scale_factor_per_deg_s, head.file)
            notes.append(f"{head.names[place].written}: taken as {taken_as}")
            at_c, rest = read_numbers(raw, head, [at, place]).values.T
            columns = {head.names[place].written: TableColumn(np.zeros(0), factor * rest, None, "deg/s")}
        else:
            at_c = read_numbers(raw, head, [at]).values[:, 0]
            raw.seek(0)
            columns = read_table(raw, head.file, layout, notes, follow=False)
            notes = [each for each in notes if not each.startswith("not analysed")]  # the temperature among them
    at_c = unit.factor * at_c + unit.added
    groups = _groups(at_c, f"{head.file}, column {temperature}")
    if left := at_c.size - sum(each.stop - each.start for each in groups):
        notes.append(f"{left} rows between temperatures are not analysed")
    means_c = np.array([at_c[rows].mean() for rows in groups])
    rising = np.diff(means_c, prepend=2.0 * means_c[0] - means_c[1]) > 0.0
    at_room = means_c.min() <= _ROOM_C <= means_c.max()
    reference_c = _ROOM_C if at_room else float(np.round(0.5 * (means_c.min() + means_c.max())))
    near_k = max(_NEAR_K, _SHARE * float(np.ptp(means_c)))
    over, found = Temperatures(means_c, rising.tolist(), reference_c, near_k=near_k), list[OverTemperature]()
    for name, each in columns.items():
        zeros = [float(each.output[rows].mean()) for rows in groups]
        if each.rate_deg_s.size:
            slopes, zeros = _lines(head, groups, each)
            of = "1" if each.unit == "deg/s" else f"{each.unit}/(deg/s)"
            fit = partial(relative_over_temperature, unit=of)
            found.append(_found(f"scale factor of {name}", over, groups, slopes, unit=of, fit=fit))
        fit = partial(over_temperature, unit="deg/s")
        found.append(_found(f"bias of {name}", over, groups, zeros, unit="deg/s", fit=fit))
    return TemperatureAnalysis(reference_c, tuple(found), tuple(notes))


def _temperature_place(head: Head, name: str) -> tuple[int, Unit]:
    """Return the column of temperatures, and its unit."""
    place = head.place(name)
    unit = head.names[place].unit
    if unit is None or unit.kind is not Kind.TEMPERATURE:
        came = unit.written if unit else head.names[place].unknown or "none"
        raise ConfigError(
            f"{head.file}, column {name}: expected a unit of temperature, of degC, K, degF, got {came}",
            hint=f"--unit {quote(f'{name}=degC')}, or that of its numbers",
        )
    return place, unit


def _groups(at_c: Floats, file: str) -> list[slice]:
    """Return the rows of each temperature, in their order; not those at which it was only passed through."""
    low, high = (float(at_c.min()), float(at_c.max())) if at_c.size else (0.0, 0.0)
    if not _COLDEST_C <= low <= high <= _HOTTEST_C:
        came = f"expected temperatures from {_COLDEST_C:g} to {_HOTTEST_C:g} degC, got {low:g} to {high:g} degC"
        kelvins = low > _ICE_K + _COLDEST_C and high < _ICE_K + _HOTTEST_C
        raise ConfigError(f"{file}: {came}", hint="--unit says what they are in: K?" if kelvins else None)
    near, begins = max(_NEAR_K, _SHARE * float(np.ptp(at_c))), [0]
    for row, each in enumerate(at_c.tolist()):
        if abs(each - at_c[begins[-1]]) > near:
            begins.append(row)
    pieces = [slice(begin, end) for begin, end in pairwise([*begins, at_c.size])]
    usual = float(np.median([each.stop - each.start for each in pieces]))
    found = [each for each in pieces if each.stop - each.start >= _BRIEF * usual]
    if len(found) < _FEWEST:
        came = f"from {low:.2f} to {high:.2f} degC" if at_c.size else "none"
        raise ConfigError(f"{file}: expected {_FEWEST} temperatures at least, got {len(found)}, {came}")
    return found


def _lines(head: Head, groups: Sequence[slice], column: TableColumn) -> tuple[list[float], list[float]]:
    """Return the scale factor and the bias, deg/s, at each temperature."""
    rates, y = column.rate_deg_s, column.output
    for rows in groups:
        if not np.ptp(rates[rows]):
            raise ConfigError(
                f"{head.file}: from line {head.line + rows.start} on: expected two rates or more, got one",
                hint="keep all rows of a temperature together",
            )
    slopes = [slope(rates[rows], y[rows]) for rows in groups]
    at_rest = [y[rows].mean() - each * rates[rows].mean() for each, rows in zip(slopes, groups, strict=True)]
    return slopes, [float(each / at) for each, at in zip(at_rest, slopes, strict=True)]


def _found(
    name: str,
    over: Temperatures,
    groups: Sequence[slice],
    values: Sequence[float],
    *,
    unit: str,
    fit: Callable[[Temperatures, Sequence[float], Sequence[Cause]], Parabola],
) -> OverTemperature:
    """Return a quantity over temperature.

    Its scatter is that of neighbours about the parabola, of which the hysteresis is no part.
    """
    size, y = len(values), np.array(values)
    powers = np.vander(over.at_c - over.reference_c, 3)
    rest = y - powers @ np.linalg.lstsq(powers, y, rcond=None)[0]
    like = np.array(over.rising[1:]) == np.array(over.rising[:-1])
    free = size / (size - 3.0)
    scatter = 0.5 * float(np.mean(np.diff(rest)[like] ** 2)) * free if like.any() else 0.0
    slow = max(0.0, float(rest @ rest) / size * free - scatter)
    lasts = np.exp(-_LASTS / size * np.abs(np.subtract.outer(np.arange(size), np.arange(size))))
    noise = Cause("scatter", scatter * np.eye(size), max(1.0, (2.0 * like.sum() - 3.0) / 3.0))
    fitted = fit(over, values, [noise, Cause("deviation from the parabola", slow * lasts)])
    turned = fit(over, values, [noise]).hysteresis
    stated: list[Value] = [
        fitted.value.called("value", "", "value"),
        fitted.tc.called("tc", "", "temperature coefficient"),
        fitted.tc2.called("tc2", "", "coefficient of the square"),
    ]
    if turned is not None:
        seen = abs(turned.value) > turned.u95
        called = turned.called("hysteresis", "", "hysteresis, going down less going up")
        stated.append(called if seen else called.bound("size-below", most(turned)))
    rows = tuple(each.stop - each.start for each in groups)
    return OverTemperature(
        name, unit, tuple(stated), tuple(over.at_c.tolist()), tuple(over.rising), rows, tuple(map(float, values))
    )
