"""A report as values: headings, tables, figures and texts that any renderer can show.

Nothing here draws or prints. A table keeps its numbers beside how many digits to print, a figure its series beside
the labels of its axes; what cannot be shown (ragged rows, unequal series) is refused when the part is made.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

from msgspec import Struct, ValidationError
from msgspec.structs import force_setattr

from vcfbench.errors import ConfigError
from vcfbench.records.plain import plain
from vcfbench.typed import typed
from vcfbench.values.printing import in_digits

Value: TypeAlias = bool | int | float | str | None  # a whole number stays one when it is read back
"""Cell of a table: a number, a text, or None where there is nothing."""

DEEPEST_HEADING = 6


class Heading(Struct, frozen=True, tag_field="part", tag=str.lower):
    """A heading; `level` 1 is the highest, 6 the lowest.

    >>> print(vcfbench.text_of(vcfbench.Report([vcfbench.Heading("Zero")])))
    Zero
    ====
    """

    text: str
    level: int = 1

    def __post_init__(self) -> None:
        """Refuse levels that there are not."""
        if not 1 <= self.level <= DEEPEST_HEADING:
            raise ValueError(f"heading {self.text!r}: expected a level from 1 to {DEEPEST_HEADING}, got {self.level}")


class Text(Struct, frozen=True, tag_field="part", tag=str.lower):
    """Words, in lines that stay as they are; `verbatim` where also their characters must: words of a person.

    >>> vcfbench.text_of(vcfbench.Report([vcfbench.Text("warm for an hour")]))
    'warm for an hour'
    """

    text: str
    verbatim: bool = False


class Notice(Struct, frozen=True, tag_field="part", tag=str.lower):
    """Important words, such as that a bench was simulated; `kind` is their weight.

    >>> vcfbench.text_of(vcfbench.Report([vcfbench.Notice("SIMULATED. Not measured.")]))
    'SIMULATED. Not measured.'
    """

    text: str
    kind: Literal["warning", "pass", "marginal", "fail"] = "warning"


class Cell(Struct, frozen=True):
    """A value of a table that is printed otherwise than its column says; `format` and `unit` are its own.

    >>> zero = vcfbench.Cell(0.0000123, format=".1e", unit="V")
    >>> print(vcfbench.text_of(vcfbench.Report([vcfbench.Table([vcfbench.Column("zero")], [[zero]])])))
         zero
    ---------
    1.2e-05 V
    """

    value: Value
    format: str = ""
    unit: str = ""


class Column(Struct, frozen=True):
    """A column of a table: name and unit for its head, `format` of its numbers (``".5f"``), and its side.

    Texts are printed as they are, None as ``-``. `verbatim` says that none of their characters may be set otherwise on
    a page: commands, names of files, what a person wrote.

    >>> vcfbench.Column("output", "V", ".5f").head
    'output / V'
    """

    name: str
    unit: str = ""
    format: str = ""
    align: Literal["left", "right"] = "right"
    verbatim: bool = False

    @property
    def head(self) -> str:
        """The printed head: ``rate / (deg/s)``."""
        if not self.unit:
            return self.name
        return f"{self.name} / ({self.unit})" if "/" in self.unit else f"{self.name} / {self.unit}"


_HEAD = re.compile(r"^(<?)(.*?)(?: \[(.*?)\])?(?::([^:]*))?$")


def heads(said: str) -> tuple[Column, ...]:
    """Return columns by their heads, ``"<name | rate [deg/s]:.5f"``: to the left, unit and format where they are."""
    found = (_HEAD.findall(each)[0] for each in said.split(" | "))
    return tuple(Column(name, unit, form, "left" if left else "right") for left, name, unit, form in found)


class Table(Struct, frozen=True, tag_field="part", tag=str.lower):
    """Columns and rows of values; `title` is shown above them, empty for none.

    Args:
        columns: what stands where.
        rows: each as many values as there are columns; numpy's numbers are kept as plain ones.
        title: what stands above.

    Raises:
        ValueError: a row has more or fewer values than there are columns, or a value cannot be printed as its column
            says.

    >>> rate, output = vcfbench.Column("rate", "deg/s", "g"), vcfbench.Column("output", "V", ".3f")
    >>> table = vcfbench.Table([rate, output], [[10.0, -0.1671], [0.0, -0.0414]])
    >>> print(vcfbench.text_of(vcfbench.Report([table])))
    rate / (deg/s)   output / V
    ---------------------------
                10       -0.167
                 0       -0.041
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Value | Cell]]
    title: str = ""

    def __post_init__(self) -> None:
        """Keep tuples, and refuse values that cannot be shown."""
        columns = tuple(self.columns)
        rows = tuple(
            tuple(
                each if isinstance(each, Cell | str) else getattr(each, "item", lambda each=each: each)()
                for each in row
            )
            for row in self.rows
        )
        force_setattr(self, "columns", columns)
        force_setattr(self, "rows", rows)
        if not columns or not all(isinstance(each, Column) for each in columns):
            raise ValueError(f"the columns of a table are one Column or more, got {columns!r}")
        for number, row in enumerate(rows, start=1):
            if len(row) != len(columns):
                raise ValueError(f"row {number} of a table of {len(columns)} columns has {len(row)} values")
            for value, column in zip(row, columns, strict=True):
                if isinstance(value, str):
                    continue
                held, where = value.value if isinstance(value, Cell) else value, f"row {number} of a table, "
                if not isinstance(held, float | int | str | None):
                    words = f"expected a number, a text or None, got {held!r}"
                    raise ValueError(f"{where}{column.name}: {words}")  # noqa: TRY004  # a value in it is wrong
                try:
                    _printed(value, column)
                except ValueError as error:
                    raise ValueError(f"{where}{column.name}: {held!r} cannot be printed: {error}") from None

    @property
    def has_heads(self) -> bool:
        """Return True if any column has a head; a table of names and values has none."""
        return any(column.head for column in self.columns)

    def printed(self) -> tuple[tuple[str, ...], ...]:
        """Return every row as texts, each value in its digits."""
        return tuple(
            tuple(_printed(value, column) for value, column in zip(row, self.columns, strict=True)) for row in self.rows
        )


