"""What a report is made of, and what it refuses to be made of."""

from __future__ import annotations

import json
import math
import pickle
from typing import Any

import numpy as np
import pytest

from tests.reports.test_text import FIGURE
from vcfbench.errors import ConfigError
from vcfbench.reports.document import (
    Axis,
    Cell,
    Column,
    Figure,
    Heading,
    Notice,
    Report,
    Series,
    Table,
    Text,
    plain_report,
    report_from,
)

RATE, OUTPUT = Axis("rate", "deg/s"), Axis("output", "V")
LINE = Series("line", [1.0, 2.0], [3.0, 4.0], kind="line")


def test_a_report_is_a_value() -> None:
    """Lists and arrays are kept as tuples of plain numbers."""
    table = Table([Column("n"), Column("output", "V", ".3f")], [[np.int64(1), np.float64(0.5)]])
    figure = Figure("f", RATE, OUTPUT, [Series("s", np.array([1.0]), np.array([2]), np.array([0.1]))])
    report = Report([Heading("h"), table, figure, Text("t")])
    assert table.rows == ((1, 0.5),)
    assert table.columns == (Column("n"), Column("output", "V", ".3f"))
    assert [type(value) for value in table.rows[0]] == [int, float]
    assert figure.series[0] == Series("s", (1.0,), (2.0,), (0.1,))
    assert pickle.loads(pickle.dumps(report)) == report  # noqa: S301  # ours
    assert len({report, report}) == 1


def test_values_stay_beside_the_digits_to_print() -> None:
    table = Table([Column("output", "V", ".2f")], [[0.123456], [Cell(0.5, ".1e", "mV")], [None], ["text"], [7]])
    assert [row[0] for row in table.rows] == [0.123456, Cell(0.5, ".1e", "mV"), None, "text", 7]
    assert [row[0] for row in table.printed()] == ["0.12", "5.0e-01 mV", "-", "text", "7.00"]


def test_axes_are_titled_with_their_units() -> None:
    assert [axis.title for axis in (RATE, OUTPUT, Axis("n"))] == ["rate / (deg/s)", "output / V", "n"]


def make_table(*rows: Any, form: str = "") -> Table:
    return Table([Column("a"), Column("b", format=form)], rows)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: make_table((1, 2), (1,)), "row 2 of a table of 2 columns has 1 values"),
        (lambda: make_table((1, 2, 3)), "row 1 of a table of 2 columns has 3 values"),
        (lambda: make_table((1, [2])), r"row 1 of a table, b: expected a number, a text or None, got \[2\]"),
        (lambda: make_table((1, Cell([2])), form="g"), "expected a number, a text or None"),  # type: ignore[arg-type]
        (lambda: make_table((1, 0.5), form="d"), "row 1 of a table, b: 0.5 cannot be printed"),
        (lambda: Table([], []), "one Column or more"),
        (lambda: Table(["a"], []), "one Column or more, got .*'a'"),  # type: ignore[list-item]
        (lambda: Heading("h", 0), "expected a level from 1 to 6, got 0"),
        (lambda: Series("s", [1, 2], [1]), "series 's': 2 x and 1 y"),
        (lambda: Series("s", [1, 2], [1, 2], [0.1]), "series 's': 2 x and 1 u_y"),
        (lambda: Series("s", [1], [1], [-0.1]), "uncertainties must not be negative"),
        (lambda: Series("s", [1], [math.nan]), "y holds a number that is not finite"),
        (lambda: Series("s", [math.inf], [1]), "x holds a number that is not finite"),
        (lambda: Series("s", [1], [1], kind="pie"), "got 'pie'"),  # type: ignore[arg-type]
        (lambda: Figure("f", RATE, OUTPUT, []), "figure 'f' has no series"),
        (
            lambda: Figure("f", Axis("tau", "s", "log"), OUTPUT, [Series("s", [0.0], [1.0])]),
            "a logarithmic x axis has positive values only",
        ),
        (lambda: Report(["words"]), "got a str"),  # type: ignore[list-item]
    ],
)
def test_what_cannot_be_shown_is_refused_when_it_is_made(make: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_a_logarithmic_axis_takes_what_is_positive() -> None:
    assert Figure("f", Axis("tau", "s", "log"), Axis("sigma", "deg/s", "log"), [LINE]).series == (LINE,)


REPORT = Report(
    [
        *(Heading("h", 2), Text("one\n two"), Notice("look", "fail"), FIGURE),
        Table([Column("a", "V", ".2f"), Column("b", align="left")], [(1.5, "x"), (None, Cell(2.0, ".1e", "s"))], "t"),
        Figure(
            *("band", Axis("x", "s", "log"), Axis("y")),
            [Series("s", [1.0, 2.0], [1.0, 2.0], [0.1, 0.1], "line", [0.5, 0.5], [3.0, 3.0])],
            "words",
        ),
    ]
)


def test_a_report_comes_back_as_it_was() -> None:
    assert report_from(json.loads(json.dumps(plain_report(REPORT)))) == REPORT


@pytest.mark.parametrize(
    "parts", [[{}], [{"part": "song"}], [{"part": "text", "words": "x"}], ["text"], [{"part": []}]]
)
def test_what_is_no_report_is_refused(parts: list[dict[str, object]]) -> None:
    with pytest.raises(ConfigError, match="this version cannot read the kept report"):
        report_from(parts)


def test_what_json_does_not_have_cannot_be_kept() -> None:
    with pytest.raises(ConfigError, match="report"):
        plain_report(Report([Table([Column("a")], [(math.nan,)])]))
