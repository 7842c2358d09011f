"""A report as Markdown."""

from __future__ import annotations

import re

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
        "\xa0\xa0two",
        "",
        "**what**",
        "",
        "| rate / (deg/s) | what |",
        "| ---: | :--- |",
        "| 1.0 | up |",
        r"| \- | a\|b |",
        "",
        "![a line](1.svg)",
        "",
        "**Figure 1.** a line.",
    ]


def test_no_word_becomes_a_mark() -> None:
    shown = markdown_of(
        Report([Text("<script> [a](b) `c` *d* _e_ &lt; $f$ a|b\n- e\x1b[31m\n# g\n1. h")]), lambda *_: ""
    )
    assert not re.search(r"(?<!\\)[<\[\]`*&|$]", shown)
    assert r"\_e\_" in shown
    assert [line[:2] for line in shown.splitlines()[2:]] == [r"\#", "1\\"]


def test_what_is_no_mark_can_be_searched() -> None:
    words = "-12.541 scale_factor -12.541 60(30) mV/(deg/s), K_Vc 150.1(1.7) (deg/s)/V; 95 % > 1 + 2 = #3!"
    assert markdown_of(Report([Text(words)]), lambda *_: "").strip() == words
