"""Reports in notebooks."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from tests.report.test_text import FIGURE
from vcfbench.report.document import Column, Heading, Report, Table, Text
from vcfbench.report.html import html_of


def test_every_part_but_figures_is_a_piece_of_html() -> None:
    table = Table([Column("rate", "deg/s", ".1f"), Column("what", align="left")], [(1.0, "<b>"), (None, "&")], "a < b")
    shown = html_of(Report([Heading("H & h", 2), Text("one\n two"), table, FIGURE]))
    tree = ET.fromstring(f"<div>{shown}</div>")  # noqa: S314  # ours
    assert [each.tag for each in tree] == ["h2", "pre", "table"]
    assert tree.findtext("h2") == "H & h"
    assert tree.findtext("pre") == "one\n two"
    assert tree.findtext("table/caption") == "a < b"
    assert [each.text for each in tree.iter("th")] == ["rate / (deg/s)", "what"]
    assert [each.text for each in tree.iter("td")] == ["1.0", "<b>", "-", "&"]
    assert [each.get("style") for each in tree.iter("th")] == ["text-align:right", "text-align:left"]
