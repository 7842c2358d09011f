"""Conducts a run: from the bench file through the open bench to the record, which is closed however the run ends."""

from __future__ import annotations

import os
from contextlib import ExitStack, nullcontext, suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Final

import msgspec
from msgspec import Struct, field, structs, to_builtins

from vcfbench.archive.results import evaluate, nothing
from vcfbench.archive.run import Run, breaks
from vcfbench.bench.bench import open_bench
from vcfbench.clock import utc_now
from vcfbench.errors import Aborted, BenchError, ConfigError, MeasurementError, NotSafe
from vcfbench.files import shown
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.layers import asked_in_python
from vcfbench.procedures.procedure import Provenance
from vcfbench.records.directory import create_run
from vcfbench.records.export import points_csv, result_text, write_text
from vcfbench.records.journal import Journal, MemoryJournal, SimulatedJournal
from vcfbench.records.metadata import RunMetadata, equipment_of, metadata_of
from vcfbench.records.schema import Status
from vcfbench.reports.kept import plain_report
from vcfbench.reports.shielded import Shielded
from vcfbench.runs.hands import operator_of, require_operator
from vcfbench.runs.needs import roles_of, with_ambient
from vcfbench.runs.request import Beginning, Checked, Request, blamed_on, prepare
from vcfbench.safety.roles import needed_roles
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.trust import require_library
from vcfbench.station.equipment import equipment_on, overdue_words
from vcfbench.steps.executor import Executor, Paused, StepStarted
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import LOOK_AT_SIGNALS
from vcfbench.version import installed_versions

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from contextlib import AbstractContextManager

    from vcfbench.archive.results import Evaluation
    from vcfbench.bench.bench import Bench
    from vcfbench.interfaces import Identity, SafeReport
    from vcfbench.procedures.procedure import AnyProcedure
    from vcfbench.records.directory import RunDirectory
    from vcfbench.records.signing import SigningKey
    from vcfbench.runs.pausing import Pausing
    from vcfbench.runs.request import DryRun, Prepared
    from vcfbench.safety.control import RunControl
    from vcfbench.safety.trust import Trust
    from vcfbench.safety.watchdog import Watchdog
    from vcfbench.station.description import BenchDescription
    from vcfbench.steps.executor import Event, Execution, Observer
    from vcfbench.steps.step import Operator

    Preparing = Callable[[Request, Checked], Prepared]

