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


def messages() -> str:
    """Every text in the code but docstrings, what is filled in left out."""
    found: list[str] = []
    for path in sorted(path for part in ("vcfbench", "simrack/simrack") for path in (ROOT / part).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        texts = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in said)
        found += [node.value for node in texts if isinstance(node.value, str)]
    return "\n".join(found)


def test_there_are_many() -> None:
    assert len(quoted()) > 30


def test_the_messages_are_in_the_code() -> None:
    said = messages()
    parts = {message: [part for part in message.split("...") if part.strip(" .,:;()")] for message in quoted()}
    assert all(parts.values())
    missing = [part for each in parts.values() for part in each if part not in said]
    assert missing == [], "change docs/troubleshooting.md with the message"
