"""The documentation as a site: it builds strictly, and a browser without a network shows all of it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FETCHED = re.compile(r'<(?:script|img|iframe|source|link)[^>]* (?:src|href)="?(?:https?:)?//[^">]*')


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build it; a link or an anchor that leads nowhere, or a page without a place, is an error."""
    pytest.importorskip("mkdocs", reason="pip install '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONWARNINGS": "ignore"}  # --quiet would count none
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_has_its_place() -> None:
    """A page that is new goes into `nav` of mkdocs.yml: tutorial, how-to, reference or explanation."""
    places = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert {page for page in pages if not re.search(rf"[ :-] {re.escape(page)}$", places, re.MULTILINE)} == set()


@pytest.mark.exhaustive
def test_it_fetches_nothing_from_elsewhere(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 30
    assert {page.name: FETCHED.findall(page.read_text(encoding="utf-8")) for page in pages} == {
        page.name: [] for page in pages
    }
    sheets = "".join(sheet.read_text(encoding="utf-8") for sheet in site.rglob("*.css"))
    assert not re.search(r"url\([\"']?(?:https?:)?//", sheets)


@pytest.mark.exhaustive
def test_equations_need_no_script(site: Path) -> None:
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count("<math") > 100
    assert "arithmatex" not in theory


@pytest.mark.exhaustive
def test_pages_outside_docs_and_blocks_of_all_kinds_are_there(site: Path) -> None:
    first = (site / "index.html").read_text(encoding="utf-8")
    assert 'href="tutorials/first-run.html"' in first
    assert (site / "CHANGELOG.html").exists()
    assert (site / "examples" / "own-procedure" / "hysteresis.py").exists()
    assert "```" not in first
