"""A report as Markdown of GitHub; its figures are separate files."""

import re
from collections.abc import Callable
from itertools import count
from typing import Final

from vcfbench.reports.document import Figure, Heading, Notice, Part, Report, Table, Text
from vcfbench.reports.plot import caption_of
from vcfbench.reports.text import printable_lines

_SPECIAL: Final = re.compile(
    r"[\\`*\[\]<&|~$]|(?<!\w)_|_(?!\w)|^[>=]|^[-+](?=[\s-]|$)|^#(?=#*(?:\s|$))|^\d+(?=[.)](?:\s|$))"
)
"""What Markdown would take for a mark; all else stays as it is, so that a report can be searched."""


def markdown_of(report: Report, place: Callable[[Figure, int], str]) -> str:
    """Return the report as Markdown, with all special characters escaped.

    Args:
        report: what is shown.
        place: puts a figure, given its number from 1, somewhere, and returns the address of its picture.
    """
    numbers = count(1)

    def put(figure: Figure) -> str:
        number = next(numbers)
        below = f" {_plain(caption)}" if (caption := caption_of(figure)) else ""
        picture = f"![{_plain(figure.title)}]({place(figure, number)})"
        return f"{picture}\n\n**Figure {number}.** {_plain(figure.title)}.{below}"

    return "\n\n".join(_part(part, put) for part in report.parts) + "\n"


def _part(part: Part, put: Callable[[Figure], str]) -> str:
    match part:
        case Heading():
            return f"{'#' * part.level} {_plain(part.text)}"
        case Table():
            title = [f"**{_plain(part.title)}**", ""] if part.title else []
            sides = ["---:" if column.align == "right" else ":---" for column in part.columns]
            rows = [[column.head for column in part.columns], *part.printed()]
            head, *body = (f"| {' | '.join(map(_plain, row))} |" for row in rows)
            return "\n".join([*title, head, f"| {' | '.join(sides)} |", *body])
        case Text():
            lines = [(line, line.lstrip(" ")) for line in part.text.split("\n")]  # spaces before words would go
            return "\\\n".join("\xa0" * (len(line) - len(words)) + _plain(words) for line, words in lines)
        case Notice():
            return f"> **{_plain(part.text)}**"
        case Figure():
            return put(part)


def _plain(text: str) -> str:
    """Return `text` with its marks as they are, in one line."""
    one_line = printable_lines(text).replace("\n", " ")
    # a backslash before a mark; behind the digits that would begin a list
    return _SPECIAL.sub(lambda found: f"{found[0]}\\" if found[0].isdigit() else f"\\{found[0]}", one_line)
