"""What every step must be able to do, and plans that are held against the limits before anything is opened."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec
import numpy as np
import pytest
from msgspec import Struct

from tests.procedures.fakes import CALIBRATIONS, make_settings
from vcfbench import steps
from vcfbench.errors import ConfigError, LimitError, PlanError
from vcfbench.instructions import routines
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.station.limits import LimitChecks
from vcfbench.station.parts import Limits, RailWiring
from vcfbench.steps import Done, SetRate, Settle
from vcfbench.steps.dry_run import dry_run
from vcfbench.steps.step import _OF_PROCEDURES, Effect, Step, StepResult
from vcfbench.typed import typed

if TYPE_CHECKING:
    from vcfbench.station.linear_gyro import LinearGyro
    from vcfbench.steps.step import Context, Plan

LIMITS = Limits(
    max_rate_deg_s=300.0,
    max_acceleration_deg_s2=200.0,
    max_v_vc_v=10.0,
    min_rail_v=9.5,
    max_rail_v=10.5,
    max_rail_current_a=0.2,
)
CHECKS = LimitChecks(LIMITS, RailWiring())
SETTINGS = make_settings()
SHIPPED = [kind for kind in Step.kinds.values() if kind.__module__.startswith("vcfbench.steps")]


@dataclass(frozen=True, slots=True)
class Blink(Step):
    """A step of somebody's own: it does nothing but is known by its name."""

    effect: ClassVar[Effect] = Effect.SETS
    subject: ClassVar[str] = "lamp"
    times: int

    def describe(self) -> str:
        return f"lamp blinks {self.times} times"

    def perform(self, context: Context) -> Done:
        del context
        return Done()

    def predict(self, gyro: LinearGyro) -> Done:
        del gyro
        return Done()


def test_every_step_says_what_it_does_to_what() -> None:
    assert len(SHIPPED) >= 29
    for kind in SHIPPED:
        assert kind.effect in Effect
        assert kind.subject or kind.effect in {Effect.NOTHING, Effect.WAITS}, kind
        assert kind.perform is not Step.perform or kind.command is not Step.command, kind
        assert kind.describe is not Step.describe or kind.instruction, kind
        assert kind.predict is not Step.predict or kind.effect is not Effect.MEASURES, kind


def test_what_sets_something_that_has_limits_is_held_against_them() -> None:
    limited = {kind.__name__ for kind in SHIPPED if kind.within is not Step.within}
    sources = {"ConfigureGenerator", "SetVvc", "SetSine", "SetVibration"}
    assert limited == {"ConfigureRail", *sources, "SetRate", "MeasureLatency", "SetTemperature"}


def test_a_step_of_ones_own_needs_nothing_but_itself() -> None:
    def plan() -> Plan:
        yield Blink(3)

    (planned,) = dry_run(plan(), SETTINGS.expected_gyro(), CHECKS)
    assert planned.step.describe() == "lamp blinks 3 times"
    assert Step.kinds["Blink"] is Blink


@pytest.mark.parametrize(("base", "name"), [(Step, "Settle"), (StepResult, "Window"), (StepResult, "SwitchedOn")])
def test_custom_class_with_built_in_name_is_refused(base: type[Step | StepResult], name: str) -> None:
    before = {**base.kinds}
    with pytest.raises(PlanError, match=f"{name} is the name of a built-in step or result"):
        type(name, (base,), {})
    assert base.kinds == before


def test_built_in_step_names_are_complete() -> None:
    for procedure in PROCEDURES:
        assert PROCEDURES[procedure]
    kinds = [*Step.kinds.values(), *StepResult.kinds.values()]
    ours = {kind.__name__ for kind in kinds if kind.__module__.startswith("vcfbench.")}
    ours -= {kind.__name__ for kind in kinds if kind.__module__.startswith("vcfbench.steps")}
    assert ours == _OF_PROCEDURES


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_each_kind_of_step_and_result_is_known_by_name(name: str) -> None:
    for planned in dry_run(PROCEDURES[name].plan(SETTINGS), SETTINGS.expected_gyro(), CHECKS):
        assert Step.kinds[type(planned.step).__name__] is type(planned.step)
        result = planned.step.predict(SETTINGS.expected_gyro())
        assert StepResult.kinds[type(result).__name__] is type(result)


