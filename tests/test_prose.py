"""Habits that make prose a riddle are rare, and become rarer: the limits may only be lowered."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
CODE = re.compile(r"^```.*?^```|`[^`]*`|\$[^$]*\$|\]\([^)]*\)", re.MULTILINE | re.DOTALL)
HABITS = {
    "a clause as a noun": (r"what", 3.5),
    "that of": (r"(?:that|those) of", 0.4),
    "nobody, nothing, none": (r"nobody|nothing|none", 1.8),
    "where for if": (r"where (?:there|it|a|the|one|no|some|nothing|nobody)", 0.25),
    "stand, beside, likewise, told": (r"stands?|besides?|likewise|thereby|upon|told|tells", 1.2),
}
"""Words of each habit, and how many of a thousand words they may be."""


@cache
def prose() -> str:
    pages = (page for page in sorted(DOCS.rglob("*.md")) if page.name != "style.md")
    return "\n".join(CODE.sub(" ", page.read_text(encoding="utf-8")) for page in pages)


@pytest.mark.parametrize("habit", HABITS)
def test_habit_is_rare(habit: str) -> None:
    words, limit = HABITS[habit]
    found = len(re.findall(rf"\b(?:{words})\b", prose(), re.IGNORECASE))
    assert 1000.0 * found / len(re.findall(r"[A-Za-z]+", prose())) <= limit


MOST_WORDS = 70_000


def test_pages_by_hand_stay_short() -> None:
    """Who adds a page takes a repeated one away: the changelog and pages of others do not count."""
    folders = [path for name in ("docs", "simrack", "examples", "experiments") for path in (ROOT / name).rglob("*.md")]
    pages = [*(path for path in ROOT.glob("*.md") if path.name != "CHANGELOG.md"), *folders]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= MOST_WORDS