def texts(*heads: str, verbatim: bool = False) -> list[Column]:
    """Return columns of texts under `heads`, all to the left."""
    return [Column(head, align="left", verbatim=verbatim) for head in heads]


def facts(rows: Sequence[tuple[str, str]]) -> Table:
    """Return names and values in two columns, with their characters unchanged."""
    return Table([*texts(""), *texts("", verbatim=True)], rows)


def _printed(value: Any, column: Column) -> str:
    if isinstance(value, str):
        return value
    cell = value if isinstance(value, Cell) else Cell(value, column.format)
    if cell.value is None:
        return "-"
    figure = cell.value if isinstance(cell.value, str) else in_digits(cell.value, cell.format)
    return f"{figure} {cell.unit}" if cell.unit else figure


class Axis(Struct, frozen=True):
    """An axis of a figure: the quantity along it, its unit, and its scale.

    >>> vcfbench.Axis("averaging time", "s", scale="log").title
    'averaging time / s'
    """

    label: str
    unit: str = ""
    scale: Literal["linear", "log"] = "linear"

    @property
    def title(self) -> str:
        """Title of the axis: ``rate / (deg/s)``."""
        return Column(self.label, self.unit).head


class Series(Struct, frozen=True):
    """Data of a figure: as many `y` as `x`, as points, a line through them, or bars.

    Args:
        label: for the legend.
        x: where, in the unit of the figure's x axis.
        y: what, in the unit of its y axis.
        u_y: standard uncertainty of each `y`; None where it is not known.
        kind: ``"points"``, ``"line"`` or ``"bars"``.
        low: lower end of a band about it (a confidence interval), in the unit of the y axis; None for no band.
        high: its upper end; there where `low` is.

    Raises:
        ValueError: there are not as many of one as of the other, or something is no finite number.

    >>> vcfbench.Series("output", x=[10.0, 0.0, -10.0], y=[-0.167, -0.041, 0.084], u_y=[3e-5] * 3).heights
    (-0.167, -0.041, 0.084)
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    u_y: Sequence[float] | None = None
    kind: Literal["points", "line", "bars"] = "points"
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Keep tuples of floats, and refuse values that cannot be drawn."""
        for name in ("x", "y", "u_y", "low", "high"):
            if (values := getattr(self, name)) is None:
                continue
            numbers = tuple(map(float, values))
            if len(numbers) != len(self.x):
                raise ValueError(f"series {self.label!r}: {len(self.x)} x and {len(numbers)} {name}")
            if not all(map(math.isfinite, numbers)):
                raise ValueError(f"series {self.label!r}: {name} holds a number that is not finite")
            if name == "u_y" and min(numbers, default=0.0) < 0.0:
                raise ValueError(f"series {self.label!r}: uncertainties must not be negative, got {min(numbers):g}")
            force_setattr(self, name, numbers)
        if self.kind not in ("points", "line", "bars"):
            raise ValueError(f"series {self.label!r}: expected points, line or bars, got {self.kind!r}")
        if (self.low is None) != (self.high is None):
            raise ValueError(f"series {self.label!r}: a band has two ends, got one")
        if any(low > high for low, high in zip(self.low or (), self.high or (), strict=True)):
            raise ValueError(f"series {self.label!r}: the lower end of its band is above the upper one")

    @property
    def heights(self) -> tuple[float, ...]:
        """All values along the y axis: the series itself and its band."""
        return (*self.y, *(self.low or ()), *(self.high or ()))