def test_plan_beyond_a_limit_in_its_third_hour_is_refused() -> None:
    def plan() -> Plan:
        yield SetRate(100.0, 100.0, 0.0)
        yield Settle(3.0 * 3600.0, "a long time")
        yield SetRate(301.0, 100.0, 100.0)

    with pytest.raises(LimitError) as caught:
        dry_run(plan(), SETTINGS.expected_gyro(), CHECKS)
    assert str(caught.value).startswith(
        "rate 301 deg/s is beyond the bench's limit of 300 deg/s, "
        "step 3 (table to +301 deg/s at 100 deg/s^2, 3:00:00 into the plan)"
    )


def test_plan_that_expects_a_rate_it_has_not_set_is_refused() -> None:
    """On the bench the table's read-back would be told to be wrong, and the run to be not safe."""

    def plan(set_deg_s: float) -> Plan:
        yield SetRate(set_deg_s, 100.0, 0.0)
        yield from routines.take(SETTINGS, 1, rate_deg_s=10.0, v_vc_v=0.0, table_deg_s=10.0)

    assert len(dry_run(plan(10.0), SETTINGS.expected_gyro(), CHECKS)) == 2
    with pytest.raises(PlanError, match=r"step 2 \(.*\) expects \+10 deg/s; the plan has set \+0 deg/s"):
        dry_run(plan(0.0), SETTINGS.expected_gyro(), CHECKS)


def test_an_adaptive_plan_is_walked_with_predicted_answers() -> None:
    """The second level hangs on the answer to the first."""

    def plan() -> Plan:
        found = yield steps.SetVvc(6.0)
        assert isinstance(found, steps.VvcSetting)
        yield steps.SetVvc(2.0 * found.v_vc_v)

    with pytest.raises(LimitError, match=r"voltage 12 V is beyond the bench's limit of 10 V, step 2 \(V_Vc = \+12 V"):
        dry_run(plan(), SETTINGS.expected_gyro(), CHECKS)


@dataclass(frozen=True)
class Pulse(Step):
    """A custom step as a dataclass."""

    rate_deg_s: float
    count: int


@pytest.mark.parametrize(
    ("step", "plain"),
    [
        (Settle(np.float64(2.0), str(np.str_("a drift"))), Settle(2.0, "a drift")),
        (Pulse(np.float32(5.0), np.int64(3)), Pulse(5.0, 3)),
    ],
)
def test_a_plan_may_count_with_numpy(step: Step, plain: Step) -> None:
    assert step == plain
    assert step.describe() == plain.describe()
    assert msgspec.json.encode(step) == msgspec.json.encode(plain)


class Heat(Step, Struct, frozen=True):
    """A custom step as a struct."""

    watts: float | None = None
    times: int = 1
    words: str = ""
    gently: bool = False
    levels: tuple[float, ...] = ()


@pytest.mark.parametrize("odd", [True, 1.5, "1", None, [1.0], np.array([1.0]), object()])
@pytest.mark.parametrize("field", Heat.__struct_fields__)
def test_a_field_that_no_record_could_give_back_is_refused(field: str, odd: Any) -> None:
    try:
        step = Heat(**{field: odd})
    except ConfigError as error:
        expected = {
            "watts": "a number or None",
            "times": "a whole number",
            "words": "a text",
            "gently": "true or false",
        }
        assert str(error).startswith(f"Heat: {field}: expected {expected[field]}, got ")  # noqa: PT017
    else:
        assert field == "levels" or typed(msgspec.to_builtins(step), Heat) == step


def test_a_step_without_an_act_is_refused_before_anything_opens() -> None:
    empty = type("Empty", (Step,), {})

    def plan() -> Plan:
        yield empty()

    with pytest.raises(PlanError, match="step 1: the class Empty has neither a command nor a perform"):
        dry_run(plan(), SETTINGS.expected_gyro(), CHECKS)


@pytest.mark.parametrize("odd", [math.nan, math.inf, -1e16])
@pytest.mark.parametrize("field", ["rate_deg_s", "v_vc_v"])
def test_a_point_at_no_rate_or_voltage_is_refused(field: str, odd: float) -> None:
    def plan() -> Plan:
        yield from routines.take(SETTINGS, 1, **{"rate_deg_s": 0.0, "v_vc_v": 0.0, field: odd})

    with pytest.raises(ConfigError, match=f"{field}: expected a number within"):
        dry_run(plan(), SETTINGS.expected_gyro(), CHECKS)
