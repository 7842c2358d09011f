"""Summaries of records in a list, and the selection of records: no readings are read for it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from msgspec import Struct, field, structs
from msgspec.structs import replace

from vcfbench.archive.results import evaluation_of, stored_outcome
from vcfbench.errors import ConfigError
from vcfbench.records.amendments import amended, amended_fields, amendments_of
from vcfbench.records.directory import RunDirectory, began, recorded_runs
from vcfbench.records.metadata import metadata_from
from vcfbench.records.outline import ListedMetadata, Outline, outline_of
from vcfbench.records.plain import ReadOnly, plain
from vcfbench.records.schema import Status
from vcfbench.station.acceptance import Acceptance
from vcfbench.values.value import Value


class RunSummary(Struct, frozen=True, kw_only=True):
    """Summary of a record in a list.

    `run` is its name, `directory` where it is, `started` when it began (UTC). `results` are those with a unit, by the
    names that they have in ``result.json``. `simulated` is None where the header does not say. `verdict` is ``pass``,
    ``marginal``, ``fail``, or None where nothing was judged. `damage` and `problem` say what is wrong with a record
    that is damaged, or cannot be read. `revision` is 1, and one more for each time that the record was amended;
    `amended` names what is another than the run was told.

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

    def as_json(self) -> dict[str, Any]:
        """Return it as ``runs list --json`` prints it."""
        members = {name: getattr(self, name) for name in self.__struct_fields__}
        del members["directory"], members["started"], members["problem"]
        results = {name: each.as_json() for name, each in self.results.items()}
        return {**plain(members), "started_utc": self.started.isoformat(), "results": results}


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

    Arguments and errors are those of :func:`list_runs`.
    ``pandas.DataFrame(vcfbench.run_summaries())`` makes a table of them.

    >>> [(summary.dut, summary.verdict) for summary in vcfbench.run_summaries(status="complete")]
    [('G-0042', 'pass')]
    """
    known = [each.value for each in Status]
    if status is not None and status not in known:
        raise ConfigError(f"status: expected one of {', '.join(known)}, got {status!r}")
    try:
        instant = datetime.fromisoformat(since) if isinstance(since, str) else since
    except ValueError:
        raise ConfigError(f"since: expected a date, as in 2026-01-15, got {since!r}") from None
    if instant is not None and instant.tzinfo is None:
        instant = instant.replace(tzinfo=UTC)
    found = [
        each
        for each in map(summary_of, recorded_runs(Path(runs)))
        if (dut is None or dut == each.dut)
        and (status is None or status == each.status)
        and (procedure is None or procedure == each.procedure)
        and (instant is None or each.started >= instant)
        and all(each.tags.get(key) == value for key, value in (tags or {}).items())
    ]
    return tuple(sorted(found, key=lambda each: (each.started, each.run)))


def summary_of(directory: RunDirectory) -> RunSummary:
    """Return the summary of one record; one that cannot be read has the reason in its `problem`."""
    outline = outline_of(directory.journal)
    if outline is not None:
        with suppress(ConfigError):  # what was not stored with the run is computed from its points
            return _summary(directory, outline, *stored_outcome(directory.path / "result.json", outline))
    try:
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
        amended=amended_fields(outline.amendments),
    )
