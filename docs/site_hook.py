# noqa: INP001 - a hook of mkdocs, not a package
"""Puts the pages outside docs/ on the site too, so that one link works on GitHub and there.

On the site docs/ is the top: README.md (the first page), CHANGELOG.md and others of its kind, examples/ and those of
the rack are put beside what is in it, and links that lead out of docs/ or into it are turned. Pages that programs write
(command line, API, formats, fault matrix, cards of the simulated instruments) are made with the site, not kept in git.
Equations become MathML, which browsers show without a script.
"""

from __future__ import annotations

import csv
import posixpath
import re
import sys
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files
from simrack.card import page as conformance_page

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))

from make_api import api_page  # noqa: E402
from make_cli import cli_page  # noqa: E402
from make_faults import fault_page  # noqa: E402
from make_formats import formats_page  # noqa: E402

WRITTEN = {
    "cli.md": cli_page,
    "api.md": api_page,
    "formats.md": formats_page,
    "evidence/fault-matrix.md": fault_page,
    "simrack/docs/conformance.md": conformance_page,
}
"""Pages that programs write."""
PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "RELEASING.md", "experiments/README.md", "simrack/README.md")
FOLDERS = ("examples", "simrack/docs", "simrack/examples")
EXAMPLES = {".ipynb", ".md", ".py", ".toml", ".csv", ".xml"}
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")
FIGURES = re.compile(r"^\[([\w-]+\.csv)\]\(\1\)$", re.MULTILINE)
"""A link alone on its line to a table of figures, which the site shows in its place."""
FENCE = re.compile(r"^(```\w+) \w+$", re.MULTILINE)
"""What stands behind a block's language (`sh hardware`) is for the tests."""

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
"""As pymdownx.arithmatex leaves it."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is outside docs/."""
    beside = [path for name in FOLDERS for path in (ROOT / name).rglob("*") if path.suffix in EXAMPLES]
    for path in [*(ROOT / name for name in PAGES), *beside]:
        files.append(File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path)))
    for name, write in WRITTEN.items():
        files.append(File.generated(config, name, content=write()))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Turn the links of a page."""
    source = page.file.src_uri
    home = source if (ROOT / source).exists() or source.startswith(FOLDERS) else f"docs/{source}"

    def turned(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(home), link[1]))
        return posixpath.relpath(target.removeprefix("docs/"), posixpath.dirname(source) or ".")

    shown = FIGURES.sub(lambda link: table_of(ROOT / posixpath.dirname(home) / link[1]), markdown)
    return FENCE.sub(r"\1", LINK.sub(turned, shown))


def table_of(path: Path) -> str:
    """Return a file of comma-separated values as a table."""
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def on_page_content(html: str, **_: object) -> str:
    """Turn the equations of a page into MathML."""
    return EQUATION.sub(lambda math: convert(unescape(math[3]), display="inline" if math[2] == "(" else "block"), html)
