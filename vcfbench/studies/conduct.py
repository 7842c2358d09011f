"""Conducts a study: checks all of it, does the runs that are missing, keeps each, and sums up."""

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from itertools import chain
from pathlib import Path
from typing import Any

from msgspec import Struct, structs

from vcfbench.clock import WallClock
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.files import shown
from vcfbench.strict import refusal
from vcfbench.studies.file import Study, read_study, study_of
from vcfbench.studies.journal import Begun, StudyJournal, kept, rows_of
from vcfbench.studies.metrics import PARTS
from vcfbench.studies.one_run import PlannedRun, RunRow, perform
from vcfbench.studies.result import StudyResult, beside, of_rows
from vcfbench.studies.table import require_writable
from vcfbench.studies.vary import Drawn
from vcfbench.studies.workers import in_processes, processors

Rows = Mapping[tuple[int, int], RunRow]

_BATCH = 64
_BATCH_S = 1.0
"""Runs, and seconds, after which finished ones go to the disk: at most so much is done again after a power cut."""


class Progress:
    """Display that is told the progress of a study; this one shows nothing."""

    def checked(self, done: int, total: int) -> None:
        """Take note that so many cases of all have been checked."""

    def begun(self, had: int, total: int) -> None:
        """Take note that runs begin; `had` of `total` were done before."""

    def done(self, row: RunRow) -> None:
        """Take note of a run that is done."""


class StudyOptions(Struct, frozen=True):
    """Options of a study: `output` is the file of its table, None writes nothing; `workers` None: all processors."""

    output: Path | None = None
    workers: int | None = None
    restart: bool = False
    keep_records: Path | None = None


class Plan(Struct, frozen=True):
    """A study without its runs: how many there are, how many are done, and how long the others will take.

    `run_s` is what one run of the first case took here, s; `left_s` what is left for `workers` processes at that pace.
    """

    study: Study
    had: int
    workers: int
    run_s: float

    @property
    def left_s(self) -> float:
        """Time left of the study, s."""
        return (len(self.study.runs) - self.had) * self.run_s / self.workers


def study(
    study: str | Path | Mapping[str, Any],
    *,
    output: str | Path | None = None,
    workers: int | None = None,
    restart: bool = False,
    keep_records: str | Path | None = None,
    progress: Progress | None = None,
) -> StudyResult:
    """Run a procedure many times on simulated benches, varied as `study` says, and return the statistics.

    The same study gives the same rows and files, however many processes do it and in whatever order they end.

    Args:
        study: a study file, or its tables as a mapping.
        output: where the table goes, ``.csv``; its journal, summary and picture beside it. A study that
            was ended goes on where it was. None writes nothing.
        workers: processes on this computer; None is one for each processor, 1 does the runs in this process. More
            than one needs ``if __name__ == "__main__":`` around the call in a script.
        restart: begin anew, whatever is there.
        keep_records: directory for the record of each run; None keeps none.
        progress: gets the progress.

    Raises:
        BenchError: the study cannot be done as asked (raised before anything runs), or no run was completed.
    """
    how = StudyOptions(
        None if output is None else Path(output), workers, restart, None if keep_records is None else Path(keep_records)
    )
    asked = study_of(study) if isinstance(study, Mapping) else read_study(study)
    return conduct(asked, how, progress or Progress())


