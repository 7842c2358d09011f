"""V_Vc that is measured: beside the output on one grid, or alone; leads that are elsewhere are found."""

from __future__ import annotations

import json
from io import BytesIO
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from tests.procedures.fakes import FakeBench, FakeMeter, FakeVvcMeter, MemoryJournal
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed import read_table
from vcfbench.bench.bench import open_bench
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.records.damage import first_damage
from vcfbench.records.export import points_csv
from vcfbench.records.schema import Point
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.writing import bench_text
from vcfbench.steps import (
    Acquire,
    AcquireWithVvc,
    ConfigureVvcMeter,
    MeasureVvc,
    PairedReading,
    VvcMeasured,
    VvcWindow,
)
from vcfbench.steps.decode import result_of, step_of
from vcfbench.steps.executor import Executor
from vcfbench.steps.step import Context

if TYPE_CHECKING:
    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription
    from vcfbench.steps.step import Plan, Step

GYRO = LinearGyro(36.0, -0.0125)


def window(samples: int = 4, **changes: Any) -> AcquireWithVvc:
    values: dict[str, Any] = {
        "step": 2,
        "rate_deg_s": 0.0,
        "v_vc_v": 0.5,
        "table_deg_s": 0.0,
        "tolerance_deg_s": 0.05,
        "rails": (),
        "rail_tolerance_v": 0.1,
        "samples": samples,
        "interval_s": 1.0,
        "resolution_v": 1e-5,
        "v_vc_tolerance_v": 0.01,
    }
    return AcquireWithVvc(**{**values, **changes})


def bench_at(v_vc_v: float) -> FakeBench:
    bench = FakeBench()
    bench.rate_source.enabled, bench.rate_source.level_v = True, v_vc_v
    bench.rate_table.servo = True
    return bench


def plan_of(*steps: Step) -> Plan:
    for step in steps:  # noqa: UP028  # a tuple cannot be sent results
        yield step


def test_a_late_reading_may_be_that_of_either_meter() -> None:
    bench = bench_at(0.5)
    bench.v_vc_meter.reading_s = 1.7
    with pytest.raises(MeasurementError, match=r"began 0\.7 s late: the meter, or that on V_Vc, cannot follow"):
        window().perform(Context(bench, lambda _: None))


def test_output_and_v_vc_are_read_on_one_grid() -> None:
    bench = bench_at(0.5)
    done = window().perform(Context(bench, lambda _: None))
    assert isinstance(done, VvcWindow)
    assert [each.t_s for each in done.readings] == [0.0, 1.0, 2.0, 3.0]
    assert all(each.v_vc_v == pytest.approx(0.5005) for each in done.readings)
    assert done.point.v_vc_v == 0.5
    assert done.point.v_vc_measured_v == pytest.approx(0.5005)
    assert done.point.v_vc_std_v == 0.0
    assert bench.clock.now() == 4.0
    begun = [(t, who, call) for t, who, call in bench.calls if call in {"begin", "read"} and who != "rate_table"]
    assert begun[:2] == [(0.0, "v_vc_meter", "begin"), (0.0, "multimeter", "read")]


def test_the_output_is_read_as_without_a_second_meter() -> None:
    both, alone = bench_at(0.5), bench_at(0.5)
    shared = {name: getattr(window(), name) for name in Acquire.__struct_fields__}
    measured = window().perform(Context(both, lambda _: None))
    plain = Acquire(**shared).perform(Context(alone, lambda _: None))
    assert [(r.t_s, r.voltage_v) for r in measured.readings] == [(r.t_s, r.voltage_v) for r in plain.readings]
    assert measured.point.output_v == plain.point.output_v


def test_a_meter_that_cannot_be_left_alone_is_read_afterwards() -> None:
    bench = bench_at(0.5)

    class Plain(FakeMeter):
        def read_voltage_v(self) -> float:
            super().read_voltage_v()
            return 0.4999

    bench.v_vc_meter = Plain(bench, "v_vc_meter", "FAKE::23")
    done = window().perform(Context(bench, lambda _: None))
    assert done.point.v_vc_measured_v == pytest.approx(0.4999)


def test_leads_that_are_elsewhere_end_it() -> None:
    bench = bench_at(0.5)
    assert isinstance(bench.v_vc_meter, FakeVvcMeter)
    bench.v_vc_meter.gain = -1.0
    said = r"v_vc_meter at FAKE::23: reads -0\.5 V where V_Vc was set to \+0\.5 V, within 0\.01 V; check its leads"
    with pytest.raises(MeasurementError, match=said):
        window().perform(Context(bench, lambda _: None))
    with pytest.raises(MeasurementError, match=said):
        MeasureVvc(0.5, 3, 1.0, 0.01).perform(Context(bench, lambda _: None))


