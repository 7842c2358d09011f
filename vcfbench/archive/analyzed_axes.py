"""Scale factors, cross-axis sensitivities and misalignment of gyroscopes on three axes, from a table's file."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.column_names import Kind, column_name
from vcfbench.analysis.csv_table import Layout, read_head, read_numbers
from vcfbench.analysis.input_axis import angle_of, direction, tilts
from vcfbench.analysis.plausibility import far_off
from vcfbench.archive.analyzed import outputs_of
from vcfbench.archive.table_files import opened_table
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records.plain import plain
from vcfbench.reports.document import Notice, Report, Table, Text, heads
from vcfbench.uncertainty.measurand import printed
from vcfbench.values.value import Value

_FEWEST = 6
_HELD = "u: of the fit alone, deviation from the line included. The axes are the axes of the table's rates."


class OutputAxis(Struct, frozen=True):
    """One output: its change with the rate about each axis, its unit a deg/s, and what is stated of it."""

    column: str
    unit: str
    sensitivity: tuple[float, float, float]
    residual_std: float
    stated: tuple[Value, ...]


class AxesAnalysis(Struct, frozen=True):
    """Outputs against the rates about three axes; `orthogonality` says by how much the angle of two is above 90 deg.

    >>> found = vcfbench.analyze_axes("axes.csv", ["x_deg_s", "y_deg_s", "z_deg_s"])
    >>> [f"{1e3 * each:.2f}" for each in found.outputs[0].sensitivity]
    ['0.10', '-0.00', '-12.50']
    """

    axes: tuple[str, ...]
    outputs: tuple[OutputAxis, ...]
    orthogonality: tuple[Value, ...]
    notices: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as ``vcfbench analyze --json`` prints it."""
        found: dict[str, Any] = plain(self)
        return found

    def report(self) -> Report:
        """Return the matrix, and the stated values of each output."""
        columns = heads("<output | <unit | " + " | ".join(f"{column_name(each).base}:.6g" for each in self.axes))
        rows = [(each.column, each.unit, *each.sensitivity) for each in self.outputs]
        parts = [(each.column, each.stated) for each in self.outputs]
        parts += [("Angle of input axes", self.orthogonality)] if self.orthogonality else []
        of_values = heads("<quantity | value:.6g | u:.2g | U95:.2g | <unit")
        tables = [
            Table(of_values, [(each.words, *printed(each), each.unit) for each in values], title)
            for title, values in parts
        ]
        matrix = Table(columns, rows, "Output for the rate about each axis")
        return Report([*map(Notice, self.notices), matrix, Text(_HELD), *tables])


def analyze_axes(file: Path | str, axes: Sequence[str], *, layout: Layout | None = None) -> AxesAnalysis:
    """Analyse a table of rates about three axes, as ``vcfbench analyze --axes`` does.

    Each output is fitted by ``bias + sum sensitivity * rate``. Its scale factor is the length of the three, and its
    input axis their direction.

    Args:
        file: its first line names the columns, with their units.
        axes: the columns of the rates about x, y and z; outputs are all others in V, deg/s or LSB.
        layout: how the file is to be read, where it does not tell by itself; the outputs that are meant.

    Raises:
        ConfigError: file, line and column of what cannot be read; fewer than six rows, or rates that do not turn about
            all three axes.

    >>> found = vcfbench.analyze_axes("axes.csv", ["x_deg_s", "y_deg_s", "z_deg_s"])
    >>> f"{found.outputs[0].stated[0].value:.4f} {found.outputs[0].stated[0].unit}"
    '-0.0125 V/(deg/s)'
    """
    layout = layout or Layout()
    with opened_table(file) as raw:
        head = read_head(raw, shown(Path(file)), layout)
        places = [head.place(each) for each in axes]
        if len(set(places)) != 3 or any(head.names[place].kind is not Kind.RATE for place in places):
            raise ConfigError(f"--axes: expected three columns of rates, got {', '.join(axes)}")
        places += outputs_of(head, head.asked(layout), places)
        values = read_numbers(raw, head, places).values
    names = [head.names[place] for place in places]
    values = values * [1.0 if name.unit is None else name.unit.factor for name in names]
    powers = np.column_stack([np.ones(len(values)), values[:, :3]])
    if len(places) == 3:
        raise ConfigError(f"{head.file}: expected an output column besides {', '.join(axes)}")
    if len(values) < _FEWEST or np.linalg.matrix_rank(powers / np.maximum(np.abs(powers).max(axis=0), 1e-300)) < 4:
        raise ConfigError(f"{head.file}: expected {_FEWEST} rows at least, and rates about each of the three axes")
    spread, dof = np.linalg.inv(powers.T @ powers), float(len(values) - 4)
    found, notices, inputs = list[OutputAxis](), list[str](), list[tuple[str, Floats, Floats]]()
    for name, y in zip(names[3:], values.T[3:], strict=True):
        fitted = spread @ (powers.T @ y)
        left = y - powers @ fitted
        if not fitted[1:].any():
            raise ConfigError(f"{head.file}, column {name.written}: the output does not follow the rates")
        if (row := far_off(powers, y)) is not None:
            off = f"{abs(left[row]):.3g} off, far beyond what the others scatter"
            notices.append(f"{name.written}, row {row + 1}: {off}")
        kind = Kind.VOLTAGE if name.unit is None else name.unit.kind
        unit, variance = "1" if kind is Kind.RATE else f"{kind.value}/(deg/s)", float(left @ left) / dof
        size, axis, of_axis = direction(fitted[1:], variance * spread[1:, 1:])
        u, u_bias = abs(size) * float(axis @ of_axis @ axis) ** 0.5, (variance * float(spread[0, 0])) ** 0.5 / abs(size)
        stated = [
            Value("", size, unit, u, dof, words="scale factor"),
            Value("", float(fitted[0]) / size, "deg/s", u_bias, dof, words="bias"),
        ]
        for other, tilt, by in tilts(axis):
            words = f"input axis towards {names[other].base}"
            stated.append(_mrad(tilt, float(by @ of_axis @ by), dof, words))
        inputs.append((name.written, axis, of_axis))
        sensitivity = float(fitted[1]), float(fitted[2]), float(fitted[3])
        found.append(OutputAxis(name.written, unit, sensitivity, variance**0.5, tuple(stated)))
    between = []
    for (first, one, of_one), (second, two, of_two) in combinations(inputs, 2):
        angle = angle_of(one, two, of_one + of_two, dof)
        words = f"{second} to {first}, {angle.words}"
        if angle.below is not None:
            between.append(Value("", 1e3 * angle.rad, "mrad", form="below", high=1e3 * angle.below, words=words))
            continue
        variance = float(angle.by_one @ of_one @ angle.by_one + angle.by_two @ of_two @ angle.by_two)
        between.append(_mrad(angle.rad, variance, dof, words))
    return AxesAnalysis(tuple(axes), tuple(found), tuple(between), tuple(notices))


def _mrad(angle: float, variance: float, dof: float, words: str) -> Value:
    return Value("", 1e3 * angle, "mrad", 1e3 * variance**0.5, dof, words=words)
