"""The page of what was seen on real instruments is made of the bundles beside this file."""

from __future__ import annotations

import runpy
from pathlib import Path

DOCS = Path(__file__).parents[3] / "docs"


def test_the_page_is_as_its_script_makes_it() -> None:
    assert (DOCS / "seen-on.md").read_text("utf-8") == runpy.run_path(str(DOCS / "make_seen_on.py"))["page"]()