@pytest.mark.parametrize("samples", [4, 150])
def test_it_is_written_and_read_back_whatever_its_length(samples: int) -> None:
    bench, journal = bench_at(0.5), MemoryJournal()
    done = Executor(bench, journal).execute(plan_of(window(samples), MeasureVvc(0.5, 3, 1.0, 0.01)))
    assert done.error is None
    lines = json.loads(json.dumps(journal.lines, default=msgspec.to_builtins))
    assert first_damage([{"type": "header"}, *lines]) is None
    [first, alone] = [line for line in lines if line["type"] == "step"]
    assert step_of(first) == window(samples)
    back = result_of(first)
    assert isinstance(back, VvcWindow)
    assert back.point == done.points[0] == Point.from_json(first["point"])
    assert back.point.v_vc_measured_v == pytest.approx(0.5005)
    assert result_of(alone) == VvcMeasured(*(getattr(result_of(alone), name) for name in VvcMeasured.__struct_fields__))
    chunks = [reading for line in lines if line["type"] == "readings" for reading in line["readings"]]
    assert len(chunks) + len(back.readings) == samples
    assert all("v_vc_v" in reading for reading in chunks)


def test_a_record_whose_mean_was_changed_is_damaged() -> None:
    journal = MemoryJournal()
    Executor(bench_at(0.5), journal).execute(plan_of(window()))
    lines = [{"type": "header"}, *json.loads(json.dumps(journal.lines, default=msgspec.to_builtins))]
    for name in ("output_v", "v_vc_measured_v"):
        changed = json.loads(json.dumps(lines))
        changed[1]["point"][name] += 1e-3
        assert "is not the mean of its readings" in (first_damage(changed) or ""), name


@pytest.mark.parametrize("samples", [4, 150])
def test_it_is_predicted(samples: int) -> None:
    gyro = LinearGyro(36.0, -0.0125, v_vc_v=0.5, v_vc_on=True)
    predicted = window(samples).predict(gyro)
    assert predicted.point.v_vc_measured_v == 0.5
    assert predicted.point.n == samples
    assert MeasureVvc(0.5, 3, 1.0, 0.01).predict(gyro).mean_v == 0.5
    assert MeasureVvc(0.5, 3, 1.0, 0.01).duration_s == 3.0


POINT = Point(2, 0.0, 0.5, -0.05, 1e-4, 10)


def test_points_without_it_have_the_columns_that_they_had() -> None:
    assert points_csv([POINT]) == "step,rate_deg_s,v_vc_v,output_v,std_v,n\n2,0.0,0.5,-0.05,0.0001,10\n"
    assert set(POINT.as_json()) == {"step", "rate_deg_s", "v_vc_v", "output_v", "std_v", "n"}
    assert Point.from_json(POINT.as_json()) == POINT


MEASURED = [
    msgspec.structs.replace(POINT, step=4, rate_deg_s=rate, v_vc_measured_v=rate / 36.0, v_vc_std_v=1e-6)
    for rate in (10.0, 0.0, -10.0)
]


def test_points_with_v_vc_have_two_more_columns() -> None:
    text = points_csv([POINT, *MEASURED])
    assert text.splitlines()[0].endswith(",n,v_vc_measured_v,v_vc_std_v")
    assert text.splitlines()[1].endswith(",10,,")
    assert all(Point.from_json(point.as_json()) == point for point in MEASURED)
    read = read_table(BytesIO(text.encode()), "points.csv", Layout(), [])
    assert read["virtual"].rate_deg_s.tolist() == [10.0, 0.0, -10.0]


def test_incomplete_line_of_table_is_refused() -> None:
    text = points_csv(MEASURED) + "2,0.0,0.5,-0.05,0.0001,10\n"
    with pytest.raises(ConfigError, match=r"points\.csv, line 5"):
        read_table(BytesIO(text.encode()), "points.csv", Layout(), [])


METER = '\n[v_vc_meter]\nmodel = "34401A"\nresource = "GPIB0::23::INSTR"\n'


def test_measured_v_vc_shows_generator_error_that_setting_hides() -> None:
    """The paper's generator is off by several millivolt and reads its setting back; the meter finds what there is."""
    text = bench_text(load_bench(None)).replace('v_vc_meter = "drawn"', 'v_vc_meter = "none"')
    built: list[SimulatedBench] = []

    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        built.append(SimulatedBench.build(description, seed, clock))
        return built[0]

    with open_bench(parse_bench(text + METER, "lab.toml"), build=build) as bench:
        bench.power.configure_output("P25V", 10.0, 0.1)
        bench.power.configure_output("N25V", -10.0, 0.1)
        bench.power.enable_outputs()
        bench.rate_source.configure_dc(0.5)
        bench.rate_source.enable_output()
        context = Context(bench, lambda _: None)
        ConfigureVvcMeter(1.0, 10.0).perform(context)
        bench.multimeter.configure_dc_voltage(10.0, 10.0)
        bench.rate_table.enable()
        start_s = bench.clock.now()
        done = window(v_vc_tolerance_v=0.03).perform(context)
        assert bench.clock.now() - start_s == pytest.approx(4.0, abs=1e-6)
        true_v = built[0].world.value_v("v_vc")
    assert done.point.v_vc_v == pytest.approx(0.5, abs=1e-9)
    assert done.point.v_vc_measured_v == pytest.approx(
        true_v, abs=2e-4
    )  # what the leads catch of the mains is in true_v
    assert abs(true_v - 0.5) > 3e-3
    assert all(isinstance(each, PairedReading) for each in done.readings)
