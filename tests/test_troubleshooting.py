"""What docs/troubleshooting.md quotes is what the program says."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROW = re.compile(r"^\| `([^`]+)` \|", re.MULTILINE)
COMMAND = "vcfbench "


def quoted() -> list[str]:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    return [words for words in ROW.findall(page) if not words.startswith(COMMAND)]


@cache
def messages() -> str:
    """Every text in the code but docstrings, what is filled in left out."""
    found: list[str] = []
    for path in sorted((ROOT / "vcfbench").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        texts = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in said)
        found += [node.value for node in texts if isinstance(node.value, str)]
    return "\n".join(found)


def test_there_are_many() -> None:
    assert len(quoted()) > 30


@pytest.mark.parametrize("message", quoted())
def test_the_message_is_in_the_code(message: str) -> None:
    parts = [part for part in message.split("...") if part.strip(" .,:;()")]
    assert parts
    missing = [part for part in parts if part not in messages()]
    assert missing == [], "change docs/troubleshooting.md with the message"
