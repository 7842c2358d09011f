"""A gyroscope with one supply, whose output rests in its middle: calibrated by every procedure, on one rail."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack.oscillation import Oscillation

import vcfbench
from tests.cells import few
from vcfbench.archive.change import _by_rails
from vcfbench.errors import ConfigError, LimitError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.models import rail_terminals
from vcfbench.procedures.bench_file import load_bench, resolved_text
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.data_sheet import SheetRow, _row_of
from vcfbench.procedures.layers import settings_of
from vcfbench.records.device_values import Measured
from vcfbench.sim.gyro.data_sheet import DataSheet, own_gyro
from vcfbench.sim.gyro.electronics import OutputLimits
from vcfbench.sim.own_gyro import own_gyro_bench
from vcfbench.sim.simulation import true_output
from vcfbench.station.file import parse_bench
from vcfbench.station.limits import LimitChecks
from vcfbench.station.new_station import Draft
from vcfbench.studies.truth import truth_of
from vcfbench.values.definition import Conditions

if TYPE_CHECKING:
    from pathlib import Path

SHEET = DataSheet(
    scale_factor_v_per_deg_s=0.008,
    range_deg_s=150.0,
    drive_hz=4000.0,
    split_hz=30.0,
    q_drive=5000.0,
    q_sense=1200.0,
    angle_random_walk_deg_sqrt_h=0.1,
    k_vc_deg_s_per_v=112.5,
    rail_v=5.0,
    rails=1.0,
)
LONG = {
    "characterize",
    "online",
    "threshold",
    "repeatability",
    "resonance",
    "bandwidth",
    "temperature",
    "zero",
    "warmup",
}


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "one.toml"
    file.write_text(own_gyro_bench(SHEET, "one"), "utf-8")
    return file


@pytest.mark.exhaustive
def test_four_steps_find_the_data_sheet(bench: Path) -> None:
    found = vcfbench.run("virtual-coriolis", bench, seed=3, runs=None)
    for name, truth in (("k_vc", 112.5), ("turntable.scale_factor", 0.008), ("turntable.bias", 2.5)):
        value = found.values[name]
        assert abs(value.value - truth) < 1.5 * value.u95, name
    assert found.values["turntable.bias"].conditions.rails_v == (5.0, 0.0)


def test_only_the_one_rail_is_set_and_reported(bench: Path, tmp_path: Path) -> None:
    run = vcfbench.run("turntable", bench, seed=3, runs=tmp_path / "runs")
    journal = (run.directory / "journal.jsonl").read_text("utf-8")
    assert '"output":"P25V"' in journal
    assert '"output":"N25V"' not in journal
    report = vcfbench.write_report(run, tmp_path / "report.md")[0].read_text("utf-8")
    assert "positive_rail_v" in report
    assert "negative_rail_v" not in report
    assert ", rail +5 V" in report
    assert "+0 V" not in report


@pytest.mark.exhaustive
@pytest.mark.parametrize("procedure", few(sorted(set(BUILT_IN) - LONG - {"self-calibration"}), "electrical", "power"))
def test_a_procedure_ends_with_results(procedure: str, bench: Path) -> None:
    settings: dict[str, Any] = {"dut": "G-1"} if procedure == "kvc" else {}
    run = vcfbench.run(procedure, bench, seed=2, settings=settings, runs=None)
    assert run.status == "complete"
    text = vcfbench.text_of(run.report()) + "".join(
        each.step.describe() for each in vcfbench.dry_run(procedure, bench).steps
    )
    assert not re.search(r"both rails|negative rail|rails? [^;]{0,40}[+-]0 V\b", text)


@pytest.mark.parametrize(
    ("without", "absent"), [((), "negative_rail_v"), (("power",), r"(posi|nega)tive_rail_v|rail_current|wiring.rails")]
)
def test_no_file_has_a_rail_that_is_not_there(without: tuple[str, ...], absent: str) -> None:
    text = own_gyro_bench(SHEET, "one", without=without)
    description = parse_bench(text, "one")
    assert not re.search(absent, text + resolved_text(description))
    assert settings_of(PROCEDURES["turntable"], description).null_v == 2.5
    assert ("null_v = 2.5" in text) == bool(without)
    assert parse_bench(resolved_text(description), "one").wiring == description.wiring


def test_new_bench_with_one_supply_has_no_negative_rail() -> None:
    draft = Draft("lab.toml")
    draft.add_instrument("power", {"model": "E3631A", "resource": "GPIB0::5::INSTR"})
    draft.set({"wiring.rails.negative": "none"})
    draft.set({"procedure.positive_rail_v": 5.0})
    assert "negative_rail_v" not in draft.values["procedure"]
    assert draft.values["limits"]["max_rail_v"] == 5.25


def test_the_rail_of_a_data_sheet_is_that_of_the_supply() -> None:
    rows = [
        SheetRow("time to valid output, the rail", 0.1, 0.01, 0.02, "s", "", "power"),
        SheetRow("bias by the rail", 0.1, 0.01, 0.02, "(deg/s)/V", "", "power"),
    ]
    assert [
        _row_of(rows, f"{name} both rails{end}", "")
        for name, end in (("time to valid output,", " together"), ("bias by", ""))
    ] == rows


def test_one_rail_that_moved_is_corrected_by_what_is_known() -> None:
    then, now = (Conditions(rails_v=(v, 0.0)) for v in (5.0, 5.4))
    moved = _by_rails(then, now, Measured(value=100.0, u=1.0, dof=10.0), 0.1, slope=True)
    assert "a rail of 5.4 V instead of 5 V" in str(moved)


@pytest.mark.exhaustive
def test_rail_change_is_kept_as_supply_change(bench: Path) -> None:
    effect = vcfbench.run("power", bench, seed=2, runs=None, settings={"dut": "G-1"}).results.effects[0]
    assert effect.rails == "positive"


def test_output_ends_above_ground_and_below_the_rail() -> None:
    stage = own_gyro(SHEET, imperfections=False, latitude_deg=0.0).output_stage
    rail = Oscillation(5.0, [])
    low_v, high_v = OutputLimits(stage, rail, Oscillation(-5.0, []), single=True).at(np.zeros(1))
    assert (float(low_v[0]), float(high_v[0])) == pytest.approx((2.5 - 2.125, 2.5 + 2.125))
    off = OutputLimits(stage, Oscillation(0.0, []), Oscillation(0.0, []), single=True).at(np.zeros(1))
    assert [float(each[0]) for each in off] == [0.0, 0.0]


def test_closed_form_ends_where_the_simulation_does(bench: Path) -> None:
    output = true_output(load_bench(bench))
    assert (output(0.0, None), output(1e3, None), output(-1e3, None)) == pytest.approx((2.5, 4.625, 0.375))


def test_wiring_names_the_one_rail() -> None:
    assert (
        rail_terminals("E36312A", None, "P25V", "none")
        == "E36312A: the one rail to + of output 2, ground to - of output 2"
    )


def test_the_other_output_is_refused_by_the_limits(bench: Path) -> None:
    checks = LimitChecks.of(load_bench(bench))
    checks.rail("P25V", 5.0)
    with pytest.raises(LimitError, match="N25V -5 V: the output feeds no rail"):
        checks.rail("N25V", -5.0)


def test_output_beyond_half_supply_is_refused_by_key() -> None:
    with pytest.raises(
        ConfigError, match=r"range_deg_s: expected outputs within 2\.125 V, V_Vc up to 10 % off, got 2\.64 V"
    ):
        DataSheet(scale_factor_v_per_deg_s=0.016, range_deg_s=150.0, rail_v=5.0, rails=1.0, k_vc_deg_s_per_v=112.5)


def test_a_ratiometric_output_is_refused_with_its_reason(bench: Path) -> None:
    text = bench.read_text("utf-8") + "\n[gyro]\nratiometric = true\n"
    with pytest.raises(ConfigError, match=r"gyro\.ratiometric: expected no output .* 1500 ppm .*, got true"):
        parse_bench(text, "one")


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"rails": 1.5}, r"rails: expected 2, or 1 of one supply, got 1\.5"),
        (
            {"drive_hz": 1000.0, "q_drive": 92_735.0, "split_hz": -3.0, "q_sense": 4500.0},
            "q_drive: expected a start within 600 s, got 612 s",
        ),
    ],
)
def test_a_sheet_without_a_bench_is_refused_by_its_key(figures: dict[str, float], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        DataSheet(**{"scale_factor_v_per_deg_s": 0.021, "range_deg_s": 10.0, "k_vc_deg_s_per_v": 24.0, **figures})


BIASES = {
    "turntable": "bias_deg_s",
    "zero": "bias",
    "virtual-coriolis": "virtual.bias_deg_s",
    "kvc": "bias_deg_s",
    "warmup": "bias_end",
    "temperature": "bias",
}


@pytest.mark.parametrize("procedure", few(sorted(BIASES), "turntable"))
@pytest.mark.parametrize("told_v", few([None, 2.4], None))
def test_bias_as_a_rate_counts_from_the_null(procedure: str, told_v: float | None, bench: Path) -> None:
    """It is that of the sheet, 0, or by how much the declared null is beside the middle of the supply."""
    description = load_bench(bench)
    if told_v is not None:
        description = structs.replace(description, gyro=structs.replace(description.gyro, null_v=told_v))
    settings: dict[str, Any] = {"health": False} if procedure == "kvc" else {}
    run = vcfbench.run(procedure, description, seed=3, settings=settings, runs=None)
    bias = run.values[BIASES[procedure]]
    expected = 0.0 if told_v is None else 0.1 / 0.008
    assert bias.unit == "deg/s"
    assert abs((bias.value or 0.0) - expected) < 1.5 * (bias.u95 or 0.05), bias
    gain = 2e-5 * 2.5 / 0.008  # of the meter: a null of volts is no small number of them
    assert bias.u95 is None or bias.u95 > 0.5 * gain
    truth = truth_of(run, description).get(BIASES[procedure])
    assert truth is None or truth == pytest.approx(expected, abs=1e-3)
