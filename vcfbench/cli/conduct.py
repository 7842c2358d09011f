"""Conducts a run: from the bench file through the open bench to the record and the answer of ``vcfbench run``."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import typer

from vcfbench.cli.answer import given, print_json
from vcfbench.errors import Aborted, BenchError, ConfigError, MeasurementError, NotSafe

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from vcfbench.bench.bench import Bench
    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.signals import StopSignals
    from vcfbench.cli.ending import EarlyAndLate
    from vcfbench.interfaces import Identity, SafeReport
    from vcfbench.procedures.acceptance import Acceptance
    from vcfbench.procedures.catalogue import Procedure
    from vcfbench.procedures.dry_run import PlannedStep
    from vcfbench.procedures.executor import Execution, Observer
    from vcfbench.procedures.settings import CalibrationSettings
    from vcfbench.record.directory import RunDirectory
    from vcfbench.record.journal import Journal
    from vcfbench.record.schema import Point
    from vcfbench.report.progress import NoProgress
    from vcfbench.report.shielded import Shielded

__all__ = ["Record", "RunOptions", "RunReport", "conduct"]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the command line asked for."""

    bench: Path | None
    seed: int | None
    json: bool
    dry_run: bool
    runs: Path
    speed: str | None
    quiet: bool
    match: str


def conduct(name: str, options: RunOptions, ending: EarlyAndLate | None = None) -> None:
    """Do what was asked; the answer goes to stdout, every error is raised for the caller of the command to tell.

    `ending` is told when the code is known, while signals are still held: what comes later shall not change it.
    """
    if options.dry_run:
        _dry_run(name, options)
        return
    from vcfbench.bench.signals import StopSignals  # noqa: PLC0415

    report = RunReport(name)
    with StopSignals() as signals:  # until all is written: a second Ctrl-C shall not cost the results
        try:
            _run(report, options, signals)
        except BenchError as error:
            _take_error(report, error)
        unwritten = given(lambda: report.show(options))
        if ending is not None:
            ending.answered()
    if report.error is not None:
        raise report.error
    if report.acceptance is not None and not report.acceptance.passed:
        raise typer.Exit(1)  # no error: a limit of the results failed, whether or not anybody could read it
    if unwritten is not None:
        unwritten.hint = None if report.directory is None else f"it is in the record {report.directory.path}"
        raise unwritten


@dataclass(slots=True)
class RunReport:
    """All that is known of a run, filled in as it comes to be known; what is not, stays empty."""

    procedure: str
    description: BenchDescription | None = None
    seed: int | None = None
    directory: RunDirectory | None = None
    execution: Execution | None = None
    results: dict[str, Any] | None = None
    acceptance: Acceptance | None = None
    error: BenchError | None = None

    @property
    def status(self) -> str:
        """Complete when every step was performed and the results could be computed."""
        return "complete" if self.results is not None else "aborted"

    @property
    def points(self) -> tuple[Point, ...]:
        """The points that were measured."""
        return () if self.execution is None else self.execution.points

    def as_json(self) -> dict[str, Any]:
        """Return the answer of ``--json``; an aborted run has the error beside the points it kept."""
        description, execution = self.description, self.execution
        answer: dict[str, Any] = {
            "run": None if self.directory is None else self.directory.run,
            "procedure": self.procedure,
            "status": self.status,
            "bench": None if description is None else description.name,
            "simulated": None if description is None else description.simulated,
            "seed": self.seed,
            "bench_seconds": 0.0 if execution is None else execution.bench_seconds,
            "points": [point.as_json() for point in self.points],
            "results": self.results or {},
            "acceptance": None if self.acceptance is None else self.acceptance.as_json(),
            "asked_again": [] if execution is None else list(execution.asked_again),
        }
        return answer if self.error is None else {**answer, "error": str(self.error)}

    def show(self, options: RunOptions) -> None:
        """Print the answer: one JSON object, or table, fits and record."""
        if options.json:
            print_json(self.as_json())
        elif self.execution is not None:
            self._show_text(self.execution)

    def _show_text(self, execution: Execution) -> None:
        from vcfbench.report.table import summary, verdicts  # noqa: PLC0415

        typer.echo(summary(self.procedure, self.points, self.results or {}))
        if self.acceptance is not None:
            typer.echo(f"\n{verdicts(self.acceptance)}")
        for said in execution.asked_again:
            typer.echo(f"\nasked again: {said}")
        typer.echo(
            f"\n{self.status}: {execution.bench_seconds:.1f} s of bench time, "
            f"{execution.physical_minimum_s:.1f} s of it windows, ramps and settling"
        )
        if self.directory is not None:
            typer.echo(f"record: {self.directory.path}")


