"""The journal of a study: one JSON line a finished run, on the disk before the study goes on.

Its first line tells which study it is of. A line that was cut off, as that of a study that was killed, is no line: the
run is done again.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from vcfbench.clock import WallClock
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import failing_as, opened, shown, try_lock
from vcfbench.studies.one_run import RunRow
from vcfbench.studies.vary import Drawn  # msgspec reads the annotation

FORMAT = 1
_TO_DISK_S = 1.0
"""Seconds after which what was written goes to the disk: at most so much is done again after a power cut."""


class Begun(Struct, frozen=True, tag="study", tag_field="type"):
    """The first line: the study's title, procedure and bench, and its fingerprint."""

    fingerprint: str
    title: str
    procedure: str
    bench: str
    labels: dict[str, str]
    cases: tuple[dict[str, Any], ...]
    drawn: tuple[Drawn, ...] = ()
    format: int = FORMAT


_HEAD = msgspec.json.Decoder(Begun)
_ROW = msgspec.json.Decoder(RunRow)


@contextmanager
def kept(
    path: Path, begun: Begun, *, restart: bool
) -> Iterator[tuple[Callable[[RunRow], None], dict[tuple[int, int], RunRow]]]:
    """Open the journal at `path`; yield a function that adds a row, and the rows that are there, by case and seed.

    Raises:
        ConfigError: it is that of another study, or no journal, and `restart` is not asked for.
        BenchError: it cannot be written, or a study that goes on writes it.
    """
    with failing_as(BenchError, f"{shown(path)}: the journal cannot be written"), path.open("ab") as file:
        with suppress(OSError):  # a file system without locks; the system lets one go with the process
            if not try_lock(file.fileno()):
                words = f"{shown(path)}: another study writes this journal now"
                raise BenchError(words, hint="wait for its end, or choose another -o")
        _, had, whole = (None, {}, 0) if restart else rows_of(path, begun)
        file.truncate(whole)
        clock, on_disk_s = WallClock(), 0.0

        def add(line: Begun | RunRow) -> None:
            nonlocal on_disk_s
            file.write(msgspec.json.encode(line) + b"\n")
            file.flush()
            if clock.now() - on_disk_s >= _TO_DISK_S:
                os.fsync(file.fileno())
                on_disk_s = clock.now()

        if not whole:
            add(begun)
        try:
            yield add, had
        finally:
            os.fsync(file.fileno())


def rows_of(path: Path, expected: Begun | None = None) -> tuple[Begun | None, dict[tuple[int, int], RunRow], int]:
    """Return first line and rows of a study's journal, and the number of its bytes whole lines.

    The first line is None where it was cut off. Rows are by case and seed.

    Raises:
        ConfigError: it cannot be read, is no journal of a study, or that of another one than is expected.
    """
    rows: dict[tuple[int, int], RunRow] = {}
    whole = 0
    with opened(path, "the journal of a study") as file:
        first = file.readline()
        if not first.endswith(b"\n"):
            if first and not first.startswith(b'{"type":"study"'[: len(first)]):
                raise ConfigError(f"{shown(path)}: not a study journal")
            return None, rows, 0
        try:
            begun = _HEAD.decode(first)
            if begun.format != FORMAT:
                raise ConfigError(f"{shown(path)}: a study of format {begun.format}; this version reads {FORMAT}")
            whole = len(first)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                row = _ROW.decode(line)
                rows[row.case, row.seed] = row
                whole += len(line)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            where = f"line {len(rows) + 2}" if whole else "line 1"
            raise ConfigError(f"{shown(path)}: {where} is not a line of a study journal: {error}") from None
    if expected is not None and begun.fingerprint != expected.fingerprint:
        raise ConfigError(
            f"{shown(path)}: this is the journal of another study: procedure, bench, "
            "settings, varied values, metrics or version differ",
            hint="--restart replaces it; another -o keeps both",
        )
    return begun, rows, whole
