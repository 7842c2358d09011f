"""A report as a piece of HTML: for notebooks, and for the page that holds a whole one."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Final

from vcfbench.reports.document import Figure, Heading, Notice, Table, Text
from vcfbench.reports.text import printable_lines
from vcfbench.reports.typography import marked_up

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.reports.document import Column, Part, Report

_SHORT: Final = 28
"""Texts of so many characters stay in one line of a table: names, numbers, units."""


def html_of(report: Report, draw: Callable[[Figure], str] | None = None) -> str:
    """Return the parts one after the other: headings, tables with their digits, texts in their lines.

    `draw` makes an element of each figure; without it figures are left out.
    """
    pieces = (_part(part, draw) for part in report.parts)
    return "\n".join(piece for piece in pieces if piece)


def escaped(text: str) -> str:
    """Return `text` as it can stand in HTML, in quotes too: its markup is shown, and unprintable characters."""
    return escape(printable_lines(text))


def _part(part: Part, draw: Callable[[Figure], str] | None) -> str:
    match part:
        case Heading():
            return f"<h{part.level}>{_set(part.text)}</h{part.level}>"
        case Table():
            columns = part.columns
            caption = f"<caption>{_set(part.title)}</caption>" if part.title else ""
            head = (
                f"<thead>{_row('th', [column.head for column in columns], columns)}</thead>" if part.has_heads else ""
            )
            body = "".join(_row("td", row, columns) for row in part.printed())
            return f'<div style="overflow-x:auto"><table>{caption}{head}<tbody>{body}</tbody></table></div>'
        case Text():
            return f"<pre>{(escaped if part.verbatim else _set)(part.text)}</pre>"
        case Notice():
            return f'<p class="notice {part.kind}"><strong>{_set(part.text)}</strong></p>'
        case Figure():
            return "" if draw is None else draw(part)


def _row(tag: str, cells: Sequence[str], columns: Sequence[Column]) -> str:
    return f"<tr>{''.join(_cell(tag, *each) for each in zip(cells, columns, strict=True))}</tr>"


def _cell(tag: str, text: str, column: Column) -> str:
    whole = ";white-space:nowrap" if len(text) <= _SHORT else ""
    said = escaped(text) if column.verbatim else _set(text)
    return f'<{tag} style="text-align:{column.align}{whole}">{said}</{tag}>'


def _set(text: str) -> str:
    """Return `text` as HTML, its names and units set as on paper."""
    return marked_up(text, escaped)
