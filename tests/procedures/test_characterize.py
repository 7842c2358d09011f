"""All of it in one session: parts in their order, the supply on between them, one data sheet, what is left out said."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import Struct, structs

import vcfbench
from tests.procedures import test_bandwidth, test_resonance
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.data_sheet import SheetRow, data_sheet_report, sheet_rows
from vcfbench.procedures.characterize.plan import (
    PARTS,
    BeginPart,
    CharacterizeResult,
    CharacterizeSettings,
    PartResult,
    _kept_on,
    _Session,
)
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.zero.noise import NoiseCoefficient
from vcfbench.reports.document import Table, Text
from vcfbench.station.acceptance import judged
from vcfbench.station.file import embedded_text
from vcfbench.station.settings import Limit, Sources, Station
from vcfbench.steps import (
    Acquire,
    AskOperator,
    DisableSupply,
    Done,
    EnableSupply,
    NotChecked,
    Note,
    Settle,
    Step,
)
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import UncertaintyPart as Source
from vcfbench.values.value import Value

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.station.description import BenchDescription
    from vcfbench.steps.step import Plan

FIELD = Path(__file__).parents[2] / "examples" / "field-bench.toml"
QUICK: dict[str, Any] = {
    "parts": ["zero", "polarity", "turntable", "temperature"],
    "samples": 6,
    "turntable": {"rates_deg_s": [200.0, 50.0, 0.0, -50.0, -200.0]},
    "zero": {"duration_s": 200.0, "samples": 4},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return vcfbench.run("characterize", seed=4, settings=QUICK, runs=tmp_path_factory.mktemp("runs"))


def row(run: Any, procedure: str, quantity: str, unit: str) -> Any:
    (found,) = [
        each
        for each in run.results.data_sheet
        if (each.procedure, each.quantity, each.unit) == (procedure, quantity, unit)
    ]
    return found


def test_resumed_it_is_warm_before_it_goes_on() -> None:
    def warm_again_s(**asked: Any) -> float:
        return settings_of(PROCEDURES["characterize"], vcfbench.load_bench("lab"), asked_in_python(asked)).warm_again_s

    assert warm_again_s() == 1800.0
    assert warm_again_s(warmup={"shortest_s": 240.0}) == 240.0
    assert warm_again_s(parts=["turntable", "zero"], warm_up_s=60.0) == 60.0


class StatesAs(Struct, frozen=True):
    """Results that state these values."""

    values: tuple[Value, ...]

    def stated(self) -> Iterator[Value]:
        yield from self.values


def test_a_limit_is_for_the_value_that_the_sheet_shows() -> None:
    """The first part is warmup, which states a bias, too: its own, of a warm end."""
    end = StatesAs((Value("bias_end", 3.298, "deg/s", 0.0019, u95=0.0038, kind="bias_deg_s"),))
    line = StatesAs(
        (
            Value("scale_factor", -0.0125, "V/(deg/s)", 2e-7, u95=4e-7, kind="scale_factor"),
            Value("bias_deg_s", 3.352, "deg/s", 0.0024, u95=0.0047, kind="bias_deg_s"),
        )
    )
    parts = tuple(PartResult(name, "", results) for name, results in (("warmup", end), ("turntable", line)))
    rows = tuple(row for part in parts for row in sheet_rows(part.name, part.results, ""))
    found = judged([Limit("bias_deg_s", 3.2, 3.35, guarded=True)], CharacterizeResult(rows, (), parts), ())
    assert found is not None
    assert (found.limits[0].value, found.limits[0].u95) == (3.352, 0.0047)


def test_the_model_equation_is_filled_in(run: Any) -> None:
    (table,) = (part for part in run.report().parts if isinstance(part, Table) and part.title == "Model equation")
    terms = {each[0]: each[1:] for each in table.printed()}
    factor, bias = row(run, "turntable", "scale factor", "V/(deg/s)"), row(run, "turntable", "bias", "deg/s")
    assert float(terms["S"][1]) == pytest.approx(factor.value, rel=1e-4)
    assert float(terms["S"][3]) == pytest.approx(factor.u95, rel=0.05)
    assert terms["S"][4:] == ("V/(deg/s)", "sensitivity")
    assert float(terms["D_F"][1]) == pytest.approx(bias.value, rel=1e-3)  # of the same line, not the output at rest
    (said,) = (part.text for part in run.report().parts if isinstance(part, Text) and "1e-6 eps" in part.text)
    assert "not measured: E_T, E_U, eps_T, eps_U" in said
    assert not any(
        part.title == "Model equation" for part in data_sheet_report([], [], "").parts if hasattr(part, "title")
    )


def test_ieee_2700_sheet_has_reasons_for_the_rest(run: Any) -> None:
    (table,) = (part for part in run.report().parts if isinstance(part, Table) and "IEEE 2700" in part.title)
    sheet = {each[0]: each[1:] for each in table.printed()}
    assert list(sheet)[2:7:2] == ["sensitivity", "cross-axis sensitivity", "zero-rate output over temperature"]
    factor, bias = row(run, "turntable", "scale factor", "V/(deg/s)"), row(run, "turntable", "bias", "deg/s")
    for name, found in (("sensitivity", factor), ("zero-rate output", bias)):
        value, u, u95, unit, _ = sheet[name]
        assert (float(value), float(u), float(u95)) == pytest.approx((found.value, found.u, found.u95), rel=0.05)
        assert unit == found.unit
    said = {name: each[-1] for name, each in sheet.items() if each[-1].startswith("not measured")}
    assert said["full scale, positive"] == "not measured: run rate-limits"
    assert said["cross-axis sensitivity"] == "not measured: the bench turns about one axis"
    assert {"bandwidth", "turn-on time", "vibration rectification"} < set(said)
    assert said["sensitivity to linear acceleration, x"] == "not measured: run g-sensitivity"
    assert "unverified" in vcfbench.text_of(run.report()).split("order of IEEE 2700")[1]


def test_ieee_2700_sheet_names_missing_instruments() -> None:
    rows = [
        SheetRow("positive input rate limit", 687.0, 0.1, 0.2, "deg/s", "", "rate-limits"),
        SheetRow("bias by acceleration along y", 0.01, 0.001, 0.002, "(deg/s)/g", "", "g-sensitivity"),
    ]
    report = data_sheet_report(rows, [("temperature", "the bench has no chamber")], "")
    (table,) = (part for part in report.parts if isinstance(part, Table) and "IEEE 2700" in part.title)
    sheet = {each[0]: each[1:] for each in table.printed()}
    assert sheet["full scale, positive"][:4] == ("687.00", "0.10", "0.20", "deg/s")
    assert sheet["full scale, positive"][-1] == "positive input rate limit (rate-limits)"
    assert sheet["sensitivity to linear acceleration, y"][:4] == ("0.0100", "0.0010", "0.0020", "(deg/s)/g")
    assert sheet["full scale, negative"][-1] == "not measured: rate-limits did not find it"
    assert sheet["sensitivity error over temperature"][-1] == "not measured: the bench has no chamber"


def test_each_part_has_results_of_its_own_part(run: Any) -> None:
    assert [part.name for part in run.results.parts] == ["zero", "polarity", "turntable"]
    zero, polarity, turntable = (part.results for part in run.results.parts)
    assert zero.samples == 200
    assert polarity.wrong_signs == 0
    assert len(turntable.residuals_v) == 5
    factor = row(run, "turntable", "scale factor", "V/(deg/s)")
    assert factor.value == pytest.approx(turntable.scale_factor.value, rel=1e-12)
    assert abs(factor.value - -12.54e-3) < 1e-4 * 12.54e-3 + factor.u95
    assert factor.u95 > factor.u > 0.0
    assert factor.conditions == "line through 5 rates to 200 deg/s"


def test_calibrated_scale_factor_is_used_by_other_parts(run: Any) -> None:
    zero, _, turntable = (part.results for part in run.results.parts)
    assert zero.scale_factor_v_per_deg_s.value == turntable.uncertainty.value("scale_factor").value


def test_settings_of_the_whole_go_to_every_part(run: Any) -> None:
    assert {point.n for point in run.points} == {6, 200}
    settings = vcfbench.PROCEDURES["characterize"].settings(turntable={"samples": 7}, samples=5)
    assert settings.of("turntable").samples == 7
    assert settings.of("kvc").samples == 5
    assert settings.of("zero").duration_s == 600.0


def test_the_first_part_alone_waits_until_it_is_warm() -> None:
    kind = vcfbench.PROCEDURES["characterize"].settings
    here = settings_of(vcfbench.PROCEDURES["characterize"], lab("warm_up_s = 900.0"))
    assert here.of("bandwidth").warm_up_s == here.of("zero").powered_s == here.of("turntable").warm_up_s == 0.0
    alone = structs.replace(here, parts=("turntable", "bandwidth"))
    assert (alone.of("turntable").warm_up_s, alone.of("bandwidth").warm_up_s) == (900.0, 0.0)
    assert isinstance(here, kind)
    settings = settings_of(vcfbench.PROCEDURES["characterize"], lab("", "[procedure.bandwidth]\nwarm_up_s = 60.0\n"))
    assert settings.of("bandwidth").warm_up_s == 60.0


def lab(shared: str, own: str = "") -> BenchDescription:
    text = embedded_text("lab").replace("[procedure.drive]", f"[procedure]\n{shared}\n{own}[procedure.drive]")
    return parse_bench(text, "lab.toml")


def test_what_the_bench_cannot_do_is_said(run: Any) -> None:
    assert [(each.name, each.reason) for each in run.results.not_measured] == [
        ("temperature", "the bench has no chamber")
    ]
    assert run.not_checked == ("temperature: the bench has no chamber",)
    assert "not measured: temperature: the bench has no chamber" in vcfbench.text_of(run.report())


def test_the_record_tells_the_same(run: Any) -> None:
    again = vcfbench.load_run(run.directory)
    assert again.results == run.results
    assert vcfbench.text_of(again.report()) == vcfbench.text_of(run.report())
    factor = next(each for each in again.results.stated() if each.name == "turntable.scale_factor")
    assert factor.value == again.results.parts[2].results.uncertainty.value("scale_factor").value


# --- one session -----------------------------------------------------------------------------------------------


def planned(bench: Any, **settings: Any) -> list[Step]:
    return [each.step for each in vcfbench.dry_run("characterize", bench, settings=settings).steps]


def test_the_supply_stays_on_from_part_to_part() -> None:
    parts = ["polarity", "turntable", "bandwidth", "zero"]
    steps = planned("lab", parts=parts)
    off = [place for place, step in enumerate(steps) if isinstance(step, DisableSupply)]
    assert off == [len(steps) - 1]
    assert [step.name for step in steps if isinstance(step, BeginPart)] == [
        "polarity",
        "turntable",
        "bandwidth",
        "zero",
    ]


def test_part_that_measures_power_on_starts_with_power_off() -> None:
    steps = planned("lab", parts=["polarity", "power"])
    kinds = [type(step).__name__ for step in steps]
    on = kinds.index("SuppliedAndLogged")
    assert kinds[on - 2 : on] == ["DisableSupply", "Settle"]
    assert kinds.count("DisableSupply") == 2


def test_without_table_and_oscilloscope_the_rest_is_done() -> None:
    steps = planned(FIELD)
    left_out = {step.what: step.reason for step in steps if isinstance(step, NotChecked)}
    assert left_out["turntable"] == left_out["virtual-coriolis"] == left_out["kvc"] == "the bench has no rate_table"
    assert left_out["resonance"] == "the bench has no oscilloscope"
    done = [step.name for step in steps if isinstance(step, BeginPart)]
    assert done == ["warmup", "polarity", "power", "bandwidth", "zero"]
    assert not any(isinstance(step, AskOperator) for step in steps)


def test_impossible_part_is_left_out_or_refused() -> None:
    narrow = parse_bench(embedded_text("lab").replace("min_rail_v = 9.5", "min_rail_v = 9.9"), "narrow")
    (left_out,) = [step for step in planned(narrow, parts=["power", "zero"]) if isinstance(step, NotChecked)]
    assert left_out.reason.startswith("rail_step_v: expected at most 0.1 V")
    with pytest.raises(ConfigError, match=r"power.rail_step_v: expected at most 0.1 V"):
        planned(narrow, parts=["power", "zero"], power={"rail_step_v": 0.3})


class Watched(EnableSupply, frozen=True):
    """Switches on and looks."""


def part(*steps: Step) -> Plan:
    try:
        for step in steps:  # noqa: UP028  # a tuple cannot be sent results
            yield step
    finally:
        yield DisableSupply()


def performed(plan: Plan, fails_at: int | None = None) -> list[Step]:
    """Perform a plan; the step of that number fails."""
    steps: list[Step] = []
    advance = lambda: next(plan)  # noqa: E731
    while True:
        try:
            steps.append(advance())
        except (StopIteration, MeasurementError):
            return steps
        if len(steps) == fails_at:
            advance = lambda: plan.throw(MeasurementError("it fails"))  # noqa: E731
        else:
            advance = lambda: plan.send(Done())  # noqa: E731


ON, OFF, LOOK = EnableSupply(), DisableSupply(), Note("look")


def test_switching_off_at_end_of_part_is_left_out() -> None:
    session = _Session()
    assert performed(_kept_on(part(ON, LOOK, OFF, ON, LOOK), session)) == [ON, LOOK, OFF, ON, LOOK]
    assert session.left_on
    assert performed(_kept_on(part(ON, LOOK), session)) == [ON, LOOK]
    assert session.left_on
    seen = performed(_kept_on(part(Watched(), LOOK), session))
    assert [type(step) for step in seen] == [DisableSupply, Settle, Watched, Note]


def test_once_something_has_failed_all_is_switched_off() -> None:
    session = _Session()
    assert performed(_kept_on(part(ON, LOOK, Note("never")), session), fails_at=2) == [ON, LOOK, OFF]
    assert not session.left_on


# --- settings --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"zero": {"durations": 3.0}}, r"procedure.characterize.zero.durations: expected a known key"),
        ({"zero": {"duration_s": 100.0}}, r"zero.duration_s: expected at least 200 s"),
        ({"parts": ["zero", "nothing"]}, r"parts\[1\]: expected a procedure: warmup, "),
        ({"parts": ["zero", "zero"]}, r"parts: expected each procedure once"),
        ({"parts": ["characterize"]}, r"parts\[0\]: expected a procedure"),
        ({"parts": ["self-calibration"]}, r"parts\[0\]: expected a procedure that uses no entry"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.dry_run("characterize", "lab", settings=settings)


def test_part_has_settings_of_its_procedure_in_bench_file() -> None:
    text = "[procedure.turntable]\nsamples = 12\n[procedure.characterize.turntable]\nsettle_s = 5.0\n"
    steps = planned(parse_bench(f"{embedded_text('paper')}\n{text}", "own"), parts=["turntable"])
    windows = [step for step in steps if isinstance(step, Acquire)]
    assert {step.samples for step in windows} == {12}
    assert any(isinstance(step, Settle) and step.seconds == 5.0 for step in steps)


def test_part_with_own_meter_setting_has_its_resolution() -> None:
    text = "[procedure.turntable]\nnplc = 1\n"
    bench = parse_bench(f"{embedded_text('paper')}\n{text}", "own")
    settings = settings_of(vcfbench.PROCEDURES["characterize"], bench)
    assert settings.of("turntable").meter_resolution_v == pytest.approx(30e-6)
    assert settings.of("zero").meter_resolution_v == pytest.approx(10e-6)


def test_part_is_procedure_with_setting_of_its_name() -> None:
    kind = vcfbench.PROCEDURES["characterize"].settings
    names = {each.name for each in PARTS}
    assert names <= set(vcfbench.PROCEDURES)
    assert names <= set(kind.__struct_encode_fields__)


# --- the data sheet --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Found:
    q: Any
    drive_hz: Any
    residuals: tuple[float, ...] = (1.0, 2.0)
    nonlinearity_ppm: float = 742.0


def test_the_sheet_has_every_value_once() -> None:
    found = Found(measurand(1200.0, "", [Source("noise", 1.0)]), measurand(3488.9, "Hz", [Source("noise", 0.1)]))
    rows = list(sheet_rows("own", found, "at rest"))
    assert [(each.quantity, each.value, each.unit) for each in rows] == [
        ("Q", 1200.0, ""),
        ("drive", 3488.9, "Hz"),
        ("non-linearity, of the span", 742.0, "ppm"),
    ]
    assert rows[1].u95 == pytest.approx(0.196, rel=1e-3)
    assert (rows[2].u, rows[2].u95) == (None, None)
    assert list(sheet_rows("own", None, "")) == []


def cut(run: Any, before: str) -> None:
    """Cut the record of a run before the first line that holds `before`, as a power failure would."""
    journal = run.directory / "journal.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    place = next(n for n, line in enumerate(lines) if before in line)
    journal.write_text("".join(lines[:place]), encoding="utf-8")


@pytest.mark.exhaustive
def test_resumed_session_needs_a_whole_warm_up(tmp_path: Path) -> None:
    settings = {"parts": ["warmup", "polarity"], "warmup": {"shortest_s": 240.0, "longest_s": 300.0}}
    whole = vcfbench.run("characterize", seed=6, settings=settings, runs=tmp_path / "one")
    cut(whole, "DisableTable")
    again = vcfbench.resume(whole.directory, runs=tmp_path)
    warmup, polarity = again.results.parts
    assert warmup.results is None
    assert "power-on" in warmup.no_result
    assert polarity.results.wrong_signs == 0
    whole = vcfbench.run("characterize", seed=7, settings=settings, runs=tmp_path / "two")
    cut(whole, "EnableVvc")
    again = vcfbench.resume(whole.directory, runs=tmp_path)
    assert [part.no_result for part in again.results.parts] == [None, None]


@pytest.mark.exhaustive
def test_the_whole_of_it_is_one_data_sheet(tmp_path: Path) -> None:
    """Each value with an uncertainty lies where the simulated bench has it."""
    short = {
        "resonance": {key: value for key, value in test_resonance.QUICK.items() if key != "warm_up_s"},
        "bandwidth": {key: value for key, value in test_bandwidth.QUICK.items() if key != "warm_up_s"},
        "vibration": {"record_samples": 256, "vibration_hz": [2.0, 10.0, 20.0, 35.0]},
        "zero": QUICK["zero"],
    }
    run = vcfbench.run("characterize", "lab", seed=8, settings=short, runs=tmp_path)
    assert [each.name for each in run.results.parts] == [each.name for each in PARTS]
    assert all(each.no_result is None for each in run.results.parts)
    assert run.results.not_measured == ()
    truths = [
        ("resonance", "drive", "Hz", 3488.9 * (1.0 - 30e-6 * 0.3)),
        ("bandwidth", "split", "Hz", 24.8 + 0.00272 * 0.3),
        ("power", "scale factor by both rails", "ppm/V", 400.0),
        ("temperature", "temperature coefficient of the drive frequency", "ppm/K", -30.0),
    ]
    for procedure, quantity, unit, truth in truths:
        found = row(run, procedure, quantity, unit)
        assert abs(found.value - truth) < 1.6 * found.u95, found
    assert vcfbench.load_run("last", runs=tmp_path).results == run.results


def test_unseen_effect_is_bound_and_not_zero() -> None:
    @dataclass(frozen=True)
    class Found:
        walk: NoiseCoefficient

    (only,) = sheet_rows(
        "zero", Found(NoiseCoefficient.stating("rate random walk", 0.0, None, 22.5, "(deg/h)/sqrt(h)")), ""
    )
    assert (only.quantity, only.value, only.u) == ("rate random walk, below (95 %)", 22.5, None)


@pytest.mark.parametrize(("bench", "known"), [("paper", "as set"), ("lab", "measured")])
def test_the_conditions_say_how_v_vc_is_known(bench: str, known: str) -> None:
    procedure = PROCEDURES["virtual-coriolis"]
    (part,) = [each for each in PARTS if each.name == "virtual-coriolis"]
    own = settings_of(procedure, parse_bench(embedded_text(bench), bench), asked_in_python({}))
    assert part.conditions(own).endswith(f"V_Vc {known}")


def test_later_parts_are_budgeted_as_warm_as_they_are() -> None:
    """After half an hour, six time constants, nothing is left but what 10 s without power before `power` cool."""
    station = Station(sources=Sources(warm_up_k=0.3, warm_up_time_s=300.0))
    settings = CharacterizeSettings(parts=("warmup", "polarity", "power", "zero"), station=station)
    left_k = [settings.of(name).station.sources.warm_up_k for name in settings.parts]
    warm = math.exp(-6.0)
    cooled = warm + 1.0 - math.exp(-10.0 / 300.0)
    assert left_k == pytest.approx([0.3, 0.3 * warm, 0.3 * cooled, 0.3 * cooled])
