"""``vcfbench run`` as a whole on the embedded simulated benches: real drivers, real dialects, simulated time."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from simrack.observations import Window
from simrack_tests.cells import few
from typer.testing import CliRunner

from tests import warm
from vcfbench.cli.main import app
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def answer(runs: Path, *arguments: str) -> dict[str, Any]:
    result = CliRunner().invoke(app, ["run", *arguments, "--json", "--quiet", "--runs", str(runs)])
    assert result.exit_code == 0, result.output
    values: dict[str, Any] = json.loads(result.stdout)
    return values


class Ran:
    """Runs each command once and gives its answer to every test that asks."""

    def __init__(self, runs: Path) -> None:
        self.runs = runs
        self._answers: dict[tuple[str, ...], dict[str, Any]] = {}

    def __call__(self, *arguments: str) -> dict[str, Any]:
        if arguments not in self._answers:
            self._answers[arguments] = answer(self.runs, *arguments)
        return self._answers[arguments]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    return Ran(tmp_path_factory.mktemp("runs"))


def footer(runs: Path, run: str) -> dict[str, Any]:
    last = (runs / run / "journal.jsonl").read_text().splitlines()[-1]
    values: dict[str, Any] = json.loads(last)
    return values


@pytest.mark.parametrize(
    ("name", "bench"), few([("turntable", "ideal"), ("virtual-coriolis", "paper")], ("turntable", "ideal"))
)
def test_bench_time_is_within_5_percent_of_minimum(name: str, bench: str, ran: Ran) -> None:
    answer = ran(name, "--bench", bench)
    end = footer(ran.runs, answer["run"])
    assert end["physical_minimum_s"] <= answer["bench_seconds"] <= 1.05 * end["physical_minimum_s"]
    assert all(report["safe"] for report in end["safe"])
    assert len(end["safe"]) >= 4


@pytest.mark.exhaustive
def test_ideal_bench_agrees_within_20_ppm_and_uncertainty(ran: Ran) -> None:
    results = ran("virtual-coriolis", "--bench", "ideal", "--seed", "5")["results"]
    error, u = results["scale_factor_error_percent"], results["scale_factor_error_u_percent"]
    assert abs(error) < 20e-4
    assert abs(error) <= 2.0 * u


@pytest.mark.exhaustive
def test_same_seed_same_results_and_another_seed_others(ran: Ran, tmp_path: Path) -> None:
    command = ("virtual-coriolis", "--bench", "paper")
    first, again = ran(*command), answer(tmp_path, *command, "--seed", "0")
    assert (first["points"], first["results"]) == (again["points"], again["results"])
    assert (ran.runs / first["run"] / "result.json").read_bytes() == (
        tmp_path / again["run"] / "result.json"
    ).read_bytes()
    one, other = (ran("turntable", "--seed", seed)["points"] for seed in ("4", "5"))
    assert one != other


@pytest.mark.exhaustive
def test_points_are_read_back_by_analyze(ran: Ran) -> None:
    virtual = ran("virtual-coriolis", "--bench", "paper")
    done = CliRunner().invoke(app, ["analyze", str(ran.runs / virtual["run"] / "points.csv"), "--json"])
    series = json.loads(done.stdout)["series"]
    for column in ("turntable", "virtual"):
        assert series[column]["scale_factor"]["value"] == virtual["results"][column]["scale_factor"]["value"]


@pytest.mark.exhaustive
def test_offset_of_zeros_does_not_enter_k_vc(ran: Ran) -> None:
    """On the paper's bench the generator's leakage lifts the zero by some 50 mV; the literal match falls into it."""
    command = ("virtual-coriolis", "--bench", "paper")
    zero, absolute = ran(*command)["results"], ran(*command, "--match", "absolute")["results"]
    lift_v = zero["virtual"]["zero_v"] - zero["turntable"]["zero_v"]
    assert 0.03 < lift_v < 0.07
    assert absolute["v_vc10_v"] / zero["v_vc10_v"] == pytest.approx(1.0 + lift_v / 0.1254, rel=0.02)
    assert absolute["scale_factor_error_percent"] > 25.0


def breaks_interlock(bench: SimulatedBench, _: pytest.MonkeyPatch) -> None:
    bench.devices["rate_table"].set_interlock(9, faulty=True)  # type: ignore[attr-defined]


def draws_too_much(_: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(World, "rail_current_a", lambda *_: 0.5)


def overloads_the_meter(_: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Window, "mean_v", lambda _: 1e3)


@pytest.mark.parametrize(
    ("misfortune", "words"),
    few(
        [
            (breaks_interlock, "rate_table at sim://paper: fault: master interlock"),
            (draws_too_much, "power at GPIB0::5::INSTR: P25V is in current limit"),
            (overloads_the_meter, "multimeter at GPIB0::22::INSTR: overload"),
        ],
        every=3,
    ),
)
def test_failure_in_full_swing_is_named_and_points_kept(
    misfortune: Callable[[SimulatedBench, pytest.MonkeyPatch], None],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A minute after the start: four windows are over, the table turns at 20 deg/s."""
    built: list[SimulatedBench] = []
    build, reach = SimulatedBench.build, World.reach

    def keep(*arguments: Any) -> SimulatedBench:
        built.append(build(*arguments))
        return built[0]

    def reach_misfortune(world: World, instant_s: float) -> bool:
        if built and world.clock.now() > 62:
            misfortune(built.pop(), monkeypatch)
        return reach(world, instant_s)

    monkeypatch.setattr(SimulatedBench, "build", keep)
    monkeypatch.setattr(World, "reach", reach_misfortune)
    result = CliRunner().invoke(app, ["run", "turntable", "--json", "--quiet", "--runs", str(tmp_path)])
    answer = json.loads(result.stdout)
    assert result.exit_code == 3
    assert result.stderr.startswith(f"vcfbench: {words}")
    assert ", step 32 (average 10 readings" in result.stderr
    assert (answer["status"], len(answer["points"]), answer["results"]) == ("aborted", 3, {})
    end = footer(tmp_path, answer["run"])
    assert len(end["safe"]) == 5
    assert all(report["safe"] for report in end["safe"])


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_interrupted_run_keeps_its_points_and_leaves_safely(tmp_path: Path) -> None:
    """At 50 times real time the first window is over within a second; then the signal comes."""
    command = ["vcfbench", "run", "turntable", "--json", "--speed", "50", "--runs", str(tmp_path)]
    with warm.running(command, tmp_path, errors=True) as child:
        assert any("average" in line for line in child.stderr)
        child.send_signal(signal.SIGINT)
        out, _ = child.communicate()
    answer = json.loads(out)
    assert child.returncode == 4
    assert answer["status"] == "aborted"
    assert len(answer["points"]) >= 1
    assert answer["results"] == {}
    end = footer(tmp_path, answer["run"])
    assert end["status"] == "aborted"
    assert all(report["safe"] for report in end["safe"])


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_impatience_costs_neither_record_nor_answer(tmp_path: Path) -> None:
    """Signals go on coming while the bench is made safe and the record is closed, until the process is gone."""
    command = ["vcfbench", "run", "turntable", "--json", "--speed", "50", "--runs", str(tmp_path)]
    with warm.running(command, tmp_path, errors=True) as child:
        assert any("outputs on" in line for line in child.stderr)
        child.send_signal(signal.SIGINT)
        assert any("FAILED: stopped by SIGINT" in line for line in child.stderr)
        for _ in range(2000):
            child.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                child.wait(0.005)
                break
        out, errors = child.communicate()
    answer = json.loads(out)
    assert child.returncode in {4, 5}, errors
    assert footer(tmp_path, answer["run"])["status"] == answer["status"] == "aborted"


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
def test_a_killed_run_keeps_every_point_that_was_told(tmp_path: Path) -> None:
    command = ["vcfbench", "run", "turntable", "--speed", "100", "--runs", str(tmp_path)]
    printed = 0
    with warm.running(command, tmp_path, errors=True) as child:
        for line in child.stderr:
            printed += "average" in line
            if printed == 3:
                child.kill()
                break
        child.stderr.read()
    listed = CliRunner().invoke(app, ["runs", "list", "--runs", str(tmp_path), "--json"])
    [line_] = json.loads(listed.stdout)["runs"]
    assert line_["status"] == "incomplete"
    assert line_["points"] >= 3
