"""Columns of values of several runs, each of one kind, unit and definition."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from msgspec import Struct

from vcfbench.reports.document import Cell, Column
from vcfbench.values.printing import digits_of_value
from vcfbench.values.value import Value

SLOPES: Final = ("scale_factor", "scale_factor_small", "scale_factor_by_v_vc")
"""Kinds of scale factors whose changes are followed; that of a declared range is shown in their place."""
_OF_RANGE: Final = "scale_factor_of_range"
_GROUPS: Final = (
    ("scale factor", (_OF_RANGE, *SLOPES)),
    ("bias", ("bias", "bias_at_rest", "bias_by_v_vc")),
    ("non-lin.", ("nonlinearity", "nonlinearity_by_v_vc")),
    ("N", ("angle_random_walk",)),
    ("B", ("bias_instability",)),
)
"""Heads, and the kinds, or names without one, of which a run shows the first that it has."""
_OTHERS: Final = 5
"""Of runs with none of these so many values are shown."""


class ValueColumn(Struct, frozen=True):
    """A column: the kind of its values (without one their name), their unit, and one of them."""

    key: str
    unit: str
    example: Value

    @classmethod
    def of(cls, value: Value) -> "ValueColumn":
        """Return the column of a value."""
        return cls(_key(value), value.unit, value)

    @property
    def is_slope(self) -> bool:
        """Return True for a column of scale factors, whose U95 has a column of its own, in ppm."""
        return self.key in {_OF_RANGE, *SLOPES}

    @property
    def heads(self) -> tuple[Column, ...]:
        """The short heads of the columns; the definition is above the table (`said`)."""
        short = next((head for head, kinds in _GROUPS if self.key in kinds), self.example.named.words)
        return (Column(short), Column("U95", format=".0f")) if self.is_slope else (Column(short),)

    @property
    def said(self) -> str:
        """Return definition and unit: ``scale factor of small signals in mV/(deg/s), its U95 in ppm``."""
        of = self.example.named
        unit = f" in {of.unit}" if of.unit else ""
        over = f", over {levels}" if self.is_slope and (levels := self.example.definition.levels_words) else ""
        return f"{of.words}{over}{unit}{', its U95 in ppm' if self.is_slope else ''}"

    def value(self, values: Sequence[Value]) -> Value | None:
        """Return the one of `values` in this column, or None."""
        return next((each for each in values if self.holds(each)), None)

    def holds(self, value: Value) -> bool:
        """Return True if this column holds the value."""
        same = (_key(value), value.unit) == (self.key, self.unit)
        return same and not value.definition.unlike(self.example.definition)

    def cells(self, values: Sequence[Value], mark: str = "") -> Iterator[Any]:
        """Yield the printed form of the one of `values` in this column; `mark` follows a U95."""
        found = self.value(values)
        if found is None or found.value is None or found.form != "plus-minus" or found.u95 is None:
            yield None if found is None else found.figure(found.named.factor)
            if self.is_slope:
                yield None
            return
        number, u95 = found.named.factor * found.value, abs(found.named.factor) * found.u95
        yield Cell(number, digits_of_value(number, u95))
        if self.is_slope:
            ppm = 1e6 * u95 / abs(number) if number else None
            yield ppm if ppm is None or not mark else f"{ppm:.0f}{mark}"


def columns_of(rows: Sequence[Sequence[Value]]) -> list[ValueColumn]:
    """Return the columns of runs by their values: scale factors, biases, non-linearities, else the first few."""
    found: dict[tuple[str, str], ValueColumn] = {}
    for _, kinds in _GROUPS:
        for values in rows:
            first = next((each for each in values if _key(each) in kinds), None)
            if first is not None:
                found.setdefault((_key(first), first.unit), ValueColumn.of(first))
    for each in () if found else (each for values in rows for each in values[:_OTHERS]):
        found.setdefault((_key(each), each.unit), ValueColumn.of(each))
    return list(found.values())


def _key(value: Value) -> str:
    return value.kind or value.name


def of_one_definition(rows: Sequence[Sequence[Value]]) -> list[list[int]]:
    """Return the places of those runs together whose first columns hold values of one definition; none: with any."""
    found: list[tuple[ValueColumn, list[int]]] = []
    without = []
    for place, values in enumerate(rows):
        first = next(iter(columns_of([values])), None)
        if first is None:
            without.append(place)
            continue
        places = next((places for column, places in found if column.holds(first.example)), None)
        if places is None:
            found.append((first, [place]))
        else:
            places.append(place)
    (leading, *others) = [places for _, places in found] or [[]]
    return [sorted([*leading, *without]), *others]
