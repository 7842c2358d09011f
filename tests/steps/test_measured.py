"""What results may see of a run: points, raw readings, and what steps have found; of its record alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from msgspec import to_builtins
from msgspec.structs import replace

import vcfbench
from tests.procedures.fakes import FakeBench, Gyro, MemoryJournal, make_settings
from vcfbench.instructions.routines import rails_of
from vcfbench.procedures.power.plan import SuppliedAndLogged
from vcfbench.procedures.power.results import RailsLogged
from vcfbench.procedures.warmup import SwitchedOn, SwitchOnAndLog
from vcfbench.records.schema import Point
from vcfbench.station.settings import Sources
from vcfbench.steps import Acquire, Note, RailsReading, Step, StepResult, VerifyZero, Window
from vcfbench.steps.executor import Executor
from vcfbench.steps.measured import Measured
from vcfbench.steps.sampling import ModulatedRecord, SampleModulated, SampleSine, SineResponse
from vcfbench.steps.step import Reading
from vcfbench.steps.v_vc import MeasureVvc, PairedReading, VvcMeasured, VvcWindow

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench.station.linear_gyro import LinearGyro
    from vcfbench.steps.step import Context, Plan

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 70, "settle_s": 0.5}
"""A window of 70 s is recorded in chunks of 60 and 10 readings."""


@dataclass(frozen=True, slots=True)
class CurrentFound(StepResult):
    """A result of one's own."""

    current_a: float


@dataclass(frozen=True, slots=True)
class MeasureCurrent(Step):
    """A step of one's own."""

    rail: str

    def describe(self) -> str:
        return f"current of {self.rail}"

    def perform(self, context: Context) -> CurrentFound:
        del context
        return CurrentFound(0.0214)

    def predict(self, gyro: LinearGyro) -> CurrentFound:
        del gyro
        return CurrentFound(0.0)


def acquire(samples: int, kind: type[Acquire] = Acquire) -> Acquire:
    return kind(1, 0.0, 0.0, 0.0, 0.05, rails_of(make_settings())[:0], 0.1, samples, 1.0, 1e-5)


def measured(*steps: Step) -> Measured:
    def plan() -> Plan:
        for step in steps:  # noqa: UP028  # a tuple cannot be sent results
            yield step

    bench, journal = FakeBench(Gyro(noise_v=1e-4, rng=np.random.default_rng(3))), MemoryJournal()
    execution = Executor(bench, journal).execute(plan())
    assert execution.error is None
    return Measured(execution.points, lambda: to_builtins(journal.lines))


def test_it_is_the_sequence_of_the_points() -> None:
    points = tuple(Point(1, float(rate), 0.0, 0.1 * rate, 0.0, 10) for rate in range(4))
    seen = Measured(points)
    assert (len(seen), tuple(seen), seen[0], seen[-1], seen[1:3]) == (4, points, points[0], points[3], points[1:3])
    assert points[2] in seen
    assert seen.readings.windows == ()
    assert seen.readings.voltage_v.size == seen.readings.t_s.size == 0
    assert seen.found(StepResult) == ()


def test_readings_are_those_of_each_window_in_chunks_or_not() -> None:
    seen = measured(acquire(10), Note("between"), acquire(150), acquire(10, VerifyZero))
    assert [(window.number, window.t_s.size) for window in seen.readings.windows] == [(1, 10), (3, 150), (4, 10)]
    assert [type(window.step) for window in seen.readings.windows] == [Acquire, Acquire, VerifyZero]
    assert seen.readings.voltage_v.shape == seen.readings.t_s.shape == (170,)
    assert np.diff(seen.readings.windows[1].t_s) == pytest.approx(np.full(149, 1.0))
    for point, window in zip(seen, seen.readings.windows, strict=False):
        assert point.output_v == pytest.approx(math.fsum(window.voltage_v) / window.voltage_v.size, rel=1e-12)
        assert point.std_v == pytest.approx(float(np.std(window.voltage_v, ddof=1)), rel=1e-9)


