from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec.structs import replace

from tests.procedures.fakes import CALIBRATIONS, FakeBench, Gyro, MemoryJournal, make_settings
from vcfbench.errors import Aborted, BenchError, FramingError, InterlockError, LinkLost, MeasurementError
from vcfbench.interfaces import Regulation
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.schema import Status
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import PAPER_RATES_DEG_S, Match
from vcfbench.steps import Acquire, Done, NotChecked, Settle, SetVvc
from vcfbench.steps.dry_run import walk
from vcfbench.steps.events import Moved, ReadingTaken, StepFailed, StepFinished, StepStarted, WentOn
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.measured import Measured
from vcfbench.steps.replay import TakenOver

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from collections.abc import Set as AbstractSet

    from vcfbench.steps.events import Event
    from vcfbench.steps.step import Plan, Routine, Step

WINDOW_S, SETTLE_S = 10.0, 2.0


def run(name: str, bench: FakeBench, journal: MemoryJournal | None = None, **changes: Any) -> Execution:
    settings = make_settings(**changes)
    return Executor(bench, journal or MemoryJournal()).execute(PROCEDURES[name].plan(settings))


class Watcher:
    def __init__(self) -> None:
        self.events: list[Event] = []

    def handle(self, event: Event) -> None:
        self.events.append(event)


def test_readings_come_on_an_exact_grid_of_one_second() -> None:
    journal = MemoryJournal()
    run("virtual-coriolis", FakeBench(), journal)
    windows = [line for line in journal.lines if line["step_kind"] == "Acquire"]
    for line in windows:
        times = [reading["t_s"] for reading in line["result"]["readings"]]
        assert times == [line["t_s"] + k for k in range(10)]
        assert line["end_s"] == line["t_s"] + 10.0
    assert len(windows) == 4 + 4 + 4 + 1 + 4 + 17 + 17


def test_bench_time_is_windows_ramps_and_settling_to_the_microsecond() -> None:
    """A bench that answers at once leaves nothing but physics."""
    bench = FakeBench()
    execution = run("virtual-coriolis", bench)
    ramps_s = (4 * 10.0 + 200.0 + 400.0 + 200.0) / 100.0
    states, windows = 5 + 7 + 19 + 20, 8 + 9 + 19 + 20  # a reference before each sweep, one or two after
    by_hand_s = SETTLE_S + states * SETTLE_S + windows * WINDOW_S + ramps_s
    assert execution.physical_minimum_s == pytest.approx(by_hand_s, abs=1e-6)
    # the fake's AGC is settled at the first look, so nothing comes on top
    assert execution.bench_seconds == pytest.approx(by_hand_s, abs=1e-6)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_estimate_is_within_five_per_cent_of_the_run(name: str) -> None:
    settings = make_settings()
    planned = list(walk(PROCEDURES[name].plan(settings), LinearGyro(settings.k_vc_guess_deg_s_per_v)))
    estimate_s = planned[-1].t_s + planned[-1].step.duration_s
    assert estimate_s == pytest.approx(run(name, FakeBench()).bench_seconds, rel=0.05)


def test_walking_a_plan_touches_nothing() -> None:
    bench = FakeBench()
    settings = make_settings()
    for name in CALIBRATIONS:
        assert len(list(walk(PROCEDURES[name].plan(settings), LinearGyro(settings.k_vc_guess_deg_s_per_v)))) > 80
    assert bench.calls == []
    assert bench.clock.now() == 0.0


def test_turntable_gives_seventeen_points_on_the_line() -> None:
    execution = run("turntable", FakeBench())
    assert execution.status is Status.COMPLETE
    assert [point.rate_deg_s for point in execution.points] == list(PAPER_RATES_DEG_S)
    for point in execution.points:
        assert point.output_v == pytest.approx(-0.042 - 0.0125 * point.rate_deg_s, abs=1e-12)
        assert (point.step, point.v_vc_v, point.n) == (1, 0.0, 10)


