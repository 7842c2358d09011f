"""Reports as plain values and back."""

from __future__ import annotations

import json
import math

import pytest

from tests.reports.test_text import FIGURE
from vcfbench.errors import ConfigError
from vcfbench.reports.document import Axis, Cell, Column, Figure, Heading, Notice, Report, Series, Table, Text
from vcfbench.reports.kept import plain_report, report_from

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
    with pytest.raises(ConfigError, match="the report that is kept is none of this program"):
        report_from(parts)


def test_what_json_does_not_have_cannot_be_kept() -> None:
    with pytest.raises(ConfigError, match="report"):
        plain_report(Report([Table([Column("a")], [(math.nan,)])]))
