"""Records as another version would have written them: a journal is changed, and its lines are sealed again."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

from vcfbench.records.seal import Sealer

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["another", "sealed"]


def sealed(journal: bytes) -> bytes:
    """Return a journal whose lines have seals of what stands before them; a line that is torn stays as it is."""
    *lines, torn = journal.split(b"\n")
    sealer, made = Sealer(), []
    for line in lines:
        values = {key: value for key, value in json.loads(line).items() if key != "seal"}
        made.append(sealer.sealed(json.dumps(values, separators=(",", ":")).encode()))
        sealer.keep()
    return b"".join([*made, torn])


def another(record: Path, directory: Path) -> None:
    """Make one more record like `record`, which has its own name: no copy."""
    shutil.copytree(record, directory)
    journal = directory / "journal.jsonl"
    header, rest = journal.read_bytes().split(b"\n", 1)
    named = json.dumps({**json.loads(header), "run": directory.name}, separators=(",", ":"))
    journal.write_bytes(sealed(named.encode() + b"\n" + rest))
