"""Several plans in lockstep: equal steps once, looks at the output for each, and who ends for himself."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.errors import BenchError, MeasurementError, PlanError
from vcfbench.records.schema import Point
from vcfbench.steps import Acquire, Done, Note, Settle, Window
from vcfbench.steps.each import DeviceEnded, EachOf, EachResult, EndedStep
from vcfbench.steps.step import abandon
from vcfbench.steps.together import together

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.steps import Plan, Step, StepResult

WINDOW = Acquire(1, 0.0, 0.0, None, 0.05, (), 0.1, 2, 1.0, 1e-6)


def seen(output_v: float) -> Window:
    return Window((), None, (), Point(1, 0.0, 0.0, output_v, 0.0, 2))


def plan(*, most_v: float = 1.0, rises: bool = False, others: str = "") -> Plan:
    """Look three times, while it rises again; refuse more than `most_v`; come to rest whatever happens."""
    try:
        yield Note("begin")
        if others:
            yield Note(others)
        output_v, number = 0.0, 0
        while number < 3 or (rises and output_v < 0.5):
            found = yield WINDOW
            assert isinstance(found, Window)
            output_v, number = found.mean_v, number + 1
            if output_v > most_v:
                raise MeasurementError(f"{output_v:g} V is too much")
        yield Settle(1.0, "rest")
    finally:
        yield Note("shut down")


def walked(plans: Mapping[str, Callable[[], Plan]], answers: Callable[[Step], StepResult]) -> list[Any]:
    """Perform plans together with answers, and return the steps; an error ends the list."""
    steps: list[Any] = []
    whole = together(plans)
    try:
        step = next(whole)
        while True:
            steps.append(step)
            step = whole.send(answers(step))
    except StopIteration:
        return steps
    except BenchError as error:
        return [*steps, error]
    finally:
        abandon(whole)


def answer(step: Step, outputs_v: Mapping[str, list[float]]) -> StepResult:
    if not isinstance(step, EachOf):
        return Done()
    return EachResult("Window", {name: seen(outputs_v[name].pop(0)) for name in step.steps}, {})


def kinds(steps: list[Any]) -> list[Any]:
    return [sorted(each.steps) if isinstance(each, EachOf) else type(each).__name__ for each in steps]


def test_equal_steps_are_done_once_and_windows_of_each() -> None:
    outputs_v = {name: [0.1] * 3 for name in "AB"}
    steps = walked({"A": plan, "B": plan}, partial(answer, outputs_v=outputs_v))
    assert kinds(steps) == ["Note", ["A", "B"], ["A", "B"], ["A", "B"], "Settle", "Note"]


@pytest.mark.parametrize("bad", ["A", "B"])
def test_a_plan_that_refuses_its_readings_ends_alone(bad: str) -> None:
    outputs_v = {name: [0.1, 2.0 if name == bad else 0.1, 0.1] for name in "AB"}
    steps = walked({"A": plan, "B": plan}, partial(answer, outputs_v=outputs_v))
    good = "B" if bad == "A" else "A"
    assert kinds(steps) == ["Note", ["A", "B"], ["A", "B"], "DeviceEnded", [good], "Settle", "Note"]
    assert steps[3] == DeviceEnded(bad, "MeasurementError", "2 V is too much")


def test_bench_rests_and_run_fails_if_all_refuse() -> None:
    outputs_v = {name: [0.1, 2.0, 0.1] for name in "AB"}
    steps = walked({"A": plan, "B": plan}, partial(answer, outputs_v=outputs_v))
    assert kinds(steps)[:4] == ["Note", ["A", "B"], ["A", "B"], "Note"]
    assert isinstance(steps[-1], MeasurementError)


def test_a_device_whose_step_failed_ends_alone() -> None:
    def answers(step: Step) -> StepResult:
        if not isinstance(step, EachOf):
            return Done()
        ended = {"B": EndedStep("DeadlineExceeded", "the stream is silent")} if "B" in step.steps else {}
        return EachResult("Window", {"A": seen(0.1)}, ended)

    steps = walked({"A": plan, "B": plan}, answers)
    assert kinds(steps) == ["Note", ["A", "B"], "DeviceEnded", ["A"], ["A"], "Settle", "Note"]
    assert steps[2].kind == "DeadlineExceeded"


def test_those_that_measure_again_are_waited_for() -> None:
    outputs_v = {"A": [0.1] * 3, "B": [0.1, 0.2, 0.3, 0.4, 0.6]}
    steps = walked({"A": plan, "B": partial(plan, rises=True)}, partial(answer, outputs_v=outputs_v))
    assert kinds(steps) == ["Note", *[["A", "B"]] * 3, ["B"], ["B"], "Settle", "Note"]


def test_a_plan_that_goes_its_own_way_ends_alone() -> None:
    outputs_v = {name: [0.1] * 3 for name in "ABC"}
    plans = {"A": plan, "B": partial(plan, others="something else"), "C": plan}
    steps = walked(plans, partial(answer, outputs_v=outputs_v))
    (ended,) = [each for each in steps if isinstance(each, DeviceEnded)]
    assert (ended.device, ended.kind) == ("B", PlanError.__name__)
    assert "something else" in ended.what
    assert kinds(steps)[-2:] == ["Settle", "Note"]


def test_what_fails_for_all_is_thrown_into_all() -> None:
    whole = together({"A": plan, "B": plan})
    steps = [next(whole), whole.send(Done())]
    steps.append(whole.throw(BenchError("the table stopped")))
    with pytest.raises(BenchError, match="the table stopped"):
        whole.send(Done())
    assert kinds(steps) == ["Note", ["A", "B"], "Note"]
