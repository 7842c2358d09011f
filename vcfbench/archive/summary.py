"""Summaries of records in a list, and the selection of records: no readings are read for it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import structs

from vcfbench.archive.recomputed import evaluation_of
from vcfbench.archive.stored import stored_outcome
from vcfbench.errors import ConfigError
from vcfbench.records.amendments import amended, amended_fields, amendments_of
from vcfbench.records.directory import RunDirectory, began
from vcfbench.records.metadata import metadata_from
from vcfbench.records.outline import outline_of
from vcfbench.records.plain import ReadOnly, plain
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class KeyResult:
    """A result that a list shows: value, combined standard uncertainty (None: not stated), unit, parts missing in u."""

    value: float
    u: float | None
    unit: str
    missing: tuple[str, ...] = ()

    def words(self) -> str:
        """Return value and unit, six digits."""
        return f"{self.value:.6g} {self.unit}".rstrip() + (" (incomplete)" if self.missing else "")

    def as_json(self) -> dict[str, Any]:
        """Return it as ``runs list --json`` prints it."""
        said = {"complete": not self.missing, "missing": list(self.missing)}
        return {"value": self.value, "u": self.u, "unit": self.unit, **said}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """Summary of a record in a list.

    `run` is its name, `directory` where it is, `started` when it began (UTC). `results` are those with a unit, by the
    names that they have in ``result.json``. `verdict` is ``pass``, ``marginal``, ``fail``, or None where nothing was
    judged. `damage` and `problem` say what is wrong with a record that is damaged, or cannot be read. `revision` is 1,
    and one more for each time that the record was amended; `amended` names what is another than the run was told.
    """

    run: str
    directory: Path
    started: datetime
    status: Status
    procedure: str | None = None
    bench: str | None = None
    seed: int | None = None
    points: int | None = None
    dut: str | None = None
    operator: str | None = None
    note: str | None = None
    tags: Mapping[str, str] = field(default_factory=dict)
    results: Mapping[str, KeyResult] = field(default_factory=dict)
    verdict: str | None = None
    damage: str | None = None
    problem: str | None = None
    revision: int = 1
    amended: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as ``runs list --json`` prints it."""
        return {
            "run": self.run,
            "procedure": self.procedure,
            "status": self.status.value,
            "damage": self.damage,
            "bench": self.bench,
            "seed": self.seed,
            "points": self.points,
            "started_utc": self.started.isoformat(),
            "dut": self.dut,
            "operator": self.operator,
            "note": self.note,
            "tags": dict(self.tags),
            "results": {name: each.as_json() for name, each in self.results.items()},
            "verdict": self.verdict,
            "revision": self.revision,
            "amended": list(self.amended),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Selection of runs; a key that is None or empty does not select. `since` is an instant with its time zone."""

    dut: str | None = None
    since: datetime | None = None
    status: Status | None = None
    procedure: str | None = None
    tags: Mapping[str, str] = field(default_factory=dict)

    def takes(self, summary: RunSummary) -> bool:
        """Tell whether a run is one of those."""
        return (
            (self.dut is None or self.dut == summary.dut)
            and (self.status is None or self.status == summary.status)
            and (self.procedure is None or self.procedure == summary.procedure)
            and (self.since is None or summary.started >= self.since)
            and all(summary.tags.get(key) == value for key, value in self.tags.items())
        )


def selection_of(
    *,
    dut: str | None = None,
    since: str | datetime | None = None,
    status: str | None = None,
    procedure: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> Selection:
    """Return which runs are meant.

    Args:
        dut: serial number of the device.
        since: the day or the instant from which on they began, ``2026-01-15`` or ``2026-01-15T10:30``; UTC where no
            time zone is said.
        status: how they ended.
        procedure: its name.
        tags: what they must all have.

    Raises:
        ConfigError: there is no such status, or the date is none.
    """
    known = [each.value for each in Status]
    if status is not None and status not in known:
        raise ConfigError(f"status: expected one of {', '.join(known)}, came {status!r}")
    ended = None if status is None else Status(status)
    return Selection(dut=dut, since=_instant(since), status=ended, procedure=procedure, tags=dict(tags or {}))


def _instant(utc: str | datetime | None) -> datetime | None:
    if utc is None:
        return None
    try:
        instant = utc if isinstance(utc, datetime) else datetime.fromisoformat(utc)
    except ValueError:
        raise ConfigError(f"since: expected a date, as in 2026-01-15, came {utc!r}") from None
    return instant if instant.tzinfo is not None else instant.replace(tzinfo=UTC)


def ordered(summaries: Iterator[RunSummary]) -> tuple[RunSummary, ...]:
    """Return runs by when they began."""
    return tuple(sorted(summaries, key=lambda each: (each.started, each.run)))


def summary_of(directory: RunDirectory) -> RunSummary:
    """Return the summary of one record; one that cannot be read has the reason in its `problem`."""
    outline = outline_of(directory.journal)
    if outline is not None:
        with suppress(ConfigError):  # what was not stored with the run is computed from its points
            verdict, results = stored_outcome(directory.path / "result.json", outline)
            as_run = structs.replace(outline.metadata, dut=outline.metadata.dut or outline.device)
            metadata = amended(as_run, outline.amendments)
            return RunSummary(
                run=directory.run,
                directory=directory.path,
                started=began(directory, outline.utc),
                status=outline.status,
                procedure=outline.procedure,
                bench=outline.bench,
                seed=outline.seed,
                points=outline.points,
                dut=metadata.dut,
                operator=metadata.operator,
                note=metadata.note,
                tags=ReadOnly(metadata.tags),
                results=ReadOnly(dict(_stored_results(results))),
                verdict=None if verdict is None else verdict.word,
                revision=len(outline.amendments) + 1,
                amended=amended_fields(outline.amendments),
            )
    try:
        return _read(directory)
    except ConfigError as error:
        started = began(directory, None)
        return RunSummary(
            run=directory.run,
            directory=directory.path,
            started=started,
            status=Status.UNREADABLE,
            problem=str(error),
        )


def _read(directory: RunDirectory) -> RunSummary:
    """Read a record in full, and compute its results again where they are not stored."""
    record = directory.read()
    header, amendments = record.header, amendments_of(record.lines)
    metadata = amended(metadata_from(header), amendments)
    evaluation, _ = evaluation_of(directory, record)
    verdict = evaluation.verdict
    return RunSummary(
        run=directory.run,
        directory=directory.path,
        started=began(directory, header.get("utc")),
        status=record.status,
        procedure=header.get("procedure"),
        bench=header.get("bench", {}).get("name"),
        seed=header.get("seed"),
        points=len(record.points),
        dut=metadata.dut,
        operator=metadata.operator,
        note=metadata.note,
        tags=metadata.tags,
        results=ReadOnly(dict(_stored_results(_encoded(evaluation.results)))),
        verdict=None if verdict is None else verdict.word,
        damage=record.damage,
        revision=len(amendments) + 1,
        amended=amended_fields(amendments),
    )


class _Quantity(msgspec.Struct, frozen=True, gc=False):
    value: float
    unit: str
    u: float | None = None
    missing: tuple[str, ...] = ()


_VALUE_FIRST = 64
"""Bytes in which the first name of an object stands, however far it is indented."""

_QUANTITY = msgspec.json.Decoder(_Quantity)


def _encoded(results: Any) -> dict[str, msgspec.Raw]:
    values = {} if results is None else plain(results)
    return {name: msgspec.Raw(msgspec.json.encode(value)) for name, value in values.items()}


def _stored_results(results: Mapping[str, msgspec.Raw]) -> Iterator[tuple[str, KeyResult]]:
    """Yield the results that have a value and a unit."""
    for name, raw in results.items():
        if b'"value"' in bytes(memoryview(raw)[:_VALUE_FIRST]):  # most are numbers, lists, tables of something else
            with suppress(msgspec.DecodeError, UnicodeDecodeError):
                found = _QUANTITY.decode(raw)
                yield name, KeyResult(found.value, found.u, found.unit, found.missing)