_OVERTIME_S: Final = 60.0
"""By how much a step may take longer than twice its estimate, wall time."""
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
    """
    if runs is not None and not str(runs).strip():
        raise ConfigError("runs: expected a directory, came an empty name")
    with _PREPARING:
        asked_settings = asked_in_python(settings or {})
        said = metadata_of(metadata)
    options = {
        "bench": _words_for(bench),
        "seed": seed,
        "runs": None if runs is None else shown(runs),
        "speed": speed,
        "settings": dict(settings or {}),
    }
    request = Request(
        procedure,
        bench,
        seed,
        asked_settings,
        None if runs is None else Path(runs),
        speed,
        observers,
        operator=operator,
        options=options,
        metadata=said,
        control=control,
        trust=trust,
    )
    with StopSignals() as signals:
        return conduct(request, signals)


def _words_for(bench: BenchDescription | Path | str | None) -> str | None:
    if isinstance(bench, Path | str):
        return shown(bench)
    return None if bench is None else str(getattr(bench, "name", bench))


def conduct(request: Request, signals: StopSignals, preparing: Preparing = prepare) -> Run:
    """Perform `request`, made ready by `preparing`, while `signals` are watched; see :func:`run`."""
    course = _Course(request, preparing)
    control = nullcontext() if request.control is None else request.control.of_run(signals)
    try:
        with control:
            _perform(course, signals)
    except BenchError as error:
        course.take_error(_as_bench_error(error))
    except BaseException as error:
        _notify(course)
        if isinstance(course.error, NotSafe):  # nothing comes before it: not a disk, not a mistake of ours
            raise course.error from error
        raise
    _notify(course)
    done = course.as_run()
    if course.error is not None:
        course.error.run = done
        raise course.error
    return done


def _notify(course: _Course) -> None:
    """Tell the program that the bench file names; a failure of it does not change the outcome of the run."""
    description, request = course.checked.description, course.request
    if description is None or description.notify is None or (request.runs is None and course.error is None):
        return
    from vcfbench.runs.notified import notify, outcome_of  # noqa: PLC0415  # few stations have one

    with suppress(Exception):
        if (failure := notify(description.notify, outcome_of(course.as_run()))) is not None:
            request.warn(f"nobody was notified: {failure}")


class _Course(Struct):
    """State of a run under way, filled in as it becomes known; the unknown rest stays empty."""

    request: Request
    preparing: Preparing
    checked: Checked = field(default_factory=Checked)
    header: Mapping[str, Any] = field(default_factory=dict)
    directory: RunDirectory | None = None
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
            self.error = error

    def observers_lost(self) -> list[str]:
        """Say which observers failed, and how."""
        return [f"{name}: {each.lost}" for name, each in self.observers.items() if each.lost is not None]

    def as_run(self) -> Run:
        """Return the run so far; complete when every step was performed and the results could be computed."""
        description, execution = self.checked.description, self.execution
        status = Status.ABORTED if self.evaluation is None else Status.COMPLETE
        points = () if execution is None else execution.points
        evaluation = nothing(points) if self.evaluation is None else self.evaluation
        return Run(
            procedure=self.checked.name,
            status=status,
            points=points,
            results=evaluation.results,
            no_results=None if self.evaluation is not None else f"the record is {status.value}",
            error=self.error,
            verdict=evaluation.verdict,
            directory=None if self.directory is None else self.directory.path,
            bench=None if description is None else description.name,
            simulated=None if description is None else description.simulated,
            seed=self.checked.seed,
            bench_seconds=None if execution is None else execution.bench_seconds,
            physical_minimum_s=None if execution is None else execution.physical_minimum_s,
            asked_again=() if execution is None else execution.asked_again,
            observers_lost=tuple(self.observers_lost()),
            not_checked=() if execution is None else execution.not_checked,
            device_entry=self.kept,
            metadata=self.checked.metadata,
            equipment=equipment_of(self.header),
            resumed=breaks(self.header, len(points)),
            pauses=() if execution is None else execution.pauses,
            _own_report=evaluation.report,
            _header=self.header,
        )


def _perform(course: _Course, signals: StopSignals) -> None:
    """Open the bench, perform the plan, make all safe, and only then close the record."""
    request = course.request
    with _PREPARING:
        prepared = course.preparing(request, course.checked)
        require_library(prepared.description, request.trust)
        planned = prepared.planned()
        require_operator(request, prepared.description, planned)
        if prepared.description.simulated:
            _load_numpy()
    _warn_of_calibrations(request, prepared)
    record = _Record(course, prepared, planned)
    course.observers = {
        f"{number} ({type(each).__name__})": Shielded(partial(_as_context, each))
        for number, each in enumerate(request.observers, start=1)
    }
    directory = record.prepare()
    procedure, description = prepared.procedure, prepared.description
    kept = None if directory is None else directory.path
    beginning = Beginning(procedure, description, planned, kept, prepared.points())
    display = Shielded(partial(request.display, beginning))
    try:
        with ExitStack() as watching:
            watchers = [watching.enter_context(each) for each in (display, *course.observers.values())]
            seed, speed = course.checked.seed, request.speed
            needs = roles_of(prepared.procedure, prepared.description)
            now_s = prepared.now_s()
            opened = open_bench(
                prepared.description,
                seed=seed,
                speed=speed,
                signals=signals,
                build=request.build,
                needs=needs,
                now_s=now_s,
                trust=True,  # it was asked for
            )
            bench = watching.enter_context(opened)
            for each in sorted(set(bench.left_by.values())):
                request.warn(f"{each} died with this bench and nothing made it safe; its table stands now")
            record.perform(bench, watchers, signals)
    except BaseException as error:
        course.take_error(_as_bench_error(error))
        if not isinstance(error, BenchError | KeyboardInterrupt | OSError | ImportError):
            raise  # a mistake of ours; the record is closed all the same
    finally:
        signals.close()
        record.close(display.lost)


def _warn_of_calibrations(request: Request, prepared: Prepared) -> None:
    """Say which of the instruments that the run opens are overdue, before anything else is said."""
    description = prepared.description
    roles = [each.name for each in needed_roles(description, roles_of(prepared.procedure, description))]
    for words in overdue_words(equipment_on(utc_now().date(), description, roles, {})):
        request.warn(words)


def _load_numpy() -> None:
    """Load the parts that numpy loads at their first use, which fails where two threads use it at once."""
    import numpy.fft  # noqa: PLC0415
    import numpy.ma  # noqa: PLC0415
    import numpy.polynomial  # noqa: PLC0415
    import numpy.random  # noqa: F401, PLC0415


def _as_context(observer: Observer) -> AbstractContextManager[Observer]:
    return nullcontext(observer)


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


def _without_result(error: Exception) -> BenchError:
    """Return the reason for the missing result; modules of results are loaded late: a file or package may be gone."""
    if isinstance(error, BenchError):
        failed = MeasurementError(f"the points give no result: {error.what}", hint=error.hint or LOOK_AT_SIGNALS)
        failed.__cause__ = error.__cause__
        return failed
    return BenchError(
        f"the results could not be worked out: {type(error).__name__}: {error}",
        hint="the record is whole: vcfbench report makes them of it",
    )


class _WatchedSteps(Struct, frozen=True):
    """Tells the watchdog the step under way, and the longest that it may take."""

    watchdog: Watchdog

    def handle(self, event: Event) -> None:
        """Pass on each beginning; every exchange has a deadline of its own, and this one is for hangs.

        A pause may take any time, until the next step begins.
        """
        if isinstance(event, StepStarted):
            step = event.step
            longest_s = None if step.waits_for_person else 2.0 * step.duration_s + _OVERTIME_S
            self.watchdog.step(f"step {event.number} ({step.describe()})", longest_s)
        elif isinstance(event, Paused):
            self.watchdog.step(f"pause after step {event.number}, by {event.by}", None)


class _Record(Struct):
    """The record of one run: journal while it goes, results and points when it is over."""

    course: _Course
    prepared: Prepared
    planned: DryRun
    journal: Journal | None = None
    safe_reports: Sequence[SafeReport] = ()
    watchdog: Watchdog | None = None
    key: SigningKey | None = None
    identities: Mapping[str, Identity] = field(default_factory=dict)

    def prepare(self) -> RunDirectory | None:
        """Make the record's directory, before any instrument is touched: a run that cannot be recorded need not begin.

        None where no record is to be kept, which real benches are not run without.
        """
        self.key = _key_of(self.prepared.description)
        runs = self.course.request.runs
        if runs is not None:
            self.course.directory = create_run(runs, self.prepared.procedure.name)
        elif not self.prepared.description.simulated:
            raise ConfigError("runs: expected a directory for the record: without one only simulated benches are run")
        return self.course.directory

    def perform(self, bench: Bench, watchers: Sequence[Observer], signals: StopSignals) -> None:
        """Open the journal, perform the plan on `bench`, and keep the outcome."""
        course = self.course
        course.checked.seed = bench.seed
        self.prepared = prepared = _identified(self.prepared, bench.identities, bench.seed)
        self.safe_reports = bench.safe_reports  # filled when the bench is left
        self.identities = dict(bench.identities)
        prepared.require_bench(bench)
        course.checked.metadata = with_ambient(course.checked.metadata, bench)
        began_s = bench.clock.now() if prepared.began_s is None else prepared.began_s
        with signals.undivided():
            journal = self._open_journal(bench.identities, began_s, bench.clock.now() - began_s)
        operator = operator_of(course.request, bench)
        self.watchdog = watchdog = bench.watchdog
        if watchdog is not None and course.directory is not None:
            watchdog.keep_in(course.directory.journal)
            watchers = [*watchers, _WatchedSteps(watchdog)]
        pausing = self._pausing(bench)
        executor = Executor(bench, journal, watchers, operator, began_s, undivided=signals.undivided, pausing=pausing)
        try:
            with blamed_on(prepared.procedure):
                execution = prepared.perform(executor)
        finally:
            course.execution = executor.so_far()
        if execution.error is not None:
            course.take_error(execution.error)

    def _pausing(self, bench: Bench) -> Pausing | None:
        request = self.course.request
        if request.control is None:
            return None
        from vcfbench.runs.pausing import Pausing  # noqa: PLC0415  # few runs are controlled

        return Pausing.of(request.control, bench, self.prepared, request.speed)

    def _open_journal(self, identities: Mapping[str, Identity], began_s: float = 0.0, done_s: float = 0.0) -> Journal:
        kept = self.course.directory
        on_disk = SimulatedJournal if self.prepared.description.simulated else Journal
        journal = MemoryJournal() if kept is None else on_disk(kept.journal)
        times = {"began_s": began_s, "planned_s": done_s + self.planned.bench_seconds}
        self.course.header = self._header("" if kept is None else kept.run, identities, times)
        try:
            journal.header(self.course.header)
        except BenchError:  # without a first line nothing that came later could be read
            journal.close()
            if kept is not None:
                kept.journal.unlink()
            raise
        self.journal = journal
        return journal

    def _header(self, name: str, identities: Mapping[str, Identity], times: Mapping[str, float]) -> dict[str, Any]:
        course, description = self.course, self.prepared.description
        equipment = equipment_on(utc_now().date(), description, identities, identities)
        return {
            "run": name,
            "procedure": self.prepared.procedure.name,
            "title": self.prepared.procedure.title,
            **({"method": method} if (method := self.prepared.procedure.method) else {}),
            "simulated": description.simulated,
            "seed": course.checked.seed,
            "versions": installed_versions(),
            "identities": msgspec.to_builtins(identities),
            "options": msgspec.to_builtins(course.request.options, enc_hook=shown),
            "settings": msgspec.to_builtins(self.prepared.settings),
            "bench": _without_program(msgspec.to_builtins(description)),
            **times,
            "metadata": course.checked.metadata.as_json(),
            "equipment": [each.as_json() for each in equipment],
            **({} if self.key is None else {"signed_by": self.key.public}),
            **profile_of(description),
            **self.prepared.header_entries(),
        }

    def close(self, display_lost: str | None) -> None:
        """Compute the results, end the journal, and write the files derived from it."""
        course = self.course
        if course.execution is not None and course.execution.status is Status.COMPLETE:
            self._compute()
        if self.journal is None:
            self._without_journal()
        if self.journal is not None:
            try:
                self._end(self.journal, display_lost)
                self._keep_of_device()
            except BenchError as error:
                course.take_error(error)

    def _end(self, journal: Journal, display_lost: str | None) -> None:
        """Write the footer, which vouches for all that is derived, and that, each whatever becomes of the others."""
        derived: Mapping[str, str] = {}
        try:
            derived = self._derived()
        finally:
            try:
                files = {name: sha256(text.encode()).hexdigest() for name, text in derived.items()}
                journal.footer({**self._footer(display_lost), "files": files})
                if self.key is not None:
                    journal.signature(self.key)
            finally:
                try:
                    self._write(derived)
                finally:
                    journal.close()

    def _keep_of_device(self) -> None:
        """Add the procedure's entry for the device to its store: of a run that is complete, recorded and safe."""
        course, procedure, settings = self.course, self.prepared.procedure, self.prepared.settings
        if procedure.entry is None or course.error is not None or course.evaluation is None or course.directory is None:
            return
        kept = procedure.entry(settings, course.evaluation.results, self._made(course.evaluation))
        if kept is not None:
            from vcfbench.records.devices import DeviceStore  # noqa: PLC0415

            try:
                course.kept = DeviceStore(kept.store).add(kept.record).path
            except ConfigError as error:
                error.hint = f"the record has it: vcfbench device --add {course.directory.run} keeps it later"
                raise

    def _made(self, evaluation: Evaluation) -> Provenance:
        assert self.course.directory is not None  # noqa: S101  # there is a journal
        description, verdict = self.prepared.description, evaluation.verdict
        return Provenance(
            bench=description.name,
            run=self.course.directory.run,
            simulated=description.simulated,
            instruments={role: _words_of(identity) for role, identity in self.identities.items()},
            finished=utc_now(),
            verdict=None if verdict is None else verdict.word,
        )

    def _without_journal(self) -> None:
        """Keep no record of a bench that did not open, unless something was left unsafe by that."""
        course = self.course
        if isinstance(course.error, NotSafe):
            self.safe_reports = course.error.reports
            try:
                self._open_journal({})
            except BenchError as error:
                course.take_error(error)
        elif course.directory is not None:
            course.directory.discard()
            course.directory = None

    def _compute(self) -> None:
        course, settings = self.course, self.prepared.settings
        assert self.journal is not None  # noqa: S101  # the plan was performed
        measured = Measured(course.as_run().points, self.journal.lines)
        try:
            course.evaluation = evaluate(self.prepared.procedure, settings, settings.acceptance, measured)
        except (BenchError, ImportError, OSError) as error:
            course.take_error(_without_result(error))
            return
        refusal = getattr(course.evaluation.results, "refusal", None)
        if callable(refusal) and (why := refusal()):
            course.take_error(MeasurementError(why))

    def _footer(self, display_lost: str | None) -> dict[str, Any]:
        done, lost = self.course.as_run(), self.course.observers_lost()
        error = None if done.error is None else {"kind": type(done.error).__name__, "what": str(done.error)}
        return {
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
        }

    def _derived(self) -> dict[str, str]:
        """Return the files derived from the journal, by name."""
        done = self.course.as_run()
        if done.directory is None or done.physical_minimum_s is None:
            return {}
        answer = done.as_json()
        for key in ("run", "equipment"):  # they go by the time of day; the same seed shall give the same bytes
            del answer[key]
        answer["physical_minimum_s"] = done.physical_minimum_s
        answer |= self._report_kept()
        return {"result.json": result_text(answer), "points.csv": points_csv(done.points)}

    def _write(self, derived: Mapping[str, str]) -> None:
        if self.course.directory is not None:
            for name, text in derived.items():
                write_text(self.course.directory.path / name, text)

    def _report_kept(self) -> dict[str, Any]:
        """Return the report of a procedure that does not come along: its code may not be there when it is asked for."""
        if self.course.evaluation is None or self.prepared.procedure.name in BUILT_IN:
            return {}
        with suppress(ConfigError):  # a number in it is not finite: the results are kept all the same
            return {"report": plain_report(self.course.evaluation.report)}
        return {}


