"""A report as HTML: a part for notebooks, or one self-contained page, the source of the PDF."""

import re
from collections.abc import Callable, Sequence
from html import escape
from importlib.resources import files
from itertools import count
from typing import Final

from vcfbench.reports.document import Column, Figure, Heading, Notice, Part, Report, Table, Text
from vcfbench.reports.plot import FLAT_IN, GRID, INK, PALETTE, caption_of, svg_of
from vcfbench.reports.text import printable_lines
from vcfbench.reports.typography import marked_up

_SHORT: Final = 28  # Texts of so many characters stay in one line of a table: names, numbers, units


_THEMED: Final = {INK: "var(--ink)", GRID: "var(--line)"} | {
    colour: f"var(--series-{number})" for number, colour in enumerate(PALETTE, start=1)
}
"""Substitute for each colour in the drawings of a page for screens, so that they are read on dark ground."""


def html_of(report: Report, draw: Callable[[Figure], str] | None = None) -> str:
    """Return the parts one after the other: headings, tables with their digits, texts in their lines.

    `draw` makes an element of each figure; without it figures are left out.
    """
    pieces = (_part(part, draw) for part in report.parts)
    return "\n".join(piece for piece in pieces if piece)


def escaped(text: str) -> str:
    """Return `text` escaped for HTML, quotes and unprintable characters included."""
    return escape(printable_lines(text))


def _part(part: Part, draw: Callable[[Figure], str] | None) -> str:
    match part:
        case Heading():
            return f"<h{part.level}>{_set(part.text)}</h{part.level}>"
        case Table():
            columns = part.columns
            caption = f"<caption>{_set(part.title)}</caption>" if part.title else ""
            heads = _row("th", [column.head for column in columns], columns) if part.has_heads else ""
            head = f"<thead>{heads}</thead>" if heads else ""
            body = "".join(_row("td", row, columns) for row in part.printed())
            return f'<div style="overflow-x:auto"><table>{caption}{head}<tbody>{body}</tbody></table></div>'
        case Text():
            return f"<pre>{(escaped if part.verbatim else _set)(part.text)}</pre>"
        case Notice():
            return f'<p class="notice {part.kind}"><strong>{_set(part.text)}</strong></p>'
        case Figure():
            return "" if draw is None else draw(part)


def _row(tag: str, cells: Sequence[str], columns: Sequence[Column]) -> str:
    made = []
    for text, column in zip(cells, columns, strict=True):
        whole = ";white-space:nowrap" if len(text) <= _SHORT else ""
        said = escaped(text) if column.verbatim else _set(text)
        made.append(f'<{tag} style="text-align:{column.align}{whole}">{said}</{tag}>')
    return f"<tr>{''.join(made)}</tr>"


def _set(text: str) -> str:
    """Return `text` as HTML, its names and units set as on paper."""
    return marked_up(text, escaped)


def page_of(report: Report, title: str, name: str, *, printed: bool = False, logo: str | None = None) -> str:
    """Return the whole page of `report`.

    Args:
        report: what is shown; headings of level 2 begin sections.
        title: of the window.
        name: stands at the head of each printed page: the run's.
        printed: made for paper alone, so that drawings keep their colours.
        logo: address of a picture that stands above all, such as ``data:image/png;base64,...``, empty for none; None
            where the first section is not the first page of a certificate.
    """
    numbers = count(1)

    def draw(figure: Figure) -> str:
        number = next(numbers)
        on_first = printed and number == 1 and logo is not None  # on paper the first page holds it
        svg = svg_of(figure, f"f{number}", **({"size_in": FLAT_IN} if on_first else {}))
        if not printed:
            for colour, themed in _THEMED.items():
                svg = svg.replace(colour, themed)
        return _captioned(figure, number, svg)

    sections: list[list[Part]] = []
    for part in report.parts:
        if not sections or (isinstance(part, Heading) and part.level <= 2):
            sections.append([])
        sections[-1].append(part)
    drawn = [html_of(Report(section), draw) for section in sections]
    first = f'<img class="logo" alt="" src="{escaped(logo)}">\n' if logo else ""
    begun = '<section class="front">' if logo is not None else "<section>"
    front = [f"{begun}\n{first}{each}\n</section>" for each in drawn[:1]]
    body = "\n".join([*front, *(f"<section>\n{each}\n</section>" for each in drawn[1:])])
    # the name as it can stand in quotes in a style sheet: all but letters, digits and - by their number
    head = re.sub(r"[^A-Za-z0-9-]", lambda each: f"\\{ord(each[0]):06x}", name)
    style = files("vcfbench.reports").joinpath("page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escaped(title)}</title>\n<style>\n{style}"
        f'@page {{ @top-left {{ content: "{head}"; }} }}\n</style>\n</head>\n'
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def piece_of(report: Report, name: str) -> str:
    """Return the report as a part of HTML with its figures, on white, for a notebook.

    `name` keeps the ids of its drawings apart from those of other pieces.
    """
    numbers = count(1)

    def draw(figure: Figure) -> str:
        drawn = _captioned(figure, (number := next(numbers)), svg_of(figure, f"{name}-{number}"))
        return drawn.replace("<figure>", '<figure style="max-width:44rem;background:#fff;color:#20262e">', 1)

    return html_of(report, draw)


def _captioned(figure: Figure, number: int, svg: str) -> str:
    # a title of its own: what is read aloud in place of the picture
    svg = svg.replace("<svg ", f'<svg role="img" aria-label="{escaped(figure.title)}" ', 1)
    below = f" {_set(caption)}" if (caption := caption_of(figure)) else ""
    words = f"<figcaption><b>Figure {number}.</b> {_set(figure.title)}.{below}</figcaption>"
    return f"<figure>\n{svg}\n{words}\n</figure>"
