"""Reports as plain text."""

from __future__ import annotations

import pytest

from vcfbench.reports.document import Axis, Cell, Column, Figure, Heading, Notice, Report, Series, Table, Text
from vcfbench.reports.text import left_table, table_text, text_of

FIGURE = Figure("a line", Axis("rate", "deg/s"), Axis("output", "V"), [Series("it", [0.0, 1.0], [0.0, 1.0])])


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    assert (
        table_text(Table([Column("a"), Column("bb")], [("1", "2"), ("333", "4")]))
        == "  a   bb\n--------\n  1    2\n333    4"
    )


def test_text_columns_are_left_aligned_without_trailing_blanks() -> None:
    assert left_table(("a", "bb"), [("333", "4")]) == "a     bb\n--------\n333   4"


def test_numbers_and_heads_follow_their_columns() -> None:
    columns = (Column("rate", "deg/s", "g"), Column("output", "V", ".3f"), Column("n"), Column("what", align="left"))
    rows = [(10.0, -0.12345, 3, "up"), (None, Cell(0.5, ".1e", "mV"), 12, "down")]
    assert table_text(Table(columns, rows, "title")).splitlines() == [
        "title",
        "rate / (deg/s)   output / V    n   what",
        "---------------------------------------",
        "            10       -0.123    3   up",
        "             -   5.0e-01 mV   12   down",
    ]


def test_parts_are_separated_and_figures_omitted() -> None:
    report = Report([Heading("Head"), Text("one\n  two"), FIGURE, Heading("Next", 2), Heading("Third", 3), FIGURE])
    assert text_of(report) == "Head\n====\n\none\n  two\n\nNext\n----\n\nThird"
    assert text_of(Report()) == ""


def test_notice_is_text_and_name_table_has_no_heads() -> None:
    pairs = Table([Column("", align="left"), Column("", align="left")], [("run", "1"), ("bench", "paper")], "whose")
    assert text_of(Report([Notice("not real"), pairs])) == "not real\n\nwhose\nrun     1\nbench   paper"


def test_long_lines_of_text_are_wrapped_under_their_indentation() -> None:
    words = " ".join(["word"] * 60)
    first, *rest = text_of(Report([Text(f"  {words}\nshort")])).splitlines()
    assert first.startswith("  word")
    assert [len(line) <= 130 for line in (first, *rest)] == [True] * len([first, *rest])
    assert all(line.startswith("    word") for line in rest[:-1])
    assert rest[-1] == "short"
    assert " ".join(f"{first} {' '.join(rest[:-1])}".split()) == words


def test_texts_of_the_last_column_go_on_under_themselves() -> None:
    words = " ".join(["word"] * 60)
    table = Table(
        [Column("quantity", align="left"), Column("contributions to u", align="left")], [("q", words), ("r", "x")]
    )
    head, rule, first, *rest, last = text_of(Report([table])).splitlines()
    assert (head, set(rule), last) == ("quantity   contributions to u", {"-"}, "r          x")
    assert all(len(line) <= 130 for line in (rule, first, *rest))
    assert all(line.startswith(" " * 11 + "word") for line in rest)
    assert " ".join([first, *rest]).split() == ["q", *words.split()]
    assert len(max(table_text(table).splitlines(), key=len)) > 300


@pytest.mark.parametrize(
    "part", [Heading("\x1b[2J"), Text("a\n\x1b[2J"), Table([Column("\x1b[2J")], [("\x1b[2J\n",)], "\x1b")]
)
def test_nothing_writes_on_the_terminal_by_itself(part: Heading | Text | Table) -> None:
    text = text_of(Report([part]))
    assert "\x1b" not in text
    assert "\\x1b" in text


@pytest.mark.parametrize("width", [40, 60, 80, 100])
def test_texts_without_room_beside_the_numbers_stand_below_them(width: int) -> None:
    columns = (Column("value", align="left"), Column("u", "V", ".1e"), Column("of what", align="left"))
    words = "intercept of that line, with Earth's rate, mean of the horizon, and more that nobody can fit in here"
    report = Report([Table(columns, [("turntable.bias", 1.2e-5, words), ("k_vc", 2.0, ""), ("r", 3.0, "short")])])
    lines = text_of(report, width).splitlines()
    assert all(line.strip() for line in lines)
    assert max(map(len, lines)) <= width
    assert " ".join(" ".join(lines).split()).replace("turntable.bias 1.2e-05 ", "").count("with Earth's rate") == 1
    assert any(line.startswith("turntable.bias") and "1.2e-05" in line for line in lines)
    assert all(word in " ".join(lines).split() for word in words.split())
