"""What docs/troubleshooting.md quotes is what the program says."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROW = re.compile(r"^\| `([^`]+)` \|", re.MULTILINE)
COMMAND = "vcfbench "


def quoted() -> list[str]:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    return [words for words in ROW.findall(page) if not words.startswith(COMMAND)]


def messages(source: str) -> str:
    """Every text in the code but docstrings, what is filled in left out."""
    nodes = list(ast.walk(ast.parse(source)))
    said = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    texts = (node.value for node in nodes if isinstance(node, ast.Constant) and id(node) not in said)
    return "\n".join(text for text in texts if isinstance(text, str))


def test_there_are_many() -> None:
    assert len(quoted()) > 30


def test_the_messages_are_in_the_code() -> None:
    paths = [path for part in ("vcfbench", "simrack/simrack") for path in (ROOT / part).rglob("*.py")]
    sources = [path.read_text(encoding="utf-8") for path in paths]
    parts = {message: [part for part in message.split("...") if part.strip(" .,:;()")] for message in quoted()}
    assert all(parts.values())
    missing = {part for each in parts.values() for part in each}
    for source in sorted(sources, key=lambda source: -sum(part in source for part in missing)):
        if missing:
            said = messages(source)
            missing = {part for part in missing if part not in said}
    assert missing == set(), "change docs/troubleshooting.md with the message"
