"""``vcfbench study``: Monte-Carlo and parameter studies of a simulated bench."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Json_, Quiet_, argument, flag, option, output_option
from vcfbench.clock import WallClock
from vcfbench.reports.outlet import Outlet
from vcfbench.reports.text import left_table, text_of
from vcfbench.studies.conduct import Plan, Progress, journal_of, plan_of
from vcfbench.studies.conduct import study as conduct
from vcfbench.studies.file import read_study
from vcfbench.studies.one_run import RunRow
from vcfbench.studies.result import beside
from vcfbench.studies.table import in_words

_LINE_S = 10.0


def study(
    file: Annotated[Path, argument("FILE.toml", "The study: procedure, bench, seeds, what varies.")],
    output: Annotated[
        Path | None, output_option("Table of the runs, .csv; the rest goes beside it. Default: named after the study.")
    ] = None,
    workers: Annotated[int | None, option("N", "Number of processes. Default: one for each processor.")] = None,
    keep_records: Annotated[Path | None, option("DIR", "Keep the record of every run there.")] = None,
    *,
    restart: Annotated[bool, flag("Begin anew, even if runs were done before.", "--restart")] = False,
    dry_run: Annotated[bool, flag("Check the study, list the cases, and estimate the time.", "--dry-run")] = False,
    json: Json_ = False,
    quiet: Quiet_ = False,
) -> None:
    """Run a procedure many times on simulated benches: over seeds, over values of bench, gyroscope and settings.

    A study that was stopped, or killed, goes on where it was with the same command.
    """
    table = Path(f"{file.stem}.csv") if output is None else output
    with _shown(table, quiet=quiet) as progress:
        if dry_run:
            _show_plan(plan_of(read_study(file), table, workers, progress, restart=restart), as_json=json)
            return
        how: Any = {"output": table, "workers": workers, "restart": restart, "keep_records": keep_records}
        result = conduct(file, **how, progress=progress)
    if json:
        print_json(result.as_json())
        return
    typer.echo(text_of(result.report()))
    typer.echo(f"\ntable: {table}")
    for ending, what in ((".summary.json", "summary"), (".svg", "picture")):
        if (made := beside(table, ending)).exists():
            typer.echo(f"{what}: {made}")


class _LineProgress(Progress):
    """A plain line when runs begin, every ten seconds, and at the end. `kept` runs of `total` are done."""

    def __init__(self, outlet: Outlet) -> None:
        self._outlet = outlet
        self._clock = WallClock()
        self._said_s = 0.0
        self._had = self._broken = 0
        self.kept = self.total = 0

    def say(self, words: str) -> None:
        """Print a line."""
        self._outlet.write(f"{words}\n")

    def checked(self, done: int, total: int) -> None:
        """Print now and then the number of checked cases."""
        if self._clock.now() - self._said_s >= _LINE_S and done < total:
            self._said_s = self._clock.now()
            self.say(f"{done} of {total} cases checked")

    def begun(self, had: int, total: int) -> None:
        """Print the number of runs."""
        self._had = self.kept = had
        self.total = total
        self._clock, self._said_s = WallClock(), 0.0
        self.say(f"{total} runs{f', {had} of them done before' if had else ''}")

    def done(self, row: RunRow) -> None:
        """Say the amount by which it is, now and then."""
        self.kept += 1
        self._broken += row.status != "complete"
        if self._clock.now() - self._said_s >= _LINE_S or self.kept == self.total:
            self._said_s = self._clock.now()
            left_s = self._clock.now() * (self.total - self.kept) / max(1, self.kept - self._had)
            broken = f", {self._broken} failed" if self._broken else ""
            self.say(f"{self.kept} of {self.total} runs, {left_s:.0f} s left{broken}")


@contextmanager
def _shown(table: Path, *, quiet: bool) -> Iterator[Progress]:
    """Show the progress of the study on stderr; when it is stopped say which runs are kept."""
    if quiet:
        yield Progress()
        return
    outlet = Outlet(sys.stderr)
    outlet.open()
    progress = _LineProgress(outlet)
    try:
        yield progress
    except BaseException:
        if progress.kept:
            kept = f"{progress.kept} of {progress.total} runs are kept in {journal_of(table)}"
            progress.say(f"{kept}; the same command goes on")
        raise
    finally:
        outlet.close()


def _show_plan(plan: Plan, *, as_json: bool) -> None:
    study, total = plan.study, len(plan.study.runs)
    cases = [{study.labels[path]: value for path, value in case.values.items()} for case in study.cases]
    if as_json:
        figures = {"runs": total, "done": plan.had, "workers": plan.workers, "run_s": plan.run_s, "left_s": plan.left_s}
        print_json({"dry_run": True, "cases": cases, **figures})
        return

    heads = list(cases[0])
    rows = [[str(number), *(in_words(values[head]) for head in heads)] for number, values in enumerate(cases)]
    typer.echo(left_table(["case", *heads], rows))
    for each in study.varied:
        if each.path not in study.cases[0].values:
            typer.echo(f"drawn by the seed: {each.label}")
    seeds = f"seeds {study.seeds[0]} to {study.seeds[-1]}"
    typer.echo(f"\n{len(cases)} cases, {seeds}: {total} runs of {study.procedure}, {plan.had} of them done")
    span = f"{plan.left_s:.0f} s" if plan.left_s < 100 else f"{plan.left_s / 60:.0f} min"
    typer.echo(f"some {span} with {plan.workers} processes, at {plan.run_s:.2f} s a run as one took now")
