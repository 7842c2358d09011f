"""A report as Markdown."""

from __future__ import annotations

from tests.reports.test_text import FIGURE
from vcfbench.reports.document import Column, Heading, Notice, Report, Table, Text
from vcfbench.reports.markdown import markdown_of


def test_every_part_has_its_place_and_figures_their_address() -> None:
    table = Table([Column("rate", "deg/s", ".1f"), Column("what", align="left")], [(1.0, "up"), (None, "a|b")], "what")
    report = Report([Heading("Head", 2), Notice("look"), Text("one\n  two"), table, FIGURE])
    assert markdown_of(report, lambda _figure, number: f"{number}.svg").splitlines() == [
        "## Head",
        "",
        "> **look**",
        "",
        "one\\",
        "&nbsp;&nbsp;two",
        "",
        "**what**",
        "",
        "| rate / &#40;°/s&#41; | what |",
        "| ---: | :--- |",
        "| 1.0 | up |",
        "| &#45; | a&#124;b |",
        "",
        "![a line](1.svg)",
        "",
        "**Figure 1.** a line.",
    ]


def test_no_word_becomes_a_mark() -> None:
    shown = markdown_of(Report([Text("<script> [a](b) `c` # d\n- e\x1b[31m")]), lambda _figure, _number: "")
    assert not set("<[]`*") & set(shown)
    assert shown.splitlines()[1].startswith("'&#45; e")
