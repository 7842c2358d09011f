"""A report as one page."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest

from tests.reports.test_text import FIGURE
from vcfbench.reports.document import Heading, Notice, Report, Text
from vcfbench.reports.html_page import page_of
from vcfbench.reports.plot import INK

NASTY = '</style><script>alert(1)</script>"\\'
REPORT = Report([Heading("Title"), Notice("look"), Heading("One", 2), Text(NASTY), FIGURE, Heading("Two", 2), FIGURE])


class Elements(HTMLParser):
    """What stands in a page: its elements, their ids, and what they ask for."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.ids += [value or "" for name, value in attrs if name == "id"]
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]


@pytest.fixture(scope="module")
def page() -> str:
    return page_of(REPORT, "w", "r")


def test_page_has_sections_and_figures_in_one_file(page: str) -> None:
    seen = Elements(page)
    assert (seen.tags.count("section"), seen.tags.count("figure"), seen.tags.count("h1")) == (3, 2, 1)
    assert len(seen.ids) == len(set(seen.ids))
    assert all(address.startswith("#") for address in seen.addresses)
    assert not {"script", "link", "img", "iframe"} & set(seen.tags)
    assert "http" not in page.replace("http://www.w3.org/", "")  # names of namespaces


@pytest.mark.parametrize("printed", [False, True])
def test_no_word_of_a_record_becomes_part_of_the_page(*, printed: bool) -> None:
    page = page_of(REPORT, NASTY, NASTY, printed=printed)
    assert "script" not in Elements(page).tags
    assert page.count("</style>") == 1
    assert "&lt;script&gt;" in page


@pytest.mark.exhaustive
def test_figures_are_read_on_dark_ground_and_on_paper(page: str) -> None:
    assert INK not in page.partition("<body>")[2]
    assert INK in page_of(REPORT, "w", "r", printed=True).partition("<body>")[2]


def test_the_same_report_gives_the_same_bytes(page: str) -> None:
    assert page_of(REPORT, "w", "r") == page


@pytest.mark.exhaustive
def test_first_page_style_needs_first_page(page: str) -> None:
    assert 'class="front"' not in page
    assert '<section class="front">\n<h1>' in page_of(REPORT, "w", "r", logo="")
    assert '<section class="front">\n<img class="logo"' in page_of(REPORT, "w", "r", logo="data:image/png;base64,AA==")
