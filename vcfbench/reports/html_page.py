"""A report as one page: HTML that needs nothing beside itself, and the source of the PDF."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING, Final

from vcfbench.reports.document import Heading, Report
from vcfbench.reports.html import escaped, html_of
from vcfbench.reports.plot import FLAT_IN, GRID, INK, PALETTE, caption_of, svg_of
from vcfbench.reports.typography import marked_up

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.reports.document import Figure, Part

_THEMED: Final = {INK: "var(--ink)", GRID: "var(--line)"} | {
    colour: f"var(--series-{number})" for number, colour in enumerate(PALETTE, start=1)
}
"""Substitute for each colour in the drawings of a page for screens, so that they are read on dark ground."""


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
    numbers = iter(range(1, len(report.parts) + 1))

    def draw(figure: Figure) -> str:
        number = next(numbers)
        size = (
            {"size_in": FLAT_IN} if printed and number == 1 and logo is not None else {}
        )  # on paper the first page holds it
        svg = svg_of(figure, f"f{number}", **size)
        if not printed:
            for colour, themed in _THEMED.items():
                svg = svg.replace(colour, themed)
        return _captioned(figure, number, svg)

    drawn = [html_of(Report(part), draw) for part in _sections(report)]
    first = f'<img class="logo" alt="" src="{escaped(logo)}">\n' if logo else ""
    begun = '<section class="front">' if logo is not None else "<section>"
    front = [f"{begun}\n{first}{each}\n</section>" for each in drawn[:1]]
    body = "\n".join([*front, *(f"<section>\n{each}\n</section>" for each in drawn[1:])])
    style = files("vcfbench.reports").joinpath("page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escaped(title)}</title>\n<style>\n{style}"
        f'@page {{ @top-left {{ content: "{_in_style(name)}"; }} }}\n</style>\n</head>\n'
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _sections(report: Report) -> Iterator[list[Part]]:
    """Yield the parts section by section."""
    section: list[Part] = []
    for part in report.parts:
        if section and isinstance(part, Heading) and part.level <= 2:
            yield section
            section = []
        section.append(part)
    if section:
        yield section


def piece_of(report: Report, name: str) -> str:
    """Return the report as a piece of HTML with its figures, for a notebook: on white, whatever is around it.

    `name` keeps the ids of its drawings apart from those of other pieces.
    """
    numbers = iter(range(1, len(report.parts) + 1))

    def draw(figure: Figure) -> str:
        drawn = _captioned(figure, (number := next(numbers)), svg_of(figure, f"{name}-{number}"))
        return drawn.replace("<figure>", '<figure style="max-width:44rem;background:#fff;color:#20262e">', 1)

    return html_of(report, draw)


def _captioned(figure: Figure, number: int, svg: str) -> str:
    # a title of its own: what is read aloud in place of the picture
    svg = svg.replace("<svg ", f'<svg role="img" aria-label="{escaped(figure.title)}" ', 1)
    below = f" {marked_up(caption, escaped)}" if (caption := caption_of(figure)) else ""
    words = f"<figcaption><b>Figure {number}.</b> {marked_up(figure.title, escaped)}.{below}</figcaption>"
    return f"<figure>\n{svg}\n{words}\n</figure>"


def _in_style(text: str) -> str:
    """Return `text` as it can stand in quotes in a style sheet: all but letters, digits and ``-`` by their number."""
    return "".join(
        each if each.isascii() and (each.isalnum() or each == "-") else f"\\{ord(each):06x}" for each in text
    )
