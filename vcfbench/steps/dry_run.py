"""Walk a plan without a bench: every step with the time at which it would begin, nothing opened or sent."""

import math
from collections.abc import Generator
from contextlib import closing

from msgspec import Struct

from vcfbench.errors import LimitError, PlanError
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.meter import Acquire
from vcfbench.steps.sampling import SampleModulated
from vcfbench.steps.step import Plan, Routine, Step, abandon
from vcfbench.steps.table import AwaitRate, SetRate


class PlannedStep(Struct, frozen=True):
    """A step of a plan that was walked: its number from 1, its beginning (s from that of the plan) and the step.

    >>> planned = vcfbench.dry_run("turntable").steps[5]
    >>> f"{planned.number}, {planned.t_s:.1f} s: {planned.step.describe()}"
    '6, 0.3 s: supply N25V (negative rail): -10 V, limit 0.1 A'
    """

    number: int
    t_s: float
    step: Step


_MOST_STEPS = 1_000_000
"""More than any calibration has: a plan that goes on beyond is taken to be one without an end."""

_STEADY_S = 4.0
"""A table with an end of travel has no word for being at its rate: so long its angles are looked at (`aaaa`: 3 s)."""


def walk(plan: Routine[object], gyro: LinearGyro) -> Generator[PlannedStep, None, None]:
    """Yield the steps of `plan` as `gyro` would let it go; their durations add up to the estimate of the bench time."""
    t_s, number = 0.0, 0
    try:
        step = next(plan)
        while True:
            number += 1
            if not isinstance(step, Step):
                several = getattr(step, "__name__", "") if isinstance(step, Generator) else ""
                came = f"the steps of {several}" if several else repr(step)
                hint = "write yield from" if several else None
                raise PlanError(f"step {number}: expected a step, the plan yields {came}", hint=hint)
            kind = type(step)
            if kind.perform is Step.perform and kind.command is Step.command:
                raise PlanError(f"step {number}: the class {kind.__name__} has neither a command nor a perform")
            if number > _MOST_STEPS:
                raise PlanError(
                    f"the plan has more than {_MOST_STEPS} steps, the last {step.describe()}",
                    hint="look for a loop in it that does not end",
                )
            # Refuse a step that is never over, or takes time back: all times behind it would be nonsense
            if not 0.0 <= step.duration_s < math.inf:
                raise PlanError(
                    f"step {number} ({step.describe()}): expected to last 0 s or more, got {step.duration_s:g} s"
                )
            yield PlannedStep(number, t_s, step)
            t_s += step.duration_s
            step = plan.send(step.predict(gyro))
    except StopIteration:
        return
    finally:
        abandon(plan)


def dry_run(plan: Plan, gyro: LinearGyro, limits: LimitChecks) -> list[PlannedStep]:
    """Walk `plan` and hold every step against the limits of the bench.

    Raises:
        LimitError: a step would leave a limit; it names step, limit and the time in the plan.
        PlanError: a step expects the table at another rate than the plan has set.
    """
    steps, set_deg_s, angle_deg = [], 0.0, 0.0
    with closing(walk(plan, gyro)) as planned:
        for each in planned:
            try:
                each.step.within(limits)
                turning_s = each.step.duration_s + (_STEADY_S if isinstance(each.step, AwaitRate) else 0.0)
                limits.turn(angle_deg := angle_deg + set_deg_s * turning_s)
            except LimitError as error:
                minutes, seconds = divmod(round(each.t_s), 60)
                at = f"{minutes // 60}:{minutes % 60:02}:{seconds:02}"
                error.step = f"{each.number} ({each.step.describe()}, {at} into the plan)"
                error.hint = "nothing was opened; change the procedure, or the limits if the bench can bear it"
                raise
            if isinstance(each.step, SetRate):
                set_deg_s = each.step.rate_deg_s
            due_deg_s = _due_deg_s(each.step)
            if due_deg_s is not None and due_deg_s != set_deg_s:
                came = f"the plan has set {set_deg_s:+g} deg/s"
                raise PlanError(f"step {each.number} ({each.step.describe()}) expects {due_deg_s:+g} deg/s; {came}")
            steps.append(each)
    return steps


def _due_deg_s(step: Step) -> float | None:
    """Return the rate that the table must read back in a step; None: it asks no table."""
    match step:
        case AwaitRate():
            return step.rate_deg_s
        case Acquire() | SampleModulated():
            return step.table_deg_s
    return None
