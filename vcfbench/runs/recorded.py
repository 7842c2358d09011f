"""Records read back: everything is made again from the journal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vcfbench import errors
from vcfbench.errors import BenchError, ConfigError
from vcfbench.record.directory import RunDirectory, find_run
from vcfbench.record.directory import list_runs as recorded_runs
from vcfbench.record.schema import Status
from vcfbench.runs.run import Run

if TYPE_CHECKING:
    from collections.abc import Mapping

    from vcfbench.procedures.acceptance import Acceptance
    from vcfbench.record.journal import JournalRecord


def load_run(name_or_path: str | Path, runs: str | Path = "runs") -> Run:
    """Return the run recorded in the directory `name_or_path`, or the one under `runs` of that name.

    A name may be the beginning or end of one, or ``"last"``.

    Raises:
        ConfigError: there is no such record, more than one, or it cannot be read.
    """
    path = Path(name_or_path)
    if path.name == "journal.jsonl":
        path = path.parent
    directory = RunDirectory(path) if (path / "journal.jsonl").is_file() else find_run(Path(runs), str(name_or_path))
    return recorded_run(directory, directory.read())


def list_runs(runs: str | Path = "runs") -> tuple[Run, ...]:
    """Return every run recorded under `runs`, oldest first.

    One whose record cannot be read has the status ``"unreadable"`` and the reason as its `error`.
    """
    return tuple(map(_run_or_why_not, recorded_runs(Path(runs))))


def _run_or_why_not(directory: RunDirectory) -> Run:
    try:
        return recorded_run(directory, directory.read())
    except ConfigError as error:
        run = Run("unknown", Status.UNREADABLE, error=error, directory=directory.path)
        error.run = run
        return run


def recorded_run(directory: RunDirectory, record: JournalRecord) -> Run:
    """Return what `record` in `directory` tells of its run."""
    header, footer = record.header, record.footer or {}
    results, why_none = recorded_results(record)
    lost = footer.get("observers_lost", ())
    run = Run(
        procedure=str(header.get("procedure")),
        status=record.status,
        points=record.points,
        results=results or None,
        no_results=why_none,
        error=_error(record),
        verdict=recorded_verdict(record, results),
        directory=directory.path,
        bench=header.get("bench", {}).get("name"),
        simulated=header.get("simulated"),
        seed=header.get("seed"),
        bench_seconds=footer.get("bench_seconds"),
        physical_minimum_s=footer.get("physical_minimum_s"),
        asked_again=tuple(asked_again(record)),
        observers_lost=tuple(lost),
        damage=record.damage,
    )
    if run.error is not None:
        run.error.run = run
    return run


def asked_again(record: JournalRecord) -> list[str]:
    """Return which answers could not be believed, and in which step."""
    return [f"step {step.get('n')}: {said}" for step in record.steps for said in step.get("asked_again", ())]


def recorded_results(record: JournalRecord) -> tuple[dict[str, Any], str | None]:
    """Compute the results again from the points; where there are none, say why in words."""
    from vcfbench.procedures.catalogue import PROCEDURES  # noqa: PLC0415  # it is needed for complete records alone
    from vcfbench.procedures.settings import CalibrationSettings  # noqa: PLC0415

    if record.status is not Status.COMPLETE:
        return {}, f"the record is {record.status.value}"
    name = record.header.get("procedure")
    if not isinstance(name, str) or name not in PROCEDURES:
        return {}, f"the procedure {name!r} is not known here"
    try:
        settings = CalibrationSettings.from_json(record.header["settings"])
    except (KeyError, ValueError) as error:  # msgspec.ValidationError is a ValueError
        return {}, f"its settings are not those of this version: {printable(repr(error))}"
    try:
        return PROCEDURES[name].results(settings, record.points), None
    except (ConfigError, ArithmeticError, ValueError) as error:
        return {}, f"the points give no result: {printable(error)}"


def recorded_verdict(record: JournalRecord, results: Mapping[str, Any]) -> Acceptance | None:
    """Judge the results by the limits that the bench file had when they were measured."""
    from vcfbench.procedures.acceptance import judged  # noqa: PLC0415
    from vcfbench.procedures.settings import CalibrationSettings  # noqa: PLC0415

    if not results:
        return None
    return judged(CalibrationSettings.from_json(record.header["settings"]).acceptance, results, record.points)


def printable(value: object) -> str:
    """Return what a record says as it can be printed: a file must not write on the terminal by itself."""
    text = str(value)
    return text if text.isprintable() else ascii(text)


def _error(record: JournalRecord) -> BenchError | None:
    """Return the error that the record tells of: its damage, what its last line says, or its last failed step."""
    if record.damage is not None:
        return ConfigError(f"the record is damaged: {record.damage}")
    if record.footer is not None:
        told = record.footer.get("error")
        return None if told is None else _of_kind(told.get("kind"), told.get("what"))
    if record.errors:
        return _of_kind(record.errors[-1].get("error_kind"), record.errors[-1].get("error"))
    return None


def _of_kind(kind: object, what: object) -> BenchError:
    """Return the error of a record; its words hold already where and when it happened."""
    found = getattr(errors, kind) if isinstance(kind, str) and kind in errors.__all__ else BenchError
    error: BenchError = found(str(what))
    return error
