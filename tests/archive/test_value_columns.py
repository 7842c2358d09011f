"""Columns of values of several runs: each of one kind and one unit."""

from __future__ import annotations

from random import Random

from vcfbench.archive.value_columns import columns_of, of_one_definition
from vcfbench.values.definition import Definition
from vcfbench.values.kinds import KINDS
from vcfbench.values.value import Value


def drawn(random: Random) -> list[Value]:
    """The values of a run: some of kinds, some with the same names and none, in any order."""
    units = ("V", "ppm", "deg/s", "V/(deg/s)")
    kinds = random.sample([name for name, kind in KINDS.items() if kind.si in units], 4)
    values = [Value(f"{number}.{kind}", 7.4, KINDS[kind].si, u95=0.2, kind=kind) for number, kind in enumerate(kinds)]
    values += [Value(name, 7445.3, random.choice(units), u95=3.0) for name in ("scale_factor", "bias", "tc")]
    random.shuffle(values)
    return values


def test_cell_has_kind_and_unit_of_its_column() -> None:
    random = Random(5)  # noqa: S311
    for _ in range(300):
        rows = [drawn(random) for _ in range(3)]
        columns = columns_of(rows)
        assert columns
        for column in columns:
            for values in rows:
                found = column.value(values)
                assert found is None or (found.kind or found.name, found.unit) == (column.key, column.unit)
                assert len(list(column.cells(values))) == len(column.heads)


def test_spread_in_ppm_has_its_own_column() -> None:
    spread = Value(
        "scale_factor_repeatability", 7.4, "ppm", form="interval", low=4.8, high=16.0, kind="scale_factor_repeatability"
    )
    (column,) = columns_of([[spread]])
    assert column.said == "repeatability of the scale factor in ppm"
    assert list(column.cells([spread])) == ["7.4 (4.8 to 16)"]


def test_values_of_other_definitions_stand_in_no_column_together() -> None:
    def row(*rates: float) -> list[Value]:
        over = Definition.of(rates)
        slope = Value("scale_factor", -0.0125, "V/(deg/s)", 1e-7, kind="scale_factor", definition=over)
        return [slope, Value("bias", -0.04, "V", 1e-5, kind="bias", definition=over)]

    rows = [row(50, 0, -50), row(200, 0, -200), [], row(50, 0, -50, 50, 0, -50), row(50.001, 0, -50)]
    assert of_one_definition(rows) == [[0, 2, 3, 4], [1]]
    column, _ = columns_of([rows[1]])
    assert column.said == "scale factor, over 200, 0, -200 deg/s in mV/(deg/s), its U95 in ppm"
    assert (column.value(rows[1]), column.value(rows[0])) == (rows[1][0], None)
