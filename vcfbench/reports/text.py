"""A report as plain text, for terminals and files; figures are left out."""

import math
from collections.abc import Callable, Iterable, Sequence
from textwrap import wrap
from unicodedata import category

from vcfbench.reports.document import Figure, Heading, Notice, Part, Report, Table, Text, texts

WIDTH = 130
"""Lines of text that are longer are wrapped, where nothing else is said; of a table that is wider its last column, if
that is of texts."""
_LEAST_WIDTH = 30  # A column of texts that would be narrower stands below its rows instead
_BELOW = "    "

_RULES = ("=", "-")  # Underlines of headings of the first and the second level


def text_of(report: Report, width: int = WIDTH) -> str:
    """Return the report with an empty line between its parts; control characters of a terminal are escaped.

    Args:
        report: what is to be shown.
        width: characters of a line; numbers of a table that is wider are not cut.

    >>> print(vcfbench.text_of(vcfbench.Report(run.report().parts[:1])))
    Omega_z / (deg/s)   output / V     s / V
    ----------------------------------------
                   10     -0.16699   3.3e-05
                    0     -0.04143   7.4e-05
                  -10      0.08427   7.2e-05
    """
    return "\n\n".join(_part(part, width) for part in report.parts if not isinstance(part, Figure))


def _part(part: Part, width: int) -> str:
    match part:
        case Heading():
            title = printable(part.text)
            return "\n".join([title, *(rule * len(title) for rule in _RULES[part.level - 1 : part.level])])
        case Table():
            return table_text(part, width)
        case Text() | Notice():
            return "\n".join(wrapped for line in part.text.split("\n") for wrapped in _wrapped(printable(line), width))
        case Figure():  # left out
            return ""


def table_text(table: Table, most: float = math.inf) -> str:
    """Return columns under their heads, a rule between; numbers to the right.

    Texts of the last column that would make lines longer than `most` go on under themselves, or stand below their rows
    where there is no room for that.
    """
    rows = [[printable(cell) for cell in row] for row in ([each.head for each in table.columns], *table.printed())]
    sides = [str.ljust if column.align == "left" else str.rjust for column in table.columns]
    *others, last = (max(map(len, column)) for column in zip(*rows, strict=True))
    room = most - sum(others) - 3 * len(others)
    if sides[-1] is str.rjust or last <= room or not others:
        lines = _in_columns(rows, [*others, last], sides)
    elif room >= _LEAST_WIDTH:
        folded = []  # the text of the last cell goes on under itself
        for row in rows:
            first, *more = wrap(row[-1], int(room), break_long_words=False, break_on_hyphens=False) or [""]
            folded += [[*row[:-1], first], *([*("" for _ in row[:-1]), each] for each in more)]
        lines = _in_columns(folded, [*others, 0], sides)
    else:
        beside = _in_columns([row[:-1] for row in rows], others, sides[:-1])
        below = [[], *(_wrapped(f"{_BELOW}{row[-1]}", most) if row[-1] else [] for row in rows[1:])]
        lines = [line for one, more in zip(beside, below, strict=True) for line in (one, *more)]
    head, *lines = lines
    above = [head, "-" * len(head)] if table.has_heads else []
    return "\n".join([*([printable(table.title)] if table.title else []), *above, *lines])


def _in_columns(
    rows: Iterable[Sequence[str]], widths: Sequence[int], sides: Sequence[Callable[[str, int], str]]
) -> list[str]:
    padded = ([side(cell, width) for cell, width, side in zip(row, widths, sides, strict=True)] for row in rows)
    return ["   ".join(row).rstrip() for row in padded]


def _wrapped(line: str, width: float) -> list[str]:
    """Return `line`, if it is too long, as several with its indentation and two more."""
    if len(line) <= width:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    return wrap(line, int(width), subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False)


def left_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return columns of texts, all to the left."""
    return table_text(Table(texts(*heads), list(rows)))


def printable_lines(text: str) -> str:
    """Return `text` with its lines, escaping lines with unprintable characters."""
    return "\n".join(map(printable, text.split("\n")))


def printable(value: object) -> str:
    """Return a text as one line that can be printed: a record must not write on the terminal by itself.

    Escaped is what cannot be printed, and that alone: a space of any width can.
    """
    text = str(value)
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() or category(each) == "Zs" else ascii(each)[1:-1] for each in text)
