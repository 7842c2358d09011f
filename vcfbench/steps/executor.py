"""The executor: the only place that acts. It performs each step of a plan, writes it to the journal, and goes on.

When a step fails, the failure is written down and thrown into the plan, whose `finally` clauses then bring table,
generator and supply to rest, step by step; what was measured is kept. A person's stop ends the plan at once. Either way
the bench's safety stack makes all safe once more, and proves it.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from typing import Any, Protocol, TypeVar

from msgspec import Struct, to_builtins

from vcfbench.bench.bench import Bench
from vcfbench.clock import TimeOfDay
from vcfbench.errors import Aborted, BenchError, MeasurementError
from vcfbench.interfaces import Operator, nobody
from vcfbench.records.journal import Journal
from vcfbench.records.schema import Point, Status
from vcfbench.steps import Window
from vcfbench.steps.events import (
    Event,
    Moved,
    Observer,
    Paused,
    ReadingTaken,
    StepFailed,
    StepFinished,
    StepStarted,
    WentOn,
)
from vcfbench.steps.no_result import as_bench_error
from vcfbench.steps.replay import TakenOver
from vcfbench.steps.step import Context, Effect, Plan, Reading, Routine, Step, StepResult, abandon
from vcfbench.steps.supply import cause_behind
from vcfbench.typed import typed

_T = TypeVar("_T")

_AGAIN = "starting up again"


class Pauses(Protocol):
    """Pauses of a run: the wish for one, the steps before and after it, and its length."""

    @property
    def by(self) -> str:
        """Source of the request to pause after the present step, or ""."""

    def wait(self) -> tuple[str, float]:
        """Wait until the run is to go on; return the source of that and the time waited, s of wall time."""

    def to_rest(self, done: Sequence[Step]) -> Routine[Window | None]:
        """Bring the bench to rest after the steps `done`, and look at the output, where that can be compared."""

    def looked_at(self, done: Sequence[Step]) -> Routine[Window]:
        """Look at the output again."""

    def moved(self, done: Sequence[Step], before: Window, after: Window) -> Moved:
        """Return the amount by which it moved."""

    def as_before(self, done: Sequence[Step], disturbed: AbstractSet[str]) -> Routine[None]:
        """Bring the bench to where it was before the pause, in which `disturbed` was set."""


class Execution(Struct, frozen=True):
    """Outcome of a plan: status, the points kept, the first error, and times in bench seconds.

    `physical_minimum_s` is the sum of the averaging windows, ramps and settling of the steps performed: the time
    below which no controller can come with this table and this settling. `asked_again` says which answers could not be
    believed, and in which step, so that they were asked for once more. `not_checked` says what the plan would have
    checked on another bench. `bench_seconds` has no pauses in it; `pauses` says what came of each.
    """

    status: Status
    points: tuple[Point, ...]
    error: BenchError | None
    bench_seconds: float
    physical_minimum_s: float
    asked_again: tuple[str, ...] = ()
    not_checked: tuple[str, ...] = ()
    pauses: tuple[str, ...] = ()


class Executor:
    """Performs plans on one open bench; `began_s` is the bench time at which they began, None: now.

    What is done in `undivided` no signal breaks off: a line of the journal and what is counted of it. `pausing` is who
    may have the run pause.
    """

    def __init__(
        self,
        bench: Bench,
        journal: Journal,
        observers: Sequence[Observer] = (),
        operator: Operator = nobody,
        began_s: float | None = None,
        *,
        undivided: Callable[[], AbstractContextManager[None]] = nullcontext,
        pausing: Pauses | None = None,
    ) -> None:
        self.bench = bench
        self.journal = journal
        self.observers = list(observers)
        self.operator = operator
        self._undivided = undivided
        self._context = Context(bench, self._heard, operator=operator, undivided=undivided)
        self._started_s = bench.clock.now() if began_s is None else began_s
        self._number = self._written = 0
        self._owed: list[dict[str, Any]] = []
        self._points: list[Point] = []
        self._asked_again: list[str] = []
        self._not_checked: list[str] = []
        self._physical_s = 0.0
        self._error: BenchError | None = None
        self._walked = False
        self._pausing = pausing
        self._performed: list[Step] = []
        self._moved: tuple[float, float] | None = None  # by how much the output did in pauses, and its u, V
        self._disturbed: set[str] = set()  # what was set beside the plan
        self._pauses: list[str] = []
        self._paused_s = 0.0
        self._time_of_day = TimeOfDay()

    def execute(self, plan: Plan) -> Execution:
        """Perform `plan` to its end or to its first error, and return the outcome.

        Errors of the bench are in the result, not raised: what was measured must not be lost with them.
        """
        advance: Callable[[], Step] = partial(next, plan)
        try:
            while True:
                try:
                    step = advance()
                except StopIteration:
                    break
                except Exception as error:  # noqa: BLE001  # what is no error of readings is raised again
                    self._keep(as_bench_error(error, self._number))
                    break
                advance = self._perform(plan, step)
            self._walked = True
        finally:
            abandon(plan)
        return self.so_far()

    def take_over(self, taken: Iterable[TakenOver]) -> None:
        """Write down, and count as this run's, the steps and pauses before it was broken off. Nothing is done."""
        for each in taken:
            for chunk in each.chunks:
                self.journal.write("readings", chunk)
            each.recall(self._context)
            with self._undivided():
                self.journal.write("step", each.line)
                self._number = self._written = self._number + 1
                self._physical_s += each.step.physical_s
                self._performed.append(each.step)
                self._count(each.result, each.line.get("asked_again", ()), each.line.get("not_checked", ""))
                if (point := each.result.recorded_point) is not None and point.moved_u_v:
                    self._moved = point.moved_v, point.moved_u_v
            for pause in each.pauses:
                self._take_over_pause(pause)

    def _take_over_pause(self, lines: Sequence[Mapping[str, Any]]) -> None:
        for line in lines:
            self.journal.write(line["type"], line)
        said = next(line for line in lines if line["type"] == "went_on")
        moved = typed(said.get("moved"), Moved | None)
        if moved is not None and moved.is_reference:
            self._count_from(moved)
        pause_s = lines[-1].get("end_s", said["t_s"]) - lines[0]["t_s"]
        self._keep_pause(WentOn(said["n"], said["t_s"], said["by"], said["waited_s"], pause_s, moved))

    def restore(self, steps: Routine[None]) -> None:
        """Perform the steps that restore the bench after a break; they are not steps of the run.

        Raises:
            BenchError: it did not come to that; what brings it to rest is up to the safety stack.
        """
        try:
            self._beside(steps, _AGAIN, self._context)
        except BenchError as error:
            self._keep(error)
            raise

    def _beside(self, steps: Routine[_T], why: str, context: Context) -> _T:
        """Perform `steps` outside the run; return their result."""
        advance: Callable[[], Step] = partial(next, steps)
        try:
            while True:
                step = advance()
                try:
                    start_s = self._now()
                    self._tell(StepStarted(self._number, start_s, step))
                    context.begin()
                    result = step.perform(context)
                    self._disturbed.update(step.sets)
                    self._physical_s += step.physical_s
                    line = {**self._done(step, result, start_s), **({} if why == _AGAIN else {"why": why})}
                    self.journal.write("restored", line)
                except BenchError as error:
                    if error.step is None:
                        error.step = f"{why} ({step.describe()})"
                    raise
                self._asked_again += (f"{why}: {said}" for said in context.asked_again)
                self._tell(StepFinished(self._number, self._now(), step, result, tuple(context.asked_again)))
                advance = partial(steps.send, result)
        except StopIteration as end:
            done: _T = end.value
            return done

    def _pause_if_wanted(self) -> None:
        """Pause, where somebody wants that: the bench at rest until somebody wants the run to go on, then as it was."""
        pausing = self._pausing
        if pausing is None or not pausing.by or self._error is not None:
            return
        why, done, begun_s = f"pause after step {self._number}", self._performed, self._now()
        context, physical_s = Context(self.bench, self._heard, undivided=self._undivided), self._physical_s
        self._disturbed.clear()
        self.journal.write("paused", {"n": self._number, "t_s": begun_s, "by": pausing.by})
        before = self._beside(pausing.to_rest(done), why, context)
        self._tell(Paused(self._number, self._now(), pausing.by))
        try:
            by, waited_s = pausing.wait()
        except BenchError as error:
            error.step = f"{self._number}, in the pause after it"
            raise
        moved = None
        if before is not None:
            moved = pausing.moved(done, before, self._beside(pausing.looked_at(done), why, context))
        line = {"n": self._number, "t_s": self._now(), "by": by, "waited_s": waited_s}
        self.journal.write("went_on", {**line, **({} if moved is None else {"moved": to_builtins(moved)})})
        if moved is not None and moved.allowed_v is not None:
            self._count_from(moved)
        self._beside(pausing.as_before(done, frozenset(self._disturbed)), why, context)
        self._physical_s = physical_s
        went_on = WentOn(self._number, self._now(), by, waited_s, self._now() - begun_s, moved)
        self._keep_pause(went_on)
        self._tell(went_on)

    def _keep_pause(self, went_on: WentOn) -> None:
        """Keep a pause for the end of the run, whose bench time it is not."""
        self._paused_s += went_on.pause_s
        self._pauses.append(f"after step {went_on.number}: {went_on.describe()}")

    def _count_from(self, moved: Moved) -> None:
        """Count later measurements from the present output."""
        if not moved.is_reference:
            raise MeasurementError(
                f"{moved.describe()}; at most {moved.allowed_v:.2g} V are noise and drift",
                instrument="multimeter",
                step=f"{self._number}, in the pause after it",
                hint="check leads and contacts, and actions during the pause; expected.zero_drift_v of the "
                "bench file allows a drift",
            )
        before_v, before_u_v = self._moved or (0.0, 0.0)
        self._moved = before_v + moved.moved_v, math.hypot(before_u_v, moved.u_v)

    def so_far(self) -> Execution:
        """Tell the amount by which it has come: after :meth:`execute`, or after something that it does not catch."""
        return Execution(
            Status.COMPLETE if self._walked and self._error is None else Status.ABORTED,
            tuple(self._points),
            self._error,
            self._now() - self._paused_s,
            self._physical_s,
            tuple(self._asked_again),
            tuple(self._not_checked),
            tuple(self._pauses),
        )

    def _perform(self, plan: Plan, step: Step) -> Callable[[], Step]:
        """Do one step, after a pause if one is wanted; return its result, or the error."""
        pausing = True
        try:
            if not step.follows_at_once:
                self._pause_if_wanted()
            self._number, pausing = self._number + 1, False
            result = self._act(step)
        except (Exception, KeyboardInterrupt) as problem:  # noqa: BLE001  # as above
            self._number += pausing
            error = self._failed(step, problem)
            # after a person's stop nothing more is done for the plan, the safety stack takes over
            return partial(next, iter(())) if isinstance(error, Aborted) else partial(plan.throw, error)
        return partial(plan.send, result.referred())

    def _act(self, step: Step) -> StepResult:
        start_s = self._now()
        self._tell(StepStarted(self._number, start_s, step))
        self._context.begin(partial(self._write_chunk, step, start_s))
        result = step.perform(self._context)
        if self._moved is not None:
            result = result.counted_from(*self._moved)
        self._physical_s += step.physical_s
        if self._context.chunks:
            self._context.rest()
        line = self._done(step, result, start_s)
        not_checked = "; ".join(filter(None, (step.not_checked, self._time_of_day.was_set())))
        if not_checked:
            line["not_checked"] = not_checked
        point = result.recorded_point
        if point is not None:
            line["point"] = point.as_json()
        if points := result.recorded_points:
            line["points"] = {name: each.as_json() for name, each in points.items()}
        with self._undivided():
            self._write_owed()
            self.journal.write("step", line)
            self._written = self._number
            self._count(result, self._context.asked_again, not_checked)
        if self._pausing is not None:
            self._performed.append(step)
        self._tell(StepFinished(self._number, self._now(), step, result, tuple(self._context.asked_again)))
        return result

    def _write_chunk(self, step: Step, start_s: float, readings: Sequence[Reading], device: str = "") -> None:
        """Write readings of the step under way; the step stands with them, for its own line may never come."""
        chunk = {
            **self._line(step),
            "t_s": start_s,
            "end_s": self._now(),
            "chunk": self._context.chunks + 1,
            "readings": readings,
            **({"device": device} if device else {}),
        }
        self._write_owed()
        self.journal.write("readings", chunk)

    def _write_owed(self) -> None:
        """Write the failures that the disk did not take when they came, so that later lines leave no gap."""
        while self._owed:
            self.journal.write("error", self._owed[0])
            del self._owed[0]

    def _done(self, step: Step, result: StepResult, start_s: float) -> dict[str, Any]:
        return {
            **self._line(step),
            "t_s": start_s,
            "end_s": self._now(),
            "result_kind": type(result).__name__,
            "result": result.as_json(),
            **self._seen(),
        }

    def _count(self, result: StepResult, asked_again: Sequence[str], not_checked: str) -> None:
        """Keep the point and the notes of a performed step for the end of the run."""
        self._asked_again += (f"step {self._number}: {said}" for said in asked_again)
        if not_checked and not_checked not in self._not_checked:  # parts of one run may leave out the same
            self._not_checked.append(not_checked)
        point = result.recorded_point
        if point is not None:
            self._points.append(point)

    def _line(self, step: Step) -> dict[str, Any]:
        return {"n": self._number, "key": step.key, "step_kind": type(step).__name__, "step": to_builtins(step)}

    def _seen(self) -> dict[str, Any]:
        """Return the optional fields of a line: chunks before it, rejected answers, questions to a person."""
        context = self._context
        seen: dict[str, Any] = {"chunks": context.chunks} if context.chunks else {}
        if context.asked_again:
            seen["asked_again"] = list(context.asked_again)
        if said := self.bench.hands.taken():
            seen["by_hand"] = said
        return seen

    def _failed(self, step: Step, problem: BaseException) -> BenchError:
        """Put the step into the error and both into the journal."""
        error = as_bench_error(problem, self._number)
        if step.effect in {Effect.MEASURES, Effect.CHECKS}:
            error = cause_behind(error, self._context)
        if error.step is None:
            error.step = f"{self._number} ({step.describe()})"
        self._keep(error)
        readings = to_builtins(self._context.readings)
        line = {
            **self._line(step),
            "t_s": self._now(),
            "error_kind": type(error).__name__,
            "error": str(error),
            "readings": readings,
            **self._seen(),
        }
        if error.of_devices:
            line["of_devices"] = {name: [type(of).__name__, str(of)] for name, of in error.of_devices.items()}
        if self._written < self._number:  # else it is done and on the disk: the stop came while it was told
            self._owed.append(line)
            with suppress(BenchError):  # a disk that is full must not keep the bench from being brought to rest
                self._write_owed()
        self._tell(StepFailed(self._number, self._now(), step, error))
        return error

    def _keep(self, error: BenchError) -> None:
        """Keep the first error: those that follow while the bench comes to rest are consequences.

        Of several devices the last has the errors of all.

        A plan knows roles only; where an instrument answers is added here.
        """
        if error.instrument is not None and error.resource is None:
            with suppress(BenchError):  # the instrument that the error is about may be one that the bench has not
                error.resource = getattr(getattr(self.bench, error.instrument, None), "resource", None)
        if self._error is None or (self._error.of_devices and error.of_devices):
            self._error = error

    def _heard(self, reading: Reading) -> None:
        self._tell(ReadingTaken(self._now(), reading))

    def _tell(self, event: Event) -> None:
        for observer in tuple(self.observers):
            try:
                observer.handle(event)
            except OSError:
                self.observers = [other for other in self.observers if other is not observer]

    def _now(self) -> float:
        return self.bench.clock.now() - self._started_s
