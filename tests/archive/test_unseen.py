"""What a run cannot have seen stands beside what it states: up to which size, and what it moves."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs, to_builtins
from simrack_tests.cells import few

import vcfbench
from experiments.unseen import KINDS, Tried
from vcfbench.analysis.plausibility import doubts_of_record
from vcfbench.archive.reported import full_report
from vcfbench.archive.unseen import K_VC, V_VC_SET, _effect, in_records, named_from, refusable, unseen_of, unseen_words
from vcfbench.belief import jumps
from vcfbench.belief.jumps import GAIN, OFFSET, V_VC_GAIN, V_VC_OFFSET
from vcfbench.belief.unseen import Course, _probes
from vcfbench.belief.walk import Seen
from vcfbench.cli.answer import print_not_seen
from vcfbench.cli.conduct import RunOptions, _show
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.schema import Point
from vcfbench.reports.document import Heading, Text
from vcfbench.reports.text import text_of
from vcfbench.station.file import embedded_text
from vcfbench.steps import Done, ModulatedRecord, SineResponse
from vcfbench.testing.gyroscopes import drawn_bench
from vcfbench.values.value import Value

if TYPE_CHECKING:
    from vcfbench.archive.run import Run
    from vcfbench.belief.walk import Walk


def taken(tmp: Path, procedure: str, **settings: Any) -> Run:
    device = {"dut": "G", "devices": str(tmp / "devices")} if procedure in {"kvc", "self-calibration"} else {}
    return vcfbench.run(procedure, "lab", seed=3, settings={**settings, **device}, runs=tmp / "runs")


@pytest.fixture(scope="module")
def turntable(tmp_path_factory: pytest.TempPathFactory) -> Tried:
    return Tried(taken(tmp_path_factory.mktemp("unseen"), "turntable"))


LIMITS = {"warm_up_s": 60.0, "samples": 4, "growth": 3.0, "resolution_deg_s": 5.0}
"""Short rate limits."""


@pytest.fixture(scope="module")
def limits(tmp_path_factory: pytest.TempPathFactory) -> Tried:
    return Tried(taken(tmp_path_factory.mktemp("unseen"), "rate-limits", **LIMITS))


@pytest.fixture(scope="module")
def kvc(tmp_path_factory: pytest.TempPathFactory) -> Run:
    few = {"match_rates_deg_s": [20.0, 100.0, 200.0], "cycles": 1, "samples": 4}
    return taken(tmp_path_factory.mktemp("unseen"), "kvc", **few)


@pytest.mark.exhaustive
def test_turntable_lists_step_pulse_ramp_and_gain(turntable: Tried) -> None:
    found = {(each.kind, each.unit): each for each in turntable.rows}
    assert set(found) == {("step", OFFSET), ("pulse", OFFSET), ("ramp", OFFSET), ("change", GAIN), ("creep", GAIN)}
    step = found["step", OFFSET]
    assert step.size is not None
    assert step.size == pytest.approx(0.33e-3, rel=0.1)
    assert step.effects["bias"] == pytest.approx(step.size, rel=0.01)  # at the end of the run: all the rates had it


@pytest.mark.parametrize("kind", [name for name, (unit, _, _) in KINDS.items() if unit != V_VC_GAIN])
def test_faults_beyond_u95_are_listed_above_refused(turntable: Tried, kind: str) -> None:
    size, rng = turntable.sizes(kind)[1], np.random.default_rng(7)
    for share in (0.5, 1.5):
        begin, end = turntable.times(rng)
        line = turntable.with_fault(kind, share * size, begin, end)
        if share > 1.0:
            assert line["outcome"] == "refused" or line["off"] < 1.0 / 3.0, line
        elif line["outcome"] == "complete" and line["off"] > 1.0:
            assert line["told"], line


def test_effect_of_fault_equals_effect_on_evaluation(turntable: Tried) -> None:
    row = next(each for each in turntable.rows if each.kind == "step")
    assert row.size is not None
    moved = [turntable.with_fault("step", 0.5 * row.size, each, 1.0) for each in turntable.gaps]
    worst = max(each["off"] for each in moved if each["outcome"] == "complete")
    most = max(effect / turntable.of.u95[name] for name, effect in row.effects.items())
    assert 0.3 * most < worst <= 0.55 * most


@pytest.mark.exhaustive
def test_ramp_moves_a_spread_as_its_evaluation_says(tmp_path: Path) -> None:
    case = Tried(taken(tmp_path, "repeatability", power_cycles=3, samples=3))
    row = next(each for each in case.rows if each.kind == "ramp" and each.size is not None)
    assert row.size is not None
    line = case.with_fault("ramp", 1e-3, case.gaps[0], 1.0)
    moved = line["off"] * case.of.u95[line["worst"]]
    assert 0.5 < moved / (1e-3 / row.size * row.effects[line["worst"]]) < 2.0


@pytest.mark.exhaustive
def test_jump_of_v_vc_meter_gain_is_refused(kvc: Run) -> None:
    case = Tried(kvc)
    assert {each.unit for each in case.rows} == {OFFSET, GAIN, V_VC_OFFSET, V_VC_GAIN}
    for begin in (0.3, 0.6, 0.8):
        line = case.with_fault("V_Vc's gain", 1e-3, begin, 1.0)
        assert line["outcome"] == "refused" or line["off"] < 1.0 or line["told"], line


@pytest.mark.parametrize(
    ("procedure", "settings"),
    few(
        [
            ("turntable", {"rates_deg_s": [100.0, 0.0, -100.0], "samples": 3}),
            pytest.param(
                "g-sensitivity",
                {"samples": 4, "cycles": 1, "warm_up_s": 60.0, "turn_s": 5.0},
                marks=pytest.mark.exhaustive,
            ),
            pytest.param("repeatability", {"power_cycles": 3, "samples": 3}, marks=pytest.mark.exhaustive),
            pytest.param("threshold", {"at_most_s": 60.0, "samples": 3}, marks=pytest.mark.exhaustive),
            ("rate-limits", LIMITS),
            *(
                pytest.param(name, {}, marks=pytest.mark.exhaustive)
                for name in ("power", "vibration", "virtual-coriolis", "kvc")
            ),
            pytest.param("temperature", {"temperatures_c": [20.0, 25.0, 30.0]}, marks=pytest.mark.exhaustive),
        ],
        every=7,
    ),
)
def test_list_compares_the_windows_that_the_run_compared(
    procedure: str, settings: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Walk] = []
    plain = jumps.require_no_jump
    monkeypatch.setattr(jumps, "require_no_jump", lambda walk: (seen.append(walk), plain(walk))[1])
    found = refusable(taken(tmp_path, procedure, **settings))
    assert found is not None
    windows = [each.windows for each, _ in found.course.walks if each.windows]
    assert [[each.point for each in own] for own in windows] == [[each.point for each in own.windows] for own in seen]


@pytest.mark.exhaustive
def test_steps_about_a_dead_band_are_compared_level_by_level(tmp_path: Path) -> None:
    case = Tried(taken(tmp_path, "threshold", at_most_s=60.0, samples=3))
    step = next(each for each in case.rows if (each.kind, each.unit) == ("step", OFFSET))
    assert step.size is not None
    assert step.size < 1e-3
    for begin in case.gaps[8::8]:
        line = case.with_fault("step", 1.5 * step.size, begin, 1.0)
        assert line["outcome"] == "refused" or line["off"] < 1.0 / 3.0, line


@pytest.mark.parametrize("kind", few(["step", "ramp", "V_Vc's gain"]))
def test_what_moves_between_the_rates_of_a_search_is_refused(limits: Tried, kind: str) -> None:
    told, _ = limits.sizes(kind)
    assert told < 3e-3
    for begin in limits.gaps[8::12]:
        line = limits.with_fault(kind, 1.5 * (told or 1e-3), begin, 1.0)  # without a row it moves no value
        assert line["outcome"] == "refused" or line["off"] < 1.0 / 3.0, line


@pytest.mark.exhaustive
def test_a_noisy_gyroscope_steps_about_rest_and_is_believed() -> None:
    """Its noise is 2 % of what the steps make."""
    bench = parse_bench(drawn_bench(4), "noisy")
    settings = {"at_most_s": 60.0, "samples": 3}
    assert vcfbench.run("threshold", bench, seed=4, settings=settings, runs=None).status == "complete"


@pytest.mark.parametrize(("settings", "visits", "most"), [(1, 300, 40), (20, 9, 60), (300, 1, 40), (1000, 1, 9)])
def test_a_long_run_is_evaluated_some_dozen_times(settings: int, visits: int, most: int) -> None:
    seen = [
        Seen(
            Point(1, float(rate), 0.0, 0.0, 0.0, 2),
            driven=False,
            rails_v=(),
            table_deg_s=float(rate),
            reference=False,
            begin_s=0.0,
            end_s=1.0,
        )
        for rate in list(range(settings)) * visits
    ]
    course = Course(tuple(seen), tuple(range(len(seen))), ())
    together = _probes(course, list(range(len(seen))))
    assert sorted(at for each in together for at in each) == list(range(len(seen)))
    assert len(together) <= most
    spread = max(
        max(each.point.rate_deg_s for each in own) - min(each.point.rate_deg_s for each in own)
        for own in ([seen[at] for at in each] for each in together)
    )
    assert spread <= len(seen) / len(together) if visits == 1 else spread == 0.0


@pytest.mark.exhaustive
def test_record_at_rest_states_effect_of_fault_within_it(tmp_path: Path) -> None:
    run = taken(tmp_path, "zero", duration_s=200.0)
    rows = unseen_of(run)
    assert [each.kind for each in rows] == ["step", "pulse", "ramp"]
    assert [each.size is None for each in rows] == [False, False, True]
    step_v = rows[0].size
    assert step_v is not None
    assert rows[0].effects["output_v"] == pytest.approx(0.5 * step_v, rel=0.02)
    (*_, (_, said, _)) = unseen_words(run, rows)
    assert said == "any size: it is the record's trend"


@pytest.mark.parametrize("kind", ["step", "pulse"])
def test_what_is_above_the_list_of_a_record_is_named_by_it(kind: str) -> None:
    rng, at = np.random.default_rng(4), np.arange(1000)
    shape = ((at >= 500) & ((at < 600) | (kind == "step"))).astype(float)
    size = named_from(1e-4 * rng.standard_normal(at.size), shape)
    assert size is not None
    told = 0
    for begin in rng.integers(100, 850, 20):
        volts = 1e-4 * rng.standard_normal(at.size)
        fault = (at >= begin) & ((at < begin + 100) | (kind == "step"))
        told += len(doubts_of_record(volts + 1.5 * size * fault)) > len(doubts_of_record(volts))
    assert told >= 19


@pytest.mark.exhaustive
def test_fault_of_any_size_has_a_reason(limits: Tried) -> None:
    why = {each.why for each in limits.rows if each.size is None and each.unit not in {K_VC, V_VC_SET}}
    assert why == {"these windows are not compared with others", "it looks like the measured effect"}


@pytest.mark.exhaustive
def test_ramp_over_the_last_windows_has_a_size(tmp_path: Path) -> None:
    assert all(each.size is not None for each in unseen_of(taken(tmp_path, "g-sensitivity")))


def test_fault_in_records_is_step_or_gain() -> None:
    sine, both = SineResponse(0.1, 0.02, (1.0, 2.0)), ModulatedRecord(0.1, 0.02, 0.0, (1.0, 2.0), 0.0, (3.0, 4.0), None)
    faults = {OFFSET: (1.0, 2.5), GAIN: (1.5, 3.0), V_VC_GAIN: (1.0, 2.0)}
    for unit, expected in faults.items():
        spoilt = in_records(unit, [0.5, 1.0])
        seen = spoilt(sine)
        assert isinstance(seen, SineResponse)
        assert seen.voltages_v == expected
        assert spoilt(Done()) == Done()
        moved = spoilt(both)
        assert isinstance(moved, ModulatedRecord)
        assert moved.v_vc_v == ((6.0, 8.0) if unit == V_VC_GAIN else both.v_vc_v)
        assert moved.interval_s == both.interval_s


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("procedure", "settings", "known", "any_size"),
    [
        (
            "online",
            {"k_vc": "150", "duration_s": 60.0},
            set(),
            {("change", GAIN), ("change", V_VC_GAIN)},
        ),
        pytest.param(
            "bandwidth",
            {},
            {("change", GAIN), ("creep", GAIN)},
            set(),
            marks=pytest.mark.exhaustive,
        ),
    ],
)
def test_records_of_sines_state_effect_of_changing_gains(
    tmp_path: Path, procedure: str, settings: dict[str, Any], known: set[Any], any_size: set[Any]
) -> None:
    """Those of a sweep by the closed form that they leave, those of `online` by nothing."""
    case = Tried(taken(tmp_path, procedure, **settings))
    sizes = {(each.kind, each.unit): each.size for each in case.rows}
    assert known <= {key for key, size in sizes.items() if size is not None}
    assert any_size <= {key for key, size in sizes.items() if size is None}
    for kind in ("gain", "creeping gain") if known else ():
        line = case.with_fault(kind, 1.5 * case.sizes(kind)[0], case.gaps[len(case.gaps) // 3], 1.0)
        assert line["outcome"] == "refused", line


@pytest.mark.exhaustive
def test_run_without_a_table_lists_what_k_vc_may_be(tmp_path: Path) -> None:
    few = {"match_rates_deg_s": [20.0, 100.0, 200.0], "cycles": 1, "samples": 4}
    taken(tmp_path, "kvc", **few)
    run = taken(tmp_path, "self-calibration", cycles=1, samples=4)
    row = next(each for each in unseen_of(run) if each.unit == K_VC)
    assert (row.size, row.kind) == (None, "change")
    assert row.effects["scale_factor"] == pytest.approx(1e-3 * abs(run.results.scale_factor.value), rel=0.01)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("on_v_vc", "size", "effect"),
    [(False, None, 1e-3), pytest.param(True, 0.1, 0.1, marks=pytest.mark.exhaustive)],
)
def test_v_vc_that_nobody_measures_may_arrive_otherwise(
    tmp_path: Path, *, on_v_vc: bool, size: float | None, effect: float
) -> None:
    """Within what a channel of the oscilloscope would show, where one is on it."""
    wiring = '\n[wiring.oscilloscope]\nchannel_4 = "v_vc"\n' if on_v_vc else ""
    (tmp_path / "bench.toml").write_text(embedded_text("paper") + wiring, "utf-8")
    settings = {"rates_deg_s": [100.0, 0.0, -100.0], "match_windows": 2, "samples": 3}
    run = vcfbench.run("virtual-coriolis", tmp_path / "bench.toml", seed=1, settings=settings, runs=tmp_path)
    (found,) = (each for each in unseen_of(run) if each.unit == V_VC_SET)
    assert found.size == size
    assert found.effects["k_vc"] / run.results.k_vc.value == pytest.approx(effect, rel=0.2)


def test_a_run_without_windows_has_nothing_to_say(tmp_path: Path) -> None:
    assert unseen_of(taken(tmp_path, "electrical")) == ()


@pytest.mark.parametrize(
    ("name", "unit", "kind", "words"),
    [
        ("k_vc", "(deg/s)/V", "k_vc", "10 ppm"),
        ("scale_factor", "V/(deg/s)", "scale_factor", "10 ppm"),
        ("by_small", "V/(deg/s)", "", "10 ppm"),
        ("bias_per_v", "(deg/s)/V", "", "0.000 10 (deg/s)/V"),
    ],
)
def test_what_is_compared_in_ppm_is_told_in_ppm(name: str, unit: str, kind: str, words: str) -> None:
    value = Value(name, 10.0, unit, u=1.0, kind=kind)
    assert _effect(value, 1e-4).endswith(words)


def test_report_and_record_say_it(turntable: Tried) -> None:
    report = full_report(turntable.run)
    assert "Undetected faults" in [part.text for part in report.parts if isinstance(part, Heading)]
    what, size, done = next(unseen_words(turntable.run, turntable.rows))
    assert what == "a step of the output"
    assert re.fullmatch(r"below 0\.3\d mV", size)
    assert re.search(r"bias 0\.02\d deg/s", done)
    first = next(
        part.text for part in report.parts if isinstance(part, Text) and "contain undetected faults" in part.text
    )
    assert f"{what} ({size})" in first


@pytest.mark.parametrize("simulated", [True, False])
def test_unseen_faults_are_in_the_answer(
    turntable: Tried, capsys: pytest.CaptureFixture[str], *, simulated: bool
) -> None:
    run = structs.replace(turntable.run, simulated=simulated)
    _show(run, RunOptions(bench=None, runs=Path()))
    assert ("faults that this run would not detect, not in U95 " in capsys.readouterr().out) is not simulated
    _show(run, RunOptions(bench=None, runs=Path(), json=True))
    answer = json.loads(capsys.readouterr().out)["not_seen"]
    assert answer == (None if simulated else [*to_builtins(unseen_of(run))])


def test_of_very_many_windows_the_answer_says_where_it_stands(
    turntable: Tried, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vcfbench.cli.answer._MOST_WINDOWS", 10)
    print_not_seen(turntable.run)
    assert (
        capsys.readouterr().out
        == f"\nundetected faults: see vcfbench report ({len(turntable.run.points)} windows take minutes)\n"
    )


@pytest.mark.parametrize("procedure", few(["zero", "kvc", "power", "bandwidth", "electrical"], "zero"))
def test_report_without_record_names_missing_list(procedure: str) -> None:
    settings = {"duration_s": 200.0} if procedure == "zero" else {}
    report = full_report(vcfbench.run(procedure, settings=settings, runs=None))
    assert "computed from its record, and it has none" in text_of(report)
