"""Record of raw commands, sent by a person past the limits of the bench.

``raw.jsonl`` beside the runs, one line a command, on the disk before the command is sent.
"""

import os
from pathlib import Path

import msgspec

from vcfbench.clock import utc_now
from vcfbench.errors import BenchError


class RawRecord:
    """Record of the raw commands that a bench is sent, ``raw.jsonl`` in `directory`.

    Raises:
        BenchError: a line cannot be written; the command is not sent then.
    """

    def __init__(self, directory: Path, bench: str) -> None:
        self.path = directory / "raw.jsonl"
        self._bench = bench

    def add(self, role: str, resource: str, message: str) -> None:
        """Append `message`, which `role` at `resource` is about to be sent."""
        utc = utc_now().isoformat(timespec="seconds")
        line = {"utc": utc, "bench": self._bench, "role": role, "resource": resource, "command": message}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as file:
                file.write(msgspec.json.encode(line) + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise BenchError(
                f"the record {self.path} cannot be written: {error.strerror}",
                instrument=role,
                command=message,
                hint="nothing was sent",
            ) from error
