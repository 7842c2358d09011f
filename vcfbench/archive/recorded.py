"""Records read back: everything is made again from the journal."""

from collections.abc import Mapping
from contextlib import suppress
from datetime import date
from pathlib import Path

from msgspec.structs import replace

from vcfbench import errors
from vcfbench.archive.results import evaluation_of, of_several
from vcfbench.archive.run import Run, breaks
from vcfbench.archive.summary import run_summaries
from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.amendments import amended, amendments_of
from vcfbench.records.directory import RunDirectory, find_run
from vcfbench.records.directory import list_runs as recorded_runs
from vcfbench.records.journal import JournalRecord, read_header
from vcfbench.records.metadata import equipment_of, metadata_from
from vcfbench.records.schema import Status
from vcfbench.reports.text import printable


def load_run(name_or_path: str | Path, runs: str | Path = "runs") -> Run:
    """Return the run recorded in the directory `name_or_path`, or the one under `runs` of that name.

    A name may be the beginning or end of one, or ``"last"``.

    Raises:
        ConfigError: there is no such record, more than one, or it cannot be read.

    >>> vcfbench.load_run("last").procedure
    'turntable'
    """
    directory = directory_of(name_or_path, runs)
    return recorded_run(directory, directory.read())


def directory_of(name_or_path: str | Path, runs: str | Path = "runs") -> RunDirectory:
    """Return the record named as for :func:`load_run`; ConfigError without exactly one."""
    path = Path(name_or_path)
    if path.name == "journal.jsonl":
        path = path.parent
    return RunDirectory(path) if (path / "journal.jsonl").is_file() else find_run(Path(runs), str(name_or_path))


def list_runs(
    runs: str | Path = "runs",
    *,
    dut: str | None = None,
    since: str | date | None = None,
    status: str | None = None,
    procedure: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> tuple[Run, ...]:
    """Return the runs recorded under `runs`, oldest first; all of them, or those that are asked for.

    One whose record cannot be read has the status ``"unreadable"`` and the reason as its `error`.

    Args:
        runs: directory of the records.
        dut: only those of this device.
        since: only those that began on this day (``"2026-01-15"`` or a date, UTC) or later, or from an instant on.
        status: only those that ended so.
        procedure: only those of this procedure.
        tags: only those that have all of them.

    Raises:
        ConfigError: there is no such status, or the date is none.

    >>> [earlier.points[0].rate_deg_s for earlier in vcfbench.list_runs(dut="G-0042", procedure="turntable")]
    [10.0]
    """
    asked = run_summaries(runs, dut=dut, since=since, status=status, procedure=procedure, tags=tags)
    return tuple(_run_or_why_not(RunDirectory(each.directory)) for each in asked)


def _run_or_why_not(directory: RunDirectory) -> Run:
    try:
        return replace(recorded_run(directory, directory.read()), _measured=None)  # of many, none keeps its readings
    except ConfigError as error:
        run = Run("unknown", Status.UNREADABLE, error=error, directory=directory.path)
        error.run = run
        return run


def recorded_run(directory: RunDirectory, record: JournalRecord) -> Run:
    """Return the run of `record` in `directory`."""
    header, footer = record.header, record.footer or {}
    evaluation, why_none = evaluation_of(directory, record)
    lost, amendments = footer.get("observers_lost", ()), amendments_of(record.lines)
    error: BenchError | None = None
    if record.damage is not None:
        error = ConfigError(f"the record is damaged: {record.damage}")
    elif footer.get("error") is not None:
        error = _of_kind(footer["error"].get("kind"), footer["error"].get("what"))
    elif record.footer is None and record.errors:
        error = _of_kind(record.errors[-1].get("error_kind"), record.errors[-1].get("error"))
    run = Run(
        procedure=str(header.get("procedure", "unknown")),
        status=record.status,
        points=record.points,
        results=evaluation.results,
        no_results=why_none,
        error=error,
        verdict=evaluation.verdict,
        directory=directory.path,
        bench=header.get("bench", {}).get("name"),
        simulated=header.get("simulated"),
        seed=header.get("seed"),
        bench_seconds=footer.get("bench_seconds"),
        physical_minimum_s=footer.get("physical_minimum_s"),
        asked_again=tuple(asked_again(record)),
        observers_lost=tuple(lost),
        damage=record.damage,
        not_checked=not_checked(record),
        metadata=amended(metadata_from(header), amendments),
        amendments=amendments,
        equipment=equipment_of(header),
        resumed=tuple(map(printable, breaks(header, len(record.points)))),
        pauses=tuple(map(printable, footer.get("pauses", ()))),
        _own_report=evaluation.report,
        _measured=evaluation.measured,
        _values=evaluation.values,
    )
    if of_several(header) is not None:
        from vcfbench.archive.lot import lot_report  # noqa: PLC0415  # few records are of several devices

        run = replace(run, devices=_of_run(directory))
        run = replace(run, _own_report=lot_report(run))
    if run.error is not None:
        run.error.run = run
    return run


def _of_run(directory: RunDirectory) -> tuple[Run, ...]:
    """Return the runs of the several devices of a run that are recorded beside it, by their names."""
    found = []
    for each in recorded_runs(directory.path.parent):
        of = None
        with suppress(ConfigError):  # one that cannot be read says of no run that it is of that
            of = read_header(each.journal).get("several")
        if isinstance(of, dict) and of.get("run") == directory.run:
            found.append(recorded_run(each, each.read()))
    return tuple(sorted(found, key=lambda run: run.metadata.dut or ""))


def asked_again(record: JournalRecord) -> list[str]:
    """Return the rejected replies, each with its step."""
    steps = [f"step {step.get('n')}: {said}" for step in record.steps for said in step.get("asked_again", ())]
    beside = ((line.get("why", "starting up again"), line.get("asked_again", ())) for line in record.restored)
    return [f"{why}: {said}" for why, all_said in beside for said in all_said] + steps


def not_checked(record: JournalRecord) -> tuple[str, ...]:
    """Return the checks that the run left out, with the reasons."""
    return tuple(str(step["not_checked"]) for step in record.steps if "not_checked" in step)


def _of_kind(kind: object, what: object) -> BenchError:
    """Return the error of a record; its words hold already where and when it happened."""
    found = getattr(errors, str(kind), BenchError)
    return (found if isinstance(found, type) and issubclass(found, BenchError) else BenchError)(str(what))
