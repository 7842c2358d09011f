"""Procedures on benches that have no more than they need: a procedure of one's own, and the two calibrations."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from vcfbench.cli.main import app
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.errors import Aborted, ConfigError
from vcfbench.instructions.routines import energised, rails_of, rails_on, set_v_vc, take, v_vc_on
from vcfbench.interfaces import (
    CapturesWaveforms,
    FunctionGenerator,
    Multimeter,
    PowersRails,
    PowerSupply,
    ReadsVoltage,
    SetsVoltage,
    lacking,
)
from vcfbench.records.schema import Status
from vcfbench.sim.served import on_wires
from vcfbench.station.parts import Limits
from vcfbench.station.settings import ProcedureSettings
from vcfbench.station.writing import bench_text
from vcfbench.steps import CheckRails, DisableSupply, SetRate, Settle
from vcfbench.steps.events import ReadingTaken
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from vcfbench.station.description import BenchDescription
    from vcfbench.steps.events import Event
    from vcfbench.steps.step import Plan, Routine
    from vcfbench.testing import ServedLab

PAPER = vcfbench.load_bench()
LEVELS_V = (-0.5, 0.0, 0.5)
QUICK = {"samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}

SMALL = structs.replace(
    PAPER,
    name="small",
    oscilloscope=None,
    rate_table=None,
    limits=Limits(max_v_vc_v=10.0, min_rail_v=9.5, max_rail_v=10.5, max_rail_current_a=0.2),
)
"""Supply, generator and multimeter."""

UNSEEN = structs.replace(PAPER, name="unseen", oscilloscope=None)
"""No oscilloscope."""


def plan(settings: ProcedureSettings) -> Plan:
    return (yield from energised(settings, levels(settings)))


def levels(settings: ProcedureSettings) -> Routine[None]:
    yield from v_vc_on()
    for level_v in LEVELS_V:
        v_vc_v = yield from set_v_vc(settings, level_v)
        yield from take(settings, 1, rate_deg_s=0.0, v_vc_v=v_vc_v)


def results(_settings: ProcedureSettings, points: Sequence[vcfbench.Point]) -> dict[str, Any]:
    return {"outputs_v": [point.output_v for point in points]}


NEEDS: dict[str, type] = {"power": PowersRails, "rate_source": SetsVoltage, "multimeter": ReadsVoltage}


def procedure(**changes: Any) -> vcfbench.Procedure[Any, Any]:
    fields = {"plan": plan, "needs": NEEDS, "uses": {}, **changes}
    return vcfbench.Procedure(
        name="levels", title="Set V_Vc, read the output.", settings=ProcedureSettings, results=results, **fields
    )


def points_of(run: vcfbench.Run) -> bytes:
    assert run.directory is not None
    return (run.directory / "points.csv").read_bytes()


def footer_of(run: vcfbench.Run) -> dict[str, Any]:
    assert run.directory is not None
    last = (run.directory / "journal.jsonl").read_text(encoding="utf-8").splitlines()[-1]
    return dict(json.loads(last))


@pytest.fixture(autouse=True)
def _locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))


@pytest.fixture
def in_process(tmp_path: Path) -> vcfbench.Run:
    return vcfbench.run(procedure(), SMALL, seed=3, settings=QUICK, runs=tmp_path / "here")


def test_procedure_with_three_instruments_runs_on_three(in_process: vcfbench.Run) -> None:
    assert in_process.status is Status.COMPLETE
    assert [point.v_vc_v for point in in_process.points] == pytest.approx(LEVELS_V, abs=1e-3)
    low_v, zero_v, high_v = (point.output_v for point in in_process.points)
    assert high_v - zero_v == pytest.approx(zero_v - low_v, rel=0.05)
    assert abs(high_v - low_v) > 1.0
    safe = footer_of(in_process)["safe"]
    assert [(each["instrument"], each["safe"]) for each in safe] == [
        *(("rate_source", True), ("power", True), ("multimeter", True))
    ]
    assert set(in_process.header["identities"]) == {"power", "rate_source", "multimeter"}
    assert {reading.table_rate_deg_s for reading in in_process.readings} == {None}


def test_a_record_of_it_is_read_back(in_process: vcfbench.Run) -> None:
    assert in_process.directory is not None
    again = vcfbench.load_run(in_process.directory)
    assert again.points == in_process.points
    assert again.readings == in_process.readings


def test_its_plan_is_walked_without_a_bench() -> None:
    planned = vcfbench.dry_run(procedure(), SMALL, settings=QUICK)
    subjects = {each.step.subject for each in planned.steps}
    assert subjects.isdisjoint({"table rate", "table servo", "oscilloscope", "drive signal"})
    assert planned.bench_seconds > 4.5


def over(wires: str, lab: ServedLab) -> BenchDescription:
    """The bench on TCP, or on pseudo-terminals where the real box has a serial port."""
    resources = {role: str(getattr(each, wires, None) or each.tcp) for role, each in lab.wires.items()}
    return on_wires(lab.description, resources, f"127.0.0.1:{lab.control_port}")


@pytest.mark.parametrize("wires", few(["tcp", "pty", "vxi11"], "vxi11"))
def test_over_real_wires_it_gives_the_same_bytes(wires: str, in_process: vcfbench.Run, tmp_path: Path) -> None:
    with serve_simulated(SMALL, seed=3) as lab:
        run = vcfbench.run(procedure(), over(wires, lab), settings=QUICK, runs=tmp_path / "there")
        assert lab.ask("get", name="rail.positive.voltage_v") == pytest.approx(0.0, abs=0.5)
    assert points_of(run) == points_of(in_process)
    assert all(each["safe"] for each in footer_of(run)["safe"])


class StopAt:
    """Sends SIGINT with the n-th reading."""

    def __init__(self, number: int) -> None:
        self.left = number

    def handle(self, event: Event) -> None:
        if isinstance(event, ReadingTaken):
            self.left -= 1
            if self.left == 0:
                signal.raise_signal(signal.SIGINT)


def test_stopped_in_the_middle_it_leaves_the_bench_safe(tmp_path: Path) -> None:
    with serve_simulated(SMALL, seed=3) as lab:
        with pytest.raises(Aborted) as caught:
            vcfbench.run(procedure(), over("tcp", lab), settings=QUICK, observers=[StopAt(5)], runs=tmp_path)
        assert lab.ask("get", name="rail.positive.voltage_v") == pytest.approx(0.0, abs=0.5)
        assert lab.ask("get", name="node.v_vc") == pytest.approx(0.0, abs=1e-2)
    assert caught.value.exit_code == 4
    assert len(caught.value.run.points) == 1
    safe = footer_of(caught.value.run)["safe"]
    assert [each["instrument"] for each in safe if each["safe"]] == ["rate_source", "power", "multimeter"]


def test_what_only_measures_and_is_not_needed_stays_closed(tmp_path: Path) -> None:
    """On the paper's bench the table, which drives something, is opened and proved all the same."""
    run = vcfbench.run(procedure(), PAPER, seed=3, settings=QUICK, runs=tmp_path)
    assert [each["instrument"] for each in footer_of(run)["safe"]] == [
        "rate_table",
        "rate_source",
        "power",
        "multimeter",
    ]