def _prepare(report: RunReport, options: RunOptions) -> tuple[Procedure, CalibrationSettings]:
    """Read the bench file and check what was asked against it; nothing is opened."""
    from vcfbench.bench.file import load_bench  # noqa: PLC0415
    from vcfbench.bench.station import checked_pace  # noqa: PLC0415
    from vcfbench.procedures.catalogue import procedure  # noqa: PLC0415
    from vcfbench.procedures.settings import settings_of  # noqa: PLC0415

    description = load_bench(options.bench)
    report.description = description
    if description.simulation is not None:
        report.seed = description.simulation.seed if options.seed is None else options.seed
    elif description.served is not None and options.seed is not None:
        raise ConfigError(f"--seed {options.seed}: {description.name} is served, its server was given the seed")
    elif options.seed is not None:
        raise ConfigError(f"--seed {options.seed}: {description.name} is a real bench, only simulated ones have a seed")
    checked_pace(description, options.speed)
    return procedure(report.procedure), settings_of(description, _match(options.match))


def _match(name: str) -> Any:
    from vcfbench.procedures.settings import Match  # noqa: PLC0415

    try:
        return Match(name)
    except ValueError:
        known = " or ".join(match.value for match in Match)
        raise ConfigError(f"--match {name}: expected {known}") from None


def _planned(procedure: Procedure, settings: CalibrationSettings, description: BenchDescription) -> list[PlannedStep]:
    """Walk the plan; raises LimitError when a step of it would leave a limit of the bench."""
    from vcfbench.bench.limits import LimitChecks  # noqa: PLC0415
    from vcfbench.procedures.dry_run import dry_run  # noqa: PLC0415

    return dry_run(procedure.plan(settings), settings.expected_gyro(), LimitChecks.of(description))


def _estimate_s(planned: Sequence[PlannedStep]) -> float:
    return planned[-1].t_s + planned[-1].step.duration_s


def _dry_run(name: str, options: RunOptions) -> None:
    try:
        report = RunReport(name)
        procedure, settings = _prepare(report, options)
        assert report.description is not None  # noqa: S101  # _prepare filled it in
        planned = _planned(procedure, settings, report.description)
    except BenchError as error:
        if options.json:
            print_json({"procedure": name, "dry_run": True, "error": str(error)})
        raise
    minimum_s = sum(each.step.physical_s for each in planned)
    if options.json:
        print_json(_dry_run_json(name, planned, minimum_s))
        return
    for each in planned:
        typer.echo(f"{each.number:4d}  {each.t_s:8.1f} s  {each.step.describe()}")
    typer.echo(
        f"estimated bench time {_estimate_s(planned):.0f} s, {minimum_s:.0f} s of it windows, ramps and settling"
    )


def _dry_run_json(name: str, planned: Sequence[PlannedStep], minimum_s: float) -> dict[str, Any]:
    return {
        "procedure": name,
        "dry_run": True,
        "estimated_bench_seconds": _estimate_s(planned),
        "physical_minimum_s": minimum_s,
        "steps": [
            {"n": each.number, "t_s": each.t_s, "kind": type(each.step).__name__, "what": each.step.describe()}
            for each in planned
        ],
    }


def _run(report: RunReport, options: RunOptions, signals: StopSignals) -> None:
    """Open the bench, perform the plan, make all safe, and only then close the record."""
    from vcfbench.bench.bench import open_bench  # noqa: PLC0415
    from vcfbench.report.shielded import Shielded  # noqa: PLC0415

    procedure, settings = _prepare(report, options)
    description = report.description
    assert description is not None  # noqa: S101  # _prepare filled it in
    record = Record(report, procedure, settings, options)
    estimate_s = _estimate_s(_planned(procedure, settings, description))
    display = Shielded(lambda: _progress(options, estimate_s))
    record.prepare()
    try:
        with display, open_bench(description, seed=report.seed, speed=options.speed, signals=signals) as bench:
            record.perform(bench, display)
    except BaseException as error:
        _take_error(report, _as_bench_error(error))
        if not isinstance(error, BenchError | KeyboardInterrupt):
            raise  # a mistake of ours; the record is closed all the same
    finally:
        signals.close()
        record.close(display)


def _as_bench_error(error: BaseException) -> BenchError:
    """Return what `error` means for the record."""
    match error:
        case BenchError():
            return error
        case KeyboardInterrupt():
            return Aborted("stopped by the operator")
    return BenchError(f"the program has a mistake: {type(error).__name__}: {error}")


def _take_error(report: RunReport, error: BenchError) -> None:
    """Keep the first error, unless something is not safe: that comes before everything."""
    if report.error is error or isinstance(report.error, NotSafe):
        return
    if isinstance(error, NotSafe) and report.error is not None:
        error.hint = "; ".join(filter(None, [error.hint, f"before that: {report.error}"]))
    if isinstance(error, NotSafe) or report.error is None:
        report.error = error


def _progress(options: RunOptions, estimate_s: float) -> NoProgress:
    from vcfbench.report.progress import LineProgress, LiveProgress, NoProgress  # noqa: PLC0415

    if options.quiet:
        return NoProgress()
    kind = LiveProgress if sys.stderr.isatty() else LineProgress
    return kind(sys.stderr, estimate_s)


