"""Summaries of records in a list, and the selection of records: no readings are read for it.

Lists of hundreds keep them beside the records, in a file that may go at any time: of a record whose journal and result
are the very files that were read (number, size, time written, and time changed, which no program can set back) the
summary holds; any other is read anew.
"""

import os
import secrets
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, date, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec import Struct, field, structs
from msgspec.structs import replace

from vcfbench.archive.results import evaluation_of, stored_outcome
from vcfbench.errors import ConfigError
from vcfbench.files import MOST_TABLE, read_file
from vcfbench.records.amendments import amended, amended_fields, amendments_of
from vcfbench.records.directory import RunDirectory, began, recorded_runs
from vcfbench.records.metadata import metadata_from
from vcfbench.records.outline import ListedMetadata, Outline, outline_of
from vcfbench.records.plain import ReadOnly, plain
from vcfbench.records.schema import Status
from vcfbench.station.acceptance import Acceptance
from vcfbench.values.value import Value
from vcfbench.version import EVALUATION, installed_version

_KEPT: Final = ".summaries"
_WORTH_KEEPING: Final = 100  # Fewer are read sooner than all of them are written
_SUM: Final = 32  # Bytes of the sum before them: what a power cut left of the file is none
_SETTLED_NS: Final = 2_000_000_000  # A file system counts time in ticks: two changes in one look like one


