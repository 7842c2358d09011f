"""A report as a piece of HTML, for notebooks; figures are left out."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from vcfbench.report.document import Figure, Heading, Table, Text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.report.document import Part, Report

__all__ = ["html_of"]


def html_of(report: Report) -> str:
    """Return the parts one after the other: headings, tables with their digits, texts in their lines."""
    return "\n".join(_part(part) for part in report.parts if not isinstance(part, Figure))


def _part(part: Part) -> str:
    match part:
        case Heading():
            return f"<h{part.level}>{escape(part.text)}</h{part.level}>"
        case Table():
            return _table(part)
        case Text():
            return f"<pre>{escape(part.text)}</pre>"
        case Figure():  # left out
            return ""


def _table(table: Table) -> str:
    sides = [f' style="text-align:{column.align}"' for column in table.columns]
    caption = f"<caption>{escape(table.title)}</caption>" if table.title else ""
    head = _row("th", [column.head for column in table.columns], sides)
    body = "".join(_row("td", row, sides) for row in table.printed())
    return f"<table>{caption}<thead>{head}</thead><tbody>{body}</tbody></table>"


def _row(tag: str, cells: Sequence[str], sides: Sequence[str]) -> str:
    return (
        f"<tr>{''.join(f'<{tag}{side}>{escape(cell)}</{tag}>' for cell, side in zip(cells, sides, strict=True))}</tr>"
    )
