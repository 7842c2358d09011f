# noqa: INP001 - a script, not a package
"""Draws the README's picture anew, the first page of a report on the simulated bench: `python docs/make_figures.py`."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import vcfbench
from vcfbench.archive.reported import full_report, title_of
from vcfbench.reports.document import Report
from vcfbench.reports.html_page import page_of

NAME = "report-first-page.svg"
SIZE = (940, 1390)
WORDS = {"laboratory": "Gyroscope Laboratory", "laboratory_address": "1 Example Street", "customer": "ACME Ltd"}
_PAGE = re.compile(r"<style>\n(.*?)</style>.*?(<body>.*?</section>)", re.DOTALL)


def draw(folder: Path) -> None:
    """Run the calibration on the paper's bench, and write the first page of its report into `folder`."""
    with TemporaryDirectory() as runs:
        run = vcfbench.run("virtual-coriolis", runs=runs, metadata={"dut": "G-0042", "operator": "A. Person"})
        parts = full_report(run, WORDS).parts
    sections = [place for place, part in enumerate(parts) if getattr(part, "level", 0) == 2]
    found = _PAGE.search(page_of(Report(parts[: sections[0]]), title_of(run), "report", printed=True, logo=""))
    assert found is not None  # noqa: S101  # a page has a style and a section
    style, body = found[1].partition("@media (max-width")[0], found[2].replace("<body>", '<div class="body">')
    width, height = SIZE
    lines = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/><foreignObject width="{width}" height="{height}">',
        f'<div xmlns="http://www.w3.org/1999/xhtml"><style>{_light(style)}</style>',
        f"{body}</main></div></div></foreignObject></svg>",
    )
    text = "\n".join(line.rstrip() for line in "\n".join(lines).splitlines())
    (folder / NAME).write_text(text + "\n", encoding="utf-8", newline="\n")


def _light(style: str) -> str:
    """Return the style of the page for a picture: always light, and of an element in place of a body."""
    style = re.sub(r"@media screen and.*?\n}\n", "", style, flags=re.DOTALL)
    return style.replace("color-scheme: light dark;", "").replace("\nbody {", "\n.body {").replace("&", "&amp;")


if __name__ == "__main__":
    draw(Path(__file__).parent)
