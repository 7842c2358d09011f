"""Several plans in lockstep are one plan.

Equal steps are done once; a step that looks at the output is one of each device (:class:`EachOf`). A plan that refuses
what was measured, or fails in a step, ends for itself, and the others go on; the last to live ends the run.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial

from msgspec import Struct, field

from vcfbench.errors import BenchError, PlanError
from vcfbench.steps.each import DeviceEnded, EachOf, EachResult, EndedStep
from vcfbench.steps.meter import Acquire, AcquireGapless, LookAtOutput
from vcfbench.steps.no_result import as_bench_error
from vcfbench.steps.step import Plan, Step, StepResult, abandon
from vcfbench.steps.stream import LookAtStream
from vcfbench.steps.stream_latency import MeasureLatency

OF_EACH = (Acquire, LookAtOutput, LookAtStream, MeasureLatency)
"""Steps that look at the output of each device."""


class _Part(Struct):
    """The plan of one device: `asked` is its step to come, `done` the answers so far."""

    name: str
    begin: Callable[[], Plan]
    plan: Plan
    asked: Step | None = None
    last: Step | None = None
    done: list[StepResult | BenchError] = field(default_factory=list)
    error: BenchError | None = None
    looked_at: int = -1

    def go(self, advance: Callable[[], Step]) -> None:
        """Go on to the next step, or to the end."""
        try:
            self.asked = advance()
        except StopIteration:
            self.asked = None
        except Exception as error:  # noqa: BLE001  # what is no error of readings is raised again
            self.asked, self.error = None, as_bench_error(error, len(self.done))

    def answer(self, answer: StepResult | BenchError) -> None:
        """Answer its step."""
        self.last = self.asked
        self.done.append(answer)
        self.go(partial(self.plan.throw if isinstance(answer, BenchError) else self.plan.send, answer))  # type: ignore[arg-type]

    def end(self, error: BenchError) -> None:
        """End it where it is; none of its steps is done any more."""
        self.error = error
        abandon(self.plan)
        self.asked = None

    def refusal(self) -> BenchError | None:
        """Return the error for which the bench comes to rest, or None; found by the same plan again."""
        if self.looked_at == len(self.done):  # and it had none
            return None
        self.looked_at = len(self.done)
        again = self.begin()
        try:
            next(again)
            for each in self.done:
                again.throw(each) if isinstance(each, BenchError) else again.send(each)
            while True:
                again.throw(_LookedAt("only looked at"))
        except StopIteration:
            return None
        except BenchError as error:
            return _behind(error)


class _LookedAt(BenchError):
    """Thrown into a plan to see the error that it deals with."""


def _behind(error: BaseException | None) -> BenchError | None:
    """Return the error that was being dealt with when a plan was only looked at."""
    while error is not None:
        if isinstance(error, BenchError) and not isinstance(error, _LookedAt):
            return error
        error = error.__context__
    return None


def together(plans: Mapping[str, Callable[[], Plan]]) -> Plan:
    """Perform the plans of several devices as one; each is made by a function, by the name of its device.

    Raises:
        BenchError: no device came to its end; it tells the error of each.
    """
    parts = [_Part(name, begin, begin()) for name, begin in plans.items()]
    for each in parts:
        each.go(partial(next, each.plan))
    try:
        yield from _lockstep(parts)
    finally:
        for each in parts:
            abandon(each.plan)


def _lockstep(parts: list[_Part]) -> Plan:
    said: set[str] = set()
    stopped: BenchError | None = None
    while going := [each for each in parts if each.asked is not None]:
        if stopped is None:
            yield from _ended(parts, said)
        of = _alike(going) if stopped is not None else _next_of(going)
        if not of:  # some have ended
            continue
        try:
            result = yield _step_of(of)
        except BenchError as error:
            stopped = error
            for each in going:
                each.answer(error.of_devices.get(each.name, error))
            continue
        for each in of:
            if isinstance(result, EachResult) and each.name in result.ended:
                each.end(result.ended[each.name].error)
            else:
                each.answer(result.results[each.name] if isinstance(result, EachResult) else result)
    if stopped is None:
        yield from _ended(parts, said)
    failed = {each.name: each.error for each in parts if each.error is not None}
    if len(failed) == len(parts):
        raise stopped if stopped is not None and not stopped.of_devices else BenchError.joined(failed)


def _ended(parts: list[_Part], said: set[str]) -> Iterator[Step]:
    """Yield the end of each device that has ended by an error of its own since."""
    for each in parts:
        if each.error is not None and each.name not in said:
            said.add(each.name)
            by = EndedStep.by(each.error)
            yield DeviceEnded(each.name, by.kind, by.what)


def _alike(going: list[_Part]) -> list[_Part]:
    """Return those that ask for the step of the first."""
    return [each for each in going if _is_same(each.asked, going[0].asked)]


def _next_of(going: list[_Part]) -> list[_Part]:
    """Return those whose step is next: all, or those that measure again while the others wait.

    Where plans part otherwise, those end that refuse their readings, else those that ask for another step than most.
    """
    if len(of := _alike(going)) == len(going):
        return of
    refused = {each.name: error for each in going if (error := each.refusal()) is not None}
    live = [each for each in going if each.name not in refused]
    if refused and (live or len(of) < len(going)):
        for each in going:
            if each.name in refused and (live or each not in of):
                each.end(refused[each.name])
        return []
    again = [each for each in going if isinstance(each.asked, Acquire) and _is_same(each.asked, each.last)]
    if 0 < len(again) < len(going) and len(_alike(again)) == len(again):
        return again
    most = max(([each for each in going if _is_same(each.asked, one.asked)] for one in going), key=len)
    for each in going:
        if each not in most:
            asked, others = (one.describe() if one else "" for one in (each.asked, most[0].asked))
            each.end(PlanError(f"it asks for ({asked}), the others for ({others}): they cannot be measured together"))
    return []


def _is_same(one: Step | None, other: Step | None) -> bool:
    """Return True if two devices ask for the same; of a look at the output some numbers are each device's own."""
    if isinstance(one, OF_EACH) and isinstance(other, OF_EACH):
        return type(one) is type(other) and one.describe() == other.describe()
    return one == other


def _step_of(of: list[_Part]) -> Step:
    asked = {each.name: each.asked for each in of}
    first = next(iter(asked.values()))
    assert first is not None  # noqa: S101  # only those that ask are here
    if isinstance(first, AcquireGapless):
        raise PlanError(
            "a record without gaps is taken of one device at a time",
            hint="mode = corrected, or a bench file for each device alone",
        )
    return EachOf(type(first).__name__, asked) if isinstance(first, OF_EACH) else first
