"""Which wire is the wrong way round, by the signs that it turns."""

from __future__ import annotations

import json
import math
from itertools import combinations
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from typer.testing import CliRunner

import vcfbench
from tests.procedures.fakes import MemoryJournal
from vcfbench.cli.main import app
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.polarity import (
    CAUSES,
    DRIVEN,
    POLARITY,
    TURNED,
    PolaritySettings,
    _carrier_sign,
    results,
)
from vcfbench.records.schema import Point
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.parts import DriveWindow, Expected, Limits, OscilloscopeWiring
from vcfbench.station.settings import PlacedInstrument, Station
from vcfbench.steps import AwaitRate, ConfigureScope, DriveReading, SetRate, SetVvc
from vcfbench.steps.executor import Executor
from vcfbench.steps.measured import Measured
from vcfbench.testing import open_simulated, simulated

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench.sim.parameters import BenchParameters

TABLE = Limits(max_rate_deg_s=300.0)
MULTIMETER = "the multimeter's leads on the output are reversed"
GENERATOR = "the generator's leads to V_Vc are reversed"
METER = "the leads of the meter on V_Vc are reversed"
CARRIER = "the carrier is shifted by half a cycle"
COMBS = "V_Vc drives the opposite combs"
DEMODULATOR = "the demodulator's reference is shifted by half a cycle"
PICK_OFF = "the sense pick-off is shifted by half a cycle"
UPSIDE_DOWN = "the table's positive sense is the other one, or the gyroscope is mounted upside down"
PHASES = {DEMODULATOR, PICK_OFF}
QUICK: dict[str, Any] = {"samples": 2}


def settings(*, table: bool = True, meter: bool = False, bias: bool = False, **expected: Any) -> PolaritySettings:
    """Return settings of a bench with the paper's gyroscope, whose bias is -42 mV."""
    placed = {"v_vc_meter": PlacedInstrument(model="34401A", where="GPIB0::23::INSTR")} if meter else {}
    known = Expected(bias_v=(-0.06, -0.02) if bias else None, **expected)
    return PolaritySettings(station=Station(instruments=placed, limits=TABLE if table else Limits(), expected=known))


def points(*, table: float = 1.0, v_vc: float = 1.0, output: float = 1.0, meter: float | None = None) -> Measured:
    """Return the points of a gyroscope with signs turned: of what acts on it, of its output, of what measures V_Vc."""

    def point(step: int, rate: float, level: float) -> Point:
        volts = output * (-0.042 - 0.0125 * (table * rate + v_vc * 150.0 * level))
        seen = None if meter is None or step != DRIVEN else meter * level
        return Point(step, rate, level, volts, 2e-5, 10, v_vc_measured_v=seen, v_vc_std_v=1e-6)

    return taken(point)


def taken(point: Callable[[int, float, float], Point]) -> Measured:
    """Return the points of the plan."""
    abba = (1.0, -1.0, -1.0, 1.0)
    turned, driven = ([(step, size * sign) for sign in abba] for step, size in ((TURNED, 10.0), (DRIVEN, 0.1)))
    return Measured(
        [point(1, 0.0, 0.0), *(point(n, x, 0.0) for n, x in turned), *(point(n, 0.0, x) for n, x in driven)]
    )


def test_right_signs_pass() -> None:
    found = results(settings(meter=True, bias=True), points(meter=1.0))
    assert [each.what for each in found.signs] == ["table", "V_Vc", "meter on V_Vc", "bias"]
    assert found.wrong_signs == 0
    assert found.causes == ()
    assert [each.response for each in found.signs] == pytest.approx([-0.0125, -1.875, 1.0, -0.042])


@pytest.mark.parametrize(
    ("turned", "causes"),
    [
        ({"output": -1.0, "meter": 1.0}, {MULTIMETER, *PHASES}),
        ({"v_vc": -1.0, "meter": -1.0}, {GENERATOR}),
        ({"v_vc": -1.0, "meter": 1.0}, {CARRIER, COMBS}),
        ({"meter": -1.0}, {METER}),
        ({"table": -1.0, "meter": 1.0}, {UPSIDE_DOWN}),
        ({"table": -1.0, "v_vc": -1.0, "meter": 1.0}, PHASES),
        (
            {"output": -1.0, "v_vc": -1.0, "meter": -1.0},
            {f"{each}, and {GENERATOR}" for each in (MULTIMETER,)} | {f"{GENERATOR}, and {each}" for each in PHASES},
        ),
    ],
)
def test_the_fewest_faults_are_named(turned: dict[str, float], causes: set[str]) -> None:
    assert set(results(settings(meter=True, bias=True), points(**turned)).causes) == causes


@pytest.mark.parametrize(("turned", "bias", "more"), [(-1.0, False, True), (-1.0, True, False), (1.0, False, False)])
def test_expected_bias_is_asked_for_where_it_would_tell(*, turned: float, bias: bool, more: bool) -> None:
    chosen, taken_points = settings(meter=True, bias=bias), points(output=turned, meter=1.0)
    said = vcfbench.text_of(POLARITY.report(chosen, taken_points, results(chosen, taken_points)))
    assert ("set expected.bias_v in the bench file" in said) is more