def test_virtual_coriolis_finds_k_vc_and_the_same_scale_factor() -> None:
    settings = make_settings()
    procedure = PROCEDURES["virtual-coriolis"]
    execution = Executor(FakeBench(), MemoryJournal()).execute(procedure.plan(settings))
    results = procedure.results(settings, Measured(execution.points))
    assert results.k_vc.value == pytest.approx(40.0, rel=1e-9)
    assert results.v_vc10_v == pytest.approx(0.25, rel=1e-9)
    assert abs(results.scale_factor_error_percent) < 1e-9
    assert results.virtual.bias.value - results.turntable.bias.value == pytest.approx(0.0517)
    steps = [point.step for point in execution.points]
    assert [steps.count(step) for step in (1, 2, 3, 4)] == [8, 9, 17, 17]
    assert steps == sorted(steps)


def test_match_absolute_shows_the_trap() -> None:
    """51.7 mV between the zeros go into K_Vc: the virtual scale factor comes out 41 % high (gyro-metrology 6.2)."""
    settings = make_settings(match=Match.ABSOLUTE)
    procedure = PROCEDURES["virtual-coriolis"]
    execution = Executor(FakeBench(), MemoryJournal()).execute(procedure.plan(settings))
    results = procedure.results(settings, Measured(execution.points))
    assert results.scale_factor_error_percent == pytest.approx(100.0 * 0.0517 / 0.125, rel=1e-4)
    assert results.match is Match.ABSOLUTE


@pytest.mark.exhaustive
def test_error_is_bounded_by_its_own_uncertainty() -> None:
    """Of 40 noisy runs about one in twenty is beyond two standard uncertainties; 12 or more would be one in 1e6."""
    settings = make_settings()
    procedure = PROCEDURES["virtual-coriolis"]
    beyond = 0
    for seed in range(40):
        gyro = Gyro(noise_v=1e-4, rng=np.random.default_rng(seed))
        execution = Executor(FakeBench(gyro), MemoryJournal()).execute(procedure.plan(settings))
        results = procedure.results(settings, Measured(execution.points))
        beyond += abs(results.scale_factor_error_percent) > 2.0 * results.scale_factor_error_u_readings_percent
    assert beyond < 12


def test_uncertainty_has_the_meters_resolution_where_there_is_no_noise() -> None:
    settings = make_settings()
    procedure = PROCEDURES["virtual-coriolis"]
    execution = Executor(FakeBench(), MemoryJournal()).execute(procedure.plan(settings))
    results = procedure.results(settings, Measured(execution.points))
    assert results.u_output_v == pytest.approx(10e-6 / math.sqrt(12.0), rel=1e-6)


def _overload(bench: FakeBench) -> None:
    bench.multimeter.overload_at = 44


def _current_limit(bench: FakeBench) -> None:
    bench.power.regulation_now = Regulation.CONSTANT_CURRENT


def _sag(bench: FakeBench) -> None:
    bench.power.sag_v = 0.2


def _sag_by_a_little(bench: FakeBench) -> None:
    bench.power.sag_v = 0.1004


def _fault(bench: FakeBench) -> None:
    bench.rate_table.fault_at_s = 72.0


def _slow(bench: FakeBench) -> None:
    bench.rate_table.ceiling_deg_s = 150.0


def _no_drive(bench: FakeBench) -> None:
    bench.oscilloscope.amplitude_v = 0.01


def _off_frequency(bench: FakeBench) -> None:
    bench.oscilloscope.frequency_hz = 3300.0


def _slow_meter(bench: FakeBench) -> None:
    bench.multimeter.reading_s = 1.6


def _lost(bench: FakeBench) -> None:
    bench.multimeter.lost = True


