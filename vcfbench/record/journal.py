"""The journal of a run: JSON lines, one a step, on the disk before the next step begins.

The first line (`header`) says who ran what on which bench; each further one (`step`) holds one step with its result,
every raw reading included, or (`error`) the step that failed; the last (`footer`) says how the run ended. A run that
was cut has no footer. Bench time is in `t_s` and `end_s`, the time of day in `utc`.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from vcfbench.clock import utc_now
from vcfbench.errors import BenchError, ConfigError
from vcfbench.record.schema import FORMAT, Point, Status

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

__all__ = ["Journal", "JournalRecord", "read_journal"]

_sync = os.fsync if sys.platform in {"darwin", "win32"} else os.fdatasync
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


class Journal:
    """An append-only file; never opens one that is there already.

    Raises:
        BenchError: a line could not be written whole (disk full, file system gone).
    """

    __slots__ = ("_descriptor", "path")

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = os.open(path, _FLAGS, 0o644)

    def header(self, values: Mapping[str, Any]) -> None:
        """Write the first line."""
        self._append({"type": "header", "format": FORMAT, "utc": _stamp(), **values})

    def step(self, values: Mapping[str, Any]) -> None:
        """Write one performed step."""
        self._append({"type": "step", "utc": _stamp(), **values})

    def error(self, values: Mapping[str, Any]) -> None:
        """Write one failed step, with what it measured before it failed."""
        self._append({"type": "error", "utc": _stamp(), **values})

    def footer(self, values: Mapping[str, Any]) -> None:
        """Write the last line."""
        self._append({"type": "footer", "utc": _stamp(), **values})

    def close(self) -> None:
        """Give the file back."""
        os.close(self._descriptor)

    def _append(self, line: Mapping[str, Any]) -> None:
        """Write one line with one system call, so that no other can come between, and see it to the disk."""
        data = msgspec.json.encode(line) + b"\n"
        try:
            written = os.write(self._descriptor, data)
            _sync(self._descriptor)
        except OSError as error:
            raise BenchError(f"the record {self.path} cannot be written: {error.strerror}") from error
        if written != len(data):
            raise BenchError(f"the record {self.path} cannot be written: the disk took {written} of {len(data)} bytes")


def _stamp() -> str:
    return utc_now().isoformat(timespec="microseconds")


@dataclass(frozen=True, slots=True)
class JournalRecord:
    """What a journal holds; `torn` tells that it ends in the middle of a line, or has one that is none."""

    header: Mapping[str, Any]
    steps: tuple[Mapping[str, Any], ...]
    errors: tuple[Mapping[str, Any], ...]
    footer: Mapping[str, Any] | None
    torn: bool

    @property
    def status(self) -> Status:
        """How the run ended; a record without a readable last line is incomplete."""
        if self.footer is None or self.torn:
            return Status.INCOMPLETE
        return Status(self.footer["status"])

    @property
    def points(self) -> tuple[Point, ...]:
        """Every averaged point that is on the disk."""
        return tuple(Point.from_json(step["point"]) for step in self.steps if "point" in step)


def read_journal(path: Path) -> JournalRecord:
    """Read a journal, whole or cut at any byte.

    Raises:
        ConfigError: the file is not there, is no journal of a known format, or was not written by a Journal.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    record = _record(data, path)
    try:
        _ = record.status, record.points, dict(record.header.get("bench", {}))
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path}: no record of this program: {error!r}") from error
    return record


def _record(data: bytes, path: Path) -> JournalRecord:
    lines = list(_whole_lines(data))
    header = lines[0] if lines and lines[0].get("type") == "header" else {}
    if header.get("format", FORMAT) != FORMAT:
        raise ConfigError(f"{path}: a record of format {header.get('format')}; this version reads format {FORMAT}")
    footers = _of_type(lines, "footer")
    return JournalRecord(
        header,
        _of_type(lines, "step"),
        _of_type(lines, "error"),
        footers[-1] if footers else None,
        torn=not data.endswith(b"\n") or len(lines) != data.count(b"\n"),
    )


def _whole_lines(data: bytes) -> Iterator[dict[str, Any]]:
    """Yield the lines up to the first that is not a whole JSON object: what comes after a torn line proves nothing."""
    *whole, _rest = data.split(b"\n")
    for line in whole:
        try:
            yield msgspec.json.decode(line, type=dict[str, Any])
        except msgspec.DecodeError:
            return


def _of_type(lines: list[dict[str, Any]], kind: str) -> tuple[dict[str, Any], ...]:
    return tuple(line for line in lines if line.get("type") == kind)
