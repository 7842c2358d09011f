"""A run under way: its readings go to its record, which is closed in any case."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from msgspec import Struct, field, to_builtins
from msgspec.structs import replace

from vcfbench.archive.results import Evaluation, evaluate, nothing, of_several
from vcfbench.archive.run import Run, breaks
from vcfbench.bench.bench import Bench
from vcfbench.clock import today, utc_now
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.drivers.together import Outputs
from vcfbench.errors import BenchError, ConfigError, MeasurementError, NotSafe, PlanError, SettingChanged
from vcfbench.files import read_text, shown
from vcfbench.instructions.procedure import Provenance
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.interfaces import Identity, SafeReport, nobody
from vcfbench.procedures.own_code import is_own
from vcfbench.records.directory import create_run
from vcfbench.records.export import points_csv, result_text, write_text
from vcfbench.records.journal import Journal, MemoryJournal, SimulatedJournal
from vcfbench.records.metadata import equipment_of
from vcfbench.records.schema import Status
from vcfbench.records.signing import SigningKey, named_key
from vcfbench.records.stated import Refuses
from vcfbench.reports.document import plain_report
from vcfbench.reports.shielded import Shielded
from vcfbench.runs.needs import with_ambient
from vcfbench.runs.notified import notify, outcome_of
from vcfbench.runs.request import Prepared, blamed_on
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.watchdog import Watchdog
from vcfbench.station.description import BenchDescription
from vcfbench.station.equipment import equipment_on
from vcfbench.station.limits import driver_of
from vcfbench.steps.events import Event, Observer, Paused, StepStarted
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.measured import Measured
from vcfbench.steps.operator import simulated_operator
from vcfbench.steps.step import LOOK_AT_SIGNALS
from vcfbench.values.printing import in_unit
from vcfbench.version import installed_versions

_OVERTIME_S: Final = 60.0  # By how much a step may take longer than twice its estimate, wall time


class _WatchedSteps(Struct, frozen=True):
    """Tells the watchdog the step under way, and the longest that it may take; `by_hand` any time."""

    watchdog: Watchdog
    by_hand: bool

    def handle(self, event: Event) -> None:
        """Pass on each beginning; every exchange has a deadline of its own, and this one is for hangs.

        A pause may take any time, until the next step begins.
        """
        if isinstance(event, StepStarted):
            step = event.step
            longest_s = None if self.by_hand or step.waits_for_person else 2.0 * step.duration_s + _OVERTIME_S
            self.watchdog.step(f"step {event.number} ({step.describe()})", longest_s)
        elif isinstance(event, Paused):
            self.watchdog.step(f"pause after step {event.number}, by {event.by}", None)


class UnderWay(Struct):
    """A run under way and its record, filled in as they become known; the unknown rest stays empty."""

    prepared: Prepared
    header: Mapping[str, Any] = field(default_factory=dict)
    journal: Journal | None = None
    key: SigningKey | None = None
    safe_reports: Sequence[SafeReport] = ()
    watchdog: Watchdog | None = None
    execution: Execution | None = None
    evaluation: Evaluation | None = None
    error: BenchError | None = None
    observers: Mapping[str, Shielded] = field(default_factory=dict)
    kept: Path | None = None
    identities: Mapping[str, Identity] = field(default_factory=dict)
    outputs: Mapping[str, Identity] = field(default_factory=dict)
    """Identities of the outputs of several devices, by the name of the device."""
    missing: Mapping[str, BenchError] = field(default_factory=dict)
    """Errors of those that could not be opened, set or asked for errors."""

    def take_error(self, error: BenchError) -> None:
        """Keep the first error, unless something is not safe: that comes before everything."""
        if self.error is error or isinstance(self.error, NotSafe):
            return
        if isinstance(error, NotSafe) and self.error is not None:
            error.hint = "; ".join(filter(None, [error.hint, f"before that: {self.error}"]))
        if isinstance(error, NotSafe) or self.error is None:
            settings = getattr(self.prepared, "settings", None)  # none before the run is made ready
            if settings is not None and self.execution is not None:
                error.what = in_unit(error.what, settings.station.output_unit)
            if settings is not None and settings.station.stream is not None and error.instrument == "multimeter":
                error.instrument = "stream"
            self.error = error

    def observers_lost(self) -> list[str]:
        """Return the observers that failed, each with its error."""
        return [f"{name}: {each.lost}" for name, each in self.observers.items() if each.lost is not None]

    def as_run(self) -> Run:
        """Return the run so far; complete when every step was performed and the results could be computed."""
        prepared, execution = self.prepared, self.execution
        description: BenchDescription | None = getattr(prepared, "description", None)
        several = bool(prepared.devices) and self.error is None and execution is not None
        status = Status.COMPLETE if self.evaluation is not None or several else Status.ABORTED
        points = () if execution is None else execution.points
        evaluation = nothing(points) if self.evaluation is None else self.evaluation
        kept = ("bench_seconds", "physical_minimum_s", "asked_again", "not_checked", "pauses")
        done = {} if execution is None else {name: getattr(execution, name) for name in kept}
        return Run(
            procedure=prepared.name,
            status=status,
            points=points,
            results=evaluation.results,
            no_results=None
            if self.evaluation is not None
            else of_several(self.header) or f"the record is {status.value}",
            error=self.error,
            verdict=evaluation.verdict,
            directory=None if prepared.directory is None else prepared.directory.path,
            bench=None if description is None else description.name,
            simulated=prepared.simulated,
            seed=prepared.seed,
            observers_lost=tuple(self.observers_lost()),
            device_entry=self.kept,
            metadata=prepared.metadata,
            equipment=equipment_of(self.header),
            resumed=breaks(self.header, len(points)),
            _own_report=evaluation.report,
            _header=self.header,
            _values=evaluation.values,
            **done,
        )

    def notify(self) -> None:
        """Start the program that the bench file names; its failure does not change the outcome of the run."""
        request, description = self.prepared.request, getattr(self.prepared, "description", None)
        if description is None or description.notify is None or (request.runs is None and self.error is None):
            return
        with suppress(Exception):
            if (failure := notify(description.notify, outcome_of(self.as_run()))) is not None:
                request.warn(f"the notification failed: {failure}")

    def begin_record(self) -> None:
        """Make the record's directory, before any instrument is touched: a run that cannot be recorded need not begin.

        None is made where no record is to be kept, which real benches are not run without.
        """
        prepared = self.prepared
        signing_key, runs = prepared.description.laboratory.signing_key, prepared.request.runs
        self.key = named_key(signing_key) if signing_key or os.environ.get("VCFBENCH_SIGNING_KEY") else None
        if runs is not None:
            prepared.directory = create_run(runs, prepared.procedure.name)
        elif not prepared.description.simulated:
            raise ConfigError("runs: expected a directory for the record: without one only simulated benches are run")

    def perform(self, bench: Bench, watchers: Sequence[Observer], signals: StopSignals) -> None:
        """Open the journal, perform the plan on `bench`, and keep the outcome."""
        prepared, request = self.prepared, self.prepared.request
        self.safe_reports = bench.safe_reports  # filled when the bench is left
        prepared.take_bench(bench)
        prepared.take_metadata(with_ambient(prepared.metadata, bench))
        began_s = bench.clock.now() if prepared.began_s is None else prepared.began_s
        with signals.undivided():
            journal = self.open_journal(bench.identities, began_s, bench.clock.now() - began_s)
        if isinstance(outputs := bench.instruments.get("multimeter"), Outputs):
            self.identities, self.outputs, self.missing = bench.identities, outputs.identities, outputs.missing
        # the caller's own, on a simulated bench the simulation, else a person if any
        operator = request.operator or simulated_operator(bench) or request.person or nobody
        self.watchdog = watchdog = bench.watchdog
        if watchdog is not None and prepared.directory is not None:
            watchdog.keep_in(prepared.directory.journal)
            watchers = [*watchers, _WatchedSteps(watchdog, bool(bench.by_hand))]
        pausing = None
        if request.control is not None:
            from vcfbench.runs.pausing import Pausing  # noqa: PLC0415  # few runs are controlled

            pausing = Pausing.of(request.control, bench, prepared)
        executor = Executor(bench, journal, watchers, operator, began_s, undivided=signals.undivided, pausing=pausing)
        try:
            with blamed_on(prepared.procedure):
                execution = prepared.perform(executor)
        finally:
            self.execution = executor.so_far()
        if execution.error is not None:
            self.take_error(execution.error)
            return
        for instrument in bench.instruments.values():  # a meter that is only read has been asked once, at its set-up
            try:
                instrument.check_errors()
                if isinstance(driver := driver_of(instrument), ScpiInstrument | Outputs):
                    driver.check_settings()
            except BenchError as error:
                error.step = error.step or "end of the run, all was measured"
                self.take_error(error)
                if isinstance(error, SettingChanged):
                    self.execution = replace(self.execution, status=Status.ABORTED)

    def open_journal(
        self, identities: Mapping[str, Identity], began_s: float = 0.0, done_s: float = 0.0, *, planned: bool = True
    ) -> Journal:
        """Begin the record with its header, which says that it will take `done_s` and, `planned`, its plan's time."""
        prepared, description = self.prepared, self.prepared.description
        kept = prepared.directory
        on_disk = SimulatedJournal if description.simulated else Journal
        procedure, bench = prepared.procedure, to_builtins(description)
        del bench["notify"]  # resuming a record elsewhere runs no program that it names
        equipment = equipment_on(today(), description, identities, identities)
        self.header = {
            "run": "" if kept is None else kept.run,
            "procedure": procedure.name,
            "title": procedure.title,
            **({"method": procedure.method} if procedure.method else {}),
            "simulated": prepared.simulated,
            "seed": prepared.seed,
            "versions": installed_versions(),
            "identities": to_builtins(identities),
            "options": {**to_builtins(prepared.request.options, enc_hook=shown), "settings": prepared.asked()},
            "settings": to_builtins(prepared.settings),
            "bench": bench,
            "began_s": began_s,
            "planned_s": done_s + (prepared.planned().bench_seconds if planned else 0.0),
            "metadata": prepared.metadata.as_json(),
            "equipment": [each.as_json() for each in equipment],
            **({} if self.key is None else {"signed_by": self.key.public}),
            **profile_of(description),
            **prepared.header_entries(),
        }
        journal = MemoryJournal() if kept is None else on_disk(kept.journal)
        try:
            journal.header(self.header)
        except BaseException:  # without a first line nothing that came later could be read
            journal.close()
            if kept is not None:
                kept.journal.unlink()
            raise
        self.journal = journal
        return journal

    def close(self, display_lost: str | None) -> None:
        """Compute the results, end the journal, and write the files derived from it."""
        several = bool(self.prepared.devices)  # each has results of its own
        complete = self.execution is not None and self.execution.status is Status.COMPLETE
        if self.journal is not None and complete and not several:
            self._compute(self.journal)
        directory = self.prepared.directory
        if self.journal is None and isinstance(self.error, NotSafe):  # the bench did not open, and is left unsafe
            self.safe_reports = self.error.reports
            try:
                self.open_journal({})
            except BenchError as error:
                self.take_error(error)
        elif self.journal is None and directory is not None:
            directory.discard()
            self.prepared.directory = None
        if self.journal is not None:
            try:
                self._end(self.journal, display_lost)
                self._keep_of_device()
            except BenchError as error:
                self.take_error(error)

    def _compute(self, journal: Journal) -> None:
        settings = self.prepared.settings
        measured = Measured(self.as_run().points, journal.lines)
        try:
            metadata = self.prepared.metadata
            self.evaluation = evaluate(self.prepared.procedure, settings, settings.acceptance, measured, metadata)
        except BenchError as error:
            words, own = f"the points give no result: {error.what}", is_own(self.prepared.procedure)
            failed: BenchError = MeasurementError(words, hint=error.hint or LOOK_AT_SIGNALS)
            if own and not isinstance(error, MeasurementError):  # a mistake in its code, not in the readings
                failed = PlanError(words, hint="correct it, and resume with --procedure FILE: the points are kept")
            failed.__cause__ = error.__cause__
            self.take_error(failed)
        except (ImportError, OSError) as error:  # modules of results are loaded late: a file or package may be gone
            words = f"the results could not be computed: {type(error).__name__}: {error}"
            self.take_error(BenchError(words, hint="the record is complete: vcfbench report computes them from it"))
        else:
            results = self.evaluation.results
            if isinstance(results, Refuses) and (why := results.refusal()):
                self.take_error(MeasurementError(why))

    def _end(self, journal: Journal, display_lost: str | None) -> None:
        """Write the footer, which vouches for all that is derived, and that, each whatever becomes of the others."""
        derived: Mapping[str, str] = {}
        try:
            derived = self._derived()
        finally:
            try:
                done, lost = self.as_run(), self.observers_lost()
                error = None if done.error is None else {"kind": type(done.error).__name__, "what": str(done.error)}
                footer = {
                    "status": done.status.value,
                    "error": error,
                    "points": len(done.points),
                    "bench_seconds": done.bench_seconds,
                    "physical_minimum_s": done.physical_minimum_s,
                    "safe": [to_builtins(safe) for safe in self.safe_reports],
                    **({} if display_lost is None else {"display_lost": display_lost}),
                    **({"observers_lost": lost} if lost else {}),
                    **({"pauses": list(done.pauses)} if done.pauses else {}),
                    **({"watchdog_lost": True} if self.watchdog is not None and self.watchdog.lost else {}),
                    "files": {name: sha256(text.encode()).hexdigest() for name, text in derived.items()},
                }
                journal.footer(footer)
                if self.key is not None:
                    journal.signature(self.key)
            finally:
                try:
                    if self.prepared.directory is not None:
                        for name, text in derived.items():
                            write_text(self.prepared.directory.path / name, text)
                finally:
                    journal.close()

    def _derived(self) -> dict[str, str]:
        """Return the files derived from the journal, by name."""
        done = self.as_run()
        if done.directory is None or done.physical_minimum_s is None:
            return {}
        answer = done.as_json()
        for key in ("run", "equipment"):  # they go by the time of day; the same seed shall give the same bytes
            del answer[key]
        answer["physical_minimum_s"] = done.physical_minimum_s
        if self.evaluation is not None and self.prepared.procedure.name not in BUILT_IN:
            # its code may not be there when its report is asked for
            with suppress(ConfigError):  # a number in it is not finite: the results are kept all the same
                answer["report"] = plain_report(self.evaluation.report)
        return {"result.json": result_text(answer), "points.csv": points_csv(done.points)}

    def _keep_of_device(self) -> None:
        """Add the procedure's entry for the device to its store: of a run that is complete, recorded and safe."""
        procedure, directory, evaluation = self.prepared.procedure, self.prepared.directory, self.evaluation
        if procedure.entry is None or self.error is not None or evaluation is None or directory is None:
            return
        made = Provenance.of(self.header, directory.run, utc_now(), evaluation.verdict)
        kept = procedure.entry(self.prepared.settings, evaluation.results, made)
        if kept is not None:
            from vcfbench.records.devices import DeviceStore  # noqa: PLC0415

            try:
                self.kept = DeviceStore(kept.store).add(kept.record).path
            except ConfigError as error:
                error.hint = f"the record has it: vcfbench device --add {directory.run} keeps it later"
                raise


def profile_of(description: BenchDescription) -> dict[str, str]:
    """Return the text of a custom table profile, because its path may lead elsewhere later."""
    dialect = "" if description.rate_table is None else description.rate_table.dialect
    if not dialect.endswith(".toml"):
        return {}
    return {"table_profile": read_text(dialect, "a profile of a rate table")}
