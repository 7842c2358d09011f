"""The second multimeter: its leads are on the V_Vc node, everything else is as with the first."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack.serve.adjust import adjustments_of
from simrack_tests.cells import few

from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.bench.ground import station
from vcfbench.clock import VirtualClock
from vcfbench.errors import BenchError, ConfigError
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.inventory import inventory
from vcfbench.station.writing import bench_text
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.bench.bench import Bench
    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

METER = '\n[v_vc_meter]\nmodel = "{model}"\nresource = "GPIB0::23::INSTR"\n'


@pytest.fixture(autouse=True)
def _locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))


def with_meter(name: str = "ideal", model: str = "34401A", more: str = "") -> BenchDescription:
    return parse_bench(bench_text(load_bench(name)) + METER.format(model=model) + more, "lab.toml")


def powered(bench: Bench, v_vc_v: float) -> None:
    bench.power.configure_output("P25V", 10.0, 0.1)
    bench.power.configure_output("N25V", -10.0, 0.1)
    bench.power.enable_outputs()
    bench.rate_source.configure_dc(v_vc_v)
    bench.rate_source.enable_output()
    bench.clock.sleep_until(bench.clock.now() + 2.0)


def read_v_vc(bench: Bench) -> float:
    bench.v_vc_meter.configure_dc_voltage(10.0, 10.0)
    return bench.v_vc_meter.read_voltage_v()


def looked_behind(described: BenchDescription) -> tuple[float, float]:
    """Return what is at the V_Vc input while the generator gives 1 V, and what the meter on it reads."""
    built: list[SimulatedBench] = []

    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        built.append(SimulatedBench.build(description, seed, clock))
        return built[0]

    with open_bench(described, build=build) as bench:
        powered(bench, 1.0)
        return built[0].world.value_v("v_vc"), read_v_vc(bench)


@pytest.mark.parametrize("model", few(["34401A", "34461A", "34465A"], every=3))
def test_v_vc_meter_reads_and_loads_v_vc_of_gyroscope(model: str) -> None:
    """50 ohm of the generator against 10 Mohm: with a meter there V_Vc is 5 ppm less, for the gyroscope too."""
    text = bench_text(with_meter(model=model))
    perfect_v, perfectly_read_v = looked_behind(parse_bench(text, "lab.toml"))
    assert perfectly_read_v == pytest.approx(perfect_v, abs=1.2e-6)
    own = 'v_vc_meter = "none"', "v_vc_meter = { input_ohm = 10e6 }"
    loaded_v, read_v = looked_behind(parse_bench(text.replace(*own), "lab.toml"))
    assert loaded_v == pytest.approx(perfect_v * (1.0 - 50.0 / 10e6), abs=1e-9)
    assert read_v == pytest.approx(loaded_v, abs=1.2e-6)


def test_a_lead_that_is_moved_takes_its_load_along() -> None:
    text = bench_text(with_meter()).replace('v_vc_meter = "none"', "v_vc_meter = { input_ohm = 10e6 }")
    with open_bench(parse_bench(text, "lab.toml")) as bench:
        powered(bench, 1.0)
        bench.multimeter.configure_dc_voltage(10.0, 10.0)
        assert bench.adjust is not None
        bench.adjust("multimeter.input.node", "v_vc")
        with_load_v = bench.multimeter.read_voltage_v()
        bench.adjust("v_vc_meter.input.node", None)
        assert bench.multimeter.read_voltage_v() - with_load_v == pytest.approx(5e-6, abs=1.5e-6)


def test_the_two_meters_read_their_own_nodes() -> None:
    with open_bench(with_meter()) as bench:
        powered(bench, 0.5)
        bench.multimeter.configure_dc_voltage(10.0, 10.0)
        assert read_v_vc(bench) == pytest.approx(0.5, rel=1e-3)
        assert abs(bench.multimeter.read_voltage_v()) > 0.01
        assert bench.multimeter.read_voltage_v() != pytest.approx(0.5, rel=0.2)


def test_its_node_can_be_another() -> None:
    text = bench_text(with_meter()).replace('v_vc_meter = "v_vc"', 'v_vc_meter = "rail_positive"')
    with open_bench(parse_bench(text, "lab.toml")) as bench:
        powered(bench, 0.5)
        assert read_v_vc(bench) == pytest.approx(10.0, abs=0.01)


def test_it_changes_nothing_for_the_others_but_what_it_loads() -> None:
    """Its random stream is its own: without a load on what they read, the output and its noise stay bit for bit."""
    plain = load_bench(None)
    second = parse_bench(
        bench_text(plain).replace('v_vc_meter = "v_vc"', 'v_vc_meter = "rail_negative"') + METER.format(model="34401A"),
        "lab.toml",
    )
    readings = []
    for described in (plain, second):
        with open_bench(described, seed=5) as bench:
            bench.multimeter.configure_dc_voltage(10.0, 10.0)
            readings.append([bench.multimeter.read_voltage_v() for _ in range(3)])
    assert readings[0] == readings[1]


def test_v_vc_meter_errors_are_drawn_apart_from_the_multimeters() -> None:
    described = with_meter("paper")
    rows = {row.path: row.value for row in inventory(described, 3)}
    own = {path.removeprefix("errors.v_vc_meter."): v for path, v in rows.items() if ".v_vc_meter." in path}
    other = {path.removeprefix("errors.multimeter."): v for path, v in rows.items() if ".multimeter." in path}
    assert own.keys() == other.keys()
    assert own != other
    assert {row.path: row.value for row in inventory(described, 3)} == rows
    text = bench_text(described).replace('v_vc_meter = "drawn"', 'v_vc_meter = "none"')
    perfect = {row.path: row for row in inventory(parse_bench(text, "lab.toml"), 3)}
    assert all("a perfect instrument" in row.source for path, row in perfect.items() if ".v_vc_meter." in path)


def test_it_is_checked_opened_and_left_idle() -> None:
    described = with_meter()
    checked = {each.role: each for each in check_bench(described).instruments}
    assert checked["v_vc_meter"].identity is not None
    assert checked["v_vc_meter"].problem is None
    with open_bench(described) as bench:
        assert bench.identities["v_vc_meter"].model == "34401A"
    assert {each.instrument: each.safe for each in bench.safe_reports}["v_vc_meter"]


def test_it_has_a_resource_of_its_own() -> None:
    text = bench_text(load_bench(None)) + METER.format(model="34401A").replace("::23", "::22")
    with pytest.raises(ConfigError, match=r"v_vc_meter\.resource: expected a resource of its own, not that of multi"):
        parse_bench(text, "lab.toml")


def test_a_generator_is_no_meter() -> None:
    with pytest.raises(ConfigError, match=r"v_vc_meter\.model: expected '34401A' or '34461A' or '34465A'"):
        with_meter(model="33220A")


def test_a_bench_without_one_says_so() -> None:
    with open_bench(load_bench("ideal")) as bench, pytest.raises(ConfigError, match=r"needs a table \[v_vc_meter\]"):
        _ = bench.v_vc_meter


def test_v_vc_meter_over_tcp_has_same_digits() -> None:
    described = with_meter("paper")
    with open_bench(described, seed=2) as bench:
        powered(bench, 0.5)
        here_v = read_v_vc(bench)
    with serve_simulated(described, seed=2) as lab:
        assert "v_vc_meter" in lab.wires
        real = lab.on_wires()
        with station(real, None, None, roles=["v_vc_meter"]), pytest.raises(BenchError, match="v_vc_meter at"):
            open_bench(real, needs=["v_vc_meter"])
        with open_bench(lab.on_wires()) as bench:
            powered(bench, 0.5)
            assert read_v_vc(bench) == pytest.approx(here_v, abs=2e-5)


def test_its_leads_can_be_moved_from_outside() -> None:
    built = SimulatedBench.build(with_meter(), 0, VirtualClock())
    offered = adjustments_of(built.world, built.devices)
    assert offered["v_vc_meter.input.node"].read() == "v_vc"
    without = SimulatedBench.build(load_bench("ideal"), 0, VirtualClock())
    assert "v_vc_meter.input.node" not in adjustments_of(without.world, without.devices)