@pytest.mark.parametrize(
    ("spoil", "kind", "words", "points"),
    [
        (_overload, MeasurementError, r"multimeter at FAKE::22: overload .* step 32 \(average 10 readings", 3),
        (
            _current_limit,
            MeasurementError,
            r"power at FAKE::5: P25V is in current limit: 0.03 A .* step 9 \(read back",
            0,
        ),
        (_sag, MeasurementError, r"power at FAKE::5: P25V reads \+9.8 V, expected \+10 V within 0.1 V, step 9", 0),
        (_sag_by_a_little, MeasurementError, r"P25V reads \+9.8996 V, expected \+10 V within 0.1 V", 0),
        (_fault, InterlockError, r"rate_table at FAKE::COM1: fault: over-speed trip, step", 4),
        (
            _slow,
            MeasurementError,
            r"rate_table at FAKE::COM1: not at \+200 deg/s within 14 s: reads \+150 deg/s.* step",
            0,
        ),
        (
            _no_drive,
            MeasurementError,
            r"oscilloscope at FAKE::7: drive signal .* after 5 s: amplitude 0.01 V, .* step the check of the drive",
            0,
        ),
        (
            _off_frequency,
            MeasurementError,
            r"frequency 3300 Hz, expected 3480...3498 Hz; .*, step the check of the drive",
            0,
        ),
        (_slow_meter, MeasurementError, r"multimeter at FAKE::22: reading 2 of 10 began 0.6 s late", 0),
        (_lost, LinkLost, r"multimeter at FAKE::22: the connection broke, step 2 \(multimeter: DC 10 V range", 0),
    ],
)
def test_error_names_instrument_and_step_and_bench_comes_to_rest(
    spoil: Callable[[FakeBench], None], kind: type[BenchError], words: str, points: int
) -> None:
    bench = FakeBench()
    spoil(bench)
    execution = run("turntable", bench)
    assert execution.status is Status.ABORTED
    assert isinstance(execution.error, kind)
    with pytest.raises(kind, match=words):
        raise execution.error
    assert len(execution.points) == points
    assert not bench.power.enabled
    assert not bench.rate_source.enabled
    assert bench.rate_table.demand_deg_s == 0.0


@pytest.mark.parametrize(("phase_deg", "fits"), [(-175.0, True), (175.0, True), (160.0, False), (0.0, False)])
def test_a_phase_window_may_hold_180_degrees(phase_deg: float, *, fits: bool) -> None:
    bench = FakeBench()
    bench.oscilloscope.phase_deg = phase_deg
    drive = replace(make_settings().drive, phase_deg=(170.0, 190.0))
    assert (run("turntable", bench, drive=drive).status is Status.COMPLETE) == fits


def test_a_window_that_fails_leaves_its_readings_in_the_journal() -> None:
    bench, journal, watcher = FakeBench(), MemoryJournal(), Watcher()
    bench.multimeter.overload_at = 6
    Executor(bench, journal, [watcher]).execute(PROCEDURES["turntable"].plan(make_settings()))
    error = next(line for line in journal.lines if line["type"] == "error")
    assert len(error["readings"]) == 5
    (failed,) = (event for event in watcher.events if isinstance(event, StepFailed))
    assert (failed.number, failed.t_s) == (error["n"], error["t_s"])
    assert error["error_kind"] == "MeasurementError"
    assert error["step"]["rate_deg_s"] == 0.0


def test_late_table_does_not_keep_the_supply_on() -> None:
    """The error of the shut-down is a consequence: the first one stays, and the remaining steps are done."""
    bench, journal = FakeBench(), MemoryJournal()
    bench.rate_table.fault_at_s = 30.0
    execution = run("turntable", bench, journal)
    kinds = [(line["type"], line["step_kind"]) for line in journal.lines][-4:]
    assert kinds == [("step", "SetRate"), ("error", "AwaitRate"), ("step", "DisableVvc"), ("step", "DisableSupply")]
    assert "Acquire" in type(execution.error).__name__ or "average 10 readings" in str(execution.error)