class Figure(Struct, frozen=True, tag_field="part", tag=str.lower):
    """A figure: title, axes, series, and words below it. Its renderer chooses size, colours and marks.

    Raises:
        ValueError: there is no series, or a logarithmic axis has values that are not positive.

    >>> output = vcfbench.Series("output", x=[10.0, 0.0, -10.0], y=[-0.167, -0.041, 0.084])
    >>> vcfbench.Figure("Output", vcfbench.Axis("rate", "deg/s"), vcfbench.Axis("output", "V"), [output]).title
    'Output'
    """

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series]
    caption: str = ""

    def __post_init__(self) -> None:
        """Keep a tuple, and refuse series that cannot be drawn."""
        force_setattr(self, "series", tuple(self.series))
        if not self.series:
            raise ValueError(f"figure {self.title!r} has no series")
        for axis, name, drawn in ((self.x, "x", "x"), (self.y, "y", "heights")):
            if axis.scale == "log" and any(value <= 0.0 for each in self.series for value in getattr(each, drawn)):
                raise ValueError(f"figure {self.title!r}: a logarithmic {name} axis has positive values only")


Part: TypeAlias = "Heading | Table | Figure | Text | Notice"


class Report(Struct, frozen=True):
    """Report of a run, part after part.

    >>> [type(part).__name__ for part in run.report().parts]
    ['Table', 'Text', 'Table', 'Table', 'Text', 'Text', 'Figure', 'Figure', 'Table']
    """

    parts: Sequence[Part] = ()

    def __post_init__(self) -> None:
        """Keep a tuple, and refuse any value that is no part."""
        force_setattr(self, "parts", tuple(self.parts))
        for part in self.parts:
            if not isinstance(part, Heading | Table | Figure | Text | Notice):
                raise ValueError(  # noqa: TRY004  # a value in it is wrong
                    f"a report has headings, tables, figures, texts and notices, got a {type(part).__name__}"
                )


def plain_report(report: Report) -> list[dict[str, Any]]:
    """Return the parts of `report` as records keep them: fields and kind of each; ConfigError as `plain`."""
    return [{"part": type(part).__name__.lower(), **plain(part, "report")} for part in report.parts]


def report_from(parts: Sequence[Mapping[str, Any]]) -> Report:
    """Return the report that :func:`plain_report` wrote; ConfigError: it did not."""
    try:
        return Report(typed(parts, list[Heading | Table | Figure | Text | Notice]))
    except ValidationError as error:
        raise ConfigError(f"this version cannot read the kept report: {error}") from error
