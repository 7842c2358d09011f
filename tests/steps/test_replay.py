"""A run that is broken off anywhere and taken up again is the run that was not broken off."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.procedures.fakes import CALIBRATIONS, FakeBench, Gyro, MemoryJournal, make_settings
from vcfbench.errors import LinkLost, MeasurementError, PlanError
from vcfbench.instructions.routines import energised, power_up, take, window_of
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.journal import JournalRecord
from vcfbench.records.schema import Status
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import PlacedInstrument
from vcfbench.steps import (
    Acquire,
    CheckRails,
    ConfigureGenerator,
    ConfigureMeter,
    ConfigureRail,
    DisableSupply,
    DisableVvc,
    Done,
    EnableSupply,
    Note,
    SetRate,
    Settle,
    SetVvc,
    move_leads,
)
from vcfbench.steps.drive_check import check_drive
from vcfbench.steps.events import StepFinished, StepStarted
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.replay import TakenOver, is_left, rest_of, set_again, start_up_again, taken_over
from vcfbench.steps.step import Context, Effect, abandon

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.station.settings import ProcedureSettings
    from vcfbench.steps.events import Event
    from vcfbench.steps.step import Plan, Routine, Step

BEFORE = "20260821T142530Z-before-0a1b2c"
QUICK: dict[str, Any] = {"rates_deg_s": (100.0, 0.0, -100.0), "samples": 4, "drive": make_settings().drive}


def settings_of(name: str) -> ProcedureSettings:
    if name != "kvc":
        return make_settings(**QUICK)
    kind, asked = PROCEDURES[name].settings, make_settings(**QUICK)
    models = {"power": "E3631A", "v_vc_meter": "34401A"}
    station = replace(
        asked.station, instruments={role: PlacedInstrument(model=model, where="FAKE") for role, model in models.items()}
    )
    values = {"cycles": 1, "match_rates_deg_s": (20.0, 100.0), "k_vc_guess_deg_s_per_v": 36.0, "curve_order": 3}
    return kind(**{**QUICK, **values, "station": station})


@dataclass
class Ended:
    """A run that came to its end: what came of it, its journal, and the bench that it was done on."""

    execution: Execution
    lines: list[dict[str, Any]]
    bench: FakeBench = field(default_factory=FakeBench)

    @property
    def steps(self) -> list[dict[str, Any]]:
        return [line for line in self.lines if line["type"] == "step"]


def from_disk(journal: MemoryJournal) -> list[dict[str, Any]]:
    return [{"utc": "then", **msgspec.json.decode(msgspec.json.encode(line))} for line in journal.lines]


@cache
def unbroken(name: str) -> Ended:
    bench, journal = FakeBench(), MemoryJournal()
    execution = Executor(bench, journal).execute(PROCEDURES[name].plan(settings_of(name)))
    assert execution.status is Status.COMPLETE, execution.error
    return Ended(execution, from_disk(journal), bench)


def record_of(lines: list[dict[str, Any]]) -> JournalRecord:
    def of(kind: str) -> tuple[dict[str, Any], ...]:
        return tuple(line for line in lines if line["type"] == kind)

    return JournalRecord({}, of("step"), of("error"), None, torn=True, chunks=of("readings"), restored=of("restored"))


def resumed(plan: Plan, asked: ProcedureSettings, lines: list[dict[str, Any]], bench: FakeBench | None = None) -> Ended:
    """Take up the run that was broken off after `lines`, on a bench on which all is off."""
    made, journal = bench or FakeBench(), MemoryJournal()
    taken = taken_over(record_of(lines), BEFORE)
    made.clock.sleep_until(taken[-1].line["end_s"] + 1000.0 if taken else 0.0)
    executor = Executor(made, journal, began_s=0.0)
    executor.take_over(taken)
    executor.restore(start_up_again([each.step for each in taken], asked))
    return Ended(executor.execute(rest_of(plan, taken)), from_disk(journal), made)


def keys(ended: Ended) -> list[str]:
    """Return what was done; the scales of the oscilloscope are those of what is seen, apart."""
    return [line["key"] for line in ended.steps if line["step_kind"] != "MeasureDrive"]


def assert_the_same(name: str, number: int) -> None:
    asked, whole = settings_of(name), unbroken(name)
    went_on = resumed(PROCEDURES[name].plan(asked), asked, whole.steps[:number])
    assert went_on.execution.status is Status.COMPLETE, went_on.execution.error
    assert keys(went_on) == keys(whole)
    for new, old in zip(went_on.execution.points, whole.execution.points, strict=True):
        assert msgspec.to_builtins(new) == pytest.approx(msgspec.to_builtins(old), abs=1e-11)
    before = sum(line["step_kind"] in {"Acquire", "AcquireWithVvc", "VerifyZero"} for line in whole.steps[:number])
    assert went_on.bench.multimeter.readings == whole.bench.multimeter.readings - before * asked.samples
    taken = [line for line in went_on.steps if "taken_over" in line]
    assert [line | {"taken_over": None} for line in taken] == [
        line | {"taken_over": None} for line in whole.steps[: len(taken)]
    ]
    assert {line["taken_over"] for line in taken} <= {BEFORE}
    assert len(taken) <= number


@pytest.mark.parametrize("name", [*CALIBRATIONS, "kvc"])
@pytest.mark.parametrize("share", [0.0, 0.04, 0.3, 0.52, 0.77, 0.97, 1.0])
def test_broken_off_and_resumed_it_is_the_same_run(name: str, share: float) -> None:
    assert_the_same(name, round(share * len(unbroken(name).steps)))


@pytest.mark.exhaustive
@given(st.data())
@settings(max_examples=12, deadline=None)
def test_wherever_it_is_broken_off(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(CALIBRATIONS))
    assert_the_same(name, data.draw(st.integers(0, len(unbroken(name).steps))))


def test_run_is_resumed_twice_and_lines_name_their_run() -> None:
    asked, whole = settings_of("turntable"), unbroken("turntable")
    once = resumed(PROCEDURES["turntable"].plan(asked), asked, whole.steps[:20])
    again = [line for line in once.lines if line["type"] != "step"] + once.steps[:30]
    taken = taken_over(record_of(again), "the second")
    assert [each.line["taken_over"] for each in taken] == [BEFORE] * 20 + ["the second"] * 10
    twice = resumed(PROCEDURES["turntable"].plan(asked), asked, again)
    assert twice.execution.status is Status.COMPLETE
    assert keys(twice) == keys(whole)


def calls_of(ended: Ended) -> list[tuple[str, str]]:
    return [(instrument, call) for _, instrument, call in ended.bench.calls]


def test_rails_are_set_before_and_v_vc_after_switching_on() -> None:
    asked, whole = settings_of("virtual-coriolis"), unbroken("virtual-coriolis")
    number = max(place for place, line in enumerate(whole.steps, 1) if "point" in line)
    calls = calls_of(resumed(PROCEDURES["virtual-coriolis"].plan(asked), asked, whole.steps[:number]))
    on = calls.index(("power", "on"))
    assert {call for role, call in calls[:on] if role == "power"} == {"configure P25V 10 0.1", "configure N25V -10 0.1"}
    assert ("rate_source", "configure 0") in calls[:on]
    output_on = calls.index(("rate_source", "on"))
    levels = [call for role, call in calls[output_on:] if role == "rate_source" and call.startswith("set")]
    assert output_on > on
    assert levels[0] == f"set {whole.steps[number - 1]['step']['v_vc_v']:g}"
    assert ("rate_table", "enable") in calls[on:output_on]


def test_the_table_ramps_from_rest_and_is_waited_for() -> None:
    """The ramp from the rate before may be much shorter than that from rest, and so is what a plan waits for it."""
    asked = make_settings(**QUICK | {"rates_deg_s": (100.0, 99.0, -1.0), "acceleration_deg_s2": 2.0})
    plan = PROCEDURES["turntable"].plan
    bench, journal = FakeBench(), MemoryJournal()
    Executor(bench, journal).execute(plan(asked))
    lines = from_disk(journal)
    number = [line["step_kind"] for line in lines].index("Acquire") + 2  # after AwaitRate of the second rate
    went_on = resumed(plan(asked), asked, lines[: number + 1])
    assert went_on.execution.status is Status.COMPLETE, went_on.execution.error
    kinds = [line["step_kind"] for line in went_on.lines if line["type"] == "restored"]
    assert kinds[-3:] == ["SetRate", "Settle", "AwaitRate"]


def test_start_up_warm_up_and_checks_are_done_again() -> None:
    asked = make_settings(**QUICK, warm_up_s=600.0)
    plan, bench, journal = PROCEDURES["turntable"].plan, FakeBench(), MemoryJournal()
    Executor(bench, journal).execute(plan(asked))
    lines = from_disk(journal)
    first = [line["step_kind"] for line in lines].index("Acquire") + 1
    went_on = resumed(plan(asked), asked, lines[:first])
    restored = [line for line in went_on.lines if line["type"] == "restored"]
    kinds = [line["step_kind"] for line in restored]
    assert {"ConfigureMeter", "EnableSupply", "CheckRails", "FindDrive", "MeasureDrive", "EnableTable"} <= set(kinds)
    assert sum(line["step"].get("seconds", 0.0) for line in restored) == pytest.approx(600.0, abs=0.0)
    assert restored[0]["t_s"] == pytest.approx(lines[first - 1]["end_s"] + 1000.0)


def test_unfinished_drive_check_is_repeated_from_begin() -> None:
    asked, whole = settings_of("turntable"), unbroken("turntable")
    looked = [line["step_kind"] for line in whole.steps].index("FindDrive") + 1
    taken = taken_over(record_of(whole.steps[:looked]), BEFORE)
    assert type(taken[-1].step).__name__ == "CheckRails"
    assert_the_same("turntable", looked)
    assert asked.drive


def test_failed_step_is_repeated_and_later_ones_not_copied() -> None:
    asked, plan = settings_of("turntable"), PROCEDURES["turntable"].plan
    bench, journal = FakeBench(), MemoryJournal()
    bench.multimeter.overload_at = 7
    failed = Executor(bench, journal).execute(plan(asked))
    assert isinstance(failed.error, MeasurementError)
    lines = from_disk(journal)
    taken = taken_over(record_of(lines), BEFORE)
    assert len(taken) == next(line["n"] for line in lines if line["type"] == "error") - 1
    went_on = resumed(plan(asked), asked, lines)
    assert went_on.execution.points == unbroken("turntable").execution.points


def test_another_plan_is_refused_and_the_step_named() -> None:
    steps = unbroken("turntable").steps
    taken = taken_over(record_of(steps[:30]), BEFORE)
    other = settings_of("turntable")
    for changed in (replace(other, rates_deg_s=(100.0, 50.0, -100.0)), replace(other, samples=5)):
        with pytest.raises(PlanError, match=r"step \d+ of the record is \(.*\), the plan now asks there for \(.*\)"):
            rest_of(PROCEDURES["turntable"].plan(changed), taken)
    configured = [each for each in taken if isinstance(each.step, ConfigureMeter)]
    with pytest.raises(PlanError, match="ends before the record does"):
        rest_of(short(other), configured * 2)


def test_steps_with_equal_descriptions_are_distinguished() -> None:
    had, asked = Settle(1.0, "settled"), Settle(1.0 + 1e-9, "settled")
    assert had.describe() == asked.describe()
    taken = [TakenOver(had, Done(), {"n": 1, "key": had.key})]
    with pytest.raises(PlanError, match=re.escape(f"({had.key}), the plan now asks there for ({asked.key})")):
        rest_of((step for step in [asked]), taken)


def short(asked: ProcedureSettings) -> Plan:
    yield ConfigureMeter(float(asked.meter_range_v), float(asked.nplc))


def test_a_kind_that_is_not_known_is_refused() -> None:
    line = unbroken("turntable").steps[0] | {"step_kind": "Unheard"}
    with pytest.raises(PlanError, match="step 1 of the record: a Unheard"):
        taken_over(record_of([line]), BEFORE)


def test_run_that_died_coming_to_rest_leaves_no_remainder() -> None:
    asked, steps = settings_of("turntable"), unbroken("turntable").steps
    last = max(number for number, line in enumerate(steps, 1) if line["step_kind"] == "VerifyZero")
    for number, left in ((last - 1, True), (last, False), (last + 2, False), (len(steps), False)):
        rest = rest_of(PROCEDURES["turntable"].plan(asked), taken_over(record_of(steps[:number]), BEFORE))
        assert is_left(rest, LinearGyro(36.0)) is left


def test_run_that_refused_its_points_is_not_resumed() -> None:
    asked, plan = settings_of("turntable"), PROCEDURES["turntable"].plan

    class Drifting(FakeBench):
        def output_v(self) -> float:
            return super().output_v() + (0.5 if self.multimeter.readings > 8 else 0.0)

    journal = MemoryJournal()
    ended = Executor(Drifting(), journal).execute(plan(asked))
    assert isinstance(ended.error, MeasurementError)
    with pytest.raises(MeasurementError):
        is_left(rest_of(plan(asked), taken_over(record_of(from_disk(journal)), BEFORE)), LinearGyro(36.0))


def test_a_fault_while_it_starts_up_again_ends_it() -> None:
    asked, steps = settings_of("turntable"), unbroken("turntable").steps
    bench = FakeBench()
    bench.power.lost = True
    with pytest.raises(LinkLost) as caught:
        resumed(PROCEDURES["turntable"].plan(asked), asked, steps[:30], bench)
    assert "starting up again (supply" in str(caught.value)
    assert not bench.rate_table.servo


def test_the_scatter_of_what_was_taken_over_is_remembered() -> None:
    asked, plan = make_settings(**QUICK | {"samples": 10}), PROCEDURES["turntable"].plan
    journal = MemoryJournal()
    Executor(FakeBench(Gyro(noise_v=1e-4)), journal).execute(plan(asked))
    lines = from_disk(journal)
    number = max(place for place, line in enumerate(lines, 1) if "point" in line) - 1
    noisy = resumed(plan(asked), asked, lines[:number], FakeBench(Gyro(noise_v=4e-3)))
    assert "scatter" in str(noisy.execution.error)


class LongOnes(VirtualCoriolisSettings, frozen=True, kw_only=True):
    """A procedure that warms up otherwise than by waiting."""

    @property
    def warm_again_s(self) -> float:
        return 1800.0


@pytest.mark.parametrize("measured", [True, False])
def test_the_gyroscope_is_as_warm_as_before(*, measured: bool) -> None:
    """Switching on again what is on already is no power-on."""
    asked = LongOnes(**{**msgspec.structs.asdict(make_settings(**QUICK)), "settle_s": 3.0})
    window = Acquire(step=1, rate_deg_s=0.0, v_vc_v=0.0, table_deg_s=None, **window_of(asked))
    start_up, later = list(power_up(asked)), [EnableSupply(), Settle(2.0, "again"), DisableVvc()]
    steps = [*start_up, *([window] if measured else []), *later]
    again = list(start_up_again(steps, asked))
    waits = [step.seconds for step in again if isinstance(step, Settle)]
    assert waits == ([3.0, 1795.0, 2.0] if measured else [3.0, 2.0])
    assert [type(step) for step in again].count(EnableSupply) == 2
    assert isinstance(again[-1], DisableVvc)


def rails_moved(asked: ProcedureSettings) -> Routine[None]:
    """Start up, move one rail, measure, move the leads away and back, measure."""
    yield ConfigureRail("positive", "P25V", 9.5, 0.1)
    yield from take(asked, 1, rate_deg_s=0.0, v_vc_v=0.0)
    yield move_leads("multimeter", "v_vc")
    yield SetVvc(0.5)
    yield move_leads("multimeter", "output")
    yield from take(asked, 1, rate_deg_s=0.0, v_vc_v=0.0)


def test_resume_repeats_last_of_equal_settings() -> None:
    asked = make_settings(**QUICK)

    def plan() -> Plan:
        return energised(asked, rails_moved(asked))

    steps = []
    walked = plan()
    step = next(walked)
    while type(step) is not SetVvc:
        steps.append(step)
        step = walked.send(step.predict(LinearGyro(36.0)))
    steps.append(step)
    abandon(walked)
    start_up = list(power_up(asked))
    again = [step for step in start_up_again(steps, asked) if step.effect is not Effect.WAITS]
    expected = [step for step in start_up if step.effect is not Effect.WAITS]
    assert again == [
        *expected,
        ConfigureRail("positive", "P25V", 9.5, 0.1),
        move_leads("multimeter", "v_vc"),
        SetVvc(0.5),
    ]


def test_a_kind_of_result_that_is_not_known_is_refused() -> None:
    line = unbroken("turntable").steps[0] | {"result_kind": "Unheard"}
    with pytest.raises(PlanError, match="step 1 of the record: a Unheard"):
        taken_over(record_of([line]), BEFORE)


def test_chunks_of_long_windows_are_taken_over_with_their_step() -> None:
    lines = unbroken("turntable").steps
    window = next(line["n"] for line in lines if line["result_kind"] == "Window")
    chunks = [{"type": "readings", "n": window, "readings": [{"voltage_v": v}]} for v in (0.1, 0.2)]
    taken = taken_over(record_of([*chunks, *lines]), BEFORE)
    assert taken[window - 1].chunks == tuple({"taken_over": BEFORE, **chunk} for chunk in chunks)
    recalled: list[list[float]] = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Acquire, "recall", lambda _, readings_v, __: recalled.append([*readings_v]))
        taken[window - 1].recall(Context(None, lambda _: None))  # type: ignore[arg-type]
    assert recalled[:2] == [[0.1], [0.2]]
    assert not any(each.chunks for each in taken if each.line["n"] != window)


def test_copied_steps_are_counted() -> None:
    lines = unbroken("turntable").steps
    window = next(line["n"] for line in lines if line["result_kind"] == "Window")
    doubtful = [line | {"asked_again": ["late"]} if line["n"] == window else line for line in lines[:window]]
    chunk = {"type": "readings", "n": window, "readings": [{"voltage_v": 0.1}]}
    watched: list[Event] = []
    watcher = Mock(handle=watched.append)
    journal = MemoryJournal()
    executor = Executor(FakeBench(), journal, [watcher])
    executor.take_over(taken_over(record_of([chunk, *doubtful]), BEFORE))
    assert [line["type"] for line in journal.lines] == [*["step"] * (window - 1), "readings", "step"]
    assert executor.so_far().asked_again == (f"step {window}: late",)
    executor.restore(step for step in (POSITIVE, SUPPLY_ON))
    assert [type(event) for event in watched] == [StepStarted, StepFinished] * 2
    assert [line["type"] for line in journal.lines[window + 1 :]] == ["restored"] * 2


def test_the_rest_of_a_plan_that_had_ended_is_nothing() -> None:
    plan = PROCEDURES["turntable"].plan(settings_of("turntable"))
    rest = rest_of(plan, taken_over(record_of(unbroken("turntable").steps), BEFORE))
    assert next(rest, None) is None


def test_drive_check_after_the_last_window_is_rejected() -> None:
    lines = unbroken("turntable").steps
    window = next(number for number, line in enumerate(lines) if line["result_kind"] == "Window")
    look = next(line for line in lines if line["step_kind"] == "FindDrive")
    taken = taken_over(record_of([*lines[: window + 1], look | {"n": window + 2}]), BEFORE)
    assert len(taken) == window + 1


def repeated(*steps: Step) -> list[Step]:
    return list(drained(start_up_again(steps, make_settings(warm_up_s=0.0))))


def drained(routine: Routine[None]) -> Iterator[Step]:
    """Each step of a routine, answered by what a dry run answers."""
    gyro = LinearGyro(36.0)
    with contextlib.suppress(StopIteration):
        step = next(routine)
        while True:
            yield step
            step = routine.send(step.predict(gyro))


POSITIVE, NEGATIVE = ConfigureRail("positive", "P25V", 10.0, 0.1), ConfigureRail("negative", "N25V", -10.0, 0.1)
SUPPLY_ON = EnableSupply()


def test_the_plans_first_step_is_repeated_too() -> None:
    assert repeated(POSITIVE, NEGATIVE, SUPPLY_ON) == [POSITIVE, NEGATIVE, SUPPLY_ON]
    assert repeated(POSITIVE, Note("a heading"), NEGATIVE, SUPPLY_ON) == [POSITIVE, NEGATIVE, SUPPLY_ON]


@pytest.mark.parametrize(
    ("disturbed", "again"), [({"generator"}, (0, 1, 2)), ({"V_Vc"}, (1, 2)), ({"table rate"}, ()), (set(), ())]
)
def test_what_was_disturbed_is_set_again_with_what_that_disturbs(disturbed: set[str], again: tuple[int, ...]) -> None:
    """To select DC sets the level of long ago too."""
    steps = (ConfigureGenerator(0.1), SetVvc(0.4), Settle(2.0, "V_Vc"), Note("measured"))
    assert list(drained(set_again(steps, disturbed))) == [steps[number] for number in again]


def test_a_rate_that_was_disturbed_is_ramped_to_from_rest() -> None:
    faster = SetRate(50.0, 100.0, 10.0)
    assert list(drained(set_again((faster, Note("measured")), {"table rate"}))) == list(faster.again())
    assert len(faster.again()) == 2


def test_a_supply_that_was_off_meanwhile_warms_up_anew() -> None:
    asked = LongOnes(**{**msgspec.structs.asdict(make_settings(**QUICK)), "settle_s": 3.0})
    window = Acquire(step=1, rate_deg_s=0.0, v_vc_v=0.0, table_deg_s=None, **window_of(asked))
    steps = [SUPPLY_ON, Settle(5.0, "first"), DisableSupply(), SUPPLY_ON, Settle(2.0, "second"), window]
    waits = [step.seconds for step in start_up_again(steps, asked) if isinstance(step, Settle)]
    assert waits[-2:] == [2.0, 1798.0]


def test_first_look_at_the_drive_stands_for_all() -> None:
    look = list(drained(check_drive(make_settings())))
    _, find, measure = look
    assert repeated(find, SUPPLY_ON, find, measure, find, measure) == [SUPPLY_ON, *look]


def test_resume_skips_checks_before_power_and_of_other_rails() -> None:
    rails = CheckRails((POSITIVE, NEGATIVE), 0.1)
    assert repeated(POSITIVE, NEGATIVE, rails, SUPPLY_ON) == [POSITIVE, NEGATIVE, SUPPLY_ON]
    assert repeated(POSITIVE, NEGATIVE, SUPPLY_ON, rails) == [POSITIVE, NEGATIVE, SUPPLY_ON, rails]
    lower, higher = replace(POSITIVE, voltage_v=5.0), replace(POSITIVE, voltage_v=12.0)
    lower_rails, higher_rails = CheckRails((lower, NEGATIVE), 0.1), CheckRails((higher, NEGATIVE), 0.1)
    steps = (POSITIVE, NEGATIVE, SUPPLY_ON, rails, lower, lower_rails, higher, higher_rails)
    assert repeated(*steps) == [POSITIVE, NEGATIVE, SUPPLY_ON, rails, higher, higher_rails]