def test_a_dead_v_vc_lead_ends_step_2() -> None:
    bench = FakeBench(Gyro(k_vc=0.0))
    execution = run("virtual-coriolis", bench)
    assert str(execution.error).startswith("rate_source at FAKE::10: the output does not respond to V_Vc")
    assert [point.step for point in execution.points] == [1] * 8 + [2] * 2


def test_a_generator_whose_relay_sticks_is_found_out() -> None:
    bench = FakeBench()
    bench.rate_source.stuck = True
    execution = run("virtual-coriolis", bench)
    assert "switched on but reads back off" in str(execution.error)


class StopAfter:
    """Stops the run as a person does, when `count` readings have been taken."""

    def __init__(self, count: int) -> None:
        self.left = count

    def handle(self, event: Event) -> None:
        self.left -= isinstance(event, ReadingTaken)
        if self.left == 0 and isinstance(event, ReadingTaken):
            raise KeyboardInterrupt


def test_stop_keeps_points_and_leaves_rest_to_safety_stack() -> None:
    bench, journal = FakeBench(), MemoryJournal()
    executor = Executor(bench, journal, [StopAfter(35)])
    execution = executor.execute(PROCEDURES["turntable"].plan(make_settings()))
    assert isinstance(execution.error, Aborted)
    assert execution.status is Status.ABORTED
    assert len(execution.points) == 2
    assert journal.lines[-1]["type"] == "error"
    assert bench.power.enabled  # the safety stack's business from here on


def test_observer_without_terminal_does_not_stop_run() -> None:
    class Gone(Watcher):
        def handle(self, event: Event) -> None:
            super().handle(event)
            raise BrokenPipeError(event)

    gone, watcher = Gone(), Watcher()
    execution = Executor(FakeBench(), MemoryJournal(), [gone, watcher]).execute(
        PROCEDURES["turntable"].plan(make_settings())
    )
    assert execution.status is Status.COMPLETE
    assert len(gone.events) == 1
    kinds = [type(event) for event in watcher.events]
    assert kinds.count(StepStarted) == kinds.count(StepFinished) == execution_steps(watcher)
    assert kinds.count(ReadingTaken) == 190  # 17 windows and the zero before and after
    assert StepFailed not in kinds


def execution_steps(watcher: Watcher) -> int:
    return max(event.number for event in watcher.events if isinstance(event, StepStarted))


def test_full_disk_ends_the_run_but_not_shut_down() -> None:
    class Full(MemoryJournal):
        def write(self, kind: str, values: Any) -> None:
            if kind == "step" and values["n"] == 20:
                raise BenchError("the record cannot be written: no space left on device")
            super().write(kind, values)
            if kind == "error":
                raise BenchError("the record cannot be written: no space left on device")

    bench = FakeBench()
    execution = run("turntable", bench, Full())
    assert "no space left" in str(execution.error)
    assert not bench.power.enabled


def test_same_seed_gives_the_same_points() -> None:
    first, second = (run("virtual-coriolis", FakeBench(Gyro(noise_v=1e-4))) for _ in range(2))
    assert first == second


def plan_of(*steps: Step) -> Plan:
    for step in steps:  # noqa: UP028  # a tuple cannot be sent results
        yield step


class Pausing:
    """Wants a pause after some steps; `found` by their numbers: how far the output moved in it, V, its u, the limit."""

    def __init__(self, found: dict[int, tuple[float, float, float | None] | None]) -> None:
        self.found, self.by = found, ""
        self.told: list[Event] = []
        self.done: Sequence[Step] = ()
        self.disturbed: list[AbstractSet[str]] = []
        self.stopped: BenchError | None = None

    def handle(self, event: Event) -> None:
        self.told.append(event)
        if isinstance(event, StepFinished) and event.number in self.found:
            self.by = "somebody"

    def wait(self) -> tuple[str, float]:
        if self.stopped is not None:
            raise self.stopped
        return "another", 7.0

    def to_rest(self, done: Sequence[Step]) -> Routine[Any]:
        self.done = tuple(done)
        yield Settle(3.0, "at rest")
        yield SetVvc(0.0)
        return self.found[len(done)]

    def looked_at(self, done: Sequence[Step]) -> Routine[Any]:
        yield Settle(1.0, "looked at")
        return tuple(done)

    def moved(self, done: Sequence[Step], before: Any, after: Any) -> Moved:
        assert tuple(done) == after == self.done
        moved_v, u_v, allowed_v = before
        return Moved(1.0, 1.0 + moved_v, u_v, allowed_v)

    def as_before(self, done: Sequence[Step], disturbed: AbstractSet[str]) -> Routine[None]:
        self.disturbed.append(disturbed)
        yield SetVvc(0.5)
        assert tuple(done) == self.done
        self.by = ""


