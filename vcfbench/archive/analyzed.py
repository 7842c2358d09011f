"""The whole analysis of a calibration table that was measured elsewhere, from its file."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import IO, Any

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.column_names import KNOWN, Kind, cure_of
from vcfbench.analysis.column_roles import are_directions, may_be_applied, may_be_output, says_applied, says_measured
from vcfbench.analysis.csv_table import Head, Layout, read_head, read_numbers
from vcfbench.analysis.nonlinearity import DEFINITIONS
from vcfbench.analysis.plausibility import doubts_of_line
from vcfbench.analysis.scale_factor import Comparison, ScaleFactorResult, characterise, compare
from vcfbench.archive.table_files import opened_table, with_unit_of_record
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records.schema import POINT_COLUMNS
from vcfbench.reports.document import Axis, Cell, Column, Figure, Notice, Report, Series, Table, Text, texts

_SERIES_OF_STEP = {3: "turntable", 4: "virtual"}
_FEWEST_POINTS = 3
_FEWEST_OF_RECORD = 64
"""Rows from which on a file may be a record at rest."""
_LEVELS = 0.25
"""Most levels of an applied rate, per row of such a file."""
_FOLLOWS = 0.95
"""Least correlation of an output with the applied rate: those of tables have 0.999."""
_MOST_V = 40.0
"""Analogue outputs, and the multimeters on them, end below: rates are larger."""
_DRAWN = 2000
"""Most points of a series in a figure: a page of 2e5 had 25 MB."""
_OUTPUTS = {Kind.RATE, Kind.VOLTAGE, Kind.COUNT}
_COUNTED = {"n", "count", "counts", "readings", "samples"}
"""Names of how many readings a point has."""


class TableColumn(Struct, frozen=True):
    """One output of a table: in V, deg/s or LSB, against the rate in deg/s, with its standard uncertainty if given."""

    rate_deg_s: Floats
    output: Floats
    u_output: Floats | None = None
    unit: str = "V"


class TableAnalysis(Struct, frozen=True):
    """Results of a table: of each column its `series`, and the `comparison` of two of them.

    `compared` names those two, reference first; both are None where nothing was compared. `units` are those of the
    outputs, V, deg/s or LSB, which stand for the V of all names in `series`; `notes` say what columns were taken for,
    `notices` what no gyroscope within its range gives.

    >>> table = vcfbench.analyze("paper-table1.csv")
    >>> table.compared, round(table.comparison.scale_factor_error_percent, 2)
    (('turntable_v', 'virtual_v'), 1.53)
    """

    series: dict[str, ScaleFactorResult]
    compared: tuple[str, str] | None
    comparison: Comparison | None
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as ``vcfbench analyze --json`` prints it."""
        compared: dict[str, Any] | None = None
        if self.compared is not None and self.comparison is not None:
            reference, other = self.compared
            compared = {"reference": reference, "other": other, **self.comparison.as_json()}
        series = {name: _in_unit(result.as_json(), self.units[name]) for name, result in self.series.items()}
        return {"series": series, "comparison": compared, "notes": list(self.notes), "notices": list(self.notices)}

    def report(self) -> Report:
        """Return the lines, their non-linearities and residuals, and the comparison of two where there is one."""
        found = self.series.values()
        columns = [Column(name) for name in self.series]
        # Volts in mV, for which the digits are made; others in their own unit
        volts = set(self.units.values()) == {"V"}
        by, unit = (1e3, "mV") if volts else (1.0, next(iter(self.units.values())))
        if len(set(self.units.values())) > 1:
            unit, columns = "output", [Column(f"{name}, {self.units[name]}") for name in self.series]
        digits = (".6f", ".4f") if volts else (".9g", ".6g")
        fits: list[tuple[Cell | float | str, ...]] = [
            (f"scale factor, {unit}/(deg/s)", *(Cell(by * each.line.scale_factor, digits[0]) for each in found)),
            (f"  u_fit, {unit}/(deg/s)", *(Cell(by * each.u_fit_scale_factor, ".2g") for each in found)),
            (f"bias, {unit}", *(Cell(by * each.line.bias, digits[1]) for each in found)),
            (f"  u_fit, {unit}", *(Cell(by * each.u_fit_bias, ".2g") for each in found)),
            ("bias over scale factor, deg/s", *(Cell(each.line.bias_deg_s, ".4f") for each in found)),
            (f"residual std, {unit}", *(Cell(by * each.line.s_v, digits[1]) for each in found)),
            ("degrees of freedom", *(each.line.dof for each in found)),
        ]
        bends: list[tuple[Cell | float | str, ...]] = [
            (name, *(Cell(each.nonlinearity_ppm[name], ".1f") for each in found), words)
            for name, words in DEFINITIONS.items()
        ]
        ppm = [1e6 / abs(each.line.scale_factor) / float(np.ptp(each.rate_deg_s)) for each in found]
        drawn = [
            Series(name, *_drawn(each.rate_deg_s, of_span * each.line.residuals_v))
            for of_span, (name, each) in zip(ppm, self.series.items(), strict=True)
        ]
        residual = Axis("residual of the span", "ppm")
        return Report(
            [
                *map(Notice, self.notices),
                Table([*texts(""), *columns], fits, "Least-squares line"),
                *map(Text, self.notes),
                Text("u_fit: of the fit alone, deviation from the line included; points alone give no combined u"),
                Table([*texts(""), *columns, *texts("definition")], bends, "Non-linearity and asymmetry, ppm"),
                Text("full scale: |K| times the largest rate; reading: from 10 deg/s on"),
                *self._compared(),
                Figure("Residuals of the least-squares line", Axis("Omega_z", "deg/s"), residual, drawn),
            ]
        )

    def _compared(self) -> Iterator[Table]:
        found = self.comparison
        if self.compared is None or found is None:
            return
        volts = self.units[self.compared[0]] == "V"
        unit = "mV" if volts else self.units[self.compared[0]]
        rows = [
            ("scale factor error, %", Cell(found.scale_factor_error_percent, ".3f")),
            ("  u_fit, percentage points", Cell(found.u_fit_scale_factor_error_percent, ".3f")),
            ("  from slopes rounded to five decimals, %", Cell(found.scale_factor_error_percent_rounded, ".3f")),
            ("E_n of the fits' scatter alone, no verdict", Cell(found.e_n, ".2f")),
            (f"bias difference, {unit}", Cell((1e3 if volts else 1.0) * found.bias_difference_v, ".3f")),
        ]
        yield Table([*texts(""), Column("")], rows, f"{self.compared[1]} against {self.compared[0]}")


