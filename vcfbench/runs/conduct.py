"""Conducts a run: from the bench file through the open bench to the record, which is closed however the run ends."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from functools import partial
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any, Final

from msgspec import Struct, field, to_builtins

from vcfbench.archive.results import Evaluation, evaluate, nothing
from vcfbench.archive.run import Run, breaks
from vcfbench.bench.bench import Bench, open_bench
from vcfbench.clock import today, utc_now
from vcfbench.errors import Aborted, BenchError, ConfigError, MeasurementError, NotSafe
from vcfbench.files import read_text, shown
from vcfbench.instructions.procedure import AnyProcedure, Provenance
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.interfaces import Identity, Operator, SafeReport, nobody
from vcfbench.procedures.layers import asked_in_python
from vcfbench.records.directory import create_run
from vcfbench.records.export import points_csv, result_text, write_text
from vcfbench.records.journal import Journal, MemoryJournal, SimulatedJournal
from vcfbench.records.metadata import RunMetadata, equipment_of, metadata_of
from vcfbench.records.schema import Status
from vcfbench.records.signing import SigningKey, named_key
from vcfbench.records.stated import Refuses
from vcfbench.reports.document import plain_report
from vcfbench.reports.shielded import Shielded
from vcfbench.runs.needs import roles_of, with_ambient
from vcfbench.runs.notified import notify, outcome_of
from vcfbench.runs.request import Prepared, Preparing, Request, blamed_on
from vcfbench.safety.control import RunControl
from vcfbench.safety.roles import needed_roles
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.trust import Trust, require_library
from vcfbench.safety.watchdog import Watchdog
from vcfbench.station.description import BenchDescription
from vcfbench.station.equipment import equipment_on, overdue_words
from vcfbench.steps.events import Event, Observer, Paused, StepStarted
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.measured import Measured
from vcfbench.steps.operator import simulated_operator
from vcfbench.steps.step import LOOK_AT_SIGNALS
from vcfbench.values.printing import in_unit
from vcfbench.version import installed_versions

_OVERTIME_S: Final = 60.0  # By how much a step may take longer than twice its estimate, wall time
_PREPARING: Final = Lock()
"""Lock of the first loading of numpy and msgspec's types, which fails where two threads do it at once."""


def run(
    procedure: str | Path | AnyProcedure,
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    settings: Mapping[str, Any] | None = None,
    observers: Sequence[Observer] = (),
    runs: str | Path | None = "runs",
    speed: str | float | None = None,
    operator: Operator | None = None,
    metadata: Mapping[str, Any] | RunMetadata | None = None,
    control: RunControl | None = None,
    trust: Trust = False,
) -> Run:
    """Run `procedure` on `bench`, record it, make the bench safe, and return its outcome.

    SIGINT and SIGTERM stop the run as they do the command: the first at its next wait, the second at once.

    Args:
        procedure: its name, the file that defines it (``"./hysteresis.py"``), or the procedure itself.
        bench: a bench file, the name of an embedded bench, or a description; None is the simulated paper bench.
        seed: of a simulated bench; None is that of the bench file. The same seed gives the same results.
        settings: of the procedure, in place of those of the bench file and checked as they are there:
            ``{"samples": 20, "drive": {"start_up_s": 8.0}}``.
        observers: get every event (``handle(event)``). One that raises is left out from then on; the run goes
            on, and :attr:`Run.observers_lost` says so.
        runs: directory of the records; this run gets one of its own in it. None keeps no record, on a simulated bench.
        speed: of a simulated bench, times real time, or ``"max"``, the default.
        operator: is called with what only hands can do (a ``Request``: words, seconds) and returns when it is done,
            with words for the record. On a simulated bench None does it to the simulated world.
        metadata: what the record says of the run beside what is measured, each key of :class:`RunMetadata`:
            ``{"dut": "G-0042", "operator": "A. Person", "tags": {"batch": "7"}}``. A procedure that goes by what is
            known of a device goes by what is known of this one.
        control: what stops the run from another thread, has it pause and lets it go on; :func:`vcfbench.start` runs
            in a thread and returns one.
        trust: whether a program that the bench file names may run (`visa_library`, where it is a file); or who is
            asked, with its path and SHA-256 in words. The environment variable ``VCFBENCH_TRUST`` allows single ones.

    Raises:
        BenchError: the run did not come to its end. The error's `run` holds what was measured, which is recorded too.
        NotSafe: something could not be made safe; whatever else went wrong is in its words.

    >>> quick = {"rates_deg_s": [10, 0, -10], "samples": 3}
    >>> run = vcfbench.run("turntable", seed=3, settings=quick, metadata={"dut": "G-0042"})
    >>> print(run.status, run.values["scale_factor"])
    complete -12.5630(29) mV/(deg/s)
    """
    if runs is not None and not str(runs).strip():
        raise ConfigError("runs: expected a directory, got an empty name")
    with _PREPARING:
        asked_settings = asked_in_python(settings or {})
        said = metadata_of(metadata)
    words = shown(bench) if isinstance(bench, Path | str) else bench and str(getattr(bench, "name", bench))
    kept = None if runs is None else shown(runs)
    request = Request(
        *(procedure, bench, seed, asked_settings, None if runs is None else Path(runs), speed, observers),
        operator=operator,
        options={"bench": words, "seed": seed, "runs": kept, "speed": speed, "settings": dict(settings or {})},
        metadata=said,
        control=control,
        trust=trust,
    )
    with StopSignals() as signals:
        return conduct(request, signals)


