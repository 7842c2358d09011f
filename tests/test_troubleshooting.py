"""What docs/troubleshooting.md quotes is what the program says."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROW = re.compile(r"^\| `([^`]+)` \|", re.MULTILINE)
COMMAND = "vcfbench "
NO_MESSAGE = re.compile(r'"""[\s\S]*?"""|#.*')
JOINT = re.compile(r"[\"']\s+f?[\"']")
"""Where a message goes on in the next line."""


def quoted() -> list[str]:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    return [words for words in ROW.findall(page) if not words.startswith(COMMAND)]


def messages(source: str) -> str:
    """The code without docstrings and comments, its messages whole."""
    return JOINT.sub("", NO_MESSAGE.sub("", source))


def test_there_are_many() -> None:
    assert len(quoted()) > 30


def test_the_messages_are_in_the_code() -> None:
    paths = [path for part in ("vcfbench", "simrack/simrack") for path in (ROOT / part).rglob("*.py")]
    sources = [path.read_text(encoding="utf-8") for path in paths]
    parts = {message: [part for part in message.split("...") if part.strip(" .,:;()")] for message in quoted()}
    assert all(parts.values())
    said = "\n".join(map(messages, sources))
    missing = {part for each in parts.values() for part in each if part not in said}
    assert missing == set(), "change docs/troubleshooting.md with the message"
