"""One run of a study, in any process: from case and seed to a row of its table."""

from pathlib import Path
from typing import Any

from msgspec import Struct, field, structs

from vcfbench.errors import Aborted, BenchError
from vcfbench.runs.conduct import conduct
from vcfbench.safety.signals import StopSignals
from vcfbench.studies.file import Study
from vcfbench.studies.metrics import metrics_of


class PlannedRun(Struct, frozen=True):
    """A run that is to be done: a study with one case, and a seed; its record goes into `keep`, None keeps none."""

    study: Study
    seed: int
    keep: Path | None = None

    @property
    def key(self) -> tuple[int, int]:
        """Case and seed."""
        return self.study.cases[0].number, self.seed


class RunRow(Struct, frozen=True):
    """Outcome of a run: ``complete`` with its metrics, or ``failed`` with a message."""

    case: int
    seed: int
    status: str
    message: str | None = None
    verdict: str | None = None
    bench_seconds: float | None = None
    metrics: dict[str, Any] = field(default_factory=dict)


def perform(work: PlannedRun) -> RunRow:
    """Do one run; an error is in its row; Aborted: a signal came."""
    case, study = work.study.cases[0], work.study
    try:
        request = study.request(case, work.seed)
        bench: Any = request.bench  # it is described; nobody wants a thousand notices
        request = structs.replace(request, runs=work.keep, bench=structs.replace(bench, notify=None))
        run = conduct(request, StopSignals())  # not entered: signals are for whoever conducts the study
        metrics = metrics_of(run, bench, study.metrics)
    except Aborted:
        raise
    except Exception as error:  # noqa: BLE001  # a procedure is anybody's; the other runs go on
        said = str(error) if isinstance(error, BenchError) else f"{type(error).__name__}: {error}"
        return RunRow(*work.key, "failed", said)
    verdict = None if run.verdict is None else run.verdict.word
    return RunRow(*work.key, run.status.value, None, verdict, run.bench_seconds, metrics)