def conduct(request: Request, signals: StopSignals, preparing: Preparing = Prepared) -> Run:
    """Perform `request`, made ready by `preparing`, while `signals` are watched; see :func:`run`."""
    under_way = _UnderWay(preparing(request))
    control = nullcontext() if request.control is None else request.control.of_run(signals)
    try:
        with control:
            _perform(under_way, signals)
    except BenchError as error:
        under_way.take_error(_as_bench_error(error))
    except BaseException as error:
        under_way.notify()
        if isinstance(under_way.error, NotSafe):  # nothing comes before it: not a disk, not a mistake of ours
            raise under_way.error from error
        raise
    under_way.notify()
    done = under_way.as_run()
    if under_way.error is not None:
        under_way.error.run = done
        raise under_way.error
    return done


def _perform(under_way: _UnderWay, signals: StopSignals) -> None:
    """Open the bench, perform the plan, make all safe, and only then close the record."""
    prepared, request = under_way.prepared, under_way.prepared.request
    with _PREPARING:
        prepared.make_ready()
        description = prepared.description
        require_library(description, request.trust)
        prepared.require_operator()
        if description.simulated:  # parts that numpy loads at their first use, which fails in two threads at once
            for part in ("fft", "ma", "polynomial", "random"):
                import_module(f"numpy.{part}")
    needs = roles_of(prepared.procedure, description)
    opened_roles = [each.name for each in needed_roles(description, needs)]
    for words in prepared.left_out():
        request.warn(words)
    for words in overdue_words(equipment_on(today(), description, opened_roles, {})):
        request.warn(words)
    under_way.observers = {
        f"{number} ({type(each).__name__})": Shielded(partial[AbstractContextManager[Observer]](nullcontext, each))
        for number, each in enumerate(request.observers, start=1)
    }
    under_way.begin_record()
    display = Shielded(partial(request.display, prepared))
    try:
        with ExitStack() as watching:
            watchers = [watching.enter_context(each) for each in (display, *under_way.observers.values())]
            opened = open_bench(
                description,
                seed=prepared.seed,
                speed=request.speed,
                signals=signals,
                build=request.build,
                needs=needs,
                now_s=prepared.now_s(),
                trust=True,  # it was asked for
                operator=request.operator or request.person,
            )
            bench = watching.enter_context(opened)
            for each in sorted(set(bench.left_by.values())):
                request.warn(f"{each} died with this bench and nothing made it safe; its table stands now")
            under_way.perform(bench, watchers, signals)
    except BaseException as error:
        under_way.take_error(_as_bench_error(error))
        if not isinstance(error, BenchError | KeyboardInterrupt | OSError | ImportError):
            raise  # a mistake of ours; the record is closed all the same
    finally:
        signals.close()
        under_way.close(display.lost)


def _as_bench_error(error: BaseException) -> BenchError:
    """Return `error` as a BenchError for the record."""
    match error:
        case BenchError():
            return Aborted.behind(error) or error
        case KeyboardInterrupt():
            return Aborted("stopped by the operator")
        case OSError() | ImportError():  # files, memory, a package that was changed meanwhile
            failed = BenchError(f"this computer ended the run: {type(error).__name__}: {error}")
            failed.__cause__ = error
            return failed
    return BenchError(f"the program has a mistake: {type(error).__name__}: {error}")


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


