"""Records as another version would have written them: a journal is changed, and its lines are sealed again."""

from __future__ import annotations

import json

from vcfbench.records.seal import Sealer

__all__ = ["sealed"]


def sealed(journal: bytes) -> bytes:
    """Return a journal whose lines have seals of what stands before them; a line that is torn stays as it is."""
    *lines, torn = journal.split(b"\n")
    sealer, made = Sealer(), []
    for line in lines:
        values = {key: value for key, value in json.loads(line).items() if key != "seal"}
        made.append(sealer.sealed(json.dumps(values, separators=(",", ":")).encode()))
        sealer.keep()
    return b"".join([*made, torn])