def test_with_fewer_signs_all_that_can_be_are_named() -> None:
    assert set(results(settings(), points(output=-1.0)).causes) == {MULTIMETER, *PHASES}
    every = {MULTIMETER, GENERATOR, CARRIER, COMBS, *PHASES}
    assert set(results(settings(table=False), points(v_vc=-1.0)).causes) == every
    assert set(results(settings(table=False, bias=True), points(output=-1.0)).causes) == {MULTIMETER, *PHASES}


PAPER = physical_parameters(vcfbench.load_bench("paper"))


def moved(faults: tuple[str, ...], offset_v: float) -> BenchParameters:
    """Return the paper's gyroscope with these faults of its own."""
    virtual, path, sign = PAPER.virtual_path, PAPER.sense_path, -1.0 if COMBS in faults else 1.0
    return structs.replace(
        PAPER,
        output_stage=structs.replace(PAPER.output_stage, offset_v=offset_v),
        virtual_path=structs.replace(
            virtual,
            left_comb_n_per_v2=sign * virtual.left_comb_n_per_v2,
            right_comb_n_per_v2=sign * virtual.right_comb_n_per_v2,
            carrier_phase_rad=virtual.carrier_phase_rad + math.pi * (CARRIER in faults),
        ),
        sense_path=structs.replace(
            path,
            demodulator_phase_rad=path.demodulator_phase_rad + math.pi * (DEMODULATOR in faults),
            preamplifier_gain=path.preamplifier_gain * (-1.0 if PICK_OFF in faults else 1.0),
        ),
    )


class Looked(Measured):
    """Points, and a carrier at 90 or -90 deg against the drive."""

    def __init__(self, points: Measured, phase_deg: float) -> None:
        super().__init__(points)
        self.phase_deg = phase_deg

    def found(self, kind: Any) -> Any:
        return (
            ((ConfigureScope(1e-4, 1), DriveReading(3488.9, 1.0, self.phase_deg, 0.0)),) if kind is DriveReading else ()
        )


@pytest.mark.parametrize("offset_v", [PAPER.output_stage.offset_v, 0.0])
@pytest.mark.parametrize("seen_by", [None, OscilloscopeWiring()])
def test_single_and_double_faults_are_named_or_look_alike(offset_v: float, seen_by: OscilloscopeWiring | None) -> None:
    """By the closed form of the gyroscope: 8 single and 28 double reversals, whatever the bias is made of."""
    rest_v = warm_output(moved((), offset_v))(0.0, None)
    window_v = tuple(sorted((0.5 * rest_v, 1.5 * rest_v)))
    chosen = settings(meter=True, bias=True)
    expected = structs.replace(chosen.station.expected, bias_v=window_v)
    station = structs.replace(chosen.station, expected=expected, oscilloscope=seen_by)
    chosen = structs.replace(chosen, station=station, drive=DriveWindow(phase_deg=(80.0, 100.0)))
    most = 0
    for faults in (*((each,) for each in CAUSES), *combinations(CAUSES, 2)):
        output = warm_output(moved(faults, offset_v))
        upside_down, leads, generator, meter = (
            -1.0 if each in faults else 1.0 for each in (UPSIDE_DOWN, MULTIMETER, GENERATOR, METER)
        )

        def point(step: int, rate: float, level: float) -> Point:
            volts = leads * output(upside_down * rate, generator * level if step == DRIVEN else None)  # noqa: B023
            seen = meter * generator * level if step == DRIVEN else None  # noqa: B023
            return Point(step, rate, level, volts, 2e-5, 10, v_vc_measured_v=seen, v_vc_std_v=1e-6)

        found = results(chosen, Looked(taken(point), -90.0 if CARRIER in faults else 90.0))
        words = ", and ".join(faults)
        assert words in (*found.causes, *found.look_alikes), faults
        assert bool(found.causes) == bool(found.wrong_signs)
        most = max(most, len(found.causes) + len(found.look_alikes))
    assert most <= 8  # not simply everything, of 36


def test_what_does_not_answer_has_no_sign() -> None:
    found = results(settings(), points(v_vc=1e-3))
    assert (found.signs[1].found, found.wrong_signs) == (0, 1)
    assert found.causes == ("the output does not respond to V_Vc: a lead of the generator is off",)
    [words] = results(settings(), points(output=0.0)).causes
    assert words.startswith("the output does not move")


def test_the_bench_file_says_what_is_expected() -> None:
    other = settings(scale_factor_v_per_deg_s=(0.01, 0.015), k_vc_deg_s_per_v=(-160.0, -140.0))
    found = results(other, points(table=-1.0))
    assert [(each.expected, each.right) for each in found.signs] == [(1, True), (-1, True)]
    assert found.expected_from == "[expected] of the bench file: scale factor, K_Vc"