WINDOW = Acquire(1, 0.0, 0.0, None, 1e-3, (), 0.1, 2, 1.0, 1e-6)


def paused(pausing: Pausing, *steps: Step) -> tuple[Execution, list[dict[str, Any]], FakeBench]:
    bench, journal = FakeBench(), MemoryJournal()
    executor = Executor(bench, journal, [pausing], pausing=pausing)
    return executor.execute(plan_of(*steps)), journal.lines, bench


def test_points_after_pauses_count_from_the_moved_output() -> None:
    """Two moves add up, their uncertainties in squares; of drift that is measured itself nothing is counted off."""
    pausing = Pausing({1: (0.375, 3e-3, 0.5), 2: (-0.125, 4e-3, 0.125), 3: (5.0, 1.0, None), 4: None})
    execution, lines, bench = paused(pausing, *[WINDOW] * 5)
    assert execution.status is Status.COMPLETE
    counted = [(point.moved_v, point.moved_u_v) for point in execution.points]
    two = pytest.approx((0.25, 5e-3))
    assert counted == [(0.0, 0.0), (0.375, 3e-3), two, two, two]
    assert execution.physical_minimum_s == 10.0
    assert execution.bench_seconds == pytest.approx(10.0)
    assert bench.clock.now() == pytest.approx(10.0 + 3 * 4.0 + 3.0)
    restored = [(line["n"], line["step_kind"], line["why"]) for line in lines if line["type"] == "restored"]
    why = [f"pause after step {number}" for number in (1, 2, 3, 4)]
    kinds = ["Settle", "SetVvc", "Settle", "SetVvc"]
    assert restored[:4] == [(1, kind, why[0]) for kind in kinds]
    assert [each[2] for each in restored] == [each for each in why[:3] for _ in kinds] + [why[3]] * 3
    went_on = [line for line in lines if line["type"] == "went_on"]
    assert [(line["n"], line["by"], line["waited_s"], "moved" in line) for line in went_on] == [
        (number, "another", 7.0, number < 4) for number in (1, 2, 3, 4)
    ]
    assert went_on[0]["t_s"] == 2.0 + 4.0
    assert [line["by"] for line in lines if line["type"] == "paused"] == ["somebody"] * 4
    assert pausing.disturbed == [{"V_Vc"}] * 4  # anew in each pause
    told = [event for event in pausing.told if isinstance(event, WentOn)]
    assert [(event.number, event.pause_s) for event in told] == [(1, 4.0), (2, 4.0), (3, 4.0), (4, 3.0)]
    assert execution.pauses == tuple(f"after step {event.number}: {event.describe()}" for event in told)


def test_what_is_taken_over_counts_with_its_moves() -> None:
    pausing = Pausing({1: (0.375, 3e-3, 0.5)})
    paused(pausing, WINDOW, WINDOW)
    windows = [event.result for event in pausing.told if isinstance(event, StepFinished) and event.step == WINDOW]
    executor = Executor(FakeBench(), MemoryJournal())
    executor.take_over(
        TakenOver(WINDOW, window, {"asked_again": ["late"], "result": window.as_json()}) for window in windows
    )
    before, after = executor.so_far(), executor.execute(plan_of(WINDOW))
    assert (len(before.points), before.physical_minimum_s) == (2, 4.0)
    assert before.asked_again == ("step 1: late", "step 2: late")
    assert [(point.moved_v, point.moved_u_v) for point in after.points] == [(0.0, 0.0), (0.375, 3e-3), (0.375, 3e-3)]
    assert after.physical_minimum_s == 6.0


