"""The chamber: opened, limited, made safe, and its air is the air around the simulated gyroscope."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from msgspec import structs

import vcfbench
from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.bench.make_safe import safe_bench
from vcfbench.errors import ConfigError, InstrumentError, InterlockError, LimitError, MeasurementError
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.writing import bench_text
from vcfbench.steps import AwaitTemperature, SetTemperature, StopFlow, TemperatureReading, set_air_by_hand
from vcfbench.steps.step import Context
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

CHAMBER = '\n[chamber]\nmodel = "ATS-545"\nresource = "GPIB0::18::INSTR"\n'
LIMITS = "[limits]\nmin_temperature_c = -40.0\nmax_temperature_c = 85.0\nmax_ramp_k_min = 600.0\n"


@pytest.fixture(autouse=True)
def _locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))


def with_chamber(name: str = "ideal") -> BenchDescription:
    return parse_bench(bench_text(load_bench(name)).replace("[limits]\n", LIMITS) + CHAMBER, "lab.toml")


class Builder:
    """Builds the bench and keeps it, to look behind the instruments."""

    built: SimulatedBench

    def __call__(self, description: BenchDescription, seed: int, clock: Clock, /) -> SimulatedBench:
        self.built = SimulatedBench.build(description, seed, clock)
        return self.built


SET = SetTemperature(60.0, 60.0, 0.5, 30.0)
AWAIT = AwaitTemperature(60.0, 40.0, 30.0, 600.0)


@pytest.mark.exhaustive
def test_step_reaches_temperature_in_its_time() -> None:
    look = Builder()
    with open_bench(with_chamber(), build=look) as bench:
        context, world = Context(bench, lambda _: None), look.built.world
        room_c, start_s = world.ambient_c(), bench.clock.now()
        SET.perform(context)
        bench.clock.sleep_until(start_s + 10.0)
        assert world.ambient_c() == pytest.approx(room_c + 10.0, abs=0.7)  # 60 K/min
        reached = AWAIT.perform(context)
        way_s = (60.0 - 0.5 - room_c) / 1.0
        assert bench.clock.now() - start_s == pytest.approx(way_s + 30.0, abs=3.0)
        assert isinstance(reached, TemperatureReading)
        assert (reached.air_c, reached.device_c) == (60.0, None)
        assert world.ambient_c() == 60.0
        bench.clock.sleep_until(bench.clock.now() + 7200.0)
        assert world.temperature_c() == pytest.approx(60.0, abs=0.5)
        StopFlow().perform(context)
        bench.clock.sleep_until(bench.clock.now() + 1200.0)
        assert world.ambient_c() == pytest.approx(room_c)
    assert {each.instrument: each.safe for each in bench.safe_reports}["chamber"]


def test_it_is_made_safe_when_the_bench_is_left() -> None:
    look = Builder()
    bench = open_bench(with_chamber(), build=look)
    SET.perform(Context(bench, lambda _: None))
    assert bench.chamber.flow_enabled()
    assert look.built.devices["chamber"].flow  # type: ignore[attr-defined]
    bench.close()
    assert not look.built.devices["chamber"].flow  # type: ignore[attr-defined]
    [report] = [each for each in bench.safe_reports if each.instrument == "chamber"]
    assert (report.safe, report.detail) == (True, "air off")


def test_what_leaves_the_limits_is_refused_before_it_is_sent() -> None:
    described = with_chamber()
    checks = LimitChecks.of(described)
    SET.within(checks)
    for step, said in (
        (SetTemperature(86.0, 60.0, 0.5, 30.0), r"temperature 86 degC is outside the bench's -40 to 85 degC"),
        (SetTemperature(-41.0, 60.0, 0.5, 30.0), r"temperature -41 degC is outside"),
        (SetTemperature(60.0, 601.0, 0.5, 30.0), r"ramp 601 K/min is beyond the bench's limit of 600"),
        (SetTemperature(60.0, 0.0, 0.5, 30.0), r"is not above 0 K/min"),
        (SetTemperature(float("nan"), 60.0, 0.5, 30.0), "temperature nan degC is outside"),
    ):
        with pytest.raises(LimitError, match=said):
            step.within(checks)
        with open_bench(described) as bench, pytest.raises(LimitError, match=said):
            step.perform(Context(bench, lambda _: None))


def test_a_bench_with_a_chamber_must_have_its_limits() -> None:
    text = bench_text(load_bench("ideal")) + CHAMBER
    with pytest.raises(ConfigError, match=r"limits\.min_temperature_c: expected a limit for the chamber"):
        parse_bench(text, "lab.toml")
    turned = LIMITS.replace("-40.0", "90.0")
    with pytest.raises(ConfigError, match=r"limits\.min_temperature_c: expected less than limits\.max_temperature_c"):
        parse_bench(bench_text(load_bench("ideal")).replace("[limits]\n", turned) + CHAMBER, "lab.toml")


def test_only_a_person_moves_the_head_and_faults_end_waiting() -> None:
    with open_bench(with_chamber()) as bench:
        context = Context(bench, lambda _: None)
        assert bench.adjust is not None
        bench.adjust("chamber.head_down", 0)
        with pytest.raises(InterlockError, match="its head is up, no air was let out"):
            SET.perform(context)
        bench.adjust("chamber.head_down", 1)
        SET.perform(context)
        with pytest.raises(MeasurementError, match=r"not at 60 degC after 10 s, its air has 3\d\.\d degC"):
            AwaitTemperature(60.0, 40.0, 30.0, 10.0).perform(context)
        bench.adjust("chamber.faults", 8 + 16)
        with pytest.raises(MeasurementError, match="low flow, low input air pressure, on the way to 60 degC"):
            AWAIT.perform(context)


def test_refused_command_is_reported_without_error_queue() -> None:
    with open_bench(with_chamber()) as bench:
        chamber = bench.chamber.driver  # type: ignore[attr-defined]  # past the bench's limits
        with pytest.raises(InstrumentError, match="execution error"):
            chamber.set_temperature(200.0, 60.0)
        chamber.check_errors()


def test_sensor_at_device_is_read_if_present() -> None:
    with open_bench(with_chamber()) as bench:
        assert bench.chamber.device_temperature_c() is None
        session = bench.chamber.driver.session  # type: ignore[attr-defined]
        session.write("DSNS 1")
        assert bench.chamber.device_temperature_c() == pytest.approx(bench.chamber.air_temperature_c(), abs=1.0)


def test_a_room_that_somebody_warms_is_left_as_it_is() -> None:
    with open_bench(with_chamber()) as bench:
        assert bench.adjust is not None
        bench.adjust("ambient_c", 30.0)
        bench.clock.sleep_until(bench.clock.now() + 60.0)
        assert bench.chamber.air_temperature_c() == 30.0


def test_it_is_checked_served_and_made_safe_from_outside() -> None:
    described = with_chamber("paper")
    assert check_bench(described).failure() is None
    with serve_simulated(described, seed=1) as lab:
        with open_bench(lab.on_wires()) as bench:
            SET.perform(Context(bench, lambda _: None))
            AWAIT.perform(Context(bench, lambda _: None))
            assert bench.chamber.air_temperature_c() == 60.0
        lab.ask("advance", seconds=1.0)
        safe = safe_bench(lab.on_wires())
        assert {each.role: each.found for each in safe.instruments}["chamber"] == "off"


def test_the_air_differs_from_what_is_read_by_the_specimen() -> None:
    look = Builder()
    with open_bench(with_chamber("paper"), seed=3, build=look) as bench:
        SET.perform(Context(bench, lambda _: None))
        AWAIT.perform(Context(bench, lambda _: None))
        off_k = look.built.world.ambient_c() - bench.chamber.air_temperature_c()
    assert 0.0 < abs(off_k) < 2.5


def test_steps_are_predicted() -> None:
    gyro = LinearGyro(36.0)
    assert AWAIT.predict(gyro).air_c == 60.0
    assert AWAIT.physical_s == 70.0
    assert SET.describe() == "temperature +60.0 degC at 60 K/min, air on"
    by_hand = set_air_by_hand(60.0)
    assert by_hand.describe() == "by hand: set the chamber to +60.0 degC and wait until it is there"
    assert by_hand.adjustments == (("ambient_c", 60.0),)


def test_other_benches_have_none() -> None:
    with open_bench(structs.replace(load_bench("ideal"))) as bench, pytest.raises(ConfigError, match=r"\[chamber\]"):
        _ = bench.chamber
    assert vcfbench.__version__
