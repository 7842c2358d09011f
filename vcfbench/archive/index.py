"""An index of runs in a database: SQLite beside the records, or PostgreSQL for many stations, by one URL.

The records are the truth. Before an index answers, it is held against them: what was added, changed or taken away since
is read anew, and what cannot be read as an index is made again. Nothing is in it that is not in the records.
"""

from __future__ import annotations

import os
import socket
import sqlite3
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from msgspec import Struct

from vcfbench.archive.index_schema import SCHEMA, STATEMENTS_AT_ONCE, Tables, tables
from vcfbench.archive.summary import KeyResult, RunSummary, Selection, summary_of
from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.records.directory import RunDirectory
from vcfbench.records.plain import ReadOnly
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sqlalchemy import Connection, Engine

BESIDE: Final = "index.sqlite"
"""Name of the index that lies with the records."""
_TEXTS: Final = ("procedure", "bench", "dut", "operator", "note", "verdict", "damage", "problem")
_WRITES: Final = "vcfbench_writes"
_PATIENCE_S: Final = 10
"""For a server that does not answer, or another program that writes."""
_TRIES: Final = 5
"""Times that two programs may come in each other's way."""


class Refreshed(Struct, frozen=True):
    """Work of bringing an index up to date: numbers of records in all, read, and gone."""

    records: int
    read: int
    gone: int
    made_again: str | None = None
    """Reason for making the index again, None where the earlier one could be used."""


def indexed(
    runs: Path, selection: Selection, url: str | None = None, *, everywhere: bool = False
) -> tuple[RunSummary, ...] | None:
    """Return the runs that are meant as an index tells them, brought up to date before.

    Without a `url` it is that beside the records; None where that cannot be used, for want of the extra or of the right
    to write: the records are then read as ever.

    Raises:
        ConfigError: the index at `url` cannot be used.
    """
    try:
        index = RunIndex(runs, url)
        try:
            index.refresh()
            return index.select(selection, everywhere=everywhere)
        finally:
            index.close()
    except ConfigError:
        if url is None:
            return None
        raise


