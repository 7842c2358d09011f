"""A report as Markdown, as GitHub and most others read it; its figures are files beside it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from vcfbench.reports.document import Figure, Heading, Notice, Table, Text
from vcfbench.reports.plot import caption_of
from vcfbench.reports.text import printable_lines
from vcfbench.reports.typography import marked_up

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.reports.document import Part, Report

_SPECIAL: Final = re.compile(r"[\\`*_{}\[\]()#+!|<>&~$-]")


def markdown_of(report: Report, place: Callable[[Figure, int], str]) -> str:
    """Return the report as Markdown, every word of it as a word.

    Args:
        report: what is shown.
        place: puts a figure, given its number from 1, somewhere, and returns the address of its picture.
    """
    numbers = iter(range(1, len(report.parts) + 1))

    def put(figure: Figure) -> str:
        number = next(numbers)
        below = f" {_set(caption)}" if (caption := caption_of(figure)) else ""
        picture = f"![{_plain(figure.title)}]({place(figure, number)})"
        return f"{picture}\n\n**Figure {number}.** {_set(figure.title)}.{below}"

    return "\n\n".join(_part(part, put) for part in report.parts) + "\n"


def _part(part: Part, put: Callable[[Figure], str]) -> str:
    match part:
        case Heading():
            return f"{'#' * part.level} {_set(part.text)}"
        case Table():
            return _table(part)
        case Text():
            said = _plain if part.verbatim else _set
            return "\\\n".join(_indented(line, said) for line in part.text.split("\n"))
        case Notice():
            return f"> **{_set(part.text)}**"
        case Figure():
            return put(part)


def _table(table: Table) -> str:
    title = [f"**{_set(table.title)}**", ""] if table.title else []
    sides = ["---:" if column.align == "right" else ":---" for column in table.columns]
    said = [_plain if column.verbatim else _set for column in table.columns]
    rows = [[column.head for column in table.columns], *table.printed()]
    head, *body = (f"| {' | '.join(say(cell) for say, cell in zip(said, row, strict=True))} |" for row in rows)
    return "\n".join([*title, head, f"| {' | '.join(sides)} |", *body])


def _indented(line: str, said: Callable[[str], str]) -> str:
    words = line.lstrip(" ")
    return "&nbsp;" * (len(line) - len(words)) + said(words)


def _set(text: str) -> str:
    """Return `text` in one line, its names and units set as on paper."""
    return marked_up(text, _plain)


def _plain(text: str) -> str:
    """Return `text` with its marks as they are, in one line."""
    return _SPECIAL.sub(lambda found: f"&#{ord(found[0])};", printable_lines(text).replace("\n", " "))