class _UnderWay(Struct):
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

    def take_error(self, error: BenchError) -> None:
        """Keep the first error, unless something is not safe: that comes before everything."""
        if self.error is error or isinstance(self.error, NotSafe):
            return
        if isinstance(error, NotSafe) and self.error is not None:
            error.hint = "; ".join(filter(None, [error.hint, f"before that: {self.error}"]))
        if isinstance(error, NotSafe) or self.error is None:
            if self.execution is not None:
                error.what = in_unit(error.what, self.prepared.settings.station.output_unit)
            self.error = error

    def observers_lost(self) -> list[str]:
        """Return the observers that failed, each with its error."""
        return [f"{name}: {each.lost}" for name, each in self.observers.items() if each.lost is not None]

    def as_run(self) -> Run:
        """Return the run so far; complete when every step was performed and the results could be computed."""
        prepared, execution = self.prepared, self.execution
        description: BenchDescription | None = getattr(prepared, "description", None)
        status = Status.ABORTED if self.evaluation is None else Status.COMPLETE
        points = () if execution is None else execution.points
        evaluation = nothing(points) if self.evaluation is None else self.evaluation
        kept = ("bench_seconds", "physical_minimum_s", "asked_again", "not_checked", "pauses")
        done = {} if execution is None else {name: getattr(execution, name) for name in kept}
        return Run(
            procedure=prepared.name,
            status=status,
            points=points,
            results=evaluation.results,
            no_results=None if self.evaluation is not None else f"the record is {status.value}",
            error=self.error,
            verdict=evaluation.verdict,
            directory=None if prepared.directory is None else prepared.directory.path,
            bench=None if description is None else description.name,
            simulated=None if description is None else description.simulated,
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
        """Tell the program that the bench file names; a failure of it does not change the outcome of the run."""
        request, description = self.prepared.request, getattr(self.prepared, "description", None)
        if description is None or description.notify is None or (request.runs is None and self.error is None):
            return
        with suppress(Exception):
            if (failure := notify(description.notify, outcome_of(self.as_run()))) is not None:
                request.warn(f"nobody was notified: {failure}")

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
        prepared.metadata = with_ambient(prepared.metadata, bench)
        began_s = bench.clock.now() if prepared.began_s is None else prepared.began_s
        with signals.undivided():
            journal = self._open_journal(bench.identities, began_s, bench.clock.now() - began_s)
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
            except BenchError as error:
                error.step = error.step or "end of the run, all was measured"
                self.take_error(error)

    def _open_journal(self, identities: Mapping[str, Identity], began_s: float = 0.0, done_s: float = 0.0) -> Journal:
        prepared, description = self.prepared, self.prepared.description
        kept = prepared.directory
        on_disk = SimulatedJournal if description.simulated else Journal
        journal = MemoryJournal() if kept is None else on_disk(kept.journal)
        procedure, bench = prepared.procedure, to_builtins(description)
        del bench["notify"]  # resuming a record elsewhere runs no program that it names
        equipment = equipment_on(today(), description, identities, identities)
        self.header = {
            "run": "" if kept is None else kept.run,
            "procedure": procedure.name,
            "title": procedure.title,
            **({"method": procedure.method} if procedure.method else {}),
            "simulated": description.simulated,
            "seed": prepared.seed,
            "versions": installed_versions(),
            "identities": to_builtins(identities),
            "options": {**to_builtins(prepared.request.options, enc_hook=shown), "settings": prepared.asked()},
            "settings": to_builtins(prepared.settings),
            "bench": bench,
            "began_s": began_s,
            "planned_s": done_s + prepared.planned().bench_seconds,
            "metadata": prepared.metadata.as_json(),
            "equipment": [each.as_json() for each in equipment],
            **({} if self.key is None else {"signed_by": self.key.public}),
            **profile_of(description),
            **prepared.header_entries(),
        }
        try:
            journal.header(self.header)
        except BenchError:  # without a first line nothing that came later could be read
            journal.close()
            if kept is not None:
                kept.journal.unlink()
            raise
        self.journal = journal
        return journal

    def close(self, display_lost: str | None) -> None:
        """Compute the results, end the journal, and write the files derived from it."""
        if self.journal is not None and self.execution is not None and self.execution.status is Status.COMPLETE:
            self._compute(self.journal)
        directory = self.prepared.directory
        if self.journal is None and isinstance(self.error, NotSafe):  # the bench did not open, and is left unsafe
            self.safe_reports = self.error.reports
            try:
                self._open_journal({})
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
            failed = MeasurementError(f"the points give no result: {error.what}", hint=error.hint or LOOK_AT_SIGNALS)
            failed.__cause__ = error.__cause__
            self.take_error(failed)
        except (ImportError, OSError) as error:  # modules of results are loaded late: a file or package may be gone
            words = f"the results could not be worked out: {type(error).__name__}: {error}"
            self.take_error(BenchError(words, hint="the record is whole: vcfbench report makes them of it"))
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
    """Return the text of the table's profile, if it is a file of one's own: its path alone says little later on."""
    dialect = "" if description.rate_table is None else description.rate_table.dialect
    if not dialect.endswith(".toml"):
        return {}
    return {"table_profile": read_text(dialect, "a profile of a rate table")}