def test_a_supply_alone_is_a_bench_too(tmp_path: Path) -> None:
    """No meter either: nothing asks for the resolution of its readings."""

    def soak(settings: ProcedureSettings) -> Plan:
        try:
            yield from rails_on(settings, settings.start_up_s)
            yield CheckRails(rails_of(settings), settings.rail_tolerance_v)
        finally:
            yield DisableSupply()

    supply = structs.replace(SMALL, rate_source=None, multimeter=None)
    run = vcfbench.run(procedure(plan=soak, needs={"power": PowersRails}), supply, settings=QUICK, runs=tmp_path)
    assert run.status is Status.COMPLETE
    assert [(each["instrument"], each["safe"]) for each in footer_of(run)["safe"]] == [("power", True)]


@pytest.mark.exhaustive
def test_a_table_calibration_needs_no_generator(tmp_path: Path) -> None:
    """It is off throughout; what stands on the bench is off before the gyroscope gets power."""
    without = structs.replace(PAPER, rate_source=None, limits=structs.replace(PAPER.limits, max_v_vc_v=None))
    quick = {**QUICK, "rates_deg_s": [10.0, 0.0, -10.0]}
    run = vcfbench.run("turntable", without, seed=3, settings=quick, runs=tmp_path)
    with_one = vcfbench.run("turntable", PAPER, seed=3, settings=quick, runs=tmp_path)
    shaken = structs.replace(PAPER, rate_source=None, vibration_source=PAPER.rate_source)  # which has that limit too
    assert vcfbench.run("turntable", shaken, seed=3, settings=quick, runs=None).status is Status.COMPLETE
    assert run.results.scale_factor.value == pytest.approx(with_one.results.scale_factor.value, rel=1e-3)
    assert set(run.header["identities"]) == {"power", "multimeter", "rate_table", "oscilloscope"}
    u95 = [made.results.uncertainty.value("scale_factor").u95 for made in (run, with_one)]
    assert u95[0] == pytest.approx(u95[1], rel=0.2)