def _drawn(rates: Floats, residuals: Floats) -> tuple[list[float], list[float]]:
    """Return the points that a figure has: of very many the least and the largest of each thousandth."""
    rows = np.arange(rates.size)
    if rates.size > _DRAWN:
        pieces = np.array_split(np.argsort(rates, kind="stable"), _DRAWN // 2)
        rows = np.array([each[at(residuals[each])] for each in pieces for at in (np.argmin, np.argmax)])
    return rates[rows].tolist(), residuals[rows].tolist()


def _in_unit(column: dict[str, Any], unit: str) -> dict[str, Any]:
    """Return a column as JSON in the unit of its output; one that is not in volts has no names that end in ``_v``."""
    if unit == "V":
        return column
    for name, of in (("scale_factor", "1" if unit == Kind.RATE.value else f"{unit}/(deg/s)"), ("bias", unit)):
        column[name] = {**column[name], "unit": of}
    return {"unit": unit, **_without_volts(column)}


def _without_volts(value: Any) -> Any:
    if isinstance(value, list):
        return [_without_volts(each) for each in value]
    if not isinstance(value, dict):
        return value
    named = {key: f"{key.removesuffix('_v').removesuffix('_output')}_output" for key in value if key.endswith("_v")}
    return {named.get(key, key): _without_volts(each) for key, each in value.items()}


def analyze(file: Path | str, compared: Sequence[str] | None = None, *, layout: Layout | None = None) -> TableAnalysis:
    """Analyse a table that was measured elsewhere, as ``vcfbench analyze`` does: a text file of rates and outputs.

    The names of the columns have their units: of rates such as deg/s, rad/s, dps, of outputs V, mV, deg/s, LSB. Outputs
    of a table in which none has a unit are in volts. ``u_X`` is the standard uncertainty of X. `compared` names two
    columns, reference first; two columns are compared by default. `layout` says what the file does not tell by itself.

    Raises:
        ConfigError: there is no such file or column, or what is in it is no such table: file, line and column are told.

    >>> table = vcfbench.analyze("paper-table1.csv")
    >>> {name: f"{1e3 * found.line.scale_factor:.3f} mV/(deg/s)" for name, found in table.series.items()}
    {'turntable_v': '-12.542 mV/(deg/s)', 'virtual_v': '-12.734 mV/(deg/s)'}
    """
    path, notes = Path(file), list[str]()
    with opened_table(file) as raw:
        columns = read_table(raw, shown(path), with_unit_of_record(path, layout), notes)
    pair = _compared_columns(compared, columns, path)
    results, notices = {}, list[str]()
    for column, one in columns.items():
        try:
            results[column] = characterise(one.rate_deg_s, one.output, one.u_output)
        except ConfigError as error:
            others = "--columns RATE,OUTPUT leaves it out" if len(columns) > 1 else None
            raise ConfigError(f"{shown(path)}, column {column}: {error}", hint=others) from error
        found = results[column]
        if one.unit == "V" and (largest_v := float(np.abs(one.output).max())) > _MOST_V:
            notices.append(f"{column}: outputs up to {largest_v:g} V: are the columns of rates and outputs exchanged?")
        doubts = doubts_of_line(found.rate_deg_s, found.output_v, found.line, found.u_fit_scale_factor)
        notices += [f"{column}, at {found.rate_deg_s[each.row]:g} deg/s: {each.words}" for each in doubts]
    comparison = None if pair is None else compare(results[pair[0]], results[pair[1]])
    units = {name: each.unit for name, each in columns.items()}
    return TableAnalysis(results, pair, comparison, units, tuple(notes), tuple(notices))


def read_table(
    raw: IO[bytes], file: str, layout: Layout, notes: list[str], *, follow: bool = True
) -> dict[str, TableColumn]:
    """Return the outputs of a table by the names of their columns, or those of a record's points by their steps.

    Args:
        raw: the file, open.
        file: its name, for messages.
        layout: how it is to be read.
        notes: what columns were taken for is added to it.
        follow: whether the outputs go with the rate alone, and not with a temperature too.

    Raises:
        ConfigError: one sentence with file, line and column, for anything that is no complete table.
    """
    head = read_head(raw, file, layout)
    if "" in layout.units:
        raise ConfigError(f"--unit {layout.units['']}: expected the column too, for a table", hint="--unit COLUMN=mV")
    if tuple(each.written for each in head.names[: len(POINT_COLUMNS)]) == POINT_COLUMNS and not layout.columns:
        return _steps(raw, head)
    rate = _rate_place(head, layout)
    outputs, uncertainties = _output_places(head, layout, rate, notes)
    places = [rate, *outputs, *(each for pair in uncertainties.values() for each in pair if each is not None)]
    values = read_numbers(raw, head, places).values
    if len(values) < _FEWEST_POINTS:
        raise ConfigError(f"{file}: at least {_FEWEST_POINTS} points are needed, the file has {len(values)}")

    def of(place: int) -> Floats:
        unit = head.names[place].unit
        return values[:, places.index(place)] * (1.0 if unit is None else unit.factor)

    if np.ptp(of(rate)) == 0.0:
        column = head.names[rate].written
        raise ConfigError(f"{file}, column {column}: every rate is {of(rate)[0]:g}, so there is no scale factor")
    require_signs(head, of(rate), set(places))
    if not head.selects(layout):
        _require_applied(head, rate, of(rate), {place: of(place) for place in outputs if follow})
    found = {}
    for place in outputs:
        name, u_output = head.names[place], None
        if place in uncertainties:
            u, readings = uncertainties[place]
            numbers = np.ones(len(values)) if readings is None else of(readings)
            if (of(u) < 0.0).any() or (numbers < 1.0).any():
                raise ConfigError(
                    f"{file}, column {head.names[u].written}: an uncertainty is below 0, or of less than 1 reading"
                )
            u_output = of(u) / np.sqrt(numbers)
        unit = "V" if name.unit is None else name.unit.kind.value
        found[name.written] = TableColumn(of(rate), of(place), u_output, unit)
    return found


def require_signs(head: Head, rates: Floats, places: set[int]) -> None:
    """Raise ConfigError where rates have no sign, and a column beside those at `places` says the direction."""
    for place, name in enumerate(head.names if rates.min() >= 0.0 else ()):
        cells = [row[place] for row in head.sample]
        if place not in places and are_directions(cells):
            words = " and ".join(dict.fromkeys(cells))
            raise ConfigError(
                f"{head.file}, column {name.written}: {words} beside rates without sign",
                hint=f"write rates with their sign; --rows {quote(f'{name.written}={cells[0]}')} reads one direction",
            )


def _rate_place(head: Head, layout: Layout) -> int:
    """Return the column of the applied rate: the one that is named first, the only rate, or that called so."""
    if asked := head.asked(layout):
        place = head.place(asked[0])
        if head.names[place].kind is not Kind.RATE:
            raise ConfigError(
                f"--columns: the rate comes first, {asked[0]} has no unit of one",
                hint=f"--unit {quote(f'{asked[0]}=deg/s')}, or that of its numbers",
            )
        kinds = {head.names[head.place(each)].kind for each in asked}
        if kinds == {Kind.RATE} and any(each.is_time for each in head.names) and not may_be_applied(head.names[place]):
            raise ConfigError(
                f"{head.file}: of a record at rest one column is analysed at a time, got {', '.join(asked)}",
                hint="of a table the column of the applied rate is called so: rate, applied, table",
            )
        return place
    every = rates = [place for place, each in enumerate(head.names) if each.kind is Kind.RATE]
    if len(every) > 1:
        rates = [place for place in every if may_be_applied(head.names[place])]
    if len(rates) != 1:
        several = ", ".join(head.names[place].written for place in every)
        volts = not every and any(each.kind in {Kind.VOLTAGE, Kind.COUNT} for each in head.names)
        got = f"column 1: the header must begin with rate_deg_s, or another rate, got {head.names[0].written!r}"
        raise ConfigError(
            f"{head.file}, line {max(1, head.line - 1)}, {several + ' may each be the applied rate' if every else got}",
            hint="--columns RATE,OUTPUT says which columns are meant"
            + ", --unit RATE=deg/s the unit of a rate" * (not every)
            + "; a record at rest in volts or counts needs --scale-factor" * volts,
        )
    name = head.names[rates[0]]
    if says_measured(name) and not head.selects(layout):
        raise ConfigError(
            f"{head.file}, column {name.written}: by its name a gyroscope's output, no applied rate",
            hint=_either(head, rates[0]),
        )
    return rates[0]


def _either(head: Head, rate: int) -> str:
    """Return what to type for a file that may be a record at rest or a table."""
    alone = f"--columns {quote(head.names[rate].written)}"
    pace = "" if any(each.is_time for each in head.names) else " --rate HZ"
    return f"of a record at rest: {alone}{pace}; of a table: --columns RATE,OUTPUT"


def _require_applied(head: Head, rate: int, rates: Floats, outputs: Mapping[int, Floats]) -> None:
    """Raise ConfigError where neither names nor numbers say that the rate was applied, and that an output follows it.

    A rate that is not called so has few levels, or the file fewer rows than a record; some output follows it, and so
    does each output without a unit.
    """
    named, name = says_applied(head.names[rate]), head.names[rate].written
    where = f"{head.file}, column {name}"
    if not named and rates.size >= _FEWEST_OF_RECORD and np.unique(rates).size > _LEVELS * rates.size:
        raise ConfigError(
            f"{where}: its {np.unique(rates).size} different rates in {rates.size} rows may be applied or measured",
            hint=_either(head, rate),
        )
    # Of a constant output the fit tells
    lost = [
        place
        for place, output in outputs.items()
        if np.ptp(output) and abs(float(np.corrcoef(rates, output)[0, 1])) < _FOLLOWS
    ]
    bare = [place for place in lost if head.names[place].unit is None]
    if bare or (lost and not named and len(lost) == len(outputs)):
        others = ", ".join(head.names[place].written for place in bare or lost)
        raise ConfigError(f"{where}: {others} does not follow it: is it the output?", hint=_either(head, rate))


def _output_places(
    head: Head, layout: Layout, rate: int, notes: list[str]
) -> tuple[list[int], dict[int, tuple[int, int | None]]]:
    """Return the columns of outputs, and of some that of their uncertainty, with that of its number of readings."""
    names = head.names
    outputs = outputs_of(head, head.asked(layout)[1:], [rate])
    if not outputs:
        others = ", ".join(each.written for place, each in enumerate(names) if place != rate)
        beside = f"{names[rate].written}{', of ' + others if others else ''}"
        raise ConfigError(
            f"{head.file}, line {max(1, head.line - 1)}: expected an output column besides {beside}",
            hint=_either(head, rate),
        )
    doubled = [names[place].written for place in outputs]
    if twice := next((place for place in outputs if doubled.count(names[place].written) > 1), None):
        raise ConfigError(
            f"{head.file}, line {max(1, head.line - 1)}, column {outputs[-1] + 1}: "
            f"there is already a column {names[twice].written}",
            hint="give each its own name",
        )
    counted = next((place for place, each in enumerate(names) if each.base in _COUNTED and not each.spread), None)
    uncertainties = dict[int, tuple[int, int | None]]()
    for place in outputs:
        for at, each in enumerate(names):
            if each.spread and each.base == names[place].base and (each.spread == "u" or counted is not None):
                uncertainties[place] = at, None if each.spread == "u" else counted
    if bare := [names[place].written for place in outputs if names[place].unit is None]:
        notes.append(f"{', '.join(bare)}: no unit in the name, taken as volts")
    used = {rate, *outputs, *(at for pair in uncertainties.values() for at in pair if at is not None)}
    if left := [each.written or f"column {place + 1}" for place, each in enumerate(names) if place not in used]:
        notes.append(f"not analysed: {', '.join(left)}")
    return outputs, uncertainties


def outputs_of(head: Head, asked: Sequence[str], rates: Sequence[int]) -> list[int]:
    """Return the columns that are `asked` for; else those whose unit is that of an output, or those without one.

    Raises:
        ConfigError: the unit of one is none of an output.
    """
    outputs = [head.place(name) for name in asked] or _outputs_beside(head, rates)
    for place in outputs:
        name, unit = head.names[place].written, head.names[place].unit
        if head.names[place].unknown or (unit and unit.kind not in _OUTPUTS):
            raise ConfigError(
                f"{head.file}, column {name}: expected the unit of an output, of {KNOWN}, got "
                f"{head.names[place].unknown or (unit and unit.written)}",
                hint=cure_of(head.names[place].unknown, name) or f"--unit {quote(f'{name}=UNIT')}, that of its numbers",
            )
    return outputs


def _outputs_beside(head: Head, rates: Sequence[int]) -> list[int]:
    left = [
        place
        for place, each in enumerate(head.names)
        if place not in rates and each.written and not each.spread and not head.is_text(place) and may_be_output(each)
    ]
    in_units = [place for place in left if head.names[place].unit is not None or head.names[place].unknown]
    analysed = [place for place in in_units if head.names[place].unknown or head.names[place].kind in _OUTPUTS]
    bare = [place for place in left if place not in in_units]
    return analysed or bare


def _steps(raw: IO[bytes], head: Head) -> dict[str, TableColumn]:
    """Return every step of a record's points that has enough for a line; the scatter is in the unit of the output."""
    values = read_numbers(raw, head, range(len(POINT_COLUMNS))).values
    unit = head.names[POINT_COLUMNS.index("output_v")].unit
    kind, factor = ("V", 1.0) if unit is None else (unit.kind.value, unit.factor)
    values = values[np.argsort(values[:, 0], kind="stable")]
    found = {}
    for rows in np.split(values, np.flatnonzero(np.diff(values[:, 0])) + 1):
        step, (_, rate, _, output, std, counts) = float(rows[0, 0]), rows.T
        if rate.size >= _FEWEST_POINTS and np.ptp(rate) > 0.0:
            u = std / np.sqrt(np.maximum(counts, 1.0))
            name = _SERIES_OF_STEP.get(int(step), f"step_{step:g}")
            found[name] = TableColumn(rate, factor * output, factor * u, kind)
    if not found:
        raise ConfigError(f"{head.file}: no step has {_FEWEST_POINTS} points at different rates")
    return found


def _compared_columns(
    asked: Sequence[str] | None, columns: dict[str, TableColumn], file: Path
) -> tuple[str, str] | None:
    """Return the two columns to compare, reference first, or None; raises ConfigError for unknown or unlike ones."""
    names = list(columns)
    if asked is None:
        like = len(names) == 2 and columns[names[0]].unit == columns[names[1]].unit
        return (names[0], names[1]) if like else None
    if isinstance(asked, str) or len(asked) != 2:
        raise ConfigError(f"expected the names of two columns to compare, got {asked!r}")
    for name in asked:
        if name not in names:
            raise ConfigError(f"{shown(file)} has no column {name!r}, only {', '.join(names)}")
    first, second = (columns[name].unit for name in asked)
    if first != second:
        raise ConfigError(f"{asked[0]} in {first} and {asked[1]} in {second} cannot be compared")
    return asked[0], asked[1]
