"""Conducts a study: checks all of it, does the runs that are missing, keeps each, and sums up."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from msgspec import Struct, structs

from vcfbench.clock import WallClock
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.files import shown
from vcfbench.strict import refusal
from vcfbench.studies.file import Study, read_study, study_of
from vcfbench.studies.journal import Begun, kept, rows_of
from vcfbench.studies.metrics import PARTS
from vcfbench.studies.one_run import PlannedRun, RunRow, perform
from vcfbench.studies.result import StudyResult, beside, of_rows
from vcfbench.studies.table import require_writable
from vcfbench.studies.vary import Drawn
from vcfbench.studies.workers import in_processes, processors


class Progress:
    """Display of the progress of a study; this one shows nothing."""

    def checked(self, done: int, total: int) -> None:
        """Take note that so many cases of all have been checked."""

    def begun(self, had: int, total: int) -> None:
        """Take note that runs begin; `had` of `total` were done before."""

    def done(self, row: RunRow) -> None:
        """Take note of a run that is done."""


class Plan(Struct, frozen=True):
    """A study without its runs: their number, the number done, and the expected time of the others.

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

    >>> quick = {"rates_deg_s": [10, 0, -10], "samples": 3}
    >>> study = {"procedure": "turntable", "seeds": {"count": 2}, "settings": quick}
    >>> found = vcfbench.study(study, workers=1, output="samples.csv")
    >>> f"bias {found.summary[0].metrics['bias'].mean:.3f} V"
    'bias -0.041 V'
    """
    asked = study_of(study) if isinstance(study, Mapping) else read_study(study)
    table, progress = None if output is None else Path(output), progress or Progress()
    records = None if keep_records is None else Path(keep_records)
    if records is not None and records.exists() and not records.is_dir():
        raise ConfigError(f"--keep-records {shown(records)}: expected a directory")
    _check(asked, table, workers, progress)
    begun = begun_by(asked)
    opened: AbstractContextManager[tuple[Callable[[RunRow], None], Mapping[tuple[int, int], RunRow]]]
    opened = nullcontext((lambda _row: None, {}))
    if table is not None:
        opened = kept(journal_of(table), begun, restart=restart)
    with opened as (keep, had):
        rows = {key: had[key] for key in asked.runs if key in had}
        progress.begun(len(rows), len(asked.runs))
        missing = [key for key in asked.runs if key not in rows]
        for row in _performed(asked, missing, workers or processors(), records):
            keep(row)
            rows[row.case, row.seed] = row
            progress.done(row)
    result = of_rows(begun, rows.values(), table)
    if table is not None:
        result.write(table)
    if result.rows and all(row.status != "complete" for row in result.rows):
        failed = result.rows[0]
        words = f"none of the {len(result.rows)} runs came to its end; case {failed.case}, seed {failed.seed}"
        raise MeasurementError(f"{words}: {failed.message}")
    return result


def plan_of(asked: Study, output: Path, workers: int | None, progress: Progress, *, restart: bool) -> Plan:
    """Check the study as before its runs, and time one of the first case, in memory; nothing is written."""
    _check(asked, output, workers, progress)
    had = 0
    if journal_of(output).exists() and not restart:
        _, rows, _ = rows_of(journal_of(output), begun_by(asked))
        had = sum(key in rows for key in asked.runs)
    work = PlannedRun(asked.of(0), asked.seeds[0])
    _require_some_metrics(asked, perform(work))  # it also loads what a process loads once
    clock = WallClock()
    perform(work)
    return Plan(asked, had, workers or processors(), clock.now())


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


def _check(asked: Study, output: Path | None, workers: int | None, progress: Progress) -> None:
    """Check that the study can be done as asked, before anything runs."""
    if workers is not None and not 1 <= workers <= 1024:
        raise ConfigError(f"--workers {workers}: expected 1 to 1024")
    if output is not None:
        require_writable(output)
    for number, _ in enumerate(asked.check(), start=1):
        progress.checked(number, len(asked.cases))


def _performed(
    asked: Study, missing: Sequence[tuple[int, int]], workers: int, records: Path | None
) -> Iterator[RunRow]:
    """Do the runs that are missing, and yield each row when it is there."""
    works = (
        PlannedRun(asked.of(case), seed, records and records.resolve() / f"case-{case:04}" / f"seed-{seed}")
        for case, seed in missing
    )
    if len(missing) == len(asked.runs) and "*" not in asked.metrics:  # done here: a name that fits no metric is seen
        row = perform(next(works))
        _require_some_metrics(asked, row)
        yield row
    workers = min(workers, len(missing))
    yield from in_processes(works, workers) if workers > 1 else map(perform, works)


def _require_some_metrics(asked: Study, row: RunRow) -> None:
    """Raise ConfigError where no metric of a row has a name that the study asks for."""
    if row.status != "complete" or row.metrics:
        return
    known = perform(PlannedRun(structs.replace(asked.of(row.case), metrics=("*",)), row.seed)).metrics
    names = ", ".join(name for name in known if not name.endswith(PARTS))
    raise refusal(f"{asked.source}: metrics", f"patterns that fit some of {names}", ", ".join(asked.metrics))
