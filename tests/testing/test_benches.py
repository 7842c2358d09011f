"""Procedures on benches that go wrong, as anybody can test theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from simrack.serve import ControlError
from simrack_tests.cells import few

from vcfbench.bench.bench import open_bench
from vcfbench.clock import sleep
from vcfbench.errors import (
    BenchError,
    ConfigError,
    DeadlineExceeded,
    FramingError,
    InstrumentError,
    LinkLost,
    MeasurementError,
    NotSafe,
    OutOfSync,
)
from vcfbench.interfaces import Regulation
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.file import template
from vcfbench.testing import open_simulated, serve_simulated, simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.testing import SimulatedLab


def energised(lab: SimulatedLab) -> None:
    bench = lab.bench
    bench.power.configure_output("P25V", 10.0, 0.1)
    bench.power.configure_output("N25V", -10.0, 0.1)
    bench.power.enable_outputs()
    bench.rate_table.enable()
    bench.rate_table.set_rate(50.0, 100.0)
    bench.multimeter.configure_dc_voltage(10.0, 10.0)
    sleep(bench.clock, 3.0)


def test_bench_without_faults_is_unchanged() -> None:
    with open_simulated(seed=3) as lab:
        energised(lab)
        here = lab.bench.multimeter.read_voltage_v(), lab.bench.clock.now()
    with open_bench(load_bench(None), seed=3) as bench:
        energised(lab=type("Lab", (), {"bench": bench})())
        there = bench.multimeter.read_voltage_v(), bench.clock.now()
    assert here == there


@pytest.mark.parametrize(
    ("role", "kind", "settings", "error"),
    few(
        [
            ("multimeter", "overload", {}, MeasurementError),
            ("multimeter", "late", {"delay_s": 60.0}, DeadlineExceeded),
            ("multimeter", "silent", {}, DeadlineExceeded),
            ("multimeter", "garbled", {}, FramingError),
            ("multimeter", "garbage", {}, FramingError),
            ("multimeter", "truncated", {}, (FramingError, DeadlineExceeded)),
            ("multimeter", "disconnect", {}, LinkLost),
            ("multimeter", "unreachable", {}, LinkLost),
            ("multimeter", "error", {"number": -330}, InstrumentError),
        ],
        every=4,
    ),
)
def test_multimeter_fault_gives_error_of_its_kind(
    role: str, kind: str, settings: dict[str, float], error: type[BenchError] | tuple[type[BenchError], ...]
) -> None:
    with open_simulated("ideal") as lab:
        energised(lab)
        lab.fault(role, kind, **settings)
        with pytest.raises(error):
            read_and_check(lab)
        lab.faults.clear()
    assert lab.world.table.rate_deg_s() == 0.0


def read_and_check(lab: SimulatedLab) -> None:
    lab.bench.multimeter.read_voltage_v()
    lab.bench.multimeter.check_errors()


def test_after_a_late_answer_the_right_one_comes() -> None:
    with open_simulated("ideal") as lab:
        energised(lab)
        before = lab.bench.multimeter.read_voltage_v()
        lab.fault("multimeter", "late", delay_s=20.0, duration_s=1.0)
        with pytest.raises((DeadlineExceeded, OutOfSync)):
            lab.bench.multimeter.read_voltage_v()
        lab.bench.rate_table.set_rate(0.0, 100.0)
        sleep(lab.bench.clock, 30.0)
        assert lab.bench.multimeter.read_voltage_v() != pytest.approx(before, abs=1e-3)


def test_a_supply_in_its_limit_says_so() -> None:
    with open_simulated("ideal") as lab:
        energised(lab)
        lab.fault("power", "current_limit", at_s=lab.bench.clock.now() + 5.0)
        assert lab.bench.power.regulation("P25V") is Regulation.CONSTANT_VOLTAGE
        sleep(lab.bench.clock, 6.0)
        assert lab.bench.power.regulation("P25V") is Regulation.CONSTANT_CURRENT
        assert abs(lab.world.value_v("rail_positive")) < 0.2


def test_faults_act_at_their_instant_within_wait() -> None:
    with open_simulated("ideal") as lab:
        energised(lab)
        begun = lab.bench.clock.now()
        lab.play(f'[[fault]]\ninstrument = "rate_table"\nkind = "interlock"\nat_s = {begun + 10.0}\n')
        sleep(lab.bench.clock, 9.9)
        assert lab.world.table.servo_closed
        angle = lab.world.table.angle_deg()
        sleep(lab.bench.clock, 10.0)
        assert not lab.world.table.servo_closed
        assert lab.world.table.angle_deg() - angle < 50.0 * 5.0
        assert "interlock" in str(lab.bench.rate_table.fault())


def test_what_cannot_be_made_safe_is_told() -> None:
    def lose_the_table(lab: SimulatedLab) -> None:
        energised(lab)
        lab.fault("rate_table", "unreachable")

    with pytest.raises(NotSafe, match="rate_table"), open_simulated("ideal") as lab:
        lose_the_table(lab)
    assert lab.world.table.rate_deg_s() == pytest.approx(50.0, abs=0.5)
    assert abs(lab.world.value_v("rail_positive")) < 0.5  # proved so; the rest discharges by itself


def test_a_real_stations_file_is_simulated_with_its_own_limits(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(template().replace("max_rate_deg_s = 300", "max_rate_deg_s = 250"), "utf-8")
    description = simulated(path, parameters="ideal", errors="none", overrides="site.latitude_deg = 10.0")
    assert description.simulation is not None
    assert description.simulation.errors.multimeter == "none"
    with open_simulated(description) as lab:
        assert lab.world.parameters.site.latitude_deg == 10.0
        with pytest.raises(BenchError, match="limit of 250 deg/s"):
            lab.bench.rate_table.set_rate(251.0, 100.0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"parameters": "mine"}, "parameters: expected 'ideal' or 'paper', got 'mine'"),
        ({"errors": "some"}, "errors.power: expected 'drawn' or 'none' or a table, got 'some'"),
        ({"overrides": "a b"}, "expected TOML"),
        ({"overrides": {"site": {"latitude": 3}}}, "simulation.override.site.latitude: expected a known name"),
    ],
)
def test_what_no_bench_can_be_is_told(settings: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        simulated(**settings)


def test_a_served_bench_answers_on_its_resource_strings() -> None:
    import pyvisa  # noqa: PLC0415

    with serve_simulated("ideal", seed=5) as lab:
        manager = pyvisa.ResourceManager("@py")
        with manager.open_resource(
            lab.resource("multimeter"), read_termination="\n", write_termination="\n", open_timeout=5000
        ) as meter:
            assert "34401A" in meter.query("*IDN?")  # type: ignore[attr-defined]
        manager.close()
        assert lab.resource("rate_table").startswith("socket://")
        assert lab.ask("set", name="applied_rate_deg_s", value=10.0) is not None
        lab.fault("multimeter", "silent", duration_s=1.0)
        with pytest.raises(ControlError, match="multimeter does not have the fault 'interlock'"):
            lab.fault("multimeter", "interlock")
        with pytest.raises(ConfigError, match="multimeter is not served on hislip"):
            lab.resource("multimeter", "hislip")
        with pytest.raises(ConfigError, match="kettle is not served on tcp"):
            lab.resource("kettle")


OVERLOAD = """
[[fault]]
instrument = "multimeter"
kind = "overload"
at_s = 100.0
duration_s = 50.0
"""


def test_a_served_bench_plays_the_same_scripts() -> None:
    import pyvisa  # noqa: PLC0415

    with serve_simulated("ideal", faults=OVERLOAD) as lab, lab.control() as control:
        manager = pyvisa.ResourceManager("@py")
        with manager.open_resource(lab.resource("multimeter"), read_termination="\n", write_termination="\n") as meter:
            readings = []
            for instant_s in (50.0, 110.0, 160.0):
                control.request("sleep_until", instant_s=instant_s)
                readings.append(float(meter.query("READ?")))  # type: ignore[attr-defined]
        manager.close()
    assert readings == [pytest.approx(0.0, abs=0.1), 9.9e37, pytest.approx(0.0, abs=0.1)]


def test_a_served_short_circuit_and_a_served_interlock_end() -> None:
    with serve_simulated("ideal") as lab:
        for role, kind in (("power", "current_limit"), ("rate_table", "interlock")):
            lab.fault(role, kind)
            assert lab.ask("status")["instruments"][role]["faults"] == [kind]
        lab.ask("clear_faults")
        assert all(each["faults"] == [] for each in lab.ask("status")["instruments"].values())
        with pytest.raises(ControlError, match="rate_table does not have the fault 'error'"):
            lab.fault("rate_table", "error")


def test_a_script_that_the_bench_cannot_suffer_is_not_served() -> None:
    script = OVERLOAD.replace("multimeter", "power")
    with (
        pytest.raises(ValueError, match="power does not have the fault 'overload'"),
        serve_simulated("ideal", faults=script),
    ):
        pass


@pytest.mark.parametrize(
    "overrides",
    [
        {"drive_mode.frequency_hz": 3490.0, "drive_mode.quality": 900.0},
        {"override.drive_mode.frequency_hz": 3490.0, "drive_mode": {"quality": 900.0}},
        {"drive_mode": {"frequency_hz": 3490.0, "quality": 900.0}},
        {"override": {"drive_mode": {"frequency_hz": 3490.0, "quality": 900.0}}},
        "drive_mode.frequency_hz = 3490.0\noverride.drive_mode.quality = 900.0",
    ],
)
def test_single_parameters_by_any_form_of_their_name(overrides: Any) -> None:
    found = simulated("paper", overrides=overrides).simulation
    assert found is not None
    assert found.override == {"drive_mode": {"frequency_hz": 3490.0, "quality": 900.0}}


@pytest.mark.parametrize(
    "overrides", [{"override": 3}, {"drive_mode.": 1.0}, {"drive_mode.x.y": 1.0}, {"drive_mode": 3}]
)
def test_a_name_of_no_parameter_is_refused(overrides: Any) -> None:
    with pytest.raises(ConfigError, match=r"paper: simulation\.override"):
        simulated("paper", overrides=overrides)