def test_what_steps_found_is_told_by_kind_with_its_step() -> None:
    first, second = MeasureCurrent("positive"), MeasureCurrent("negative")
    seen = measured(first, acquire(150), second)
    assert seen.found(CurrentFound) == ((first, CurrentFound(0.0214)), (second, CurrentFound(0.0214)))
    ((step, window),) = seen.found(Window)
    assert step == acquire(150)
    assert window.point == seen[0]
    assert len(seen.found(StepResult)) == 3


def test_a_run_in_parts_is_seen_part_by_part() -> None:
    first, second = MeasureCurrent("positive"), MeasureCurrent("negative")
    seen = measured(acquire(10), first, acquire(150), Note("between"), second, acquire(10), acquire(10, VerifyZero))
    (one, of_first), (two, of_second) = seen.parted(MeasureCurrent)
    assert (one, two) == (first, second)
    assert (tuple(of_first), tuple(of_second)) == (tuple(seen[1:2]), tuple(seen[2:3]))
    assert [window.t_s.size for window in of_first.readings.windows] == [150]
    assert [window.number for window in of_second.readings.windows] == [6, 7]
    assert [step for step, _ in of_second.found(CurrentFound)] == [second]
    assert seen.parted(VerifyZero)[0][1].readings.windows[0].t_s.size == 10
    assert measured(acquire(10)).parted(MeasureCurrent) == ()


def test_steps_of_two_records_equal_those_of_one_run() -> None:
    lines = [{"type": "step", "n": 1, "taken_over": "one"}, {"type": "restored"}, {"type": "step", "n": 2}]
    assert Measured((), lambda: lines).broken_off
    assert not Measured((), lambda: lines[:2]).broken_off
    assert not Measured((), lambda: lines[2:]).broken_off


def test_the_journal_is_read_once_and_only_when_asked() -> None:
    reads: list[int] = []

    def lines() -> tuple[()]:
        reads.append(1)
        return ()

    seen = Measured((), lines)
    assert len(seen) == 0
    assert reads == []
    assert (seen.readings.windows, seen.found(StepResult), seen.readings.windows) == ((), (), ())
    assert reads == [1]


@dataclass(frozen=True, slots=True)
class Seen:
    readings: int
    sum_v: float
    first_s: float
    rails: int
    voltages_v: tuple[float, ...]


def see(_settings: object, run: Measured) -> Seen:
    rails = run.found(RailsReading)
    readings = run.readings
    voltages = tuple(rail.voltage_v for _, reading in rails for rail in reading.rails)
    return Seen(readings.t_s.size, math.fsum(readings.voltage_v), float(readings.t_s[0]), len(rails), voltages)


def report(_settings: object, run: Measured, results: Seen) -> vcfbench.Report:
    return vcfbench.Report([vcfbench.Text(f"{run.readings.t_s.size} of {results.readings}")])


@pytest.mark.exhaustive
def test_a_run_and_its_record_see_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan: Callable[[Any], Plan] = vcfbench.PROCEDURES["turntable"].plan
    own = vcfbench.Procedure(
        name="see",
        title="See.",
        settings=vcfbench.PROCEDURES["turntable"].settings,
        plan=plan,
        results=see,
        report=report,
    )
    run = vcfbench.run(own, settings=QUICK, runs=tmp_path)
    assert run.results.readings == 5 * 70  # the zero is taken before and after, and is no point
    assert run.results.rails == 1
    assert run.results.voltages_v == pytest.approx((10.0, -10.0), abs=0.05)
    assert run.results.sum_v == math.fsum(reading.voltage_v for reading in run.readings)
    monkeypatch.setattr("vcfbench.archive.results.PROCEDURES", {"see": own})
    again = vcfbench.load_run("last", runs=tmp_path)
    assert again.no_results is None
    assert again.results == run.results
    assert vcfbench.text_of(again.report()) == vcfbench.text_of(run.report())
    assert "350 of 350" in vcfbench.text_of(again.report())


KNOWN = Sources(meter_gain_correction=1e-3, meter_offset_correction_v=2e-3, v_vc_gain_correction=-1e-3)
"""Of 1 V the multimeter's certificate makes 1.003 V, that of the meter on V_Vc 0.999 V."""


