"""The bench as users get it: real drivers, simulated instruments, and what is physically there when it is left."""

from __future__ import annotations

import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.clock import VirtualClock, sleep
from vcfbench.errors import BenchError, InterlockError, NotSafe, WrongInstrument
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.bench.bench import Bench
    from vcfbench.clock import Clock
    from vcfbench.sim.world import World
    from vcfbench.station.description import BenchDescription

PAPER = embedded_text("paper")


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> list[World]:
    """The worlds behind the benches that are opened, in order."""
    made: list[World] = []
    build = SimulatedBench.build

    def remember(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = build(description, seed, clock)
        made.append(bench.world)
        return bench

    monkeypatch.setattr(SimulatedBench, "build", remember)
    return made


def in_full_swing(bench: Bench) -> None:
    """Rails on, V_Vc on, table at 200 deg/s."""
    bench.power.configure_output("P25V", 10.0, 0.1)
    bench.power.configure_output("N25V", -10.0, 0.1)
    bench.power.enable_outputs()
    bench.rate_source.configure_dc(2.5)
    bench.rate_source.enable_output()
    bench.rate_table.enable()
    bench.rate_table.set_rate(200.0, 100.0)
    sleep(bench.clock, 5.0)


def break_in_full_swing(bench: Bench, world: World) -> None:
    in_full_swing(bench)
    assert still_energised(world) == ["rail_positive", "rail_negative", "v_vc", "table"]
    raise ZeroDivisionError


def cut_the_line_in_full_swing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the table hear nothing any more."""
    in_full_swing(bench)
    monkeypatch.setattr("simrack.wires.serial_backend.SimulatedSerial.write", lambda _port, data: len(data))


def still_energised(world: World) -> list[str]:
    """What a person with a voltmeter and eyes would find wrong."""
    most = {"rail_positive": 0.5, "rail_negative": 0.5, "v_vc": 0.05}  # a supply that is off still discharges
    found = [node for node, volts in most.items() if abs(world.value_v(node)) > volts]
    return [*found, "table"] if abs(world.table.rate_deg_s()) > 0.05 else found


def test_everything_is_open_and_known() -> None:
    with open_bench(load_bench(None)) as bench:
        assert bench.simulated
        assert bench.seed == 0
        models = {role: identity.model for role, identity in bench.identities.items()}
    assert models == {
        "power": "E3631A",
        "rate_source": "33220A",
        "multimeter": "34401A",
        "oscilloscope": "DSO7104B",
        "rate_table": "Acutrol3000",
    }


def test_a_run_that_breaks_in_full_swing_leaves_nothing_energised(worlds: list[World]) -> None:
    with pytest.raises(ZeroDivisionError), open_bench(load_bench(None)) as bench:
        break_in_full_swing(bench, worlds[0])
    assert still_energised(worlds[0]) == []
    assert [report.instrument for report in bench.safe_reports][:3] == ["rate_table", "rate_source", "power"]
    assert all(report.safe for report in bench.safe_reports)


def test_check_leaves_nothing_energised_and_finds_nothing_wrong(worlds: list[World]) -> None:
    done = check_bench(load_bench("ideal"))
    assert [each.problem for each in done.instruments] == [None] * 5
    assert done.failure() is None
    assert still_energised(worlds[0]) == []


def test_a_table_found_turning_is_refused_and_stopped(worlds: list[World], monkeypatch: pytest.MonkeyPatch) -> None:
    build = SimulatedBench.build

    def turning(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = build(description, seed, clock)
        bench.world.table.close_servo()
        bench.world.table.demand_rate(50.0, 100.0)
        clock.sleep_until(2.0)
        return bench

    monkeypatch.setattr(SimulatedBench, "build", turning)
    with pytest.raises(InterlockError, match="before any command was sent"), open_bench(load_bench(None)):
        pytest.fail("the bench opened")
    assert still_energised(worlds[0]) == []


def test_instruments_that_are_not_the_ones_meant_are_all_named(worlds: list[World]) -> None:
    meant = 'model = "33220A"\nserial_number = "MY00000001"'
    other = PAPER.replace('model = "33220A"', meant).replace('"34401A"', '"34401A"\nserial_number = "7"')
    with pytest.raises(BenchError, match="2 instruments did not open") as caught, open_bench(parse_bench(other, "f")):
        pytest.fail("the bench opened")
    assert "rate_source at USB0::" in str(caught.value)
    assert "multimeter at GPIB0::22::INSTR" in str(caught.value)
    assert still_energised(worlds[0]) == []
    one = PAPER.replace('model = "33220A"', meant)
    with pytest.raises(WrongInstrument, match="MY00000001"), open_bench(parse_bench(one, "f")):
        pytest.fail("the bench opened")


def test_the_same_seed_gives_the_same_bench_whatever_the_speed() -> None:
    readings = []
    for seed, speed in ((3, None), (3, "max"), (3, 50.0), (4, None)):
        with open_bench(load_bench(None), seed=seed, speed=speed) as bench:
            in_full_swing(bench)
            bench.multimeter.configure_dc_voltage(10.0, 10.0)
            readings.append((bench.multimeter.read_voltage_v(), bench.clock.now()))
    assert readings[0] == readings[1] == readings[2]
    assert readings[3][0] != readings[0][0]


def test_noise_of_the_generator_follows_the_seed() -> None:
    def volts(seed: int) -> list[float]:
        bench = SimulatedBench.build(parse_bench(PAPER, "paper"), seed, VirtualClock())
        bench.devices["rate_source"].write(b"APPL:NOIS DEF,1,0\n")
        sleep(bench.clock, 1.0)
        bench.devices["rate_source"].wake_at()
        seen = []
        for _ in range(20):
            sleep(bench.clock, 1e-3)
            seen.append(bench.world.value_v("v_vc"))
        return seen

    assert volts(1) == volts(1)
    assert not set(volts(1)) & set(volts(2))


def test_a_vibration_source_is_opened_and_made_safe_too(worlds: list[World]) -> None:
    more = '\n[vibration_source]\nmodel = "33220A"\nresource = "GPIB0::10::INSTR"\n'
    with open_bench(parse_bench(PAPER + more, "paper")) as bench:
        assert bench.vibration_source is not None
        bench.vibration_source.configure_sine(3488.9, 2.0)
        bench.vibration_source.enable_output()
        assert bench.vibration_source.output_enabled()
    assert "vibration_source" in [report.instrument for report in bench.safe_reports]
    assert still_energised(worlds[0]) == []


def test_table_with_dead_line_is_not_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(NotSafe, match="NOT SAFE: rate_table at sim://paper") as caught,
        open_bench(load_bench(None)) as bench,
    ):
        cut_the_line_in_full_swing(bench, monkeypatch)
    assert caught.value.exit_code == 5
    assert [report.instrument for report in bench.safe_reports if not report.safe] == ["rate_table"]


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="signals are sent to another process")
def test_signal_in_paced_run_ends_it_safely(tmp_path: Path) -> None:
    code = "from vcfbench.cli.main import main; main()"
    command = [sys.executable, "-c", code, "run", "turntable", "--speed", "5", "--runs", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stderr is not None
        assert any("outputs on" in line for line in process.stderr)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 4
    assert "stopped by SIGTERM" in errors.splitlines()[-1]
    assert errors.splitlines()[-1].endswith("; the bench was made safe")
