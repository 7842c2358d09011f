"""A report as plain text, for terminals and files; figures are left out."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import TYPE_CHECKING

from vcfbench.report.document import Column, Figure, Heading, Notice, Table, Text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from vcfbench.report.document import Part, Report

__all__ = ["left_table", "printable_lines", "table_text", "text_of"]

WIDTH = 130
"""Lines of text that are longer are wrapped; of a table that is wider its last column, if that is of texts."""
_LEAST_WIDTH = 30
"""A column of texts that would be narrower is left as it is."""

_RULES = ("=", "-")
"""What stands below headings of the first and the second level."""


def text_of(report: Report) -> str:
    """Return the report with an empty line between its parts; what would write on a terminal by itself is escaped."""
    return "\n\n".join(_part(part) for part in report.parts if not isinstance(part, Figure))


def _part(part: Part) -> str:
    match part:
        case Heading():
            title = _line(part.text)
            return "\n".join([title, *(rule * len(title) for rule in _RULES[part.level - 1 : part.level])])
        case Table():
            return table_text(part, WIDTH)
        case Text() | Notice():
            return "\n".join(wrapped for line in part.text.split("\n") for wrapped in _wrapped(_line(line)))
        case Figure():  # left out
            return ""


def table_text(table: Table, most: float = math.inf) -> str:
    """Return columns under their heads, a rule between; numbers to the right.

    Texts of the last column that would make lines longer than `most` go on under themselves.
    """
    rows = [[_line(cell) for cell in row] for row in ([each.head for each in table.columns], *table.printed())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = [str.ljust if column.align == "left" else str.rjust for column in table.columns]
    room = most - sum(widths[:-1]) - 3 * len(widths[:-1])
    if sides[-1] is str.ljust and _LEAST_WIDTH <= room < widths[-1]:
        widths[-1] = int(room)
        rows = [part for row in rows for part in _under_itself(row, widths[-1])]
    head, *lines = ("   ".join(map(_aligned, row, widths, sides)).rstrip() for row in rows)
    above = [head, "-" * len(head)] if table.has_heads else []
    return "\n".join([*([_line(table.title)] if table.title else []), *above, *lines])


def _under_itself(row: list[str], width: int) -> list[list[str]]:
    """Return a row as several, the text of its last cell wrapped."""
    first, *more = wrap(row[-1], width, break_long_words=False, break_on_hyphens=False) or [""]
    return [[*row[:-1], first], *([*("" for _ in row[:-1]), each] for each in more)]


def _wrapped(line: str) -> list[str]:
    """Return `line`, if it is too long, as several with its indentation and two more."""
    if len(line) <= WIDTH:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    return wrap(line, WIDTH, subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False)


def _aligned(cell: str, width: int, side: Callable[[str, int], str]) -> str:
    return side(cell, width)


def left_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return columns of texts, all to the left."""
    return table_text(Table([Column(head, align="left") for head in heads], list(rows)))


def printable_lines(text: str) -> str:
    """Return `text` with its lines as they are, those escaped that hold what cannot be printed."""
    return "\n".join(map(_line, text.split("\n")))


def _line(text: str) -> str:
    """Return `text` as one line that can be printed: a record must not write on the terminal by itself."""
    return text if text.isprintable() else ascii(text)