@dataclass(slots=True)
class Record:
    """The record of one run: journal while it goes, results and points when it is over."""

    report: RunReport
    procedure: Procedure
    settings: CalibrationSettings
    options: RunOptions
    journal: Journal | None = None
    safe_reports: Sequence[SafeReport] = ()

    def prepare(self) -> None:
        """Make the record's directory, before any instrument is touched: what cannot be recorded need not begin."""
        from vcfbench.record.directory import create_run  # noqa: PLC0415

        self.report.directory = create_run(self.options.runs, self.procedure.name)

    def perform(self, bench: Bench, display: Observer) -> None:
        """Open the journal, perform the plan on `bench`, and keep what came of it in the report."""
        from vcfbench.procedures.executor import Executor  # noqa: PLC0415

        self.report.seed = bench.seed
        self.safe_reports = bench.safe_reports  # filled when the bench is left
        journal = self._open_journal(bench.identities)
        executor = Executor(bench, journal, [display])
        try:
            execution = executor.execute(self.procedure.plan(self.settings))
        finally:
            self.report.execution = executor.so_far()
        if execution.error is not None:
            _take_error(self.report, execution.error)

    def _open_journal(self, identities: Mapping[str, Identity]) -> Journal:
        from vcfbench.record.journal import Journal  # noqa: PLC0415

        assert self.report.directory is not None  # noqa: S101  # prepared
        self.journal = Journal(self.report.directory.journal)
        self.journal.header(self._header(identities))
        return self.journal

    def _header(self, identities: Mapping[str, Identity]) -> dict[str, Any]:
        import msgspec  # noqa: PLC0415

        description = self.report.description
        assert description is not None  # noqa: S101  # a record is made of a bench that was read
        return {
            "run": self.report.as_json()["run"],
            "procedure": self.procedure.name,
            "simulated": description.simulated,
            "seed": self.report.seed,
            "versions": _versions(),
            "identities": msgspec.to_builtins(identities),
            "options": msgspec.to_builtins(asdict(self.options), enc_hook=str),
            "settings": asdict(self.settings),
            "bench": msgspec.to_builtins(description),
            **_profile_of(description.rate_table.dialect),
        }

    def close(self, display: Shielded) -> None:
        """Compute the results, end the journal, and write what is derived from it."""
        from vcfbench.record.schema import Status  # noqa: PLC0415

        report = self.report
        if report.execution is not None and report.execution.status is Status.COMPLETE:
            self._compute()
        if self.journal is None:
            self._without_journal()
        if self.journal is not None:
            try:
                self._end(self.journal, display.lost)
            except BenchError as error:
                _take_error(report, error)

    def _end(self, journal: Journal, display_lost: str | None) -> None:
        """Write the footer and all that is derived, each whatever becomes of the others."""
        try:
            journal.footer(self._footer(display_lost))
        finally:
            try:
                self._derive()
            finally:
                journal.close()

    def _without_journal(self) -> None:
        """Keep no record of a bench that did not open, unless something was left unsafe by that."""
        report = self.report
        if isinstance(report.error, NotSafe):
            self.safe_reports = report.error.reports
            try:
                self._open_journal({})
            except BenchError as error:
                _take_error(report, error)
        elif report.directory is not None:
            report.directory.discard()
            report.directory = None

    def _compute(self) -> None:
        from vcfbench.procedures.acceptance import judged  # noqa: PLC0415

        try:
            self.report.results = self.procedure.results(self.settings, self.report.points)
            self.report.acceptance = judged(self.settings.acceptance, self.report.results, self.report.points)
        except ConfigError as error:
            _take_error(self.report, MeasurementError(f"the points give no result: {error.what}"))

    def _footer(self, display_lost: str | None) -> dict[str, Any]:
        report, execution = self.report, self.report.execution
        error = None if report.error is None else {"kind": type(report.error).__name__, "what": str(report.error)}
        return {
            "status": report.status,
            "error": error,
            "points": len(report.points),
            "bench_seconds": None if execution is None else execution.bench_seconds,
            "physical_minimum_s": None if execution is None else execution.physical_minimum_s,
            "safe": [asdict(safe) for safe in self.safe_reports],
            **({} if display_lost is None else {"display_lost": display_lost}),
        }

    def _derive(self) -> None:
        from vcfbench.record.export import points_csv, write_result, write_text  # noqa: PLC0415

        report = self.report
        if report.directory is None or report.execution is None:
            return
        answer = report.as_json()
        del answer["run"]  # it holds the time of day; the same seed shall give the same bytes
        answer["physical_minimum_s"] = report.execution.physical_minimum_s
        write_result(report.directory.path / "result.json", answer)
        write_text(report.directory.path / "points.csv", points_csv(report.points))


def _profile_of(dialect: str) -> dict[str, str]:
    """Return the text of the table's profile, if it is a file of one's own: its path alone says little later on."""
    if not dialect.endswith(".toml"):
        return {}
    from vcfbench.drivers.rate_table.profile import profile_text  # noqa: PLC0415

    return {"table_profile": profile_text(dialect)}


def _versions() -> Mapping[str, str]:
    import platform  # noqa: PLC0415
    from importlib.metadata import version  # noqa: PLC0415

    packages = ("vcfbench", "numpy", "pyvisa", "pyvisa-py", "pyserial")
    return {"python": platform.python_version(), **{package: version(package) for package in packages}}