def _without_program(bench: dict[str, Any]) -> dict[str, Any]:
    """Return a bench without its program to notify: resuming a record elsewhere runs no program that it names."""
    del bench["notify"]
    return bench


def _key_of(description: BenchDescription) -> SigningKey | None:
    """Return the key that signs the record; ConfigError where one is named that cannot be used."""
    if not description.laboratory.signing_key and not os.environ.get("VCFBENCH_SIGNING_KEY"):
        return None
    from vcfbench.records.signing import named_key  # noqa: PLC0415  # few records are signed

    return named_key(description.laboratory.signing_key)


def _identified(prepared: Prepared, identities: Mapping[str, Identity], seed: int | None) -> Prepared:
    """Return the prepared run with the instruments told apart, by the serial numbers that they answered.

    Simulated ones answer one and the same, whichever specimen the seed has drawn: there the seed tells. What a server
    draws of its bench it does not say, so all of its instruments go by its seed.
    """
    settings, description = prepared.settings, prepared.description
    if description.simulated:
        simulation = description.simulation
        placed = {
            role: each.drawn_by(seed) if simulation is None or "drawn" in getattr(simulation.errors, role, ()) else each
            for role, each in settings.station.instruments.items()
        }
    else:
        placed = {
            role: each.answering(identities[role].serial) if role in identities else each
            for role, each in settings.station.instruments.items()
        }
    station = structs.replace(settings.station, instruments=placed)
    return structs.replace(prepared, settings=structs.replace(settings, station=station))


def _words_of(identity: Identity) -> str:
    fields = (identity.maker, identity.model, identity.serial, identity.firmware)
    return ",".join(fields) if any(fields) else "says nothing of itself"


def profile_of(description: BenchDescription) -> dict[str, str]:
    """Return the text of the table's profile, if it is a file of one's own: its path alone says little later on."""
    dialect = "" if description.rate_table is None else description.rate_table.dialect
    if not dialect.endswith(".toml"):
        return {}
    from vcfbench.drivers.rate_table.profile import profile_text  # noqa: PLC0415

    return {"table_profile": profile_text(dialect)}