class RunIndex:
    """The index of the records under `runs`.

    Args:
        runs: directory of the records.
        url: of the database, ``postgresql://user@host/database`` or ``sqlite:///file``; None is a file beside the
            records, which is made again if it is none of ours.

    Raises:
        ConfigError: the extra ``index`` is not installed, or the URL is none.
    """

    def __init__(self, runs: Path, url: str | None = None) -> None:
        self._sql = need("sqlalchemy", "index", "an index of runs")
        self._runs = runs
        self._file = runs / BESIDE if url is None else None
        self._store = _fit(f"{socket.gethostname()}:{runs.resolve()}")
        self._url = self._checked(url)
        self._tables: Tables = tables()
        self._engine: Engine = self._made_engine()

    @property
    def name(self) -> str:
        """Its URL, without the password."""
        return str(self._url.render_as_string(hide_password=True))

    def close(self) -> None:
        """Let go of the database."""
        self._engine.dispose()

    def refresh(self, *, rebuild: bool = False) -> Refreshed:
        """Read anew the records that differ, with `rebuild` all of them.

        Raises:
            ConfigError: the database cannot be reached, or written.
        """
        why: str | None = None
        for tries_left in reversed(range(_TRIES)):
            try:
                with self._errors_named():
                    why = self._prepare(rebuild=rebuild) or why
                    return self._refreshed(why, rebuild=rebuild)
            except _Again as again:
                if tries_left == 0:
                    raise ConfigError(f"index {self.name}: {again}") from again
                if again.unusable:
                    why = str(again)
                    self._throw_away()
        raise AssertionError  # the last try returns or raises

    def select(self, selection: Selection, *, everywhere: bool = False) -> tuple[RunSummary, ...]:
        """Return the runs that are meant, oldest first; `everywhere` those of other directories of records too.

        What is not of this directory is what its own station last said.

        Raises:
            ConfigError: the database cannot be reached.
        """
        sql, runs = self._sql, self._tables.runs
        wanted = [] if everywhere else [runs.c.store == self._store]
        given = {"dut": selection.dut, "procedure": selection.procedure, "status": selection.status}
        wanted += [runs.c[name] == _fit(str(value)) for name, value in given.items() if value is not None]
        if selection.since is not None:
            wanted.append(runs.c.started_utc >= _instant(selection.since))
        for key, value in selection.tags.items():
            tag = self._tables.tags
            same = (tag.c.store == runs.c.store) & (tag.c.run == runs.c.run)
            wanted.append(sql.exists().where(same & (tag.c.key == _fit(key)) & (tag.c.value == _fit(value))))
        query = sql.select(runs).where(*wanted).order_by(runs.c.started_utc, runs.c.run)
        try:
            with self._errors_named(), self._engine.connect() as connection:
                return tuple(self._summary(row) for row in connection.execute(query).mappings())
        except _Again as again:
            raise ConfigError(f"index {self.name}: {again}", hint="vcfbench runs index --rebuild") from again

    def _summary(self, row: Any) -> RunSummary:
        directory = Path(row["directory"])
        return RunSummary(
            run=row["run"],
            directory=self._runs / directory.name if row["store"] == self._store else directory,
            started=datetime.fromisoformat(row["started_utc"]),
            status=Status(row["status"]),
            amended=tuple(row["amended"]),
            tags=ReadOnly(row["tags"]),
            results=ReadOnly(
                {
                    name: KeyResult(value, u, unit, tuple(said))
                    for name, (value, u, unit, said) in row["results"].items()
                }
            ),
            **{key: row[key] for key in ("seed", "points", "revision", *_TEXTS)},
        )

    def _checked(self, url: str | None) -> Any:
        if self._file is not None:
            return self._sql.engine.URL.create("sqlite", database=str(self._file))
        try:
            parsed = self._sql.engine.make_url(url)
        except self._sql.exc.ArgumentError:
            raise ConfigError("--index: expected a URL, as in postgresql://user@host/database") from None
        kind = parsed.get_backend_name()
        if kind not in {"sqlite", "postgresql"}:
            raise ConfigError(f"--index: expected a URL of postgresql or sqlite, came one of {kind}")
        if kind == "postgresql":
            need("psycopg", "index", "an index on PostgreSQL")
            return parsed.set(drivername="postgresql+psycopg")
        return parsed

    def _made_engine(self) -> Engine:
        if self._url.get_backend_name() == "postgresql":
            texts = {"client_encoding": "utf8", "connect_timeout": _PATIENCE_S}  # whatever the server's own encoding
            made: Engine = self._sql.create_engine(self._url, connect_args=texts)
            return made
        engine: Engine = self._sql.create_engine(self._url)
        self._sql.event.listen(engine, "connect", _quick_and_patient)
        self._sql.event.listen(engine, "begin", _begin)
        return engine

    def _prepare(self, *, rebuild: bool) -> str | None:
        """See that the tables are there and ours; return why they had to be made again, None where they had not."""
        with self._engine.begin() as connection:
            if self._url.get_backend_name() == "sqlite":
                found = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
                if found != "ok":
                    raise _Again(f"the file is damaged: {found}", unusable=True)
            if self._is_ours(connection):
                return None
        with self._writing() as connection:
            if self._is_ours(connection):  # another program has made them meanwhile
                return None
            metadata, inspector = self._tables.metadata, self._sql.inspect(connection)
            there = any(inspector.has_table(each.name) for each in metadata.sorted_tables)
            if there and self._file is None and not rebuild:  # others may stand in it, of another version
                raise ConfigError(
                    f"index {self.name}: its tables are those of another version of vcfbench",
                    hint="vcfbench runs index --rebuild makes them again, for all stations; or name another database",
                )
            metadata.drop_all(connection)
            metadata.create_all(connection)
            connection.execute(self._tables.about.insert().values(value=SCHEMA))
        return "its tables are those of another version" if there else None

    def _is_ours(self, connection: Connection) -> bool:
        inspector = self._sql.inspect(connection)
        for each in self._tables.metadata.sorted_tables:
            if not inspector.has_table(each.name):
                return False
            if {column["name"] for column in inspector.get_columns(each.name)} != set(each.columns.keys()):
                return False
        return connection.execute(self._sql.select(self._tables.about.c.value)).scalars().all() == [SCHEMA]

    def _refreshed(self, why: str | None, *, rebuild: bool) -> Refreshed:
        present = dict(_fingerprints(self._runs))
        with self._engine.begin() as connection:
            if not rebuild and self._known(connection) == {name: seen for name, (_, seen) in present.items()}:
                return Refreshed(len(present), 0, 0, why)
        with self._writing() as connection:
            before = self._known(connection)
            known = {} if rebuild else before
            changed = [name for name, (_, seen) in present.items() if known.get(name) != seen]
            gone = before.keys() - present.keys()
            self._forget(connection, [*gone, *(name for name in changed if name in before)])
            if self._file is not None:  # what lay elsewhere before is of no use in a file of this directory
                for table in (self._tables.tags, self._tables.runs):
                    connection.execute(table.delete().where(table.c.store != self._store))
            for first in range(0, len(changed), STATEMENTS_AT_ONCE):
                self._add(connection, {name: present[name] for name in changed[first : first + STATEMENTS_AT_ONCE]})
        return Refreshed(len(present), len(changed), len(gone), why)

    def _known(self, connection: Connection) -> dict[str, str]:
        """Return the fingerprints in the index of this directory, by the record's name; they tell a changed record."""
        runs = self._tables.runs
        mine = self._sql.select(runs.c.run, runs.c.fingerprint).where(runs.c.store == self._store)
        return {row.run: row.fingerprint for row in connection.execute(mine)}

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        """Open a transaction that writes, when no other program does: of this directory, or SQLite file."""
        with self._engine.execution_options(**{_WRITES: True}).begin() as connection:
            if self._url.get_backend_name() == "postgresql":
                key = self._sql.func.hashtext(f"vcfbench {self._store}")
                connection.execute(self._sql.select(self._sql.func.pg_advisory_xact_lock(key)))
            yield connection

    def _forget(self, connection: Connection, names: Sequence[str]) -> None:
        for table in (self._tables.tags, self._tables.runs):
            mine = table.delete().where(table.c.store == self._store)
            for first in range(0, len(names), STATEMENTS_AT_ONCE):
                connection.execute(mine.where(table.c.run.in_(names[first : first + STATEMENTS_AT_ONCE])))

    def _add(self, connection: Connection, records: Mapping[str, tuple[Path, str]]) -> None:
        found = {name: (summary_of(RunDirectory(path)), seen) for name, (path, seen) in records.items()}
        rows = [_row(self._store, name, seen, summary) for name, (summary, seen) in found.items()]
        connection.execute(self._tables.runs.insert(), rows)
        tags = [
            {"store": self._store, "run": name, "key": _fit(key), "value": _fit(value)}
            for name, (summary, _) in found.items()
            for key, value in summary.tags.items()
        ]
        if tags:
            connection.execute(self._tables.tags.insert(), tags)

    @contextmanager
    def _errors_named(self) -> Iterator[None]:
        """Raise the database's errors as ConfigError, or as _Again where a second try may help."""
        errors = self._sql.exc
        try:
            yield
        except errors.DBAPIError as error:
            reason = str(error.orig).strip().splitlines()[0]
            if isinstance(error, errors.IntegrityError | errors.ProgrammingError):  # another program made the same
                raise _Again(reason) from None
            if isinstance(error.orig, sqlite3.DatabaseError):
                if not isinstance(error.orig, sqlite3.OperationalError):
                    raise _Again(reason, unusable=True) from None
                if "locked" in reason:
                    raise _Again(reason) from None
            raise ConfigError(f"index {self.name}: {reason}") from None

    def _throw_away(self) -> None:
        """Take away a file beside the records that is no index; ConfigError for a database that somebody named."""
        if self._file is None:
            raise ConfigError(
                f"index {self.name}: it is no database, or damaged", hint="take it away, or name another with --index"
            )
        self._engine.dispose()
        with suppress(OSError):
            self._file.unlink(missing_ok=True)
        self._engine = self._made_engine()