def conduct(asked: Study, how: StudyOptions, progress: Progress) -> StudyResult:
    """Do the study as :func:`study` does, which see."""
    _check(asked, how, progress)
    begun = begun_by(asked)
    opened: AbstractContextManager[tuple[StudyJournal | None, Rows]] = nullcontext((None, {}))
    if how.output is not None:
        opened = kept(journal_of(how.output), begun, restart=how.restart)
    with opened as (journal, had):
        wanted = asked.runs
        rows = {key: had[key] for key in wanted if key in had}
        progress.begun(len(rows), len(wanted))
        missing = [key for key in wanted if key not in rows]
        first = []
        if not rows and missing and "*" not in asked.metrics:  # done here: a metric's name that fits none is seen
            first = [perform(_work(asked, *missing[0], how.keep_records))]
            _require_some_metrics(asked, first[0])
        left = missing[len(first) :]
        works = (_work(asked, case, seed, how.keep_records) for case, seed in left)
        workers = min(_workers(how), len(left))
        done = in_processes(works, workers) if workers > 1 else map(perform, works)
        for row in _kept(chain(first, done), journal):
            rows[row.case, row.seed] = row
            progress.done(row)
    drawn = begun.drawn_for(asked.seeds)
    result = of_rows(begun, [rows[key] for key in wanted], drawn, how.output)
    if how.output is not None:
        result.write(how.output)
    if result.rows and all(row.status != "complete" for row in result.rows):
        failed = result.rows[0]
        words = f"none of the {len(result.rows)} runs came to its end; case {failed.case}, seed {failed.seed}"
        raise MeasurementError(f"{words}: {failed.message}")
    return result


def plan_of(asked: Study, how: StudyOptions, progress: Progress) -> Plan:
    """Check the study as before its runs, and time one of the first case, in memory; nothing is written."""
    _check(asked, how, progress)
    had = 0
    if how.output is not None and journal_of(how.output).exists() and not how.restart:
        rows, _ = rows_of(journal_of(how.output), begun_by(asked))
        had = sum(key in rows for key in asked.runs)
    work = PlannedRun(asked.of(0), asked.seeds[0])
    _require_some_metrics(asked, perform(work))  # it also loads what a process loads once
    clock = WallClock()
    perform(work)
    return Plan(asked, had, _workers(how), clock.now())


def journal_of(output: Path) -> Path:
    """Return the journal of the study whose table is `output`."""
    return beside(output, ".journal.jsonl")


def begun_by(asked: Study) -> Begun:
    """Return the first line of the journal of a study."""
    return Begun(
        asked.fingerprint(),
        asked.title or Path(asked.source).stem,
        asked.procedure,
        asked.bench,
        asked.labels,
        tuple(dict(case.values) for case in asked.cases),
        tuple(each for each in asked.varied if isinstance(each, Drawn)),
    )


def _check(asked: Study, how: StudyOptions, progress: Progress) -> None:
    """Check that the study can be done as asked, before anything runs."""
    if how.workers is not None and not 1 <= how.workers <= 1024:
        raise ConfigError(f"--workers {how.workers}: expected 1 to 1024")
    if how.output is not None:
        require_writable(how.output)
    if how.keep_records is not None and how.keep_records.exists() and not how.keep_records.is_dir():
        raise ConfigError(f"--keep-records {shown(how.keep_records)}: expected a directory")
    for number, _ in enumerate(asked.check(), start=1):
        progress.checked(number, len(asked.cases))


def _workers(how: StudyOptions) -> int:
    return processors() if how.workers is None else how.workers


def _require_some_metrics(asked: Study, row: RunRow) -> None:
    """Raise ConfigError where no metric of a row has a name that the study asks for."""
    if row.status != "complete" or row.metrics:
        return
    known = perform(PlannedRun(structs.replace(asked.of(row.case), metrics=("*",)), row.seed)).metrics
    names = ", ".join(name for name in known if not name.endswith(PARTS))
    raise refusal(f"{asked.source}: metrics", f"patterns that fit some of {names}", ", ".join(asked.metrics))


def _work(asked: Study, case: int, seed: int, keep: Path | None) -> PlannedRun:
    return PlannedRun(
        asked.of(case), seed, None if keep is None else keep.resolve() / f"case-{case:04}" / f"seed-{seed}"
    )


def _kept(rows: Iterator[RunRow], journal: StudyJournal | None) -> Iterator[RunRow]:
    """Yield `rows`, and write them to the journal in batches."""
    batch: list[RunRow] = []
    clock, written_s = WallClock(), 0.0
    try:
        for row in rows:
            batch.append(row)
            if journal is not None and (len(batch) >= _BATCH or clock.now() - written_s >= _BATCH_S):
                journal.add(batch)
                batch, written_s = [], clock.now()
            yield row
    finally:
        if journal is not None and batch:
            journal.add(batch)
