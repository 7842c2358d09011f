"""Reports in notebooks."""

from __future__ import annotations

from unicodedata import category
from xml.etree import ElementTree as ET

from hypothesis import given
from hypothesis import strategies as st

from tests.characters import CHARACTERS
from tests.reports.test_text import FIGURE
from vcfbench.reports.document import Column, Heading, Notice, Report, Table, Text
from vcfbench.reports.html_page import html_of


def test_every_part_but_figures_is_a_piece_of_html() -> None:
    table = Table([Column("rate", "deg/s", ".1f"), Column("what", align="left")], [(1.0, "<b>"), (None, "&")], "a < b")
    shown = html_of(Report([Heading("H & h", 2), Text("one\n two"), table, FIGURE]))
    tree = ET.fromstring(f"<div>{shown}</div>")  # noqa: S314  # ours
    assert [each.tag for each in tree] == ["h2", "pre", "div"]
    assert tree.findtext("h2") == "H & h"
    assert tree.findtext("pre") == "one\n two"
    assert tree.findtext("div/table/caption") == "a < b"
    assert [each.text for each in tree.iter("th")] == ["rate / (°/s)", "what"]
    assert [each.text for each in tree.iter("td")] == ["1.0", "<b>", "-", "&"]
    sides = [(each.get("style") or "").partition(";")[0] for each in tree.iter("th")]
    assert sides == ["text-align:right", "text-align:left"]


def test_notices_have_a_kind_and_lone_values_no_heads() -> None:
    pairs = Table([Column("", align="left"), Column("", align="left")], [("run", "1"), ("long", "word " * 9)])
    shown = html_of(
        Report([Notice("not real"), Notice("FAIL", "fail"), pairs, FIGURE]), lambda each: f"<i>{each.title}</i>"
    )
    tree = ET.fromstring(f"<div>{shown}</div>")  # noqa: S314  # ours
    assert [each.get("class") for each in tree.iter("p")] == ["notice warning", "notice fail"]
    assert tree.find(".//thead") is None
    assert ["nowrap" in (each.get("style") or "") for each in tree.iter("td")] == [True, True, True, False]
    assert tree.findtext("i") == FIGURE.title


@given(st.text(CHARACTERS))
def test_no_text_becomes_markup_or_anything_that_cannot_be_printed(text: str) -> None:
    (element,) = ET.fromstring(f"<div>{html_of(Report([Text(text)]))}</div>")  # noqa: S314  # ours
    assert len(element) == 0
    assert all(each.isprintable() or category(each) == "Zs" for each in (element.text or "").replace("\n", ""))