class _Again(Exception):
    """The index could not be used as it is; `unusable`: it must be made again."""

    def __init__(self, words: str, *, unusable: bool = False) -> None:
        super().__init__(words)
        self.unusable = unusable


def _quick_and_patient(connection: Any, _record: object) -> None:
    """Wait for others, and not for the disk: an index spoilt by a power failure is made again."""
    connection.isolation_level = None  # transactions begin where they are said to, see _begin
    connection.execute(f"PRAGMA busy_timeout = {1000 * _PATIENCE_S}")
    connection.execute("PRAGMA synchronous = OFF")


def _begin(connection: Connection) -> None:
    """Begin a transaction; one that writes takes the file at once, so that its reads still hold."""
    connection.exec_driver_sql("BEGIN IMMEDIATE" if connection.get_execution_options().get(_WRITES) else "BEGIN")


def _fingerprints(runs: Path) -> Iterator[tuple[str, tuple[Path, str]]]:
    """Yield each record by its name: its path, and a fingerprint that tells a changed record."""
    try:
        entries = list(os.scandir(runs))
    except FileNotFoundError:
        return
    except OSError as error:
        raise ConfigError(f"{runs}: the records cannot be listed: {error.strerror}") from error
    for entry in entries:
        journal = _seen(f"{entry.path}/journal.jsonl")
        if journal is not None:
            yield _fit(entry.name), (runs / entry.name, f"{journal} {_seen(f'{entry.path}/result.json')}")


def _seen(path: str) -> str | None:
    """Return size and times of a file, None where there is none."""
    try:
        found = os.stat(path)  # noqa: PTH116  # ten thousand paths take as long as all the rest
    except OSError:
        return None
    return f"{found.st_size}:{found.st_mtime_ns}:{found.st_ctime_ns}"


def _fit(text: str) -> str:
    """Return `text` as every database takes it: names of files may be no text, and a note may hold a NUL."""
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")


def _instant(instant: datetime) -> str:
    """Return an instant as a text of fixed length in UTC, whose order is that of time."""
    return instant.astimezone(UTC).isoformat(timespec="microseconds")


def _row(store: str, name: str, seen: str, summary: RunSummary) -> dict[str, Any]:
    texts = {key: getattr(summary, key) for key in _TEXTS}
    return {
        "store": store,
        "run": name,
        "fingerprint": "goes on" if summary.status is Status.RUNNING else seen,  # who is killed changes no file
        "directory": _fit(str(summary.directory.resolve())),
        "started_utc": _instant(summary.started),
        "status": summary.status.value,
        "seed": summary.seed,
        "points": summary.points,
        "revision": summary.revision,
        "amended": [*summary.amended],
        **{key: None if value is None else _fit(str(value)) for key, value in texts.items()},
        "tags": {_fit(key): _fit(value) for key, value in summary.tags.items()},
        "results": {name: [each.value, each.u, each.unit, [*each.missing]] for name, each in summary.results.items()},
    }
