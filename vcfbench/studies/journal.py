"""The journal of a study: one JSON line a finished run, on the disk before the study goes on.

Its first line tells which study it is of. A line that was cut off, as that of a study that was killed, is no line: the
run is done again.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import msgspec
from msgspec import Struct

from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import failing_as, opened, shown, try_lock
from vcfbench.studies.one_run import RunRow
from vcfbench.studies.vary import Drawn  # msgspec reads the annotation

FORMAT = 1


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

    def drawn_for(self, seeds: Iterable[int]) -> dict[int, dict[str, Any]]:
        """Return the values drawn for each seed, by label."""
        if not self.drawn:
            return {}
        return {seed: {each.label: each.value(seed) for each in self.drawn} for seed in seeds}


_HEAD = msgspec.json.Decoder(Begun)
_ROW = msgspec.json.Decoder(RunRow)


class StudyJournal:
    """Rows that are kept as they come; open as long as the study goes; BenchError: the disk took no more."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path = path
        self._file = file

    def add(self, lines: Iterable[object]) -> None:
        """Write lines and see them to the disk."""
        with failing_as(BenchError, f"{shown(self.path)}: the journal cannot be written"):
            self._file.writelines(msgspec.json.encode(line) + b"\n" for line in lines)
            self._file.flush()
            os.fsync(self._file.fileno())


@contextmanager
def kept(path: Path, begun: Begun, *, restart: bool) -> Iterator[tuple[StudyJournal, dict[tuple[int, int], RunRow]]]:
    """Open the journal at `path`, and yield it with the rows that are there, by case and seed.

    Raises:
        ConfigError: it is that of another study, or no journal, and `restart` is not asked for.
        BenchError: it cannot be written, or a study that goes on writes it.
    """
    with failing_as(BenchError, f"{shown(path)}: the journal cannot be written"), path.open("ab") as file:
        with suppress(OSError):  # a file system without locks; the system lets one go with the process
            if not try_lock(file.fileno()):
                words = f"{shown(path)}: another study writes this journal now"
                raise BenchError(words, hint="wait for its end, or choose another -o")
        had, whole = ({}, 0) if restart else rows_of(path, begun)
        file.truncate(whole)
        journal = StudyJournal(path, file)
        if not whole:
            journal.add([begun])
        yield journal, had


def rows_of(path: Path, begun: Begun) -> tuple[dict[tuple[int, int], RunRow], int]:
    """Return the rows that are there of the study that `begun` says, and how many bytes of the journal are whole.

    Raises:
        ConfigError: it is that of another study, or no journal.
    """
    found, had, whole = _read(path)
    if found is not None and found.fingerprint != begun.fingerprint:
        raise ConfigError(
            f"{shown(path)}: expected the journal of this study, it is that of another: procedure, bench, "
            "settings, what varies, metrics or version have changed",
            hint="--restart begins anew; or another -o keeps both",
        )
    return had, whole


def read_rows(path: Path) -> tuple[Begun, dict[tuple[int, int], RunRow]]:
    """Return the first line of a study's journal and every row, by case and seed.

    Raises:
        ConfigError: it cannot be read, or is no journal of a study.
    """
    begun, rows, _ = _read(path)
    if begun is None:
        raise ConfigError(f"{shown(path)}: expected the journal of a study, its first line is none")
    return begun, rows


def _read(path: Path) -> tuple[Begun | None, dict[tuple[int, int], RunRow], int]:
    """Return first line, rows, and their number of bytes: any after them are of a line that was cut off."""
    rows: dict[tuple[int, int], RunRow] = {}
    whole = 0
    with opened(path, "the journal of a study") as file:
        first = file.readline()
        if not first.endswith(b"\n"):
            if first and not first.startswith(b'{"type":"study"'[: len(first)]):
                raise ConfigError(f"{shown(path)}: expected the journal of a study, this is something else")
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
            raise ConfigError(f"{shown(path)}: {where} is none of the journal of a study: {error}") from None
    return begun, rows, whole