def driven(v_vc: Literal["v_vc_meter", "multimeter"]) -> list[tuple[Step, StepResult]]:
    """Return a step of each kind whose result holds readings of a meter, all of 1 V."""
    one, point = Reading(0.0, 1.0), Point(1, 0.0, 1.0, 1.0, 0.0, 1)
    both = replace(point, v_vc_measured_v=1.0, v_vc_std_v=0.0)
    sampled = SampleModulated(1.0, 1.0, 1, 1.0, "v_vc" if v_vc == "multimeter" else "both", None, 0.1)
    rails = rails_of(make_settings())
    return [
        (acquire(1), Window((one,), None, (), point)),
        (acquire(1), VvcWindow((PairedReading(0.0, 1.0, 1.0),), None, (), both)),
        (MeasureVvc(1.0, 1, 1.0, 0.1, v_vc), VvcMeasured((one,), 1.0, 0.0)),
        (sampled, ModulatedRecord(1.0, 1.0, 0.0, (1.0,), 0.0, (1.0,), None)),
        (SampleSine(1.0, 1.0, 1, 1.0, 25.0), SineResponse(1.0, 1.0, (1.0,))),
        (SwitchOnAndLog(1.0, 1.0), SwitchedOn(0.0, (one,))),
        (SuppliedAndLogged(rails, 1.0), RailsLogged(0.0, (), (one,))),
    ]


@pytest.mark.parametrize(("v_vc", "v_vc_v"), [("v_vc_meter", 0.999), ("multimeter", 1.003)])
def test_certificates_correct_every_direct_voltage_that_results_are_made_of(
    v_vc: Literal["v_vc_meter", "multimeter"], v_vc_v: float
) -> None:
    lines = [
        {"type": "step", "n": number, "step_kind": type(step).__name__, "step": to_builtins(step)}
        | {"result_kind": type(result).__name__, "result": {**to_builtins(result), **result.as_json()}}
        for number, (step, result) in enumerate(driven(v_vc), 1)
    ]
    raw = Measured([Point(1, 0.0, 1.0, 1.0, 0.0, 1, v_vc_measured_v=1.0, v_vc_std_v=0.0)], lambda: lines)
    found = raw.corrected(KNOWN)
    assert (raw[0].output_v, found[0].output_v, found[0].v_vc_measured_v) == pytest.approx((1.0, 1.003, 0.999))
    assert found.readings.voltage_v == pytest.approx([1.003] * found.readings.voltage_v.size)
    window, paired, v_vc_found, record, sine, warm, rails = (each for _, each in found.found(StepResult))
    assert (window.mean_v, paired.readings[0].v_vc_v) == pytest.approx((1.003, 0.999))
    assert (v_vc_found.mean_v, v_vc_found.v_vc[0].voltage_v) == pytest.approx((v_vc_v, v_vc_v))
    assert (*record.output_v, *record.v_vc_v, *sine.voltages_v) == pytest.approx((1.003, v_vc_v, 1.003))
    assert (warm.log[0].voltage_v, rails.outputs[0].voltage_v) == pytest.approx((1.003, 1.003))
    assert found.corrected(Sources())[0].output_v == 1.0  # corrections go before one another, they are not added up


@pytest.mark.parametrize(("rho", "grows"), [(0.0, False), (0.7, True)])
def test_correlated_readings_give_scatter_of_their_means(rho: float, *, grows: bool) -> None:
    rng, points, lines = np.random.default_rng(2), list[Point](), list[dict[str, Any]]()
    for number in range(40):
        volts = 1e-4 * rng.standard_normal(30)
        for at in range(1, 30):
            volts[at] = rho * volts[at - 1] + math.sqrt(1.0 - rho**2) * volts[at]
        points.append(Point(1, 0.0, 0.0, float(volts.mean()), float(volts.std(ddof=1)), 30))
        readings = [{"t_s": float(at), "voltage_v": volt} for at, volt in enumerate(volts.tolist())]
        lines.append({"type": "step", "n": number, "point": points[-1].as_json(), "result": {"readings": readings}})
    measured = Measured(points, lambda: lines)
    assert tuple(measured) == tuple(points)
    u_v = math.sqrt(float(np.mean([each.std_v**2 for each in measured.corrected(Sources())])) / 30.0)
    assert u_v == pytest.approx(float(np.std([each.output_v for each in points])), rel=0.3)
    assert (measured.growth > 1.0) == grows