OWN_FILE = """
from vcfbench import Procedure
from vcfbench.interfaces import PowersRails, ReadsVoltage, SetsVoltage
from vcfbench.instructions.routines import energised, set_v_vc, take, v_vc_on
from vcfbench.station.settings import ProcedureSettings


def levels(settings):
    yield from v_vc_on()
    for level_v in (-0.5, 0.0, 0.5):
        v_vc_v = yield from set_v_vc(settings, level_v)
        yield from take(settings, 1, rate_deg_s=0.0, v_vc_v=v_vc_v)


LEVELS = Procedure(
    name="levels",
    title="Set V_Vc, read the output.",
    settings=ProcedureSettings,
    plan=lambda settings: energised(settings, levels(settings)),
    results=lambda settings, points: {"outputs_v": [point.output_v for point in points]},
    needs={"power": PowersRails, "rate_source": SetsVoltage, "multimeter": ReadsVoltage},
    uses={},
)
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to a child alone")
def test_custom_file_is_run_stopped_and_made_safe(tmp_path: Path) -> None:
    own, bench = tmp_path / "levels.py", tmp_path / "served.toml"
    own.write_text(OWN_FILE, encoding="utf-8")
    with serve_simulated(SMALL, seed=3, speed=1.0) as lab:
        bench.write_text(bench_text(over("tcp", lab)), encoding="utf-8")
        settings = [word for key in ("samples=3", "sample_interval_s=0.5", "settle_s=0.5") for word in ("--set", key)]
        command = [sys.executable, "-m", "vcfbench", "run", str(own), "--bench", str(bench), "--json", *settings]
        done = subprocess.run(  # noqa: S603 - our own command
            [*command, "--quiet"], capture_output=True, text=True, cwd=tmp_path, check=False
        )
        assert done.returncode == 0, done.stderr
        assert len(json.loads(done.stdout)["points"]) == 3
        with subprocess.Popen(  # noqa: S603 - our own command
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
        ) as process:
            assert process.stderr is not None
            assert any("average 3 readings" in line for line in process.stderr)
            process.send_signal(signal.SIGINT)
            process.stderr.read()
            assert process.wait(30) == 4
        assert lab.ask("get", name="rail.positive.voltage_v") == pytest.approx(0.0, abs=0.5)
        assert lab.ask("get", name="node.v_vc") == pytest.approx(0.0, abs=1e-2)


# --- what is refused, and when ---


def stderr_of(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["run", *arguments])
    assert result.exit_code == 2, result.output
    assert result.stderr.count("\n") == 1
    return result.stderr.strip()


@pytest.mark.parametrize("name", ["turntable", "virtual-coriolis"])
@pytest.mark.parametrize("more", [(), ("--dry-run",)])
def test_a_calibration_without_its_table_is_refused_in_a_sentence(
    name: str, more: tuple[str, ...], tmp_path: Path
) -> None:
    bench = tmp_path / "small.toml"
    bench.write_text(bench_text(SMALL), encoding="utf-8")
    said = stderr_of(name, "--bench", str(bench), "--quiet", "--runs", str(tmp_path / "runs"), *more)
    assert said == (
        f"vcfbench: {name} needs rate_table, which bench small does not have; its bench file needs a table [rate_table]"
    )
    assert not (tmp_path / "runs").exists()


def test_all_that_is_missing_is_named() -> None:
    bench = structs.replace(SMALL, multimeter=None)
    with pytest.raises(
        ConfigError, match=r"needs multimeter and rate_table, which .*the tables \[multimeter\], \[rate"
    ):
        vcfbench.dry_run("turntable", bench)


def test_instrument_without_an_ability_is_refused_before_opening() -> None:
    asks: dict[str, type] = {**NEEDS, "multimeter": CapturesWaveforms}
    with pytest.raises(ConfigError) as caught:
        vcfbench.dry_run(procedure(needs=asks), SMALL, settings=QUICK)
    assert str(caught.value) == (
        "multimeter at GPIB0::22::INSTR: levels needs CapturesWaveforms, and the driver of 34401A has no acquire, "
        "configure_channel, configure_timebase, configure_trigger and waveform; put another model into the bench file "
        "of small"
    )


def test_used_instrument_needs_its_capabilities() -> None:
    unable = procedure(uses={"multimeter": CapturesWaveforms})
    with pytest.raises(ConfigError, match="levels needs"):
        vcfbench.dry_run(unable, SMALL, settings=QUICK)
    assert vcfbench.dry_run(procedure(uses={"oscilloscope": CapturesWaveforms}), SMALL, settings=QUICK).steps


def test_the_instruments_themselves_can_be_asked_for() -> None:
    asks: dict[str, type] = {"power": PowerSupply, "rate_source": FunctionGenerator, "multimeter": Multimeter}
    assert vcfbench.dry_run(procedure(needs=asks), SMALL, settings=QUICK).steps
    assert lacking(Hp34401A, Multimeter) == ()
    assert "set_dc" in lacking(Hp34401A, FunctionGenerator)


def test_step_on_a_missing_instrument_names_the_key(tmp_path: Path) -> None:
    def careless(settings: ProcedureSettings) -> Plan:
        return (yield from energised(settings, turned(settings)))

    def turned(_settings: ProcedureSettings) -> Routine[None]:
        yield SetRate(10.0, 100.0, 0.0)

    with pytest.raises(vcfbench.LimitError, match=r"it is refused \(limits\.max_rate_deg_s\).*nothing was opened"):
        vcfbench.run(procedure(plan=careless), SMALL, runs=tmp_path)
    limited = structs.replace(SMALL, limits=PAPER.limits)
    with pytest.raises(ConfigError, match=r"rate_table: bench small has none.*step 10 \(table to \+10 deg/s") as caught:
        vcfbench.run(procedure(plan=careless), limited, settings=QUICK, runs=tmp_path)
    assert [each["safe"] for each in footer_of(caught.value.run)["safe"]] == [True] * 3


# --- the calibrations without an oscilloscope ---


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", few(["turntable", "virtual-coriolis"], "turntable"))
def test_drive_is_not_checked_without_oscilloscope(name: str, tmp_path: Path) -> None:
    run = vcfbench.run(name, UNSEEN, seed=3, settings={"rates_deg_s": (10.0, 0.0, -10.0), **QUICK}, runs=tmp_path)
    said = ("the drive signal: the bench has no oscilloscope",)
    waits = [each.step.seconds for each in vcfbench.dry_run(name, UNSEEN).steps if isinstance(each.step, Settle)]
    assert waits[:2] == [2.0, 5.0]
    assert run.status is Status.COMPLETE
    assert run.not_checked == said
    assert run.as_json()["not_checked"] == list(said)
    assert "not checked: the drive signal" in run._repr_html_()
    assert run.directory is not None
    assert vcfbench.load_run(run.directory).not_checked == said
    shown = CliRunner().invoke(app, ["runs", "show", str(run.name), "--runs", str(tmp_path)])
    assert "\nnot checked: the drive signal: the bench has no oscilloscope\n" in shown.stdout


def test_with_an_oscilloscope_nothing_is_said_of_it(tmp_path: Path) -> None:
    run = vcfbench.run("turntable", seed=3, settings={"rates_deg_s": (10.0, 0.0, -10.0), **QUICK}, runs=tmp_path)
    assert run.not_checked == ()
    assert "not_checked" not in run.as_json()