@pytest.fixture(scope="module")
def backwards(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run on a gyroscope whose V_Vc drives the opposite combs; one limit of the bench file passes."""
    combs = {"virtual_path": {"left_comb_n_per_v2": -1.448e-7, "right_comb_n_per_v2": -1.42e-7}}
    lab = simulated("lab", overrides=combs)
    return vcfbench.run("polarity", lab, settings=QUICK, runs=tmp_path_factory.mktemp("backwards"))


def test_a_wrong_sign_fails_the_run(backwards: Any) -> None:
    assert backwards.error is None
    assert backwards.verdict.word == "fail"
    assert backwards.results.causes == (COMBS,)  # the oscilloscope sees that the carrier is right
    assert f"{GENERATOR}, and {METER}" in backwards.results.look_alikes
    assert vcfbench.load_run(backwards.directory).results == backwards.results
    where = ["--runs", str(backwards.directory.parent)]
    shown = CliRunner().invoke(app, ["runs", "show", "last", *where])
    assert "1 of 4 signs are wrong" in shown.stdout
    assert COMBS in shown.stdout
    [listed] = json.loads(CliRunner().invoke(app, ["runs", "list", "--json", *where]).stdout)["runs"]
    assert listed["verdict"] == "fail"


def test_command_prints_pass_and_exit_code_is_verdict(tmp_path: Path) -> None:
    command = ["run", "polarity", "--quiet", "--set", "samples=2", "--runs", str(tmp_path)]
    right = CliRunner().invoke(app, command)
    assert right.exit_code == 0, right.output
    assert "all signs are right" in right.stdout
    bench = tmp_path / "turned.toml"
    bench.write_text(_paper_with_expected(), encoding="utf-8")
    wrong = CliRunner().invoke(app, [*command, "--bench", str(bench), "--json"])
    assert wrong.exit_code == 1, wrong.output
    answer = json.loads(wrong.stdout)
    assert answer["acceptance"]["verdict"] == "fail"
    assert answer["results"]["causes"] == [MULTIMETER, DEMODULATOR, PICK_OFF]


def _paper_with_expected() -> str:
    from vcfbench.station.file import embedded_text  # noqa: PLC0415  # one test needs it

    return embedded_text("paper") + "\n[expected]\nscale_factor_v_per_deg_s = [0.01, 0.015]\n"


def test_leads_that_are_really_reversed_are_found() -> None:
    """On the simulated bench, where a hand turns them round."""
    chosen = settings_of(POLARITY, vcfbench.load_bench("lab"), asked_in_python(QUICK))
    chosen = structs.replace(chosen, station=structs.replace(chosen.station, expected=Expected(bias_v=(-0.06, -0.02))))
    with open_simulated(simulated("lab"), seed=2) as lab:
        lab.world.leads["multimeter"].turn("input", reversed_=True)
        executed = Executor(lab.bench, MemoryJournal()).execute(POLARITY.plan(chosen))
    found = results(chosen, Looked(Measured(executed.points), 90.0))
    assert found.causes == (MULTIMETER, DEMODULATOR, PICK_OFF)


def test_turned_carrier_is_named_and_lost_one_ends_the_run(tmp_path: Path) -> None:
    """The drive check ended the run without a word about the sign."""
    turned = simulated("lab", overrides={"virtual_path": {"carrier_phase_rad": 2.0 * math.pi + 0.005}})
    run = vcfbench.run("polarity", turned, settings=QUICK, runs=tmp_path)
    assert run.results.causes == (CARRIER,)
    [seen] = [each for each in run.results.signs if each.what == "carrier"]
    assert (seen.found, seen.response) == (-1, pytest.approx(-89.7, abs=1.0))
    assert "carrier, by its phase against the drive" in vcfbench.text_of(run.report())
    lost = simulated("lab", overrides={"virtual_path": {"carrier_phase_rad": 0.5 * math.pi}})
    with pytest.raises(vcfbench.MeasurementError, match="drive signal not as it should be"):
        vcfbench.run("polarity", lost, settings=QUICK, runs=tmp_path)


def test_both_signs_cancel_drift_with_and_without_table() -> None:
    steps = [each.step for each in vcfbench.dry_run("polarity", "lab", settings=QUICK).steps]
    assert [each.rate_deg_s for each in steps if isinstance(each, AwaitRate)] == [10.0, -10.0, 10.0, 0.0]
    assert [each.v_vc_v for each in steps if type(each) is SetVvc] == [0.0, 0.1, -0.1, 0.1]
    field = [each.step for each in vcfbench.dry_run("polarity", "examples/field-bench.toml", settings=QUICK).steps]
    assert not any(isinstance(each, SetRate) for each in field)


@pytest.mark.parametrize(("phase_deg", "sign"), [(-175.0, 1), (175.0, 1), (5.0, -1), (-355.0, -1), (90.0, 0)])
def test_a_carrier_s_phase_counts_apart_from_whole_turns(phase_deg: float, sign: int) -> None:
    assert _carrier_sign(PolaritySettings(drive=DriveWindow(phase_deg=(170.0, 190.0))), phase_deg) == sign