def test_pause_of_a_resumed_run_has_the_earlier_state() -> None:
    pausing = Pausing({2: None})
    executor = Executor(FakeBench(), MemoryJournal(), [pausing], pausing=pausing)
    set_before = SetVvc(0.5)
    executor.take_over([TakenOver(set_before, Done(), {})])
    assert executor.execute(plan_of(WINDOW, WINDOW)).status is Status.COMPLETE
    assert pausing.done == (set_before, WINDOW)


def test_moved_output_ends_the_run_in_the_pause() -> None:
    for moved_v in (0.0101, -0.0101):
        execution, lines, _ = paused(Pausing({1: (moved_v, 1e-3, 0.01)}), WINDOW, WINDOW)
        assert isinstance(execution.error, MeasurementError)
        assert execution.error.step == "1, in the pause after it"
        assert (execution.status, len(execution.points)) == (Status.ABORTED, 1)
        assert lines[-1]["type"] == "error"
        assert lines[-1]["n"] == 2  # the step that was to come


def test_pause_does_not_delay_rest_of_failed_run() -> None:
    def plan() -> Plan:
        try:
            yield WINDOW
            yield WINDOW
        finally:
            yield SetVvc(0.0)

    bench, journal, pausing = FakeBench(), MemoryJournal(), Pausing({})
    bench.multimeter.overload_at = 3
    pausing.handle = lambda event: setattr(pausing, "by", "somebody" if isinstance(event, StepFailed) else "")  # type: ignore[method-assign]
    execution = Executor(bench, journal, [pausing], pausing=pausing).execute(plan())
    assert isinstance(execution.error, MeasurementError)
    assert [line["type"] for line in journal.lines] == ["step", "error", "step"]


def test_what_starts_a_run_up_again_takes_its_time() -> None:
    executor = Executor(FakeBench(), MemoryJournal())
    executor.restore(step for step in (SetVvc(0.5), Settle(3.0, "at rest")))
    assert executor.so_far().physical_minimum_s == 3.0


def test_a_stop_in_a_pause_says_after_which_step() -> None:
    pausing = Pausing({1: None})
    pausing.stopped = Aborted("stopped by a signal")
    execution, lines, _ = paused(pausing, WINDOW, WINDOW)
    assert execution.error is pausing.stopped
    assert execution.error.step == "1, in the pause after it"
    assert "went_on" not in [line["type"] for line in lines]


def test_what_a_plan_leaves_unchecked_is_said_once() -> None:
    journal = MemoryJournal()
    one, other = NotChecked("the drive signal", "no oscilloscope"), NotChecked("the rails", "no supply")
    execution = Executor(FakeBench(), journal).execute(plan_of(one, other, one))
    assert execution.not_checked == ("the drive signal: no oscilloscope", "the rails: no supply")
    assert [line["not_checked"] for line in journal.lines] == [each.not_checked for each in (one, other, one)]


def test_repeated_query_is_in_the_line_of_its_step() -> None:
    bench, journal = FakeBench(), MemoryJournal()
    set_dc, answers = bench.rate_source.set_dc, [FramingError("noise"), None, None]

    def noisy(voltage_v: float) -> float:
        if (error := answers.pop(0)) is not None:
            raise error
        return set_dc(voltage_v)

    bench.rate_source.set_dc = noisy  # type: ignore[method-assign]
    execution = Executor(bench, journal).execute(plan_of(SetVvc(0.5), SetVvc(0.25)))
    assert [line.get("asked_again") for line in journal.lines] == [["noise"], None]
    assert execution.asked_again == ("step 1: noise",)
