"""A resumed run: its plan is started again, and recorded steps are answered from the record.

A step whose key is that of the record gets the result that stands there; nothing of it is done or measured again. Then
the bench, which was made safe meanwhile, is brought to where it was (:func:`start_up_again`), and the plan goes on.
Nothing here opens or sends anything.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from functools import partial
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.errors import BenchError, PlanError
from vcfbench.records.journal import JournalRecord
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import (
    AwaitRate,
    ConfigureRail,
    ConfigureScope,
    DisableSupply,
    DisableTable,
    DisableVvc,
    EnableSupply,
    FindDrive,
    MeasureDrive,
    MeasureDriveAgain,
    Note,
    SetRate,
    Settle,
    StopFlow,
    Window,
)
from vcfbench.steps.decode import result_of, step_of
from vcfbench.steps.drive_check import check_drive
from vcfbench.steps.each import EachOf, EachResult
from vcfbench.steps.step import Context, Effect, Plan, Routine, Step, StepResult, abandon

_LOOKS_AT_DRIVE = (ConfigureScope, FindDrive, MeasureDrive)
_COMES_TO_REST = {
    *(Note, Settle, SetRate, AwaitRate, StopFlow, DisableTable, DisableVvc, DisableSupply),
    *(ConfigureScope, MeasureDriveAgain),  # which after a break is that of another warm-up
}
"""Steps of coming to rest: a plan that asks for no others any more only repeats making safe."""


class TakenOver(Struct, frozen=True):
    """A step that was performed before the break: itself, its result, and its lines of the journal, marked as such.

    `pauses` are the lines of each pause after it from which the run went on.
    """

    step: Step
    result: StepResult
    line: Mapping[str, Any]
    chunks: tuple[Mapping[str, Any], ...] = ()
    pauses: tuple[tuple[Mapping[str, Any], ...], ...] = ()

    def recall(self, context: Context) -> None:
        """Give the steps the recorded readings of their windows."""
        if isinstance(self.step, EachOf) and isinstance(self.result, EachResult):
            for name, seen in self.step.contexts(context)[0].items():
                own = (each for each in self.chunks if each.get("device") == name)
                _recall(self.step.steps[name], own, self.line["result"]["results"].get(name, {}), seen)
        elif isinstance(self.result, Window):
            _recall(self.step, self.chunks, self.line["result"], context)


def _recall(step: Step, chunks: Iterable[Mapping[str, Any]], result: Mapping[str, Any], context: Context) -> None:
    for each in (*chunks, result):
        if readings := each.get("readings"):
            step.recall([reading["voltage_v"] for reading in readings], context)


def taken_over(record: JournalRecord, run: str) -> tuple[TakenOver, ...]:
    """Return the steps that a run resumed from `record` takes over: those before the first that failed.

    `run` is the name of the record; lines that it took over itself keep the name of the run that wrote them. A check of
    the drive signal after which nothing was measured is left out: it waits for something that begins anew.

    Raises:
        PlanError: a step or result is of a kind that is not known here, or of another version, or was changed.
    """
    failed = record.errors[0]["n"] if record.errors else None
    chunks = defaultdict(list)
    for chunk in record.chunks:
        chunks[chunk["n"]].append({"taken_over": run, **chunk})
    taken = []
    for line in [line for line in record.steps if failed is None or line["n"] < failed]:
        step, result = step_of(line), result_of(line)
        if isinstance(step, Step) and step.key != line["key"]:
            raise PlanError(f"step {line['n']} of the record was changed: it says {step.key}, its key is {line['key']}")
        if not (isinstance(step, Step) and isinstance(result, StepResult)):
            unknown = line["result_kind"] if isinstance(step, Step) else line["step_kind"]
            raise PlanError(f"step {line['n']} of the record: a {unknown} of this form is not known here")
        taken.append(TakenOver(step, result, {"taken_over": run, **line}, tuple(chunks[line["n"]])))
    for pause in _pauses(record.lines):
        if 0 <= (place := pause[0]["n"] - 1) < len(taken):
            marked = tuple({"taken_over": run, **line} for line in pause)
            taken[place] = replace(taken[place], pauses=(*taken[place].pauses, marked))
    steps = [each.step for each in taken]
    measured = max((number for number, step in enumerate(steps, 1) if step.effect is Effect.MEASURES), default=0)
    checks = (number for number in range(measured, len(steps)) if isinstance(steps[number], _LOOKS_AT_DRIVE))
    return tuple(taken[: next(checks, len(steps))])


def _pauses(lines: Iterable[Mapping[str, Any]]) -> Iterator[list[Mapping[str, Any]]]:
    """Yield the lines of each pause that ended, those of the steps in it too."""
    pause: list[Mapping[str, Any]] = []
    for line in (*lines, {"type": "the end"}):
        if pause and (line["type"] == "went_on" or "why" in line):
            pause.append(line)
            continue
        if any(each["type"] == "went_on" for each in pause):
            yield pause
        pause = [line] if line["type"] == "paused" else []


def rest_of(plan: Plan, taken: Sequence[TakenOver]) -> Plan:
    """Start `plan`, answer it with the steps `taken` over, and return the rest of it.

    Raises:
        PlanError: it asks for another step than the record has; both are named.
    """
    advance: Callable[[], Step] = partial(next, plan)
    try:
        for each in taken:
            step = advance()
            if step.key != each.line["key"]:
                asked, had = step.describe(), each.step.describe()
                if asked == had:
                    asked, had = step.key, each.line["key"]
                raise PlanError(
                    f"step {each.line['n']} of the record is ({had}), the plan now asks there for ({asked})",
                    hint=_CHANGED,
                )
            advance = partial(plan.send, each.result.referred())
    except StopIteration:
        raise PlanError("the plan now ends before the record does", hint=_CHANGED) from None
    except BenchError:
        abandon(plan)
        raise
    return _going_on(plan, advance)


_CHANGED = "the procedure or its settings were changed since: it cannot be resumed, only run anew"


def _going_on(plan: Plan, advance: Callable[[], Step]) -> Plan:
    """Yield the steps of `plan` from its present one."""
    while True:
        try:
            step = advance()
        except StopIteration:
            return
        try:
            result = yield step
        except BenchError as error:
            advance = partial(plan.throw, error)
        else:
            advance = partial(plan.send, result)


def is_left(rest: Plan, gyro: LinearGyro) -> bool:
    """Return True if `rest` of a plan does more than come to rest; `gyro` answers its steps until that is known.

    Raises:
        BenchError: it ends with that, by itself: what was measured is refused.
    """
    try:
        step = next(rest)
        while type(step) in _COMES_TO_REST:
            step = rest.send(step.predict(gyro))
    except StopIteration:
        return False
    finally:
        abandon(rest)
    return True


def start_up_again(steps: Sequence[Step], settings: ProcedureSettings) -> Routine[None]:
    """Bring a bench that was made safe to where `steps` had brought it.

    Of all steps that set the same the last is done again, in the order of the plan, with the waits after it and the
    checks. What was set before the supply was switched on is set before that again. The gyroscope is given as long
    under power as the plan had given it, `warm_again_s` at most, and that where something was measured since.
    """
    powered = powered_after(steps)
    waits_s = {n: step.physical_s for n, step in enumerate(steps) if step.effect is Effect.WAITS and n >= powered}
    measured = any(step.effect is Effect.MEASURES for step in steps[powered:])
    warm_s = settings.warm_again_s if measured else min(settings.warm_again_s, sum(waits_s.values()))
    repeated = [*_to_repeat(steps, powered)]
    cold_s = warm_s - sum(waits_s.get(number, 0.0) for number in repeated) if powered else 0.0
    for number in repeated:
        if cold_s > 0.0 and number >= powered and steps[number].effect not in {Effect.WAITS, Effect.CHECKS}:
            yield Settle(cold_s, "as warm as before the break")
            cold_s = 0.0
        if isinstance(steps[number], FindDrive | MeasureDrive):
            yield from check_drive(settings)
        else:
            for each in steps[number].again():  # noqa: UP028  # a tuple cannot be sent results
                yield each
    if cold_s > 0.0:
        yield Settle(cold_s, "as warm as before the break")


def set_again(steps: Sequence[Step], disturbed: AbstractSet[str]) -> Routine[None]:
    """Bring a bench that is on to where `steps` had brought it, of which something `disturbed` was set otherwise since.

    Of all steps that set what was disturbed the last is done again, with the waits after it; what it sets besides is
    disturbed by that.
    """
    last = {name: number for number, step in enumerate(steps) for name in step.sets}
    repeated, names = set[int](), {*disturbed} & last.keys()
    while names:
        number = last[names.pop()]
        if number not in repeated:
            repeated.add(number)
            names |= {*steps[number].sets}
    is_repeated = False
    for number, step in enumerate(steps):
        if step.effect is not Effect.WAITS:
            is_repeated = number in repeated
        if is_repeated:
            for each in step.again():  # noqa: UP028  # a tuple cannot be sent results
                yield each


def powered_after(steps: Sequence[Step]) -> int:
    """Return the number of `steps` before the supply is on for the last time; 0 if it never was.

    To switch on what is on already, or to switch off, is no such time.
    """
    powered, is_on = 0, False
    for number, step in enumerate(steps, 1):
        if isinstance(step, EnableSupply):
            powered, is_on = (powered if is_on else number), True
        elif EnableSupply.subject in step.sets:
            is_on = False
    return powered


def _to_repeat(steps: Sequence[Step], powered: int) -> Iterator[int]:
    """Yield the numbers of the steps that are done again; the first look at the drive signal stands for all."""
    lasting = _lasting(steps, 0, powered) | _lasting(steps, powered, len(steps))
    left_out, is_repeated, looked = set[str](), False, False
    for number, step in enumerate(steps):
        looks = isinstance(step, FindDrive | MeasureDrive)
        match step.effect:
            case Effect.SETS:
                is_repeated = number in lasting
                left_out = left_out - {*step.sets} if is_repeated else left_out | {*step.sets}
            case Effect.MEASURES:
                is_repeated = False
            case Effect.CHECKS:
                rails_differ = any(name.startswith(ConfigureRail.subject) for name in left_out)
                is_repeated = number >= powered and not (looked if looks else rails_differ)
                looked = looked or (looks and number >= powered)
        if is_repeated and step.effect is not Effect.NOTHING:
            yield number


def _lasting(steps: Sequence[Step], first: int, end: int) -> set[int]:
    """Return the numbers of those steps from `first` to `end` whose settings no other of them changes.

    Where something must be set before one of them can be done, so is the step that last did: a level is followed later.
    """
    last = {*{name: number for number in range(first, end) for name in steps[number].sets}.values()}
    for number in tuple(last):
        needed = [at for at in range(first, number) if steps[number].needs in steps[at].sets]
        last |= {*needed[-1:]}
    return last