class RunSummary(Struct, frozen=True, kw_only=True):
    """Summary of a record in a list.

    `run` is its name, `directory` where it is, `started` when it began (UTC). `results` are those with a unit, by the
    names that they have in ``result.json``. `simulated` is None where the header does not say. `verdict` is ``pass``,
    ``marginal``, ``fail``, or None where nothing was judged. `damage` and `problem` say what is wrong with a record
    that is damaged, or cannot be read. `revision` is 1, and one more for each time that the record was amended;
    `amended` names what is another than the run was told. `copies` are other directories with the same record, which
    counts once; `recorded_as` is the name that it was made with.

    >>> summary = vcfbench.run_summaries()[0]
    >>> print(summary.procedure, summary.dut, summary.results["scale_factor"])
    turntable G-0042 -12.5630(29) mV/(deg/s)
    """

    run: str
    directory: Path
    started: datetime
    status: Status
    procedure: str | None = None
    bench: str | None = None
    simulated: bool | None = None
    seed: int | None = None
    points: int | None = None
    dut: str | None = None
    operator: str | None = None
    note: str | None = None
    tags: Mapping[str, str] = field(default_factory=dict)
    results: Mapping[str, Value] = field(default_factory=dict)
    verdict: str | None = None
    damage: str | None = None
    problem: str | None = None
    revision: int = 1
    amended: tuple[str, ...] = ()
    recorded_as: str | None = None
    copies: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as ``runs list --json`` prints it."""
        members = {name: getattr(self, name) for name in self.__struct_fields__}
        del members["directory"], members["started"], members["problem"], members["recorded_as"]
        results = {name: each.as_json() for name, each in self.results.items()}
        return {**plain(members), "started_utc": self.started.isoformat(), "results": results}


def run_summaries(
    runs: str | Path = "runs",
    *,
    dut: str | None = None,
    since: str | date | None = None,
    status: str | None = None,
    procedure: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> tuple[RunSummary, ...]:
    """Return summaries of the runs of :func:`list_runs`, oldest first, without reading whole records.

    Arguments and errors are those of :func:`list_runs`.
    ``pandas.json_normalize([each.as_json() for each in vcfbench.run_summaries()])`` makes a table of them.

    >>> [(summary.dut, summary.verdict) for summary in vcfbench.run_summaries(status="complete")]
    [('G-0042', 'pass')]
    """
    known = [each.value for each in Status]
    if status is not None and status not in known:
        raise ConfigError(f"status: expected one of {', '.join(known)}, got {status!r}")
    try:
        day = since.isoformat() if isinstance(since, date) else since  # a datetime has its time too
        instant = None if day is None else datetime.fromisoformat(day)
    except ValueError:
        raise ConfigError(f"since: expected a date, as in 2026-01-15, got {since!r}") from None
    if instant is not None and instant.tzinfo is None:
        instant = instant.replace(tzinfo=UTC)
    found = [
        each
        for each in _once(_all_summaries(Path(runs)))
        if (dut is None or dut == each.dut)
        and (status is None or status == each.status)
        and (procedure is None or procedure == each.procedure)
        and (instant is None or each.started >= instant)
        and all(each.tags.get(key) == value for key, value in (tags or {}).items())
    ]
    return tuple(sorted(found, key=lambda each: (each.started, each.run)))


def _once(found: Iterable[RunSummary]) -> Iterator[RunSummary]:
    """Yield each record once, of its copies the one that was amended last, else under its own name.

    A damaged one is no copy.
    """
    same = defaultdict[object, list[RunSummary]](list)
    for each in found:
        whole = each.recorded_as if each.damage is None else None
        same[whole or each.directory, each.started].append(each)
    for alike in same.values():
        first, *others = sorted(alike, key=lambda each: (-each.revision, each.run != each.recorded_as, each.run))
        yield replace(first, copies=tuple(each.run for each in others)) if others else first


class _Kept(Struct, frozen=True, array_like=True):
    """Summary of a record as it was when its files were these; its results apart."""

    files: tuple[int, ...]
    summary: RunSummary
    results: dict[str, msgspec.Raw]

    def whole(self) -> RunSummary:
        """Return it with its results."""
        return replace(self.summary, tags=ReadOnly(self.summary.tags), results=_Later(self.results))


class _AllKept(Struct, frozen=True, array_like=True):
    """Summaries by the names of the records, read by a version of this program."""

    version: str
    records: dict[str, _Kept]


class _Later(ReadOnly):
    """Values by name, of which only those that are asked for are decoded."""

    __slots__ = ()

    def __init__(self, values: Mapping[str, msgspec.Raw]) -> None:
        self._values = dict(values)

    def __getitem__(self, name: str) -> Value:
        return _VALUE.decode(self._values[name])

    def __repr__(self) -> str:
        return repr(dict(self))


_VALUE: Final = msgspec.msgpack.Decoder(Value)


def _all_summaries(runs: Path) -> Iterator[RunSummary]:
    """Yield the summaries of all records, in no order, and keep them where many were read anew."""
    version, kept, anew = f"{installed_version()}, {EVALUATION}", dict[str, _Kept](), 0
    with suppress(ConfigError, msgspec.DecodeError):  # none is there, or none of this program
        data = read_file(runs / _KEPT, "summaries of records", MOST_TABLE)
        if data[:_SUM] == sha256(memoryview(data)[_SUM:]).digest():
            found = msgspec.msgpack.decode(data[_SUM:], type=_AllKept, dec_hook=lambda _, name: runs / name)
            kept = found.records if found.version == version else kept
    still = dict[str, _Kept]()
    for directory in recorded_runs(runs):
        files, entry = _files_of(directory), kept.get(directory.run)
        if entry is not None and entry.files == files:
            still[directory.run] = entry
            yield entry.whole()
            continue
        summary = _stored_summary(directory)
        if summary is not None and files:
            raw = {name: msgspec.Raw(msgspec.msgpack.encode(each)) for name, each in summary.results.items()}
            still[directory.run], anew = _Kept(files, replace(summary, results={}), raw), anew + 1
        yield summary or summary_of(directory)
    if anew >= _WORTH_KEEPING:
        draft = runs / f"{_KEPT}.{secrets.token_hex(4)}"
        with suppress(OSError, OverflowError):  # the folder is another's: then they are read again
            draft.touch()
            until_ns = draft.stat().st_mtime_ns - _SETTLED_NS
            settled = {
                name: each for name, each in still.items() if max(each.files[2::4] + each.files[3::4]) < until_ns
            }
            data = msgspec.msgpack.encode(_AllKept(version, settled), enc_hook=_plain)
            draft.write_bytes(sha256(data).digest() + data)
            draft.replace(runs / _KEPT)
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def _files_of(directory: RunDirectory) -> tuple[int, ...]:
    """Return what shows that the files of a record are still the same; nothing where that cannot be known."""
    if os.name == "nt":  # it does not tell when a file was changed
        return ()
    try:
        found = [os.stat(f"{directory.path}/{name}") for name in ("journal.jsonl", "result.json")]  # noqa: PTH116
    except OSError:
        return ()
    return tuple(each for file in found for each in (file.st_ino, file.st_size, file.st_mtime_ns, file.st_ctime_ns))


def _plain(value: object) -> object:
    return value.name if isinstance(value, Path) else dict(value)  # type: ignore[call-overload]  # a read-only mapping


def _stored_summary(directory: RunDirectory) -> RunSummary | None:
    """Return the summary of a whole record with its stored results; None of any other."""
    outline = outline_of(directory.journal)
    if outline is not None:
        with suppress(ConfigError):
            return _summary(directory, outline, *stored_outcome(directory.path / "result.json", outline))
    return None


def summary_of(directory: RunDirectory) -> RunSummary:
    """Return the summary of one record; one that cannot be read has the reason in its `problem`."""
    if (stored := _stored_summary(directory)) is not None:
        return stored
    try:  # what was not stored with the run is computed from its points
        record = directory.read()
        header, metadata = record.header, metadata_from(record.header)
        outline = Outline(
            procedure=header.get("procedure"),  # type: ignore[arg-type]  # None of a record that has no header
            bench=header.get("bench", {}).get("name"),
            seed=header.get("seed"),
            status=record.status,
            points=len(record.points),
            utc=header.get("utc"),
            metadata=ListedMetadata(metadata.dut, metadata.operator, metadata.note, dict(metadata.tags)),
            amendments=amendments_of(record.lines),
            simulated=header.get("simulated"),
            run=header.get("run"),
        )
        evaluation, _ = evaluation_of(directory, record)
        return _summary(directory, outline, evaluation.verdict, evaluation.values, record.damage)
    except ConfigError as error:
        began_at, why = began(directory, None), str(error)
        return RunSummary(
            run=directory.run, directory=directory.path, started=began_at, status=Status.UNREADABLE, problem=why
        )


def _summary(
    directory: RunDirectory,
    outline: Outline,
    verdict: Acceptance | None,
    values: Sequence[Value],
    damage: str | None = None,
) -> RunSummary:
    listed = (
        each if each.words and not (each.of or each.parts) else replace(each, of="", words=each.named.words, parts=())
        for each in values
    )
    found = {each.name: each for each in listed}
    metadata = amended(outline.metadata, outline.amendments)
    kept = {name: getattr(outline, name) for name in ("procedure", "bench", "simulated", "seed", "status", "points")}
    kept |= {**structs.asdict(metadata), "tags": ReadOnly(metadata.tags)}
    return RunSummary(
        run=directory.run,
        directory=directory.path,
        started=began(directory, outline.utc),
        **kept,
        results=ReadOnly(found),
        verdict=None if verdict is None else verdict.word,
        damage=damage,
        revision=len(outline.amendments) + 1,
        recorded_as=outline.run,
        amended=amended_fields(outline.amendments),
    )
