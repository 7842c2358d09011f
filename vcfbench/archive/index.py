"""Lists of records: from an index where there is one, a SQLite file beside them with the summary of each.

The records are the truth. Before an index answers, it is held against them: what was added, changed or taken away since
is read anew, and a file that cannot be read as an index is made again. Nothing is in it that is not in the records.
"""

import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct, structs

from vcfbench.archive.summary import KeyResult, RunSummary, Selection, ordered, summary_of
from vcfbench.errors import ConfigError
from vcfbench.records.directory import RunDirectory, recorded_runs
from vcfbench.records.plain import ReadOnly, plain
from vcfbench.records.schema import Status

BESIDE: Final = "index.sqlite"  # Name of the index that lies with the records
_VERSION: Final = 5  # Version of the file; raised when its content changes, also in how it is made of a record
_PATIENCE_S: Final = 10  # For another program that writes


class Refreshed(Struct, frozen=True):
    """Work of bringing an index up to date: numbers of records in all, read, and gone."""

    records: int
    read: int
    gone: int
    made_again: str | None = None  # Reason for making the index again, None where the earlier one could be used


class _Unusable(Exception):
    """The file is no index of this version."""


def run_summaries(
    runs: str | Path = "runs",
    *,
    dut: str | None = None,
    since: str | datetime | None = None,
    status: str | None = None,
    procedure: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> tuple[RunSummary, ...]:
    """Return summaries of the records under `runs`, oldest first; those of :func:`list_runs`, far sooner.

    An index beside the records (``vcfbench runs index``) is brought up to date and asked instead of them.
    ``pandas.DataFrame(vcfbench.run_summaries())`` makes a table of them.

    Args:
        runs: directory of the records.
        dut: only those of this device.
        since: only those that began on this day (``"2026-01-15"``, UTC) or later, or from an instant on.
        status: only those that ended so.
        procedure: only those of this procedure.
        tags: only those that have all of them.

    Raises:
        ConfigError: there is no such status, or the date is none.
    """
    chosen = Selection.of(dut, since, status, procedure=procedure, tags=dict(tags or {}))
    index = RunIndex(Path(runs))
    if index.path.is_file():
        with suppress(ConfigError):  # the records say the same, later
            index.refresh()
            return index.select(chosen)
    return ordered(each for each in map(summary_of, recorded_runs(Path(runs))) if chosen.takes(each))


class RunIndex:
    """The index of the records under `runs`."""

    def __init__(self, runs: Path) -> None:
        self._runs = runs
        self.path = runs / BESIDE

    def refresh(self, *, rebuild: bool = False) -> Refreshed:
        """Read anew the records that differ, with `rebuild` all of them; ConfigError: the file cannot be written."""
        try:
            return self._refreshed(rebuild=rebuild)
        except _Unusable as unusable:
            self.path.unlink(missing_ok=True)
            return structs.replace(self._refreshed(rebuild=rebuild), made_again=str(unusable))

    def select(self, selection: Selection) -> tuple[RunSummary, ...]:
        """Return the selected runs, oldest first; ConfigError: the file cannot be read."""
        try:
            with self._opened() as database:
                rows = database.execute("SELECT run, summary FROM runs").fetchall()
        except _Unusable as unusable:
            raise ConfigError(f"index {self.path}: {unusable}", hint="vcfbench runs index --rebuild") from unusable
        summaries = []
        for run, data in rows:
            kept, directory = msgspec.json.decode(data), self._runs / os.fsdecode(run)
            found = {
                key: KeyResult(**{**each, "missing": tuple(each["missing"])}) for key, each in kept["results"].items()
            }
            read = {
                "started": datetime.fromisoformat(kept["started"]),
                "status": Status(kept["status"]),
                "amended": tuple(kept["amended"]),
                "tags": ReadOnly(kept["tags"]),
                "results": ReadOnly(found),
            }
            summaries.append(RunSummary(run=directory.name, directory=directory, **{**kept, **read}))
        return ordered(each for each in summaries if selection.takes(each))

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        try:
            with closing(sqlite3.connect(self.path, timeout=_PATIENCE_S, isolation_level=None)) as database:
                database.execute("PRAGMA synchronous = OFF")  # an index spoilt by a power failure is made again
                yield database
        except sqlite3.OperationalError as error:
            raise ConfigError(f"index {self.path}: {error}") from error
        except sqlite3.DatabaseError as error:
            raise _Unusable(str(error)) from error

    def _refreshed(self, *, rebuild: bool) -> Refreshed:
        present = dict(self._fingerprints())
        with self._opened() as database:
            if (found := database.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
                raise _Unusable(f"the file is damaged: {found}")
            both = "SELECT (SELECT user_version FROM pragma_user_version), (SELECT count(*) FROM sqlite_master)"
            version, tables = database.execute(both).fetchone()
            if tables and version != _VERSION:
                raise _Unusable("its tables are those of another version")
            if tables and not rebuild and _known(database) == present:
                return Refreshed(len(present), 0, 0)
            database.execute("BEGIN IMMEDIATE")
            database.execute("CREATE TABLE IF NOT EXISTS runs (run BLOB PRIMARY KEY, fingerprint TEXT, summary BLOB)")
            database.execute(f"PRAGMA user_version = {_VERSION}")
            before = _known(database)
            changed = [run for run, seen in present.items() if rebuild or before.get(run) != seen]
            gone = before.keys() - present.keys()
            database.executemany("DELETE FROM runs WHERE run = ?", [(run,) for run in gone])
            for run in changed:
                summary = summary_of(RunDirectory(self._runs / os.fsdecode(run)))
                kept = {key: value for key, value in plain(summary).items() if key not in {"run", "directory"}}
                seen = "goes on" if summary.status is Status.RUNNING else present[run]  # to be killed changes no file
                row = (run, seen, msgspec.json.encode(kept))
                database.execute("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", row)
            database.execute("COMMIT")
        return Refreshed(len(present), len(changed), len(gone))

    def _fingerprints(self) -> Iterator[tuple[bytes, str]]:
        """Yield the name of each record, as bytes, with a fingerprint that tells a changed record."""
        try:
            entries = list(os.scandir(self._runs))
        except FileNotFoundError:
            return
        except OSError as error:
            raise ConfigError(f"{self._runs}: the records cannot be listed: {error.strerror}") from error
        for entry in entries:
            if (journal := _seen(f"{entry.path}/journal.jsonl")) is not None:
                yield os.fsencode(entry.name), f"{journal} {_seen(f'{entry.path}/result.json')}"


def _known(database: sqlite3.Connection) -> dict[bytes, str]:
    """Return the fingerprints in the index by the record's name."""
    return dict(database.execute("SELECT run, fingerprint FROM runs"))


def _seen(path: str) -> str | None:
    """Return size and times of a file, None where there is none."""
    try:
        found = os.stat(path)  # noqa: PTH116  # ten thousand paths take as long as all the rest
    except OSError:
        return None
    return f"{found.st_size}:{found.st_mtime_ns}:{found.st_ctime_ns}"
